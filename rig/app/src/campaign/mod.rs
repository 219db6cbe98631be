//! A campaign: run, fit, diagnose, design, and the next run, by itself, until its goal is reached, or only work by hand can help, or its
//! runs are used up.
//!
//! - [`record`]: `campaign.json`, what it did and where it stands;
//! - `next`: what to do after a run.
//!
//! Every step's experiment, results and report are in a folder of the campaign, `after-1`, `after-2`, ...; its runs are run folders like
//! all others.

mod next;
pub mod record;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;
use ground::strict::Seconds;
use ident::experiment::Use;
use ident::parameters::Parameters;

use super::announce::wait_until_allowed;
use super::compose::{compose, degraded};
use super::experiment::{Experiment, Extent};
use super::{Failure, Interrupt, Watcher, base, hand_in, read_model};
use ::record::outputs::OutputFolder;
use ::record::run_id::RunId;
use analysis::prepared;
use config::RigConfig;
use ground::urgency::Urgency;
use next::Next;
use record::{Made, Record, Standing, Step};
use store::goal::Goal;

/// What a campaign writes into its folder.
pub const FILES: [&str; 3] = [record::FILE, "after-*", next::CONFIGS];
/// The runs of a step.
const EXPERIMENT: &str = "experiment.toml";

/// A campaign as it was asked for.
#[derive(Debug)]
pub struct Campaign<'a> {
    /// The rig's config: that of the first run. An absolute path, as the others: the campaign may go on from elsewhere.
    pub config: &'a Path,
    /// The folder of run folders.
    pub runs_dir: &'a Path,
    /// The campaign's own folder.
    pub out: &'a OutputFolder,
    /// What it is for.
    pub goal: Goal,
    /// The most runs it may make, those of before it was interrupted included.
    pub max_runs: usize,
    /// Worker threads.
    pub threads: usize,
}

