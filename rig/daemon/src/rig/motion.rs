//! The conditions for beginning a motion, checked when it begins, not when its job was added.

use serde_json::json;

use super::owed::Owed;
use super::{Permissions, Rig};
use crate::slots::{Busy, Decision, Slots};
use app::{Failure, Watcher, announce};
use ground::clock::Now;
use servo::motion::Motion;
use store::job::{Job, JobResult, Lane, NewJob, State, Work};

impl Rig {
    /// Begins the next motion of the queue, unless something prevents it.
    pub(super) fn begin_motion(
        &mut self,
        now: Now,
        may: Permissions,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        self.waits = match self.store.waiting(Lane::Motion).map_err(Failure::internal)? {
            0 => None,
            _ => self.obstacle(now, may)?,
        };
        if self.waits.is_none() {
            self.begin_on(Lane::Motion, Some(now), watcher)?;
        }
        Ok(())
    }

    /// Why no motion begins now, in words.
    fn obstacle(&self, now: Now, may: Permissions) -> Result<Option<String>, Failure> {
        Ok(match &self.held {
            Some(hold) => Some(hold.to_string()),
            None if !may.move_ => Some("the daemon ends".into()),
            None if self.jobs.is_clearing_up() => Some("clearing up after a job that was killed".into()),
            None if self.servos.motion != Motion::AtRest => Some(format!("servos {}", self.servos)),
            None if now.boot < self.rests_until => Some("the water rests".into()),
            None => announce::too_many(&self.config, &self.runs_dir, now.wall)?,
        })
    }

    /// Begins the next job of `lane`.
    pub(super) fn begin(&mut self, lane: Lane, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        self.begin_on(lane, None, watcher)
    }

    fn begin_on(&mut self, lane: Lane, now: Option<Now>, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(job) = self.store.take(lane).map_err(Failure::internal)? else { return Ok(()) };
        if let (Some(now), Some(slots)) = (now, &self.slots)
            && job.slot.is_some()
            && slots.is_quiet(now)
        {
            let error = Some("quiet hours began before its turn came".to_owned());
            return self.close(&job, State::Cancelled, JobResult { error, ..JobResult::default() }, watcher);
        }
        watcher.event(&format!("job {}: {}", job.id, job.work.kind()));
        match self.start(&job) {
            Ok(pid) => {
                self.store.began(job.id, pid).map_err(Failure::internal)?;
                let what = json!({ "job": job.id, "work": job.work, "pid": pid });
                self.owed.push_back(Owed::Line("job-began", what));
                self.pay()
            }
            Err(failure) => {
                let error = Some(format!("{:#}", failure.error()));
                self.close(&job, State::Failed, JobResult { error, ..JobResult::default() }, watcher)
            }
        }
    }

    /// Starts `job`; gives its process.
    fn start(&mut self, job: &Job) -> Result<u32, Failure> {
        let origin = self.store.origin(job.id).map_err(Failure::internal)?;
        let running = self.jobs.start(job, origin)?;
        let pid = running.pid();
        if job.work.lane() == Lane::Motion {
            self.stop.set_motion_process(Some(pid));
        }
        *self.running_job(job.work.lane()) = Some(running);
        Ok(pid.as_raw_nonzero().get().unsigned_abs())
    }

    /// Adds runs for the slots of the schedule that are due.
    pub(super) fn follow_schedule(
        &mut self,
        now: Now,
        may: Permissions,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        if let Some(by) = self.slots.as_mut().and_then(|slots| slots.clock_was_set(now)) {
            let what = format!("the computer's clock was set by {:.0} s", by.as_secs_f64());
            self.owed.push_back(Owed::alert("clock-set", what, None));
            self.write("clock-set", json!({ "by_s": by.as_secs_f64() }))?;
        }
        let Some(slots) = self.slots.as_ref().filter(|_| may.move_) else { return Ok(()) };
        if slots.next(now).is_ok_and(|next| next.timestamp() > now.wall) {
            return Ok(());
        }
        let is_free = self.motion.is_none() && now.boot >= self.rests_until;
        let busy = match self.store.waiting(Lane::Motion).map_err(Failure::internal)? {
            _ if self.held.is_some() => Busy::Held,
            0 if is_free => Busy::Free,
            0 => Busy::Moving,
            _ => Busy::Waiting,
        };
        for decision in self.slots.as_mut().map_or(Vec::new(), |slots| slots.due(now, busy)) {
            match decision {
                Decision::Run(slot) => {
                    self.write("slot", json!({ "slot": slot.timestamp().to_string() }))?;
                    let work = Work::Run { config: self.path.clone(), film_only: false };
                    let why = Some(format!("scheduled for {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
                    let job = NewJob { why, slot: Some(slot.timestamp()), ..NewJob::new(work) };
                    self.store.add_unlimited(&job).map_err(Failure::internal)?;
                    self.queue_check.1 = None;
                }
                Decision::Skip { slots, why } => {
                    self.write("skipped", json!({ "slots": slots, "why": why }))?
                }
            }
        }
        self.report_next_run(now, watcher);
        Ok(())
    }

    /// Reports when the next scheduled run is.
    pub(crate) fn report_next_run(&self, now: Now, watcher: &mut dyn Watcher) {
        if let Some(Ok(slot)) = self.slots.as_ref().map(|slots: &Slots| slots.next(now)) {
            watcher.event(&format!("next run at {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
        }
    }

    /// Holds the rig after too many hardware failures in a row.
    pub(super) fn count_failure(&mut self) {
        self.failures += 1;
        let most = self.config.motion.failures_to_hold.get();
        if self.held.is_none() && self.failures >= most {
            self.hold(&format!("{most} motions in a row were ended by hardware"));
        }
    }
}
