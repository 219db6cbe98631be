//! What follows from a job that has ended.

use std::path::Path;

use jiff::{SignedDuration, Timestamp};
use serde_json::json;

use super::Rig;
use ::record::below;
use ::record::run_id::RunId;
use app::campaign::record::{self, Record};
use app::compose::degraded;
use app::last_good::{self, Recalibrated};
use app::{Failure, Watcher};
use store::alerts::Alert;
use store::job::{Job, JobId, JobResult, Lane, NewJob, State, Work};

/// A job that only computes and was lost is begun again so many times: it harms nobody, but it may be what kills.
const MOST_REPEATS: u32 = 2;
/// The same drift is told again after so many days.
const SAME_DRIFT_DAYS: i64 = 7;

impl Rig {
    /// Writes how a job ended, and adds what follows from it.
    pub(super) fn close(
        &mut self,
        job: &Job,
        state: State,
        result: JobResult,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        self.store.end(job.id, state, &result).map_err(Failure::internal)?;
        let what = json!({ "job": job.id, "kind": job.work.kind(), "state": state, "result": result });
        self.write("job-ended", what)?;
        if let Some((kind, what)) = alert(job, state, &result)
            && !self.was_told(kind, &what)?
        {
            self.raise(kind, &what, Some(job.id))?;
        }
        if let Some(error) = &result.error {
            watcher.tell(&format!("rig: job {} ({}) {state}: {error}", job.id, job.work.kind()));
        }
        match (&job.work, state) {
            (Work::Run { config, film_only: false }, State::Done) if *config == self.path => {
                let id = result
                    .run
                    .as_deref()
                    .and_then(|run| Path::new(run).file_name()?.to_str()?.to_owned().try_into().ok());
                if let Some(run) = id as Option<RunId> {
                    let why = Some(format!("job {} has run", job.id));
                    let job = NewJob { why, priority: 1, ..NewJob::new(Work::Recalibrate { run }) };
                    self.store.follow(&job).map_err(Failure::internal)?;
                }
            }
            (work, State::Lost) if work.lane() == Lane::Analysis => self.repeat(job)?,
            _ => {}
        }
        Ok(())
    }

    /// Raises an alert.
    pub(super) fn raise(&mut self, kind: &str, what: &str, job: Option<JobId>) -> Result<(), Failure> {
        self.alerts.raise(&mut self.store, kind, what, job).map_err(Failure::internal)?;
        self.write("alert", json!({ "kind": kind, "text": what, "job": job }))
    }

    /// Whether the same was told within the last days already: what has moved stays where it is for all runs that follow.
    fn was_told(&self, kind: &str, what: &str) -> Result<bool, Failure> {
        if kind != "drift" {
            return Ok(false);
        }
        let names = |text: &str| -> Vec<String> {
            text.split("; ").filter_map(|one| Some(one.split_once(' ')?.0.to_owned())).collect()
        };
        let since = Timestamp::now() - SignedDuration::from_hours(24 * SAME_DRIFT_DAYS);
        let known = self.store.alerts(usize::MAX).map_err(Failure::internal)?;
        let is_recent = |alert: &Alert| alert.raised.parse().is_ok_and(|raised: Timestamp| raised >= since);
        Ok(known
            .iter()
            .take_while(|alert| is_recent(alert))
            .any(|alert| alert.kind == kind && names(&alert.text) == names(what)))
    }

    /// Adds again a job that was lost, unless it is the repetition of too many.
    fn repeat(&mut self, job: &Job) -> Result<(), Failure> {
        if self.store.repeats(job.id).map_err(Failure::internal)? < MOST_REPEATS {
            let again = NewJob {
                priority: job.priority,
                why: Some("its process was lost".into()),
                retry_of: Some(job.id),
                ..NewJob::new(job.work.clone())
            };
            self.store.follow(&again).map_err(Failure::internal)?;
        }
        Ok(())
    }
}

/// What somebody should know of a job that has ended: the kind of alert, and the words.
fn alert(job: &Job, state: State, result: &JobResult) -> Option<(&'static str, String)> {
    let said = result.error.as_deref().unwrap_or("it said nothing");
    match (&job.work, state) {
        (work, State::Failed | State::Lost) => {
            Some(("job-failed", format!("job {} ({}) {state}: {said}", job.id, work.kind())))
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
