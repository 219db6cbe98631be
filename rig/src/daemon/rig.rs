//! One rig of a daemon: its queue, its schedule, and the two jobs that may run at a time, one that moves it and one that computes; in
//! `ended`, what follows from one that has ended.

mod ended;

use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ident::strict::Seconds;
use jiff::Timestamp;
use serde_json::json;

use tokio::sync::watch;

use super::alerts::Alerts;
use super::api::Served;
use super::child::Running;
use super::slots::{Busy, Decision, Slots};
use super::state::RigState;
use crate::app::experiment::{Experiment, Extent};
use crate::app::{Failure, Watcher, base, hand_in, recover, retention};
use crate::claim::Claim;
use crate::clock::MonotonicNs;
use crate::config::{RetentionConfig, RigConfig};
use crate::record::files::create_folder;
use crate::record::journal::{self, Journal};
use crate::record::run_id::RunId;
use crate::store::Store;
use crate::store::job::{JobResult, Lane, NewJob, State, Work};

/// The daemon's journal in the folder of run folders.
const JOURNAL: &str = "daemon.jsonl";
/// The queue is looked at so often although nothing changed in it: a job's time may have come.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// See the module.
pub(super) struct Rig {
    config: PathBuf,
    runs_dir: PathBuf,
    store: Store,
    slots: Option<Slots>,
    journal: Journal,
    threads: usize,
    retention: Option<RetentionConfig>,
    /// How long the water is left alone after a motion.
    rest: Duration,
    rests_until: Option<Instant>,
    motion: Option<Running>,
    analysis: Option<Running>,
    /// Runs that ended without a word are made whole; nothing moves meanwhile.
    recovering: Option<JoinHandle<Vec<(RunId, String)>>>,
    motions_ended: u64,
    state: watch::Sender<RigState>,
    alerts: Alerts,
    /// The queue as it was last looked at.
    seen: (i64, Option<Instant>),
    _claim: Claim,
}

