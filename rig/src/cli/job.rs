//! `rig job`: what a daemon has ordered, in a process of its own.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use app::compose::{EXPERIMENT, compose};
use app::hand_in::Order;
use ident::experiment::Use;
use record::outputs::Outputs;
use record::run_id::RunId;
use store::job::{Chosen, Work};

use super::{Failure, Outcome, campaign, design, diagnose, fit, recalibrate, replay, run};

/// Arguments of `rig job`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The job's folder, which holds its order
    pub folder: PathBuf,
}

/// Carries the order out.
///
/// # Errors
/// As the verb that does such work.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let order = Order::read(&args.folder)?;
    let (threads, runs_dir) = (NonZeroUsize::new(order.threads), order.runs_dir.clone());
    match &order.work {
        Work::Run { config, film_only } => {
            let (config, film_only) = (config.clone(), *film_only);
            run::run(&run::Args { config, runs_dir, film_only, threads })
        }
        Work::Recalibrate { run } => {
            recalibrate::run(&recalibrate::Args { run: runs_dir.join(run.as_str()), runs_dir, threads })
        }
        Work::Replay { run, from } => {
            let (run, out, from) = (runs_dir.join(run.as_str()), order.out.clone(), *from);
            replay::run(&replay::Args { run, out, from, config: None, overlay: None, threads })
        }
        Work::Fit(chosen) => {
            let (experiment, out) = (experiment(&order, chosen)?, order.out.clone());
            fit::run(&fit::Args { experiment, out, threads, resume: false, profile: false, prior: None })
        }
        Work::Diagnose(chosen) => {
            let (experiment, out, config) =
                (experiment(&order, chosen)?, order.out.clone(), Some(order.config.clone()));
            diagnose::run(&diagnose::Args { experiment, out, threads, config, exit_code: false })
        }
        Work::Design(chosen) => {
            let (experiment, out, config) =
                (experiment(&order, chosen)?, Some(order.out.clone()), Some(order.config.clone()));
            design::run(&design::Args { experiment, parameters: Vec::new(), config, out })
        }
        Work::Campaign { config, goals, max_runs } => campaign::run(&campaign::Args {
            config: config.clone(),
            goals: goals.clone(),
            resolve: goals.is_empty(),
            max_runs: *max_runs,
            runs_dir,
            out: Some(order.out.clone()),
            threads,
        }),
    }
}

/// Writes the experiment of the `chosen` runs.
fn experiment(order: &Order, chosen: &Chosen) -> Result<PathBuf, Failure> {
    let path = |id: &RunId| order.runs_dir.join(id.as_str());
    let fitted: Vec<PathBuf> = chosen.runs.iter().map(path).collect();
    let held_out: Vec<PathBuf> = chosen.holdout.iter().map(path).collect();
    let runs = fitted.iter().map(|path| (Use::Fit, path.as_path()));
    let runs: Vec<_> = runs.chain(held_out.iter().map(|path| (Use::Holdout, path.as_path()))).collect();
    let file = order.out.join(EXPERIMENT);
    let read = runs.iter().map(|(_, path)| path.to_path_buf());
    compose(&runs, None, true, &Outputs::reading(read).file(&file)?)?;
    Ok(file)
}
