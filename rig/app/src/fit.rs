//! An experiment to coefficients, a calibrated model and a report, in a folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use ident::description::{Suspect, suspects};
use ident::fit::{Checkpoint, Fit, FitError, Fitted, Flow, INTERRUPTED, Observer, Progress};

use super::results::{Given, earlier, write_fit};
use super::{Failure, Watcher, on_threads};
use record::folder::file;
use record::outputs::{OutputFile, OutputFolder};
use record::timing::Stage;
use report::ReportData;

/// What is fitted and how.
#[derive(Debug, Clone, Copy)]
pub struct FitJob<'a> {
    /// The experiment's file.
    pub experiment: &'a Path,
    /// The folder for [`FILES`].
    pub out: &'a OutputFolder,
    /// Worker threads.
    pub threads: usize,
    /// Go on from where an interrupted fit into the same folder stood.
    pub resume: bool,
    /// Intervals from the profile of the likelihood.
    pub profile: bool,
    /// `fit.json` of an earlier fit that the runs update.
    pub prior: Option<&'a Path>,
}

/// Where a fit stands, to go on from; gone when it is done.
const STATE_FILE: &str = "fit-state.json";
/// A fit of new runs that may not replace the earlier one.
const REFUSED_FILE: &str = "fit-refused.json";
/// What a fit writes into its folder.
pub const FILES: [&str; 6] = [file::FIT, file::MODEL, file::REPORT, file::TIMING, STATE_FILE, REFUSED_FILE];
/// A fit that is off by more than this many times the noise is asked whether the files are why (chosen).
const FAR_OFF_NOISE_RATIO: f64 = 3.0;
/// An interrupted fit loses at most this much work.
const SAVE_INTERVAL: Duration = Duration::from_secs(5);

