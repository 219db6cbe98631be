//! `rig run`.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::progress::Bar;
use super::signal::Interrupt;
use super::{Failure, InRun, Outcome};
use crate::analysis::live::Live;
use crate::analysis::timeline::Chronicle;
use crate::analysis::{Analysis, AnalysisError, Stage};
use crate::claim::Claim;
use crate::config::RigConfig;
use crate::doctor::{self, Health};
use crate::record::folder::file;
use crate::report::ReportData;
use crate::run::film::Notice;
use crate::run::machine::Ending;
use crate::run::{Conducted, Job, RunError};

/// Arguments of `rig run`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config
    pub config: PathBuf,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Film only; leave extraction and fit to `rig replay`
    #[arg(long)]
    pub film_only: bool,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<usize>,
}

/// Runs the experiment once.
///
/// # Errors
/// [`Failure`] by class; a run that has begun stays readable and is named.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let _claim = Claim::take("the runs folder", &args.runs_dir.join(".lock")).map_err(Failure::input)?;
    for check in doctor::host::runs_folder(&args.runs_dir, config.expected_bytes()) {
        if check.health == Health::Bad {
            return Err(Failure::Input(anyhow!("{}: {}", check.subject, check.finding)));
        }
    }
    let runtime = tokio::runtime::Runtime::new().map_err(Failure::internal)?;
    runtime.block_on(async {
        let interrupt = Interrupt::listen().map_err(Failure::internal)?;
        let experiment = Experiment {
            config: &config,
            base: base(&args.config),
            runs_dir: &args.runs_dir,
            film_only: args.film_only,
            threads: threads(args.threads),
        };
        experiment.run(&interrupt).await
    })
}

/// The folder that relative paths in the config at `path` start from.
pub(super) fn base(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Worker threads asked for, or one for each core.
pub(super) fn threads(asked: Option<usize>) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    asked.filter(|&count| count > 0).unwrap_or_else(cores)
}

/// One experiment from config to report, for `rig run` and `rig daemon`.
pub(super) struct Experiment<'a> {
    pub(super) config: &'a RigConfig,
    pub(super) base: &'a Path,
    pub(super) runs_dir: &'a Path,
    pub(super) film_only: bool,
    pub(super) threads: usize,
}

impl Experiment<'_> {
    pub(super) async fn run(&self, interrupt: &Interrupt) -> Result<Outcome, Failure> {
        let bar = Bar::new(interrupt.flag());
        let job = Job { config: self.config, base: self.base, runs_dir: self.runs_dir };
        let mut phase = "";
        let mut live = None;
        let mut chronicle = None;
        let conducted = job
            .conduct(interrupt.raised(), |folder, notice| {
                let origin = folder.origin();
                let chronicle = chronicle.get_or_insert_with(|| Chronicle::new(origin));
                match notice {
                    Notice::Phase(now, images) => {
                        if now != phase {
                            bar.note(&format!("{}  {now}", folder.start().id));
                            phase = now;
                        }
                        bar.say(format!("{now}: {images} images"));
                    }
                    Notice::Image(image) => {
                        chronicle.image(&image);
                        if !self.film_only {
                            live.get_or_insert_with(|| {
                                Live::start(folder, self.config, self.base, self.threads)
                            })
                            .iter_mut()
                            .for_each(|live| live.image(&image));
                        }
                    }
                    Notice::Servo(event) => chronicle.servo(&event),
                    Notice::Command(command) => chronicle.command(&command),
                    Notice::Learn(from) => {
                        live.iter_mut().flatten().for_each(|live| live.learn(from.clone()));
                    }
                    Notice::Fit => {
                        live.iter_mut().flatten().for_each(|live| live.fit(chronicle.clone()));
                    }
                    Notice::LetGo => bar.ask("The water is still: let go of the mechanism now."),
                    Notice::Journal(text) => tracing::info!("{text}"),
                }
            })
            .await
            .map_err(filming_failed)?;
        let Conducted { folder, filmed } = conducted;
        let here = InRun(folder.path().into());
        match &filmed.ending {
            Ending::Success => {}
            Ending::Abort(reason) => {
                return Err(Failure::Interrupted(anyhow!("aborted: {reason}").context(here)));
            }
            Ending::Fail(reason) => {
                return Err(Failure::Hardware(anyhow!("run incomplete: {reason}").context(here)));
            }
        }
        let mut text = format!("filmed {} images", filmed.recorded.images);
        if filmed.images_lost > 0 {
            text += &format!(", {} lost by the camera", filmed.images_lost);
        }
        if !self.film_only {
            let mut bar = bar;
            let data = tokio::task::block_in_place(|| {
                let analysis = Analysis {
                    run: &folder,
                    out: folder.path(),
                    config: self.config,
                    paths_from: self.base,
                    from: Stage::Frames,
                    threads: self.threads,
                    chronicle,
                    live: live.flatten(),
                };
                analysis.carry_out(&mut bar)
            })
            .map_err(|error| analysis_failed(error, here))?;
            text = format!("{text}\n{}", summary(&data, folder.path()));
            drop(bar);
            finished(interrupt, &text, InRun(folder.path().into()))?;
        }
        Ok(Outcome { run: Some(folder.path().into()), text, ..Outcome::default() })
    }
}

fn filming_failed(error: RunError) -> Failure {
    if error.is_input() { Failure::input(error) } else { Failure::hardware(error) }
}

/// A fit that was told to end has written its best so far, but the verb did not do all it was asked for.
pub(super) fn finished(interrupt: &Interrupt, text: &str, here: InRun) -> Result<(), Failure> {
    if interrupt.is_raised() {
        return Err(Failure::Interrupted(
            anyhow!("interrupted; the best so far is written\n{text}").context(here),
        ));
    }
    Ok(())
}

/// Classifies what ended an analysis.
pub(super) fn analysis_failed(error: AnalysisError, here: InRun) -> Failure {
    let lack_of_data = match &error {
        AnalysisError::Vision(_) => true,
        AnalysisError::Fit(error) => error.is_lack_of_data(),
        _ => false,
    };
    let error = anyhow::Error::new(error).context(here);
    if lack_of_data { Failure::Data(error) } else { Failure::Input(error) }
}

/// What came out, for a terminal: the report in short, and where to look at it whole.
pub(super) fn summary(data: &ReportData, folder: &Path) -> String {
    let report = folder.join(file::REPORT);
    let report = std::fs::canonicalize(&report).unwrap_or(report);
    format!("{}\nreport: file://{}", crate::report::summary(data), report.display())
}
