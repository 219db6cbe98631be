//! `rig replay`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::anyhow;

use super::choice::choice;
use super::progress::Bar;
use super::{Failure, Outcome};
use analysis::Analysis;
use app::experiment::analysed;
use app::look::Filming;
use app::{base, interruptible, threads};
use config::{RigConfig, paths};
use record::folder::{RunFolder, file};
use record::outputs::Outputs;
use record::stage::Stage;
use record::sums::RESULTS;

/// Arguments of `rig replay`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The run folder
    pub run: PathBuf,
    /// Folder for the results, which becomes a run folder without a recording
    #[arg(long)]
    pub out: PathBuf,
    /// What to begin with; the stages before it are taken as they stand in RUN
    #[arg(long, value_parser = choice::<Stage>(), default_value = "frames")]
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
    // What `start.json` names must be there for who reads it from the results' folder.
    let made_with = RigConfig::parse(&run.start().config, &run.file(file::START)).ok();
    let calibrations = made_with.iter().flat_map(RigConfig::servo_calibrations);
    let model = PathBuf::from(&run.start().model);
    let taken = [file::START.into(), file::STOP.into(), model].into_iter().chain(calibrations);
    let taken = taken.map(|path| name_in(&run, path)).collect::<Result<Vec<String>, _>>()?;
    let read = args.config.iter().flat_map(|config| paths::files(config)).chain([args.run.clone()]);
    let mut outputs = Outputs::reading(read);
    let names: Vec<&str> = taken.iter().map(String::as_str).chain(RESULTS).collect();
    let out = outputs.results(&args.out, &names)?;
    let film = args.overlay.as_deref().map(|path| Filming::plan(&outputs.file(path)?, 1.0)).transpose()?;
    let (config, paths_from) = match &args.config {
        Some(path) => (RigConfig::read(path), base(path)),
        None => (RigConfig::parse(&run.start().config, &run.file(file::START)), run.path()),
    };
    let config = config.map_err(Failure::input)?;
    out.create().map_err(Failure::input)?;
    for name in &taken {
        let from = run.file(name);
        if from.exists() {
            out.write(name, &std::fs::read(&from).map_err(Failure::input)?).map_err(Failure::input)?;
        }
    }
    let analysis =
        Analysis { run: &run, out: &out, config: &config, paths_from, from: args.from, live: None };
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

/// What `start.json` names beside it: a name, which leads nowhere else.
fn name_in(run: &RunFolder, path: PathBuf) -> Result<String, Failure> {
    let name = path.file_name().filter(|name| *name == path.as_os_str()).and_then(|name| name.to_str());
    name.map(str::to_owned).ok_or_else(|| {
        let start = run.file(file::START);
        Failure::Input(anyhow!("{} names {}, which is no file beside it", start.display(), path.display()))
    })
}
