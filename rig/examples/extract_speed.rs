//! What extraction costs: CPU milliseconds an image, on one thread, without reading and decoding.
//!
//! `cargo run --release -p rig --example extract_speed -- FRAMES CONFIG`, FRAMES and CONFIG as for `rig extract`.

#![expect(clippy::print_stdout, reason = "an example talks to its terminal")]

use std::path::{Path, PathBuf};

use camera::calibration::Calibration;
use ground::strict;
use images::{self, SourceError, TimedImage};
use rustix::time::{ClockId, clock_gettime};
use serde::Deserialize;
use vision::extractor::LEARN_FROM;
use vision::{Task, VisionConfig};

/// The two tables of a rig config that say what is extracted.
#[derive(Deserialize)]
struct Config {
    calibration: Calibration,
    vision: VisionConfig,
}

/// Images that are timed; all are held in memory.
const MOST: usize = 300;
/// Only orders the pictures of a folder without times.
const FPS: f64 = 100.0;

fn main() -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(timed)
}

fn timed() -> anyhow::Result<()> {
    let mut args = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(frames), Some(config_path)) = (args.next(), args.next()) else {
        anyhow::bail!("usage: extract_speed FRAMES CONFIG");
    };
    let config: Config = strict::read(&config_path)?;
    let folder = config_path.parent().unwrap_or(Path::new(""));
    let plane = config.calibration.plane(folder)?;
    let source = images::open(&frames, Some(FPS))?;
    let sample = source.sample(LEARN_FROM)?;
    let images: Vec<TimedImage> = source.images()?.take(MOST).collect::<Result<_, _>>()?;

    let started = cpu_ms();
    let mut extraction = Task::new(&config.vision, None, plane, folder)?.learn(&sample)?;
    let learnt = cpu_ms();
    let count = images.len();
    extraction.take(&mut images.into_iter().map(Ok::<_, SourceError>), count)?;
    let done = cpu_ms();
    println!(
        "learning from {} images: {:.0} ms CPU; then {:.2} ms CPU an image over {} images",
        sample.len(),
        learnt - started,
        (done - learnt) / count as f64,
        count
    );
    Ok(())
}

/// Processor time of this process so far \[ms\]: other work on the machine does not count.
fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
