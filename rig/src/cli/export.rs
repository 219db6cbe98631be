//! `rig export`: a run's results in the forms that other programs read.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use serde_json::{Value, json};
use sim::Trajectory;

use super::{Failure, Outcome};
use crate::record::folder::{RunFolder, file, write_whole};

/// Hands a run's results to other programs.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What to write
    #[arg(value_enum)]
    format: Format,
    /// The run folder, or the folder a fit wrote to
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Where to write it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// What can be exported.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    /// The calibrated model, for MuJoCo 3.14 and later
    Mjcf,
    /// Keypoints over time: trajectory.csv
    Csv,
    /// Keypoints over time as Worm tracker Commons Object Notation
    Wcon,
}

/// Carries out `rig export`.
///
/// # Errors
/// [`Failure::Input`] when RUN is no folder, [`Failure::Data`] when it lacks what is to be exported.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if !args.run.is_dir() {
        return Err(Failure::Input(anyhow!("{} is not a folder; give a run folder", args.run.display())));
    }
    let bytes = match args.format {
        Format::Mjcf => read(&args.run, file::MODEL, "fit it first with `rig fit`")?,
        Format::Csv => read(&args.run, file::TRAJECTORY, "extract it first with `rig replay`")?,
        Format::Wcon => {
            let path = args.run.join(file::TRAJECTORY);
            read(&args.run, file::TRAJECTORY, "extract it first with `rig replay`")?;
            let trajectory = ident::table::read_trajectory(&path).map_err(Failure::input)?;
            let id = RunFolder::open(&args.run)
                .map_or_else(|_| "rig".to_owned(), |folder| folder.start().id.to_string());
            serde_json::to_vec(&wcon(&trajectory, &id)).map_err(Failure::internal)?
        }
    };
    write_whole(&args.out, &bytes).map_err(Failure::input)?;
    let text = format!("{}\n", args.out.display());
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

fn read(run: &Path, name: &str, remedy: &str) -> Result<Vec<u8>, Failure> {
    let path = run.join(name);
    if !path.is_file() {
        return Err(Failure::Data(anyhow!("{} holds no {name}; {remedy}", run.display())));
    }
    std::fs::read(&path).with_context(|| format!("reading {}", path.display())).map_err(Failure::Input)
}

/// Keypoints as a WCON skeleton: z of the picture's plane becomes WCON's y; a gap is null.
fn wcon(trajectory: &Trajectory, id: &str) -> Value {
    let axis = |axis: usize| -> Vec<Vec<Option<f64>>> {
        let keypoints = trajectory.keypoints.len();
        let finite = |p: &[f64; 3]| Some(p[axis]).filter(|value| value.is_finite());
        trajectory.position_m.chunks(keypoints.max(1)).map(|row| row.iter().map(finite).collect()).collect()
    };
    json!({
        "units": { "t": "s", "x": "m", "y": "m" },
        "metadata": { "software": { "name": "rig", "version": env!("CARGO_PKG_VERSION") } },
        "data": [{ "id": id, "t": trajectory.time_s, "x": axis(0), "y": axis(2) }],
        "comments": [format!("points: {}; y is upward", trajectory.keypoints.join(", "))],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(run: &Path, format: Format) -> Args {
        Args { format, run: run.into(), out: run.join("exported") }
    }

    #[test]
    fn run_without_a_fit_has_no_model_to_export_and_says_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let failure = run(&args(folder.path(), Format::Mjcf)).unwrap_err();
        assert_eq!(failure.exit_code(), 4);
        assert!(failure.error().to_string().contains("rig fit"), "{}", failure.error());
    }

    #[test]
    fn trajectory_is_exported_byte_by_byte() {
        let folder = tempfile::tempdir().unwrap();
        let text = "time_s,P1_x_m,P1_z_m\n0,0.1,0.2\n0.1,,\n";
        std::fs::write(folder.path().join(file::TRAJECTORY), text).unwrap();
        run(&args(folder.path(), Format::Csv)).unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("exported")).unwrap(), text);
    }

    #[test]
    fn gap_becomes_null_in_wcon() {
        let folder = tempfile::tempdir().unwrap();
        let text = "time_s,P1_x_m,P1_z_m,P2_x_m,P2_z_m\n0,0.1,0.2,0.3,0.4\n0.1,,,0.5,0.6\n";
        std::fs::write(folder.path().join(file::TRAJECTORY), text).unwrap();
        run(&args(folder.path(), Format::Wcon)).unwrap();
        let bytes = std::fs::read(folder.path().join("exported")).unwrap();
        let wcon: Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(wcon["data"][0]["x"], json!([[0.1, 0.3], [null, 0.5]]));
        assert_eq!(wcon["data"][0]["y"], json!([[0.2, 0.4], [null, 0.6]]));
        assert_eq!(wcon["units"]["x"], "m");
    }
}