impl Rig {
    /// The rig of the config at `path`, whose runs are in `runs_dir`. Jobs that an earlier daemon began are waited for where their
    /// processes live, and are lost where not.
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
        // what no run of it could do is said now, not every night
        let extent = Extent::Report;
        Experiment { config: &config, base: base(path), runs_dir, extent, motion: None, threads }.check()?;
        create_folder(runs_dir).map_err(Failure::input)?;
        let claim = Claim::take("the runs folder", &hand_in::lock(runs_dir)).map_err(Failure::input)?;
        let journal_path = runs_dir.join(JOURNAL);
        let table = config.schedule.as_ref();
        let slots = table.map(|table| Slots::new(table, last_slot(&journal_path), Timestamp::now()));
        let rest = table.and_then(|table| table.rest_s).map_or(Duration::ZERO, Seconds::duration);
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut rig = Self {
            config: std::path::absolute(path).map_err(Failure::input)?,
            runs_dir: std::path::absolute(runs_dir).map_err(Failure::input)?,
            store: Store::open(runs_dir).map_err(Failure::input)?,
            slots: slots.transpose().map_err(Failure::input)?,
            journal: Journal::open(&journal_path, MonotonicNs::now()).map_err(Failure::input)?,
            threads,
            retention: config.retention.clone(),
            rest,
            rests_until: None,
            motion: None,
            analysis: None,
            recovering: None,
            motions_ended: 0,
            state: watch::channel(RigState::default()).0,
            alerts: Alerts::new(name.clone(), config.alerts.clone()),
            seen: (0, None),
            _claim: claim,
        };
        rig.state.send_modify(|state| {
            state.name = name;
            state.experiment = config.run.name.clone();
        });
        rig.write("started", json!({ "pid": std::process::id() }))?;
        rig.take_over(watcher)?;
        if rig.motion.is_none() {
            rig.recovering = Some(recover::beside(&rig.runs_dir));
        }
        Ok(rig)
    }

    /// Takes over what an earlier daemon left behind.
    fn take_over(&mut self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        for job in self.store.running().map_err(Failure::internal)? {
            match Running::adopt(&job, &self.runs_dir) {
                Some(running) => {
                    self.write("job-adopted", json!({ "job": job.id }))?;
                    *self.place(job.work.lane()) = Some(running);
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

    fn place(&mut self, lane: Lane) -> &mut Option<Running> {
        match lane {
            Lane::Motion => &mut self.motion,
            Lane::Analysis => &mut self.analysis,
        }
    }

    /// One look at everything. Nothing here waits.
    ///
    /// # Errors
    /// [`Failure::Internal`] where queue or journal cannot be written.
    pub(super) fn tick(&mut self, may: May, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        for lane in [Lane::Motion, Lane::Analysis] {
            self.reap(lane, may, watcher)?;
        }
        self.hear_of_recovered(watcher)?;
        self.tell();
        self.alerts.tick(&mut self.store).map_err(Failure::internal)?;
        if self.slots.is_some() && may.move_ {
            self.look_at_schedule(watcher)?;
        }
        if !self.is_worth_a_look()? {
            return Ok(());
        }
        self.alerts.begin(&mut self.store).map_err(Failure::internal)?;
        for lane in [Lane::Motion, Lane::Analysis] {
            let Some(id) = self.place(lane).as_ref().map(|running| running.id) else { continue };
            if self.store.job(id).map_err(Failure::internal)?.cancel.is_some()
                && let Some(running) = self.place(lane)
            {
                running.end();
                // until it has: it may have to be killed
                self.seen.1 = None;
            }
        }
        let rested = self.rests_until.is_none_or(|until| Instant::now() >= until);
        if may.move_ && rested && self.motion.is_none() && self.recovering.is_none() {
            self.begin(Lane::Motion, watcher)?;
        }
        if may.compute && self.analysis.is_none() {
            self.begin(Lane::Analysis, watcher)?;
        }
        Ok(())
    }

    /// Deletes the recordings that the config says are too many.
    fn retain(&self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(retention) = &self.retention else { return Ok(()) };
        for (run, removed) in retention::retain(&self.store, retention)? {
            watcher.note(&format!("run {run}: its recording is deleted, as [retention] says"));
            self.write(
                "recording-deleted",
                json!({ "run": run, "bytes": removed.bytes, "sha256": removed.sha256 }),
            )?;
        }
        Ok(())
    }

    /// Takes in what became of runs that had ended without a word.
    fn hear_of_recovered(&mut self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(recovering) = self.recovering.take_if(|recovering| recovering.is_finished()) else {
            return Ok(());
        };
        self.seen.1 = None;
        // a panic has said so by itself, and the next run tries again
        for (run, said) in recovering.join().unwrap_or_default() {
            watcher.tell(&format!("rig: run {run} {said}"));
            self.write("run-recovered", json!({ "run": run, "what": said }))?;
        }
        self.retain(watcher)
    }

    /// Tells whoever looks on what the rig does.
    fn tell(&self) {
        let id = |running: &Option<Running>| running.as_ref().map(|running| running.id.0);
        let next = self.slots.as_ref().and_then(|slots| slots.next().ok());
        let (motion, analysis) = (id(&self.motion), id(&self.analysis));
        let rests = self.rests_until.is_some_and(|until| Instant::now() < until);
        self.state.send_if_modified(|state| {
            let before = state.clone();
            state.next_run = next.map(|slot| slot.strftime("%Y-%m-%dT%H:%M:%S%:z").to_string());
            (state.motion, state.analysis, state.rests) = (motion, analysis, rests);
            state.motions_ended = self.motions_ended;
            *state != before
        });
    }

    /// What it does, in a few words.
    pub(super) fn says(&self) -> String {
        let state = self.state.borrow();
        let what = match (state.motion, state.analysis, &state.next_run) {
            (Some(job), ..) => format!("job {job} moves it"),
            (None, Some(job), _) => format!("job {job} computes"),
            (None, None, Some(next)) => format!("next run at {next}"),
            (None, None, None) => "waits for jobs".into(),
        };
        format!("{}: {what}", state.name)
    }

    /// What a server needs to know of it.
    ///
    /// # Errors
    /// [`Failure::Internal`] where its database cannot be opened once more.
    pub(super) fn served(&self) -> Result<Served, Failure> {
        Served::new(self.config.clone(), self.runs_dir.clone(), self.state.subscribe())
            .map_err(Failure::internal)
    }

    /// Whether the queue changed, or has not been looked at for a while.
    fn is_worth_a_look(&mut self) -> Result<bool, Failure> {
        let version = self.store.version().map_err(Failure::internal)?;
        let (seen, at) = self.seen;
        let worth = version != seen || at.is_none_or(|at| at.elapsed() >= LOOK_EVERY);
        if worth {
            self.seen = (version, Some(Instant::now()));
        }
        Ok(worth)
    }

    fn look_at_schedule(&mut self, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let resting = self.rests_until.is_some_and(|until| Instant::now() < until);
        let busy = || -> Result<Busy, Failure> {
            Ok(match self.store.waiting(Lane::Motion).map_err(Failure::internal)? {
                0 if self.motion.is_none() && !resting => Busy::Free,
                0 => Busy::Moving,
                _ => Busy::Waiting,
            })
        };
        let now = Timestamp::now();
        let Some(slots) = &mut self.slots else { return Ok(()) };
        if !slots.is_due(now) {
            return Ok(());
        }
        for decision in slots.due(now, busy()?) {
            match decision {
                Decision::Run(slot) => {
                    self.write("slot", json!({ "slot": slot.timestamp().to_string() }))?;
                    let work = Work::Run { config: self.config.clone(), film_only: false };
                    let why = Some(format!("scheduled for {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
                    self.store.follow(&NewJob { why, ..NewJob::new(work) }).map_err(Failure::internal)?;
                    self.seen.1 = None;
                }
                Decision::Skip { slots, why } => {
                    self.write("skipped", json!({ "slots": slots, "why": why }))?
                }
            }
        }
        self.say_next(watcher);
        Ok(())
    }

    /// Says when the next run is.
    pub(super) fn say_next(&self, watcher: &mut dyn Watcher) {
        if let Some(Ok(slot)) = self.slots.as_ref().map(Slots::next) {
            watcher.note(&format!("next run at {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
        }
    }

    fn begin(&mut self, lane: Lane, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(job) = self.store.take(lane).map_err(Failure::internal)? else { return Ok(()) };
        watcher.note(&format!("job {}: {}", job.id, job.work.kind()));
        let origin = self.store.origin(job.id).map_err(Failure::internal)?;
        match Running::start((&job, origin), &self.runs_dir, &self.config, self.threads) {
            Ok(running) => {
                let pid = running.pid().as_raw_nonzero().get().unsigned_abs();
                *self.place(lane) = Some(running);
                self.store.began(job.id, pid).map_err(Failure::internal)?;
                self.write("job-began", json!({ "job": job.id, "work": job.work, "pid": pid }))
            }
            Err(failure) => {
                let error = Some(format!("{:#}", failure.error()));
                self.close(&job, State::Failed, JobResult { error, ..JobResult::default() }, watcher)
            }
        }
    }

    fn reap(&mut self, lane: Lane, may: May, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let Some(running) = self.place(lane) else { return Ok(()) };
        if may.end_all {
            running.end();
        }
        let Some((state, result)) = running.ended()? else { return Ok(()) };
        let id = running.id;
        *self.place(lane) = None;
        self.seen.1 = None;
        let job = self.store.job(id).map_err(Failure::internal)?;
        if state == State::Cancelled && job.cancel.is_none() && lane == Lane::Analysis {
            // the daemon ended, not the job
            self.write("job-put-back", json!({ "job": id }))?;
            return self.store.put_back(id).map_err(Failure::internal);
        }
        if lane == Lane::Motion {
            self.motions_ended += 1;
            self.retain(watcher)?;
            self.rests_until = Some(Instant::now() + self.rest);
            if state == State::Lost {
                self.recovering = Some(recover::beside(&self.runs_dir));
            }
        }
        self.close(&job, state, result, watcher)
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
    pub(super) fn is_idle(&self) -> Result<bool, Failure> {
        Ok(self.has_ended() && self.store.waiting(Lane::Analysis).map_err(Failure::internal)? == 0)
    }

    /// Whether no job runs.
    pub(super) fn has_ended(&self) -> bool {
        self.motion.is_none() && self.analysis.is_none()
    }

    /// The last words in the journal.
    ///
    /// # Errors
    /// [`Failure::Internal`].
    pub(super) fn say_end(&self) -> Result<(), Failure> {
        self.write("stopped", json!({ "motions": self.motions_ended }))
    }

    pub(super) fn write(&self, event: &str, details: serde_json::Value) -> Result<(), Failure> {
        // a slot that was taken is not taken again after a power cut
        self.journal.write(event, details).and_then(|()| self.journal.sync()).map_err(Failure::internal)
    }
}

/// What a rig may do now.
#[derive(Debug, Clone, Copy)]
pub(super) struct May {
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
