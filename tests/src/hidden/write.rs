//! A case as files: `experiment.toml`, the nominal model, trajectories with noise, servo tables.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::bench::{Bench, DATA_STEP_S, Draw, Run};
use super::cases::{Case, Made};
use super::limit::NOISE_M;
use super::motion::Drive;
use super::pictures;

/// Keypoints are read to this \[m\].
const KEYPOINT_RESOLUTION_M: f64 = 5e-5;

/// How far off a misread keypoint is, along each axis \[m\].
const MISREAD_ERROR_M: f64 = 0.02;

/// How a case is filmed and read.
#[derive(Debug, Clone, Copy)]
pub struct Film {
    /// Of the images at 100 a second each so many-th is kept.
    pub every: usize,
    /// Share of the keypoints that are misread.
    pub misread: f64,
    /// Pictures are drawn and read, instead of keypoints with noise being written.
    pub pictures: bool,
    /// How long the diagnosis may take \[s\], where it is not the program's own limit.
    pub limit_s: Option<f64>,
}

impl Default for Film {
    fn default() -> Self {
        Self { every: 1, misread: 0.0, pictures: false, limit_s: None }
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
pub fn write<const N: usize>(
    case: &Case,
    made: &Made<N>,
    film: Film,
    folder: &Path,
) -> std::io::Result<PathBuf> {
    let model_file = format!("{}.xml", made.bench.mechanism.name);
    let mut text = format!("model = \"{model_file}\"\nprescribed = true\n\n{}", fit(&made.bench));
    if let Some(limit_s) = film.limit_s {
        let _ = writeln!(text, "\n[diagnose]\nlimit_s = {limit_s:?}");
    }
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
    std::fs::write(folder.join(model_file), model)?;
    let path = folder.join("experiment.toml");
    std::fs::write(&path, text)?;
    Ok(path)
}

/// What is fitted.
fn fit<const N: usize>(bench: &Bench<N>) -> String {
    let one_piece = bench.mechanism.of_one_piece;
    let groups = [
        ("fluidcoef", bench.chain.density > 0.0),
        ("damping", bench.fits_joints),
        ("stiffness", bench.fits_joints && one_piece),
        ("one_sided_stiffness/q*", bench.fits_joints && one_piece),
    ];
    let groups = groups.iter().filter(|(_, is_fitted)| *is_fitted);
    let groups: Vec<String> = groups.map(|(name, _)| format!("\"{name}\"")).collect();
    let mut text = format!("[fit]\nparameters = [{}]\n", groups.join(", "));
    if one_piece {
        text +=
            "tie = [[\"g*/blunt\"], [\"g*/slender\"], [\"g*/angular\"], [\"g*/kutta\"], [\"g*/magnus\"]]\n";
        if bench.fits_joints {
            text += "proportional = [[\"q*/stiffness\"], [\"q*/damping\"], [\"one_sided_stiffness/q*\"]]\n";
        }
    }
    text
}

/// Each case has its own noise, whatever else shares its seed.
fn own(case: &Case) -> u64 {
    case.id
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The keypoints of `run` as they are read: noise that correlates in time, rounded, some misread.
fn trajectory<const N: usize>(case: &Case, made: &Made<N>, film: Film, run: &Run<N>) -> String {
    let own = own(case);
    let mut draw = Draw::new(own, 16 + run.motion.run as u64);
    let mut misread = Draw::new(own, 32 + run.motion.run as u64);
    let keep = correlation(case.seed);
    let rest = (1.0 - keep * keep).sqrt();
    let keypoints = made.bench.keypoints();
    let mut noise = vec![[0.0; 2]; keypoints.len()];
    let mut table = String::from("time_s");
    for name in keypoints {
        let _ = write!(table, ",{name}_x_m,{name}_z_m");
    }
    table.push('\n');
    let seen = made.bench.watch(run, &made.hidden, DATA_STEP_S);
    for (row, (time_s, points)) in run.times_s.iter().zip(seen).enumerate() {
        let mut cells = String::new();
        for (noise, point) in noise.iter_mut().zip(points) {
            let is_misread = misread.even(0.0, 1.0) < film.misread;
            for (noise, point) in noise.iter_mut().zip(point) {
                let fresh = NOISE_M * draw.normal();
                *noise = if row == 0 { fresh } else { keep * *noise + rest * fresh };
                let off = if is_misread { MISREAD_ERROR_M * misread.normal() } else { 0.0 };
                let _ = write!(
                    cells,
                    ",{:.5}",
                    ((point + *noise + off) / KEYPOINT_RESOLUTION_M).round() * KEYPOINT_RESOLUTION_M
                );
            }
        }
        if row.is_multiple_of(film.every) {
            let _ = writeln!(table, "{time_s}{cells}");
        }
    }
    table
}
