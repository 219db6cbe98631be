//! `rig replay`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::anyhow;

use super::progress::Bar;
use super::{Failure, Outcome};
use crate::analysis::{Analysis, Stage};
use crate::app::experiment::analysed;
use crate::app::look::Filming;
use crate::app::{base, interruptible, threads};
use crate::config::RigConfig;
use crate::record::files::write_whole;
use crate::record::folder::{RunFolder, file};
use crate::report;

/// Arguments of `rig replay`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The run folder
    pub run: PathBuf,
    /// Folder for the results, which becomes a run folder without a recording
    #[arg(long)]
    pub out: PathBuf,
    /// What to begin with; the stages before it are taken as they stand in RUN
    #[arg(long, value_enum, default_value = "frames")]
    pub from: Stage,
    /// Another config than the one the run was made with
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Also write a film of what was found in the images and what the fitted simulation does: .mp4, .webm or .mkv; needs ffmpeg
    #[arg(long, visible_alias = "overlays", value_name = "FILM")]
    pub overlay: Option<PathBuf>,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Redoes a run's analysis into another folder.
///
/// # Errors
/// [`Failure`] by class.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let run = RunFolder::open(&args.run).map_err(Failure::input)?;
    std::fs::create_dir_all(&args.out).map_err(Failure::input)?;
    let film = args.overlay.as_deref().map(|path| Filming::plan(path, 1.0)).transpose()?;
    if same_folder(&args.run, &args.out) {
        return Err(Failure::Input(anyhow!(
            "--out {} is the run itself, which a replay never writes into",
            args.out.display()
        )));
    }
    let (config, paths_from) = match &args.config {
        Some(path) => (RigConfig::read(path), base(path)),
        None => (RigConfig::parse(&run.start().config, &run.file(file::START)), run.path()),
    };
    let config = config.map_err(Failure::input)?;
    // What `start.json` names must be there for who reads it from the results' folder.
    let made_with = RigConfig::parse(&run.start().config, &run.file(file::START)).ok();
    let named = made_with.iter().flat_map(RigConfig::servo_calibrations);
    let names = [file::START, file::STOP, run.start().model.as_str()].map(PathBuf::from);
    for name in names.into_iter().chain(named) {
        let from = run.path().join(&name);
        if from.exists() {
            let bytes = std::fs::read(&from).map_err(Failure::input)?;
            write_whole(&args.out.join(&name), &bytes).map_err(Failure::input)?;
        }
    }
    let analysis = Analysis {
        run: &run,
        out: &args.out,
        config: &config,
        paths_from,
        from: args.from,
        chronicle: None,
        live: None,
    };
    let (run, config) = (&run, &config);
    interruptible(async move |interrupt| {
        let data = analysed(analysis, threads(args.threads), interrupt, &mut Bar::new(interrupt.flag()));
        let filmed = film.map_or(Ok(()), |film| {
            let plane = config.calibration.plane(paths_from).map_err(Failure::input)?;
            film.run(run, &args.out, &plane, data.as_ref().ok().and_then(|data| data.runs.first()))
        });
        // Without a fit the film shows the keypoints alone; why there is none is told all the same.
        let data = data?;
        filmed?;
        let text = report::written(&data, &args.out);
        let (out, run) = (Some(args.out.clone()), Some(args.run.clone()));
        Ok(Outcome { out, run, warnings: data.warnings, text, ..Outcome::default() })
    })
}

fn same_folder(a: &std::path::Path, b: &std::path::Path) -> bool {
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}
