//! One rig of a daemon: its queue, its schedule, and its two lanes: one job that moves the rig and one that only computes.
//!
//! - `motion`: the conditions for beginning a motion, and the schedule;
//! - `ended`: what follows from a job that has ended;
//! - `owed`: what has happened and cannot be written at once, as on a full disk.
//!
//! Nothing here blocks. An error of the disk or the database does not end the daemon: no motion begins, the error is logged, and the
//! work is tried again. The hold is checked first, each time.

mod ended;
mod motion;
mod owed;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use ground::strict::Seconds;
use jiff::{SignedDuration, Timestamp};
use serde_json::json;
use tokio::sync::watch;

use self::owed::Owed;
use super::Heartbeat;
use super::alerts::Alerts;
use super::api::Served;
use super::child::{Jobs, Processes, Running};
use super::slots::Slots;
use super::state::{Doing, RigState};
use super::stop::Stop;
use app::experiment::{Experiment, Extent};
use app::{Failure, HARDWARE_FAULT, Watcher, base, hand_in, retention};
use config::RigConfig;
use ground::claim::Claim;
use ground::clock::{MonotonicNs, Now};
use ground::error_chain::with_causes;
use ground::hold::Hold;
use record::files::create_folder;
use record::journal::{self, Journal};
use run::open;
use servo::motion::{Motion, Standing, standing};
use store::Store;
use store::job::{Lane, State};

/// The daemon's journal in the folder of run folders.
const JOURNAL: &str = "daemon.jsonl";
/// The queue is checked this often even if it has not changed: the time of a job may have come. Chosen.
const QUEUE_CHECK_INTERVAL: SignedDuration = SignedDuration::from_secs(1);
/// The API request that asks for a stop writes the hold, with name and reason, within this time; else it is written here. Chosen.
const HOLD_WRITE_TIMEOUT: Duration = Duration::from_millis(200);
/// The files of hold and servo state are read this often; a stop asked of this process is checked at every tick. Chosen.
const FILE_CHECK_INTERVAL: SignedDuration = SignedDuration::from_millis(50);
/// Servos whose state is unknown are queried this often. Chosen.
const CLEAR_UP_INTERVAL: SignedDuration = SignedDuration::from_secs(2);

/// One rig: its config, its queue, its schedule and the jobs that go on.
pub(super) struct Rig {
    /// Where its config is.
    path: PathBuf,
    config: RigConfig,
    runs_dir: PathBuf,
    store: Store,
    slots: Option<Slots>,
    journal: Journal,
    jobs: Box<dyn Jobs>,
    stop: Arc<Stop>,
    /// The hold at the last check.
    held: Option<Hold>,
    servos: Standing,
    /// How long the water rests after a motion, and when this rest ends.
    rest: SignedDuration,
    rests_until: SignedDuration,
    motion: Option<Box<dyn Running>>,
    analysis: Option<Box<dyn Running>>,
    motions_ended: u64,
    /// Motions in a row that hardware has ended, since somebody released the rig.
    failures: usize,
    /// What has happened and is not written yet, the oldest first.
    owed: VecDeque<Owed>,
    state: watch::Sender<RigState>,
    alerts: Alerts,
    /// Version of the queue at the last check, and when that was; `None` asks for a check.
    queue_check: (i64, Option<SignedDuration>),
    last_clear_up: SignedDuration,
    last_file_check: SignedDuration,
    waits: Option<String>,
    trouble: Option<String>,
    _claim: Option<Claim>,
}

