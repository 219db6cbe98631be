//! Records how a job ended, and adds the jobs and alerts that follow from it.

use std::path::Path;

use jiff::{SignedDuration, Timestamp};
use serde_json::json;

use super::Rig;
use super::owed::Owed;
use ::record::below;
use ::record::run_id::RunId;
use app::campaign::record::{self, Record};
use app::compose::degraded;
use app::last_good::{self, Recalibrated};
use app::{Failure, Watcher};
use store::alerts::Alert;
use store::job::{Job, JobResult, Lane, NewJob, State, Work};

/// A computing job that was lost is repeated this many times at most: it may be the cause of the crash. Chosen.
const MAX_REPEATS: u32 = 2;
/// An alert of the same drift is raised again after this many days. Chosen.
const DRIFT_ALERT_REPEAT_DAYS: i64 = 7;

impl Rig {
    /// Records how a job ended; what follows from it is owed from then on. Where that cannot be recorded, nothing has happened.
    pub(super) fn close(
        &mut self,
        job: &Job,
        state: State,
        result: JobResult,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        let mut owed = vec![];
        let what = json!({ "job": job.id, "kind": job.work.kind(), "state": state, "result": result });
        owed.push(Owed::Line("job-ended", what));
        if let Some((kind, what)) = alert(job, state, &result)
            && !self.was_alerted(kind, &what)?
        {
            owed.push(Owed::alert(kind, what, Some(job.id)));
        }
        owed.extend(self.follows(job, state, &result)?.map(|job| Owed::Job(Box::new(job))));
        self.store.end(job.id, state, &result).map_err(Failure::internal)?;
        self.owed.extend(owed);
        if let Some(error) = &result.error {
            watcher.alert(&format!("rig: job {} ({}) {state}: {error}", job.id, job.work.kind()));
        }
        Ok(())
    }

    /// The job that follows from the end of another: a run is recalibrated from, and a computing job that was lost is repeated, unless that was
    /// done too often.
    fn follows(&self, job: &Job, state: State, result: &JobResult) -> Result<Option<NewJob>, Failure> {
        Ok(match (&job.work, state) {
            (Work::Run { config, film_only: false }, State::Done) if *config == self.path => {
                let run = result.run.as_deref();
                let id = run.and_then(|run| Path::new(run).file_name()?.to_str()?.to_owned().try_into().ok());
                let why = Some(format!("job {} has run", job.id));
                (id as Option<RunId>).map(|run| NewJob {
                    why,
                    priority: 1,
                    ..NewJob::new(Work::Recalibrate { run })
                })
            }
            (work, State::Lost) if work.lane() == Lane::Analysis => {
                let repeats = self.store.repeats(job.id).map_err(Failure::internal)?;
                (repeats < MAX_REPEATS).then(|| NewJob {
                    priority: job.priority,
                    why: Some("its process was lost".into()),
                    retry_of: Some(job.id),
                    ..NewJob::new(job.work.clone())
                })
            }
            _ => None,
        })
    }

    /// Whether an alert of the same drift was raised in the last days: a coefficient that has drifted stays so in the runs that follow.
    fn was_alerted(&self, kind: &str, what: &str) -> Result<bool, Failure> {
        if kind != "drift" {
            return Ok(false);
        }
        let names = |text: &str| -> Vec<String> {
            text.split("; ").filter_map(|one| Some(one.split_once(' ')?.0.to_owned())).collect()
        };
        let since = Timestamp::now() - SignedDuration::from_hours(24 * DRIFT_ALERT_REPEAT_DAYS);
        let known = self.store.alerts(usize::MAX).map_err(Failure::internal)?;
        let is_recent = |alert: &Alert| alert.raised.parse().is_ok_and(|raised: Timestamp| raised >= since);
        Ok(known
            .iter()
            .take_while(|alert| is_recent(alert))
            .any(|alert| alert.kind == kind && names(&alert.text) == names(what)))
    }
}

/// The alert that a job's end raises: its kind and text.
fn alert(job: &Job, state: State, result: &JobResult) -> Option<(&'static str, String)> {
    let error = result.error.as_deref().unwrap_or("it said nothing");
    match (&job.work, state) {
        (work, State::Failed | State::Lost) => {
            Some(("job-failed", format!("job {} ({}) {state}: {error}", job.id, work.kind())))
        }
        (Work::Run { .. }, State::Done) => {
            let run = Path::new(result.run.as_deref()?);
            let (why, name) = (degraded(run)?, run.file_name()?.to_string_lossy());
            Some(("images-lost", format!("run {name}: {why}; nothing is promoted that is made from it")))
        }
        (Work::Recalibrate { .. }, State::Done) => {
            let path = Path::new(result.run.as_deref()?).join(last_good::VERDICT);
            let found: Recalibrated = serde_json::from_slice(&below::read_at(&path).ok()?).ok()?;
            found.alert()
        }
        (Work::Campaign { .. }, State::Done) => {
            let path = Path::new(result.out.as_deref()?).join(record::FILE);
            let campaign: Record = serde_json::from_slice(&below::read_at(&path).ok()?).ok()?;
            let words = [campaign.says].into_iter().chain(campaign.needs).collect::<Vec<_>>().join("; ");
            Some(("campaign-ended", format!("{}: {words}", campaign.state.name())))
        }
        _ => None,
    }
}
