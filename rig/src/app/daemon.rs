//! The experiment on its schedule, one run at a time, and after each the last good fit brought up to date. A page and an API
//! come later.

use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use ident::experiment::Use;
use ident::strict::NonNegative;
use jiff::{Timestamp, Zoned};
use serde_json::json;

use super::compose::compose;
use super::experiment::{Done, Experiment};
use super::last_good::LastGood;
use super::{Failure, Interrupt, Watcher, on_threads};
use crate::claim::Claim;
use crate::clock::MonotonicNs;
use crate::record::journal::{self, Journal};
use crate::schedule::Schedule;

/// The wall clock is looked at so often: a jump of it is noticed within this time.
const CLOCK_PERIOD: Duration = Duration::from_secs(20);
/// The daemon's journal in the runs folder.
const JOURNAL: &str = "daemon.jsonl";
/// What the last good fit is brought up to date with, in the folder of the run.
const EXPERIMENT: &str = "experiment.toml";

/// See the module.
pub struct Daemon<'a> {
    experiment: Experiment<'a>,
    schedule: Schedule,
    /// How long the water rests after a run.
    rest: Duration,
    journal: Journal,
    last_slot: Option<Zoned>,
    _claim: Claim,
}

impl<'a> Daemon<'a> {
    /// Of an experiment whose config has a schedule.
    ///
    /// # Errors
    /// [`Failure::Input`] for a config or schedule that cannot be used.
    pub fn new(experiment: Experiment<'a>) -> Result<Self, Failure> {
        let table = experiment.config.schedule.as_ref();
        let table =
            table.ok_or_else(|| Failure::Input(anyhow!("a daemon needs a table [schedule] with `cron`")))?;
        let schedule = Schedule::parse(&table.cron).map_err(Failure::input)?;
        let rest = Duration::from_secs_f64(table.rest_s.map_or(0.0, NonNegative::get));
        let claim = experiment.claim()?;
        let path = experiment.runs_dir.join(JOURNAL);
        Ok(Self {
            last_slot: last_slot(&path),
            journal: Journal::open(&path, MonotonicNs::now()).map_err(Failure::input)?,
            experiment,
            schedule,
            rest,
            _claim: claim,
        })
    }

    /// Runs until a signal comes, or until `max_runs` runs have ended where that is not 0. Gives how many there were.
    ///
    /// # Errors
    /// [`Failure::Input`] when the schedule comes to an end. A run that fails is journalled and the next slot awaited.
    pub async fn serve(
        mut self,
        max_runs: u64,
        interrupt: &Interrupt,
        watcher: &mut dyn Watcher,
    ) -> Result<u64, Failure> {
        self.write("started", json!({ "pid": std::process::id() }))?;
        if let Some(before) = self.last_slot.take() {
            self.skip(&before, &Zoned::now(), "the daemon was down")?;
        }
        let mut runs = 0;
        let mut from = Zoned::now();
        while max_runs == 0 || runs < max_runs {
            let slot = self.schedule.next(&from).map_err(Failure::input)?;
            watcher.note(&format!("next run at {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
            if !wait_until(&slot, interrupt).await {
                break;
            }
            self.write("slot", json!({ "slot": slot.timestamp().to_string() }))?;
            let ended = self.experiment.carry_out(interrupt, watcher).await;
            runs += 1;
            self.write("run", report(&ended, watcher))?;
            if interrupt.is_raised() {
                break;
            }
            if let Ok(Done { conducted, .. }) = &ended {
                self.recalibrate(conducted.folder.path(), watcher)?;
            }
            let still = Zoned::now().checked_add(self.rest).map_err(Failure::input)?;
            self.skip(&slot, &still, "the rig was busy or the water not at rest")?;
            from = still;
        }
        self.write("stopped", json!({ "runs": runs }))?;
        Ok(runs)
    }

    /// Brings the last good fit up to date with `run`, or says why it stays. Whatever is wrong with the run's fit, the schedule
    /// goes on.
    fn recalibrate(&self, run: &Path, watcher: &mut dyn Watcher) -> Result<(), Failure> {
        let good = LastGood::among(self.experiment.runs_dir);
        let experiment = compose(&[(Use::Fit, run)], None, &run.join(EXPERIMENT));
        let updated = experiment.and_then(|experiment| {
            let source = run.display().to_string();
            let update = || good.update(&experiment, &source, watcher);
            tokio::task::block_in_place(|| on_threads(self.experiment.threads, update))
        });
        watcher.clear();
        match updated {
            Ok(verdict) if verdict.updated => {
                self.write("recalibrated", json!({ "run": run, "verdict": verdict }))
            }
            Ok(verdict) => self.write("kept", json!({ "run": run, "verdict": verdict })),
            Err(failure) => {
                let why = format!("{:#}", failure.error());
                watcher.tell(&format!("rig: the last good fit stays: {why}"));
                self.write("kept", json!({ "run": run, "status": failure.status(), "why": why }))
            }
        }
    }

    fn skip(&self, after: &Zoned, until: &Zoned, why: &str) -> Result<(), Failure> {
        match self.schedule.missed(after, until) {
            0 => Ok(()),
            slots => self.write("skipped", json!({ "slots": slots, "why": why })),
        }
    }

    fn write(&self, event: &str, details: serde_json::Value) -> Result<(), Failure> {
        self.journal.write(event, details).map_err(Failure::internal)
    }
}

/// Waits for a wall-clock time; false when a signal came first. Looks at the clock again and again, since it may jump.
async fn wait_until(slot: &Zoned, interrupt: &Interrupt) -> bool {
    loop {
        let left = Duration::try_from(slot.timestamp().duration_since(Timestamp::now())).unwrap_or_default();
        if left.is_zero() {
            return !interrupt.is_raised();
        }
        tokio::select! {
            () = interrupt.raised() => return false,
            () = tokio::time::sleep(left.min(CLOCK_PERIOD)) => {}
        }
    }
}

fn report(ended: &Result<Done, Failure>, watcher: &mut dyn Watcher) -> serde_json::Value {
    match ended {
        Ok(done) => json!({ "status": "done", "run": done.conducted.folder.path() }),
        Err(failure) => {
            let why = format!("{:#}", failure.error());
            watcher.tell(&format!("rig: {why}"));
            json!({ "status": failure.status(), "run": failure.run(), "error": why })
        }
    }
}

/// The last slot that an earlier daemon took, from its journal.
fn last_slot(path: &std::path::Path) -> Option<Zoned> {
    let entries = journal::read(path).ok()?;
    let slot = entries.iter().rev().find(|entry| entry.event == "slot")?;
    let at: Timestamp = slot.details.get("slot")?.as_str()?.parse().ok()?;
    Some(at.to_zoned(jiff::tz::TimeZone::system()))
}
