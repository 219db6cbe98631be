//! `rig daemon`: the experiment on its schedule, one run at a time, and after each the last good fit brought up to date. A
//! page and an API come later.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;
use jiff::{Timestamp, Zoned};
use serde_json::json;

use super::last_good::LastGood;
use super::progress::Bar;
use super::run::{Experiment, base, threads};
use super::signal::Interrupt;
use super::{Failure, InRun, Outcome, experiment};
use crate::claim::Claim;
use crate::clock::MonotonicNs;
use crate::config::RigConfig;
use crate::record::journal::{self, Journal};
use crate::schedule::Schedule;

/// Arguments of `rig daemon`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config, with a table `[schedule]`
    pub config: PathBuf,
    /// Folder of run folders, and of the daemon's own journal
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// End after so many runs; 0 for never
    #[arg(long, default_value_t = 0)]
    pub max_runs: u64,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<usize>,
}

/// The wall clock is looked at so often: a jump of it is noticed within this time.
const LOOK: Duration = Duration::from_secs(20);
/// The daemon's journal in the runs folder.
const JOURNAL: &str = "daemon.jsonl";
/// What the last good fit is brought up to date with, in the folder of the run.
const EXPERIMENT: &str = "experiment.toml";

/// Runs until a signal comes, or until `--max-runs` runs have ended.
///
/// # Errors
/// [`Failure::Input`] for a config or schedule that cannot be used; a run that fails is journalled and the next slot
/// awaited.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let table = config.schedule.as_ref().ok_or_else(|| {
        Failure::Input(anyhow!("{}: a daemon needs a table [schedule] with `cron`", args.config.display()))
    })?;
    let schedule = Schedule::parse(&table.cron).map_err(Failure::input)?;
    let rest = Duration::from_secs_f64(table.rest_s.map_or(0.0, ident::strict::NonNegative::get));
    let _claim = Claim::take("the runs folder", &args.runs_dir.join(".lock")).map_err(Failure::input)?;
    let path = args.runs_dir.join(JOURNAL);
    let daemon = Daemon {
        experiment: Experiment {
            config: &config,
            base: base(&args.config),
            runs_dir: &args.runs_dir,
            film_only: false,
            threads: threads(args.threads),
        },
        last_slot: last_slot(&path),
        journal: Journal::open(&path, MonotonicNs::now()).map_err(Failure::input)?,
        schedule,
        rest,
    };
    let runtime = tokio::runtime::Runtime::new().map_err(Failure::internal)?;
    runtime.block_on(daemon.serve(args.max_runs))
}

struct Daemon<'a> {
    experiment: Experiment<'a>,
    schedule: Schedule,
    rest: Duration,
    journal: Journal,
    last_slot: Option<Zoned>,
}

impl Daemon<'_> {
    async fn serve(mut self, max_runs: u64) -> Result<Outcome, Failure> {
        let interrupt = Interrupt::listen().map_err(Failure::internal)?;
        self.note("started", json!({ "pid": std::process::id() }))?;
        if let Some(before) = self.last_slot.take() {
            self.skip(&before, &Zoned::now(), "the daemon was down")?;
        }
        let mut runs = 0;
        let mut from = Zoned::now();
        while max_runs == 0 || runs < max_runs {
            let slot = self.schedule.next(&from).map_err(Failure::input)?;
            Bar::new(interrupt.flag())
                .note(&format!("next run at {}", slot.strftime("%Y-%m-%d %H:%M:%S %Z")));
            if !wait_until(&slot, &interrupt).await {
                break;
            }
            self.note("slot", json!({ "slot": slot.timestamp().to_string() }))?;
            let ended = self.experiment.run(&interrupt).await;
            runs += 1;
            self.note("run", report(&ended))?;
            if interrupt.is_raised() {
                break;
            }
            if let Ok(Outcome { run: Some(run), .. }) = &ended {
                self.recalibrate(run, &interrupt)?;
            }
            let still = Zoned::now().checked_add(self.rest).map_err(Failure::input)?;
            self.skip(&slot, &still, "the rig was busy or the water not at rest")?;
            from = still;
        }
        self.note("stopped", json!({ "runs": runs }))?;
        Ok(Outcome {
            out: Some(self.experiment.runs_dir.into()),
            text: format!("{runs} runs"),
            ..Outcome::default()
        })
    }

    /// Brings the last good fit up to date with `run`, or says why it stays. Whatever is wrong with the run's fit, the schedule
    /// goes on.
    fn recalibrate(&self, run: &Path, interrupt: &Interrupt) -> Result<(), Failure> {
        let good = LastGood::among(self.experiment.runs_dir);
        let file = run.join(EXPERIMENT);
        let update = || {
            experiment::run(&experiment::Args::of_run(run, &file))?;
            let experiment = ident::experiment::Experiment::read(&file).map_err(experiment::unfit)?;
            good.update(&experiment, &run.display().to_string(), &mut Bar::new(interrupt.flag()))
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.experiment.threads).build();
        let updated = tokio::task::block_in_place(|| pool.map_err(Failure::internal)?.install(update));
        match updated {
            Ok(verdict) if verdict.updated => {
                self.note("recalibrated", json!({ "run": run, "verdict": verdict }))
            }
            Ok(verdict) => self.note("kept", json!({ "run": run, "verdict": verdict })),
            Err(failure) => {
                let why = format!("{:#}", failure.error());
                eprintln!("rig: the last good fit stays: {why}");
                self.note("kept", json!({ "run": run, "status": failure.status(), "why": why }))
            }
        }
    }

    fn skip(&self, after: &Zoned, until: &Zoned, why: &str) -> Result<(), Failure> {
        match self.schedule.missed(after, until) {
            0 => Ok(()),
            slots => self.note("skipped", json!({ "slots": slots, "why": why })),
        }
    }

    fn note(&self, event: &str, details: serde_json::Value) -> Result<(), Failure> {
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
            () = tokio::time::sleep(left.min(LOOK)) => {}
        }
    }
}

fn report(ended: &Result<Outcome, Failure>) -> serde_json::Value {
    match ended {
        Ok(outcome) => json!({ "status": "done", "run": outcome.run }),
        Err(failure) => {
            eprintln!("rig: {:#}", failure.error());
            let run = failure.error().downcast_ref::<InRun>().map(|InRun(run)| run);
            json!({ "status": failure.status(), "run": run, "error": format!("{:#}", failure.error()) })
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
