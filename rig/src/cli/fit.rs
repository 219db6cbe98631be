//! `rig fit`: an experiment to coefficients, a calibrated model and a report.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use ident::experiment::{Experiment, Use};
use ident::fit::{Checkpoint, CheckpointError, Fit, FitError, Fitted, Flow, INTERRUPTED, Observer, Progress};
use indicatif::{ProgressBar, ProgressStyle};

use super::signal::Interrupt;
use super::{Failure, Outcome, experiment::unfit};
use crate::record::RecordError;
use crate::record::folder::{file, write_whole};
use crate::record::timing::{Stage, Timing};
use crate::report::{self, ReportData};

/// Fits the model of an experiment to its runs.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml, as written by hand or by `rig experiment`
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Folder for fit.json, model.xml, report.html and timing.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Threads that simulate; the result is the same for any number [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Go on from where an interrupted fit into the same folder stood
    #[arg(long)]
    resume: bool,
    /// 95 % intervals from the profile of the likelihood: a few fits per parameter
    #[arg(long)]
    profile: bool,
    /// fit.json of an earlier fit of the same mechanism: updated with these runs, unless they contradict it
    #[arg(long, value_name = "FIT.json", conflicts_with = "resume")]
    prior: Option<PathBuf>,
}

/// Where a fit stands, for `--resume`; gone when it is done.
const STATE: &str = "fit-state.json";
/// A fit of new runs that may not replace the earlier one.
const REFUSED: &str = "fit-refused.json";
/// An interrupted fit loses at most this much work.
const SAVE_EVERY: Duration = Duration::from_secs(5);

/// Carries out `rig fit`.
///
/// # Errors
/// [`Failure::Input`] for an experiment that contradicts itself, [`Failure::Data`] for one whose runs hold no
/// answer, [`Failure::Interrupted`] after Ctrl-C, the best so far written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.threads == Some(0) {
        return Err(Failure::Input(anyhow!("--threads 0: at least one thread must simulate")));
    }
    let mut experiment = Experiment::read(&args.experiment).map_err(unfit)?;
    experiment.fit.profile |= args.profile;
    let earlier = args.prior.as_deref().map(earlier).transpose()?;
    let text = std::fs::read_to_string(&args.experiment)
        .with_context(|| format!("reading {}", args.experiment.display()))
        .map_err(Failure::Input)?;
    let runtime = tokio::runtime::Runtime::new().map_err(Failure::internal)?;
    let interrupt = runtime.block_on(async { Interrupt::listen() }).map_err(Failure::internal)?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("creating {}", args.out.display()))
        .map_err(Failure::Input)?;
    let fitted = fit(&experiment, earlier.as_ref(), &args.out.join(STATE), args, interrupt.flag())?;

    let source = args.experiment.display().to_string();
    let timing = Timing {
        workers: fitted.timing.threads,
        stages: vec![Stage { name: "fit".into(), wall_s: fitted.timing.wall.as_secs_f64() }],
    };
    let mut data = ReportData {
        id: name(&args.experiment),
        date: jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%S UTC").to_string(),
        description: description(&experiment),
        timing: timing.clone(),
        provenance: vec![
            ("rig".into(), env!("CARGO_PKG_VERSION").into()),
            ("experiment".into(), source.clone()),
            ("model".into(), experiment.model.name.clone()),
        ],
        config_toml: Some(text),
        ..ReportData::default()
    };
    data.add_fitted(&fitted);
    if let Some(refused) = fitted.fit.recalibration.as_ref().filter(|verdict| !verdict.accepted) {
        let json = fitted.fit.to_json().map_err(Failure::internal)?;
        write_whole(&args.out.join(REFUSED), json.as_bytes()).map_err(Failure::internal)?;
        let kept = args.prior.as_deref().unwrap_or(Path::new("the earlier fit"));
        return Err(Failure::Data(anyhow!(
            "{} stays as it is: {}; what the new runs say by themselves is in {}",
            kept.display(),
            refused.reasons.join("; "),
            args.out.join(REFUSED).display()
        )));
    }
    write_results(&fitted, &source, &args.out)?;
    timing.write(&args.out.join(file::TIMING)).map_err(Failure::internal)?;
    write_whole(&args.out.join(file::REPORT), report::render(&data).as_bytes()).map_err(Failure::internal)?;

    if fitted.fit.stop_reason == INTERRUPTED {
        return Err(Failure::Interrupted(anyhow!(
            "interrupted after {} evaluations; {} holds the best so far, `--resume` goes on from there",
            fitted.fit.evaluations,
            args.out.display()
        )));
    }
    let text = format!("{}\n{}\n", report::summary(&data), args.out.join(file::REPORT).display());
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