impl Campaign<'_> {
    /// Carries it out; in a folder where it was interrupted it goes on from there. Gives what it did.
    ///
    /// # Errors
    /// As [`Experiment::carry_out`] and the fits and diagnoses of its steps; what was done before stands in its folder.
    pub async fn carry_out(
        &self,
        interrupt: &Interrupt,
        watcher: &mut dyn Watcher,
    ) -> Result<Record, Failure> {
        let first = RigConfig::read(self.config).map_err(Failure::input)?;
        self.check(&first)?;
        let rest =
            first.schedule.as_ref().and_then(|table| table.rest_s).map_or(Duration::ZERO, Seconds::duration);
        self.out.create().map_err(Failure::input)?;
        let mut record = Record::open(self.out, self.config, &self.goal, self.max_runs)?;
        let _claim = self.experiment(&first, self.config, false).claim()?;
        let mut next = match record.runs.is_empty() {
            true => Next::Run { config: self.config.into(), why: "the first run".into() },
            false => self.look(&mut record, watcher)?,
        };
        loop {
            let (config, why) = match next {
                Next::End(state, says) => {
                    (record.state, record.says) = (state, says);
                    record.write(self.out)?;
                    watcher.event(&format!("{}: {}", record.state.name(), record.says));
                    return Ok(record);
                }
                Next::Run { .. } if record.runs.len() >= self.max_runs => {
                    let says = format!("after {} runs: {}", record.runs.len(), record.says);
                    next = Next::End(Standing::BudgetSpent, says);
                    continue;
                }
                Next::Run { config, why } => (config, why),
            };
            if !record.runs.is_empty() {
                self.rest(rest, interrupt, watcher).await?;
            }
            watcher.event(&format!("run {} of at most {}: {why}", record.runs.len() + 1, self.max_runs));
            let begins_by_itself = !record.runs.is_empty();
            let run = self.run(&config, begins_by_itself, interrupt, watcher).await?;
            record.runs.push(Made { run, config, why });
            record.write(self.out)?;
            next = self.look(&mut record, watcher)?;
            if interrupt.is_raised() {
                return Err(Failure::Interrupted(anyhow!(
                    "interrupted after {} runs; the same command with `--out {}` goes on from there",
                    record.runs.len(),
                    self.out.path().display()
                )));
            }
        }
    }

    /// Checks that the fit has the parameters of the goal.
    fn check(&self, config: &RigConfig) -> Result<(), Failure> {
        let Goal::Precision(targets) = &self.goal else { return Ok(()) };
        let model = read_model(&base(self.config).join(&config.run.model))?;
        let prepared = prepared(config, model)?;
        let fitted = Parameters::select(&prepared.model, &prepared.fit).map_err(Failure::input)?;
        let known: Vec<&str> = fitted.free.iter().flat_map(|one| &one.names).map(String::as_str).collect();
        match targets.iter().find(|target| !known.contains(&target.name.as_str())) {
            None => Ok(()),
            Some(target) => Err(Failure::Input(anyhow!(
                "--goal \"{target}\": no fitted parameter is called `{}`; {} fits {}",
                target.name,
                self.config.display(),
                known.join(", ")
            ))),
        }
    }

    fn experiment<'e>(&'e self, config: &'e RigConfig, path: &'e Path, announced: bool) -> Experiment<'e> {
        Experiment {
            config,
            base: base(path),
            runs_dir: self.runs_dir,
            extent: Extent::Keypoints,
            motion: None,
            threads: self.threads,
            announced,
        }
    }

    /// Makes the run of the config at `path`; one that begins by itself waits for its leave and is announced.
    async fn run(
        &self,
        path: &Path,
        begins_by_itself: bool,
        interrupt: &Interrupt,
        watcher: &mut dyn Watcher,
    ) -> Result<RunId, Failure> {
        let config = RigConfig::read(path).map_err(Failure::input)?;
        if begins_by_itself {
            wait_until_allowed(&config, self.runs_dir, interrupt, watcher).await?;
        }
        let announced = begins_by_itself || hand_in::is_job();
        let done = self.experiment(&config, path, announced).carry_out(interrupt, watcher).await?;
        Ok(done.conducted.folder.start().id.clone())
    }

    /// Fits or diagnoses all runs made so far, and says what to do then.
    fn look(&self, record: &mut Record, watcher: &mut dyn Watcher) -> Result<Next, Failure> {
        let folder = self.out.folder(&format!("after-{}", record.runs.len()));
        let paths: Vec<PathBuf> =
            record.runs.iter().map(|made| self.runs_dir.join(made.run.as_str())).collect();
        // degraded runs are not used
        let whole = paths.iter().filter(|path| degraded(path).is_none());
        let runs: Vec<(Use, &Path)> = whole.map(|path| (Use::Fit, path.as_path())).collect();
        if let (true, Some(why)) = (runs.is_empty(), paths.first().and_then(|path| degraded(path))) {
            return Err(Failure::Data(anyhow!("no run of this campaign can be used: {why}")));
        }
        compose(&runs, None, false, &folder.file(EXPERIMENT))?;
        let mut step = Step {
            folder: folder.path().into(),
            verdict: None,
            sentence: None,
            established: Vec::new(),
            known: Vec::new(),
        };
        let next = tokio::task::block_in_place(|| {
            // other rigs may be moving: they have priority
            std::thread::scope(|scope| {
                let polite = scope.spawn(|| {
                    // the pool's threads inherit it
                    Urgency::Computing.take();
                    match &self.goal {
                        Goal::Resolve => self.resolved(&folder, &mut step, record, watcher),
                        Goal::Precision(targets) => {
                            self.precise(&folder, targets, &mut step, record, watcher)
                        }
                    }
                });
                polite.join().unwrap_or_else(|_| Err(Failure::Internal(anyhow!("the analysis panicked"))))
            })
        })?;
        record.steps.truncate(record.runs.len() - 1);
        record.steps.push(step);
        record.write(self.out)?;
        Ok(next)
    }

    /// Waits until the water rests.
    async fn rest(
        &self,
        rest: Duration,
        interrupt: &Interrupt,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        if !rest.is_zero() {
            watcher.status(format!("the water rests for {:.0} s", rest.as_secs_f64()));
        }
        tokio::select! {
            () = interrupt.raised() => Err(Failure::Interrupted(anyhow!(
                "interrupted between two runs; the same command with `--out {}` goes on from there",
                self.out.path().display()
            ))),
            () = tokio::time::sleep(rest) => Ok(()),
        }
    }
}
