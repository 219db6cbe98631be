//! Films by ray tracing, and how well they are read:
//! `cargo run --release -p system-tests --example rendered -- FOLDER [--kind chain|arm|octopus] [--scene NAME[+NAME]] [--seed N]
//! [--images 120] [--size 640x480] [--empty] [--stride 1]`
//!
//! A FOLDER that has no frames/ is rendered first. One thread reads.
#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::error::Error;
use std::path::PathBuf;

use system_tests::optics::score::score;
use system_tests::optics::{Film, Kind};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| {
        arguments.iter().position(|one| one == name).and_then(|at| arguments.get(at + 1)).map(String::as_str)
    };
    let folder = PathBuf::from(arguments.first().ok_or("which FOLDER?")?);
    let kind = match value("--kind").unwrap_or("chain") {
        "chain" => Kind::Chain,
        "arm" => Kind::Arm,
        "octopus" => Kind::Octopus,
        other => return Err(format!("--kind {other}: chain, arm or octopus").into()),
    };
    let (width, height) =
        value("--size").unwrap_or("640x480").split_once('x').ok_or("--size is as 640x480")?;
    let film = Film {
        kind,
        scene: value("--scene").unwrap_or("clean").into(),
        seed: value("--seed").unwrap_or("1").parse()?,
        images: value("--images").unwrap_or("120").parse()?,
        size_px: (width.parse()?, height.parse()?),
    };
    if !folder.join("frames").exists() {
        film.write(&folder, arguments.iter().any(|one| one == "--empty"))?;
    }
    let stride = value("--stride").unwrap_or("1").parse()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    match pool.install(|| score(&folder, stride)) {
        Ok(score) => println!("{}: {score}", folder.display()),
        Err(error) => println!("{}: {}", folder.display(), ground::error_chain::with_causes(error.as_ref())),
    }
    Ok(())
}