impl Rig {
    /// The rig of the config at `path`, whose runs are in `runs_dir`. Jobs that an earlier daemon began are adopted if their processes
    /// still live, and marked as lost if not.
    ///
    /// # Errors
    /// [`Failure::Input`] for a config or schedule that cannot be used, and where another daemon has the folder.
    pub(super) fn open(
        path: &Path,
        runs_dir: &Path,
        threads: usize,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, Failure> {
        let config = RigConfig::read(path).map_err(Failure::input)?;
        // errors of the config are reported now, not at the first run
        let extent = Extent::Report;
        let experiment = Experiment {
            config: &config,
            base: base(path),
            runs_dir,
            extent,
            motion: None,
            threads,
            announced: true,
        };
        experiment.check()?;
        create_folder(runs_dir).map_err(Failure::input)?;
        let claim = Claim::take("the runs folder", &hand_in::lock(runs_dir)).map_err(Failure::input)?;
        let path = std::path::absolute(path).map_err(Failure::input)?;
        let runs_dir = std::path::absolute(runs_dir).map_err(Failure::input)?;
        let jobs = Processes { runs_dir: runs_dir.clone(), config: path.clone(), threads, clearing: None };
        let store = Store::open(&runs_dir).map_err(Failure::input)?;
        let mut rig = Self::new(path, config, runs_dir, store, Box::new(jobs), Now::read())?;
        rig._claim = Some(claim);
        rig.write("started", json!({ "pid": std::process::id() }))?;
        rig.take_over(watcher)?;
        if rig.motion.is_none() {
            rig.jobs.clear_up();
        }
        Ok(rig)
    }

    fn new(
        path: PathBuf,
        config: RigConfig,
        runs_dir: PathBuf,
        store: Store,
        jobs: Box<dyn Jobs>,
        now: Now,
    ) -> Result<Self, Failure> {
        let latch = open::latch(&config, Some(&runs_dir));
        latch.make_room().map_err(Failure::input)?;
        // a locked database must not delay a stop
        store.disable_lock_wait().map_err(Failure::input)?;
        let failures = config.motion.failures_to_hold.get();
        // failures before the last release do not count
        let released = latch.released().map(|(at, _)| at).unwrap_or_default();
        let failures = store.failures_in_a_row(failures, &released).map_err(Failure::input)?;
        let journal = runs_dir.join(JOURNAL);
        let table = config.schedule.as_ref();
        let slots = table.map(|table| Slots::new(table, last_slot(&journal), now));
        let rest = table.and_then(|table| table.rest_s).map_or(Duration::ZERO, Seconds::duration);
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let alerts = Alerts::new(name.clone(), config.alerts.clone());
        let state = RigState { name, experiment: config.run.name.clone(), ..RigState::default() };
        Ok(Self {
            path,
            store,
            slots: slots.transpose().map_err(Failure::input)?,
            journal: Journal::open(&journal, MonotonicNs::now()).map_err(Failure::input)?,
            jobs,
            stop: Arc::new(Stop::new(latch)),
            held: None,
            servos: Standing::default(),
            rest: SignedDuration::try_from(rest).unwrap_or(SignedDuration::MAX),
            rests_until: SignedDuration::ZERO,
            motion: None,
            analysis: None,
            motions_ended: 0,
            failures,
            owed: VecDeque::new(),
            state: watch::channel(state).0,
            alerts,
            queue_check: (0, None),
            last_clear_up: SignedDuration::MIN,
            last_file_check: SignedDuration::MIN,
            waits: None,
            trouble: None,
            _claim: None,
            config,
            runs_dir,
        })
    }

    /// Takes over the jobs that an earlier daemon left running.
    fn take_over(&mut self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        for job in self.store.running().map_err(Failure::internal)? {
            match self.jobs.adopt(&job) {
                Some(running) => {
                    self.write("job-adopted", json!({ "job": job.id }))?;
                    if job.work.lane() == Lane::Motion {
                        self.stop.set_motion_process(Some(running.pid()));
                    }
                    *self.running_job(job.work.lane()) = Some(running);
                }
                None => {
                    let folder = hand_in::folder(&self.runs_dir, job.id);
                    let (state, result) = super::child::result(&folder, "the daemon and the job were killed");
                    self.close(&job, state, result, watcher)?;
                }
            }
        }
        Ok(())
    }

    fn running_job(&mut self, lane: Lane) -> &mut Option<Box<dyn Running>> {
        match lane {
            Lane::Motion => &mut self.motion,
            Lane::Analysis => &mut self.analysis,
        }
    }

    /// One step of the daemon's loop for this rig; does not block.
    pub(super) fn tick(&mut self, now: Now, may: Permissions, watcher: &mut dyn Watcher) {
        if self.stop.is_asked() || now.boot.saturating_sub(self.last_file_check) >= FILE_CHECK_INTERVAL {
            self.last_file_check = now.boot;
            self.update_hold();
            self.servos = standing(&self.runs_dir);
            self.stop.set_at_rest(!self.servos.may_move());
        }
        if let Some(motion) = &mut self.motion
            && (may.end_all || self.held.is_some() && self.servos.may_move())
        {
            motion.end();
        }
        let trouble = self.work(now, may, watcher).err().map(|failure| format!("{:#}", failure.error()));
        if trouble != self.trouble {
            match &trouble {
                Some(trouble) => tracing::warn!("{trouble}; trying again"),
                None => tracing::warn!("the daemon goes on"),
            }
            self.trouble = trouble;
            // check the queue again
            self.queue_check.1 = None;
        }
        self.publish_state(now);
    }

    /// Writes the hold that was asked for, and reports a new hold or its end.
    fn update_hold(&mut self) {
        let written = self.stop.write(HOLD_WRITE_TIMEOUT);
        let held = self.stop.held();
        if let Err(error) = written {
            tracing::error!("the rig is held by the daemon alone: {}", with_causes(&error));
        }
        if held.is_some() == self.held.is_some() {
            self.held = held;
            return;
        }
        // journal and alert come after the stop; the hold does not depend on them
        match &held {
            Some(hold) => {
                self.owed.push_back(Owed::Line("held", json!({ "by": hold.by, "why": hold.why })));
                self.owed.push_back(Owed::alert("held", format!("the rig is {hold}"), None));
            }
            None => {
                self.failures = 0;
                let by = self.stop.released_by();
                self.owed.push_back(Owed::Line("released", json!({ "by": by })));
            }
        }
        self.held = held;
        self.queue_check.1 = None;
    }

    /// Holds the rig for a reason that the daemon itself has found.
    fn hold(&mut self, why: &str) {
        self.stop.request(Hold::now("the daemon", why));
        self.update_hold();
    }

    /// All work that needs the database or the disk, and may fail.
    fn work(&mut self, now: Now, may: Permissions, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        self.pay()?;
        for lane in [Lane::Motion, Lane::Analysis] {
            self.reap(lane, now, may, watcher)?;
        }
        self.clear_up(now, watcher)?;
        self.alerts.tick(&mut self.store).map_err(Failure::internal)?;
        self.follow_schedule(now, may, watcher)?;
        if !self.should_check_queue(now)? {
            return Ok(());
        }
        self.alerts.begin(&mut self.store).map_err(Failure::internal)?;
        for lane in [Lane::Motion, Lane::Analysis] {
            let Some(id) = self.running_job(lane).as_ref().map(|running| running.id()) else { continue };
            if self.store.job(id).map_err(Failure::internal)?.cancel.is_some()
                && let Some(running) = self.running_job(lane)
            {
                running.end();
                // check again until it has ended: it may have to be killed
                self.queue_check.1 = None;
            }
        }
        if self.motion.is_none() {
            self.begin_motion(now, may, watcher)?;
        }
        if may.compute && self.analysis.is_none() {
            self.begin(Lane::Analysis, watcher)?;
        }
        Ok(())
    }

    /// Deletes recordings as `[retention]` of the config says.
    fn retain(&self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(retention) = &self.config.retention else { return Ok(()) };
        for (run, removed) in retention::retain(&self.store, retention)? {
            watcher.event(&format!("run {run}: its recording is deleted, as [retention] says"));
            self.write(
                "recording-deleted",
                json!({ "run": run, "bytes": removed.bytes, "sha256": removed.sha256 }),
            )?;
        }
        Ok(())
    }

    /// Begins to clear up after a killed job, and records which runs were recovered.
    fn clear_up(&mut self, now: Now, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        if self.jobs.is_clearing_up() {
            let runs = self.jobs.take_recovered_runs();
            if self.jobs.is_clearing_up() {
                return Ok(());
            }
            self.queue_check.1 = None;
            for (run, what) in runs {
                watcher.alert(&format!("rig: run {run} {what}"));
                self.write("run-recovered", json!({ "run": run, "what": what }))?;
            }
            return self.retain(watcher);
        }
        let is_left = self.servos.motion != Motion::AtRest && self.motion.is_none();
        if is_left && now.boot.saturating_sub(self.last_clear_up) > CLEAR_UP_INTERVAL {
            self.last_clear_up = now.boot;
            self.jobs.clear_up();
        }
        Ok(())
    }

    /// Publishes the rig's state to the API.
    fn publish_state(&self, now: Now) {
        let id = |running: &Option<Box<dyn Running>>| running.as_ref().map(|running| running.id().0);
        let next = self.slots.as_ref().and_then(|slots| slots.next(now).ok());
        let (motion, analysis) = (id(&self.motion), id(&self.analysis));
        self.state.send_if_modified(|state| {
            let before = state.clone();
            state.next_run = next.map(|slot| slot.strftime("%Y-%m-%dT%H:%M:%S%:z").to_string());
            (state.motion, state.analysis) = (motion, analysis);
            state.doing = Doing::of(self.servos.motion, motion.is_some() || analysis.is_some());
            state.servos = self.servos.clone();
            state.hold = self.held.clone();
            (state.waits, state.trouble) = (self.waits.clone(), self.trouble.clone());
            state.motions_ended = self.motions_ended;
            *state != before
        });
    }

    /// The rig's state in a few words.
    pub(super) fn status_line(&self) -> String {
        self.state.borrow().status_line()
    }

    /// The rig as the API serves it.
    ///
    /// # Errors
    /// [`Failure::Internal`] where its database cannot be opened once more.
    pub(super) fn served(&self, heartbeat: Arc<Heartbeat>) -> Result<Served, Failure> {
        let config = (self.path.clone(), self.config.clone());
        let (stop, state) = (Arc::clone(&self.stop), self.state.subscribe());
        Served::new(config, self.runs_dir.clone(), stop, state, heartbeat).map_err(Failure::internal)
    }

    /// Whether the queue has changed, or has not been checked for [`QUEUE_CHECK_INTERVAL`].
    fn should_check_queue(&mut self, now: Now) -> Result<bool, Failure> {
        let version = self.store.version().map_err(Failure::internal)?;
        let (last_version, at) = self.queue_check;
        let due = version != last_version
            || at.is_none_or(|at| now.boot.saturating_sub(at) >= QUEUE_CHECK_INTERVAL);
        if due {
            self.queue_check = (version, Some(now.boot));
        }
        Ok(due)
    }

    fn reap(
        &mut self,
        lane: Lane,
        now: Now,
        may: Permissions,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        let Some(running) = self.running_job(lane) else { return Ok(()) };
        if may.end_all {
            running.end();
        }
        let Some((state, result)) = running.ended()? else { return Ok(()) };
        let id = running.id();
        self.queue_check.1 = None;
        let job = self.store.job(id).map_err(Failure::internal)?;
        let ended_by_daemon = state == State::Cancelled && job.cancel.is_none() && lane == Lane::Analysis;
        if ended_by_daemon || state == State::Queued {
            // the daemon ended it, or nothing of it was begun
            self.store.put_back(id).map_err(Failure::internal)?;
            self.clear_lane(lane);
            self.owed.push_back(Owed::Line("job-put-back", json!({ "job": id })));
            return self.pay();
        }
        let by_hardware = state == State::Lost || result.status.as_deref() == Some(HARDWARE_FAULT);
        self.close(&job, state, result, watcher)?;
        self.clear_lane(lane);
        if lane == Lane::Motion {
            self.motions_ended += 1;
            match state {
                _ if by_hardware => self.count_failure(),
                State::Done => self.failures = 0,
                _ => {}
            }
            self.rests_until = now.boot.saturating_add(self.rest);
            if state == State::Lost {
                self.jobs.clear_up();
            }
            self.pay()?;
            self.retain(watcher)?;
        }
        self.pay()
    }

    /// Forgets the job of `lane`, which is over and recorded.
    fn clear_lane(&mut self, lane: Lane) {
        *self.running_job(lane) = None;
        if lane == Lane::Motion {
            self.stop.set_motion_process(None);
        }
    }

    /// Motions that have ended since the daemon began.
    pub(super) fn motions_ended(&self) -> u64 {
        self.motions_ended
    }

    /// Whether a job computes.
    pub(super) fn computes(&self) -> bool {
        self.analysis.is_some()
    }

    /// Whether no job runs, and none that only computes waits.
    pub(super) fn is_idle(&self) -> bool {
        // if the jobs cannot be counted now, they are at the next check
        self.has_ended() && self.store.waiting(Lane::Analysis).is_ok_and(|waiting| waiting == 0)
    }

    /// Whether no job runs.
    pub(super) fn has_ended(&self) -> bool {
        self.motion.is_none() && self.analysis.is_none()
    }

    /// Writes the last entry of the journal.
    ///
    /// # Errors
    /// [`Failure::Internal`].
    pub(super) fn log_end(&self) -> Result<(), Failure> {
        self.write("stopped", json!({ "motions": self.motions_ended }))
    }

    pub(super) fn write(&self, event: &str, details: serde_json::Value) -> Result<(), Failure> {
        // synced, so that no slot is run twice after a power cut
        self.journal.write(event, details).and_then(|()| self.journal.sync()).map_err(Failure::internal)
    }
}

/// What a rig may do now.
#[derive(Debug, Clone, Copy)]
pub(super) struct Permissions {
    /// Begin a motion.
    pub(super) move_: bool,
    /// Begin a job that only computes.
    pub(super) compute: bool,
    /// All jobs are to end.
    pub(super) end_all: bool,
}

/// The last slot that an earlier daemon took, from its journal.
fn last_slot(path: &Path) -> Option<Timestamp> {
    let entries = journal::read(path).ok()?;
    let slot = entries.iter().rev().find(|entry| entry.event == "slot")?;
    slot.details.get("slot")?.as_str()?.parse().ok()
}