impl FitJob<'_> {
    /// Fits; gives what the report shows, and where it is.
    ///
    /// # Errors
    /// [`Failure::Input`] for an experiment that contradicts itself, [`Failure::Data`] for one whose runs hold no answer or
    /// contradict the earlier fit, [`Failure::Interrupted`] after a signal, the best so far written.
    pub fn carry_out(self, watcher: &mut dyn Watcher) -> Result<(ReportData, PathBuf), Failure> {
        let mut given = Given::read(self.experiment, self.out)?;
        given.experiment.fit.profile |= self.profile;
        let earlier = self.prior.map(earlier).transpose()?;
        watcher.begin("fit", Some(given.experiment.fit.max_evaluations));
        let fitted = self.fit(&given, earlier.as_ref(), watcher);
        watcher.clear();
        let fitted = fitted?;

        let stage = Stage { name: "fit".into(), wall_s: fitted.timing.wall.as_secs_f64() };
        let mut data = given.report(["Fit", "to"], stage, fitted.timing.threads);
        data.add_fitted(&fitted);
        data.warnings.extend(self.misdescribed(&given, &fitted, watcher)?);
        if let Some(refused) = fitted.fit.recalibration.as_ref().filter(|verdict| !verdict.accepted) {
            let json = fitted.fit.to_json().map_err(Failure::internal)?;
            self.out.write(REFUSED_FILE, json.as_bytes()).map_err(Failure::internal)?;
            let kept = self.prior.unwrap_or(Path::new("the earlier fit"));
            return Err(Failure::Data(anyhow!(
                "{} stays as it is: {}; what the new runs say by themselves is in {}",
                kept.display(),
                refused.reasons.join("; "),
                self.out.path().join(REFUSED_FILE).display()
            )));
        }
        write_fit(&fitted, &given.source(), self.out)?;
        let report = given.write_report(&data)?;
        if fitted.fit.stop_reason == INTERRUPTED {
            return Err(Failure::Interrupted(anyhow!(
                "interrupted after {} evaluations; {} holds the best so far, `--resume` goes on from there",
                fitted.fit.evaluations,
                self.out.path().display()
            )));
        }
        Ok((data, report))
    }

    /// What of the files may be why the fit is far off.
    fn misdescribed(
        &self,
        given: &Given<'_>,
        fitted: &Fitted,
        watcher: &dyn Observer,
    ) -> Result<Vec<String>, Failure> {
        let Some(_) =
            fitted.fit.error_m.filter(|error_m| *error_m > FAR_OFF_NOISE_RATIO * fitted.fit.noise_m)
        else {
            return Ok(Vec::new());
        };
        let stop = watcher.interrupted();
        if stop.load(Ordering::Relaxed) {
            return Ok(Vec::new());
        }
        let suspects = on_threads(self.threads, || Ok(suspects(&given.experiment, stop)))?;
        let said = |suspect: Suspect| {
            format!("The fit is far off, and the files may be why: {}; {}.", suspect.sentence, suspect.check)
        };
        Ok(suspects.into_iter().map(said).collect())
    }

    fn fit(
        &self,
        given: &Given<'_>,
        earlier: Option<&Fit>,
        watcher: &mut dyn Watcher,
    ) -> Result<Fitted, Failure> {
        let (experiment, state) = (&given.experiment, self.out.file(STATE_FILE));
        if self.resume && !state.path().exists() {
            return Err(Failure::Input(anyhow!(
                "{} is not there: no fit was interrupted in this folder; leave out --resume",
                state.path().display()
            )));
        }
        let from =
            if self.resume { Some(Checkpoint::read(state.path()).map_err(Failure::input)?) } else { None };
        let mut saving = Saving { watcher, state: &state, saved: None, newest: None, trouble: None };
        let fitted = on_threads(self.threads, || {
            Ok(match (from, earlier) {
                (Some(from), _) => ident::fit::resume(experiment, from, &mut saving),
                (None, Some(earlier)) => ident::fit::recalibrate(experiment, earlier, &mut saving),
                (None, None) => ident::fit::fit(experiment, &mut saving),
            })
        })?;
        if let Some(error) = saving.trouble {
            return Err(error);
        }
        if matches!(fitted, Err(FitError::Interrupted)) {
            return Err(Failure::Interrupted(match &saving.newest {
                Some(newest) => {
                    state.write(&newest.to_json().map_err(Failure::internal)?).map_err(Failure::input)?;
                    anyhow!(
                        "interrupted, with too little time for what follows from the best so far; `--resume` goes on from there in {}",
                        self.out.path().display()
                    )
                }
                None if self.resume => {
                    anyhow!("interrupted; `--resume` goes on from where it went on this time")
                }
                None => anyhow!("interrupted while the runs were made ready; nothing is written"),
            }));
        }
        let fitted = fitted?;
        if fitted.fit.stop_reason != INTERRUPTED {
            // One that outlives its fit would only mislead.
            state.remove();
        }
        Ok(fitted)
    }
}

/// Saves the state of the fit at its first step, at intervals, and at its end where it is interrupted.
struct Saving<'a> {
    watcher: &'a mut dyn Watcher,
    state: &'a OutputFile,
    saved: Option<Instant>,
    /// The newest state.
    newest: Option<Checkpoint>,
    trouble: Option<Failure>,
}

impl Observer for Saving<'_> {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        let flow = self.watcher.progress(progress);
        let is_due = self.saved.is_none_or(|saved| saved.elapsed() >= SAVE_INTERVAL);
        if flow == Flow::Stop || is_due {
            let state = progress.checkpoint.to_json().map_err(Failure::internal);
            if let Err(trouble) = state.and_then(|state| self.state.write(&state).map_err(Failure::input)) {
                self.trouble = Some(trouble);
                return Flow::Stop;
            }
            self.saved = Some(Instant::now());
        }
        self.newest = Some(progress.checkpoint.clone());
        flow
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Observer::interrupted(&*self.watcher)
    }
}