/// Writes `fit.json` and the calibrated `model.xml` to `folder`; `source` says in the model what it was fitted to.
///
/// # Errors
/// [`Failure::Internal`] when the folder cannot be written.
pub fn write_results(fitted: &Fitted, source: &str, folder: &Path) -> Result<(), Failure> {
    let fit = &fitted.fit;
    let json = fit.to_json().map_err(Failure::internal)?;
    let write = |name: &str, text: &str| -> Result<(), RecordError> {
        write_whole(&folder.join(name), text.as_bytes())
    };
    write(file::FIT, &json).map_err(Failure::internal)?;
    let left_open: Vec<&str> =
        fit.parameters.iter().filter(|p| !p.determined).map(|p| p.name.as_str()).collect();
    let mut comment = format!(
        "Calibrated by rig {} on {source}: method {}, seed {}, loss {:.4} mm2.",
        env!("CARGO_PKG_VERSION"),
        fit.method,
        fit.seed,
        fit.loss_m2 * 1e6
    );
    if !left_open.is_empty() {
        comment.push_str(&format!(" Left open by the data: {}.", left_open.join(", ")));
    }
    write(file::MODEL, &fitted.to_mjcf(&comment)).map_err(Failure::internal)
}

fn description(experiment: &Experiment) -> String {
    let held_out = experiment.runs.iter().filter(|run| run.usage == Use::Holdout).count();
    let fitted = experiment.runs.len() - held_out;
    format!("Fit of {} to {fitted} runs, {held_out} held out.", experiment.model.name)
}

/// The experiment's name: its file's, or its folder's where the file has the usual name.
pub(super) fn name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if stem != "experiment" {
        return stem;
    }
    let folder = path.canonicalize().ok().and_then(|path| Some(path.parent()?.file_name()?.to_owned()));
    folder.map_or(stem, |folder| folder.to_string_lossy().into_owned())
}

fn fit(
    experiment: &Experiment,
    earlier: Option<&Fit>,
    state: &Path,
    args: &Args,
    interrupted: Arc<AtomicBool>,
) -> Result<Fitted, Failure> {
    if args.resume && !state.exists() {
        return Err(Failure::Input(anyhow!(
            "{} is not there: no fit was interrupted in this folder; leave out --resume",
            state.display()
        )));
    }
    let from = if args.resume { Some(Checkpoint::read(state).map_err(Failure::input)?) } else { None };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0))
        .build()
        .map_err(Failure::internal)?;
    let mut watcher = Watcher::new(state, interrupted);
    let fitted = pool.install(|| match (from, earlier) {
        (Some(from), _) => ident::fit::resume(experiment, from, &mut watcher),
        (None, Some(earlier)) => ident::fit::recalibrate(experiment, earlier, &mut watcher),
        (None, None) => ident::fit::fit(experiment, &mut watcher),
    });
    let Watcher { bar, trouble, .. } = watcher;
    bar.finish_and_clear();
    if let Some(error) = trouble {
        return Err(Failure::input(error));
    }
    let fitted =
        fitted.map_err(
            |error: FitError| {
                if error.is_lack_of_data() { Failure::data(error) } else { Failure::input(error) }
            },
        )?;
    if fitted.fit.stop_reason != INTERRUPTED {
        // A state that outlives its fit would only mislead; one that is not there is what is wanted.
        let _ = std::fs::remove_file(state);
    }
    Ok(fitted)
}

/// Shows progress on a terminal, and saves now and then where the fit stands.
struct Watcher {
    bar: ProgressBar,
    state: PathBuf,
    saved: Instant,
    interrupted: Arc<AtomicBool>,
    trouble: Option<CheckpointError>,
}

impl Watcher {
    fn new(state: &Path, interrupted: Arc<AtomicBool>) -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) =
            ProgressStyle::with_template("fit {msg} {wide_bar} {pos}/{len} evaluations, {elapsed}")
        {
            bar.set_style(style);
        }
        Self { bar, state: state.into(), saved: Instant::now(), interrupted, trouble: None }
    }
}

impl Observer for Watcher {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        self.bar.set_length(progress.max_evaluations.max(progress.evaluations));
        self.bar.set_position(progress.evaluations);
        let rms_mm = progress.loss_m2.sqrt() * 1e3;
        self.bar.set_message(format!("({}) rms {rms_mm:.3} mm", progress.phase));
        let interrupted = self.interrupted.load(Ordering::Relaxed);
        if interrupted || self.saved.elapsed() >= SAVE_EVERY {
            if let Err(error) = progress.checkpoint.write(&self.state) {
                self.trouble = Some(error);
                return Flow::Stop;
            }
            self.saved = Instant::now();
        }
        if interrupted { Flow::Stop } else { Flow::Continue }
    }
}

/// Reads the fit.json of an earlier fit.
pub(super) fn earlier(path: &Path) -> Result<Fit, Failure> {
    let read = || format!("reading the earlier fit {}", path.display());
    let text = std::fs::read_to_string(path).with_context(read).map_err(Failure::Input)?;
    serde_json::from_str(&text).with_context(read).map_err(Failure::Input)
}
