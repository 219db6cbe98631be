//! Makes the runs of `docs/real-fish.md` from the published markers:
//! `cargo run -p system-tests --example fish -- DATA OUT`
//!
//! `DATA` holds `Data/Markers/markers_f0_50.csv` and the others of `srl-ethz/fishsim`; `OUT` gets the model, for each run its tables, and the
//! experiments.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::PathBuf;

use system_tests::fish::{EXPERIMENTS, MODEL, RUNS, markers, prepare, write};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1).map(PathBuf::from);
    let (Some(data), Some(out)) = (words.next(), words.next()) else {
        return Err("name the folder of the markers' repository, and one for the runs".into());
    };
    std::fs::create_dir_all(&out)?;
    std::fs::write(out.join("fish.xml"), MODEL)?;
    for (name, text) in EXPERIMENTS {
        std::fs::write(out.join(name), text)?;
    }
    for run in RUNS {
        let path = data.join(format!("Data/Markers/markers_f{run}.csv"));
        let text =
            std::fs::read_to_string(&path).map_err(|error| format!("reading {}: {error}", path.display()))?;
        let name = format!("f{}", run.replace('_', ""));
        match prepare(&markers(&text).map_err(|error| format!("{}: {error}", path.display()))?) {
            Ok(prepared) => {
                write(&prepared, &out, &name)?;
                let images = prepared.trajectory.time_s.len();
                println!("{name}: {images} images, of which P1, P2, P3 are gaps in {:?}", prepared.gaps);
            }
            Err(useless) => {
                let [usable, images] = useless.usable_of_all;
                println!(
                    "{name}: left out, the driven plates' markers are apart in {usable} of {images} images"
                );
            }
        }
    }
    Ok(())
}
