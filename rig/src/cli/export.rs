//! `rig export`: a run's results in the forms that other programs read.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};

use super::{Failure, Outcome};
use app::exchange::{Export, TableOfImages, frames_file};
use config::paths;
use record::folder::file;
use record::outputs::{OutputFile, Outputs};

/// Hands a run's results to other programs.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What to write
    #[arg(value_enum)]
    format: Format,
    /// The run folder; for mjcf also the folder a fit wrote to, for csv, dlc and wcon also a trajectory
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Where to write it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// dlc: any rig config with the `[calibration]` that the film was made with; left out: the run's own
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
}

/// What can be exported.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    /// The calibrated model, for MuJoCo 3.14 and later
    Mjcf,
    /// Keypoints over time: trajectory.csv
    Csv,
    /// Keypoints in the picture as DeepLabCut's CSV; times go to `<FILE>.frames.csv`
    Dlc,
    /// Keypoints over time as Worm tracker Commons Object Notation
    Wcon,
    /// Pictures, keypoints, links in space, servos and events of a run, for Foxglove
    Mcap,
    /// A run as Bluesky's documents, a JSON array `[name, document]` a line, for databroker and pandas
    Bluesky,
}

/// Carries out `rig export`.
///
/// # Errors
/// [`Failure::Input`] when RUN is not what it should be, [`Failure::Data`] when it lacks what is to be exported.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.config.is_some() && args.format != Format::Dlc {
        return Err(Failure::Input(anyhow!(
            "--config says how keypoints lie in the picture: only dlc has a use for it"
        )));
    }
    let export = Export { from: &args.run, config: args.config.as_deref() };
    let from = match args.format {
        Format::Mjcf => model(&args.run)?,
        Format::Csv | Format::Dlc | Format::Wcon => export.path()?,
        Format::Mcap | Format::Bluesky => args.run.clone(),
    };
    let config = args.config.iter().flat_map(|config| paths::files(config));
    let mut outputs = Outputs::reading(config.chain([from.clone()]));
    let mut text = format!("{}\n", args.out.display());
    let write = |file: OutputFile, bytes: &[u8]| file.write(bytes).map_err(Failure::input);
    match args.format {
        Format::Mjcf | Format::Csv => {
            let out = outputs.file(&args.out)?;
            let reading = || format!("reading {}", from.display());
            write(out, &std::fs::read(&from).with_context(reading).map_err(Failure::Input)?)?;
        }
        Format::Dlc => {
            export.dlc(&TableOfImages::at(&args.out, &mut outputs)?)?;
            text.push_str(&format!(
                "{}: its images' times, for `rig import`\n",
                frames_file(&args.out).display()
            ));
        }
        Format::Wcon => write(outputs.file(&args.out)?, &export.wcon()?)?,
        Format::Mcap | Format::Bluesky => {
            let export =
                if args.format == Format::Mcap { app::foxglove::export } else { app::bluesky::export };
            for left_out in export(&args.run, &outputs.file(&args.out)?)? {
                text.push_str(&format!("{left_out}\n"));
            }
        }
    }
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

fn model(run: &Path) -> Result<PathBuf, Failure> {
    if !run.is_dir() {
        return Err(Failure::Input(anyhow!("{} is not a folder; give a run folder", run.display())));
    }
    let path = run.join(file::MODEL);
    if !path.is_file() {
        return Err(Failure::Data(anyhow!(
            "{} holds no {}; fit it first with `rig fit`",
            run.display(),
            file::MODEL
        )));
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn args(run: &Path, format: Format) -> Args {
        Args { format, run: run.into(), out: run.join("exported"), config: None }
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
        assert_eq!(wcon["data"][0]["x"], json!([[100.0, 300.0], [null, 500.0]]));
        assert_eq!(wcon["data"][0]["y"], json!([[200.0, 400.0], [null, 600.0]]));
        assert_eq!(wcon["units"]["x"], "mm");
    }
}
