//! A case as files: `experiment.toml`, the nominal model, trajectories with noise, servo tables.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::bench::{Draw, FINE_S, LINKS, Run};
use super::cases::{Case, Made};
use super::limit::NOISE_M;
use super::motion::Drive;
use super::pictures;

/// Keypoints are read to this \[m\].
const GRAIN_M: f64 = 5e-5;

/// How far off a misread keypoint is, along each axis \[m\].
const MISREAD_M: f64 = 0.02;

/// How a case is filmed and read.
#[derive(Debug, Clone, Copy)]
pub struct Film {
    /// Of the images at 100 a second each so many-th is kept.
    pub every: usize,
    /// Share of the keypoints that are misread.
    pub misread: f64,
    /// Pictures are drawn and read, instead of keypoints with noise being written.
    pub pictures: bool,
}

impl Default for Film {
    fn default() -> Self {
        Self { every: 1, misread: 0.0, pictures: false }
    }
}

/// How much of the noise stays from image to image in the runs of `seed`.
pub fn correlation(seed: u64) -> f64 {
    Draw::new(seed, 4).even(0.0, 0.6)
}

/// Writes `case`, filmed as `film` says, into `folder`, which must be there; the experiment's path.
///
/// # Errors
/// When a file cannot be written.
pub fn write(case: &Case, made: &Made, film: Film, folder: &Path) -> std::io::Result<PathBuf> {
    let wet = made.bench.chain.density > 0.0;
    let groups = [("fluidcoef", wet), ("damping", made.bench.fits_damping)];
    let groups: Vec<String> =
        groups.iter().filter(|(_, is_fitted)| *is_fitted).map(|(name, _)| format!("\"{name}\"")).collect();
    let parameters = groups.join(", ");
    let mut text =
        format!("model = \"chain.xml\"\nprescribed = true\n\n[fit]\nparameters = [{parameters}]\n");
    for run in &made.bench.runs {
        let (id, driven) = (&run.id, run.is_driven());
        let (kind, usage) =
            (if driven { "driven" } else { "drop" }, if run.held_out { "holdout" } else { "fit" });
        let _ = write!(text, "\n[[run]]\nid = \"{id}\"\nkind = \"{kind}\"\ntrajectory = \"{id}.csv\"\n");
        match &run.motion.drive {
            Drive::Exact(servo) | Drive::Servo(servo, _) => {
                let _ = writeln!(text, "servo = \"{id}-servo.csv\"");
                let mut table = String::from("time_s,servo_rad\n");
                for (time_s, angle) in servo.time_s.iter().zip(&servo.angle_rad) {
                    let _ = writeln!(table, "{time_s},{angle}");
                }
                std::fs::write(folder.join(format!("{id}-servo.csv")), table)?;
            }
            Drive::None => {
                let _ = writeln!(text, "release_s = {}", run.motion.start_s);
            }
        }
        let _ = writeln!(text, "use = \"{usage}\"");
        let table = match film.pictures {
            true => pictures::trajectory(made, film, run, own(case))?,
            false => trajectory(case, made, film, run),
        };
        std::fs::write(folder.join(format!("{id}.csv")), table)?;
    }
    let model = made.bench.model;
    let model = if film.pictures { pictures::with_base(model) } else { model.to_owned() };
    std::fs::write(folder.join("chain.xml"), model)?;
    let path = folder.join("experiment.toml");
    std::fs::write(&path, text)?;
    Ok(path)
}

/// Each case has its own noise, whatever else shares its seed.
fn own(case: &Case) -> u64 {
    case.id
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The keypoints of `run` as they are read: noise that correlates in time, rounded, some misread.
fn trajectory(case: &Case, made: &Made, film: Film, run: &Run) -> String {
    let own = own(case);
    let mut draw = Draw::new(own, 16 + run.motion.run as u64);
    let mut misread = Draw::new(own, 32 + run.motion.run as u64);
    let keep = correlation(case.seed);
    let rest = (1.0 - keep * keep).sqrt();
    let mut noise = [[0.0; 2]; LINKS];
    let mut table = String::from("time_s");
    for k in 1..=LINKS {
        let _ = write!(table, ",P{k}_x_m,P{k}_z_m");
    }
    table.push('\n');
    let seen = made.bench.watch(run, &made.hidden, FINE_S);
    for (row, (time_s, points)) in run.times_s.iter().zip(seen).enumerate() {
        let mut cells = String::new();
        for (noise, point) in noise.iter_mut().zip(points) {
            let is_misread = misread.even(0.0, 1.0) < film.misread;
            for (noise, point) in noise.iter_mut().zip(point) {
                let fresh = NOISE_M * draw.normal();
                *noise = if row == 0 { fresh } else { keep * *noise + rest * fresh };
                let off = if is_misread { MISREAD_M * misread.normal() } else { 0.0 };
                let _ = write!(cells, ",{:.5}", ((point + *noise + off) / GRAIN_M).round() * GRAIN_M);
            }
        }
        if row.is_multiple_of(film.every) {
            let _ = writeln!(table, "{time_s}{cells}");
        }
    }
    table
}
