//! `rig run`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::progress::Bar;
use super::{Failure, Outcome};
use app::compose::degraded;
use app::experiment::{Done, Experiment, Extent};
use app::hand_in::{self, hand_in};
use app::{base, interruptible, threads};
use config::RigConfig;
use store::job::{NewJob, Work};

/// Arguments of `rig run`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config
    pub config: PathBuf,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Film only; leave extraction and fit to `rig replay`
    #[arg(long)]
    pub film_only: bool,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Runs the experiment once; where a daemon holds the rig, that does it.
///
/// # Errors
/// As [`Experiment::claim`] and [`Experiment::carry_out`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let experiment = Experiment {
        config: &config,
        base: base(&args.config),
        runs_dir: &args.runs_dir,
        extent: if args.film_only { Extent::Film } else { Extent::Report },
        motion: None,
        threads: threads(args.threads),
        announced: hand_in::is_job(),
    };
    if hand_in::daemon(&args.runs_dir).is_some() {
        return handed_in(args);
    }
    let _claim = experiment.claim()?;
    interruptible(async |interrupt| {
        let Done { conducted, data } =
            experiment.carry_out(interrupt, &mut Bar::new(interrupt.flag())).await?;
        let folder = conducted.folder.path();
        let mut text = format!("filmed {} images", conducted.filmed.recorded.images);
        if conducted.filmed.images.lost > 0 {
            text += &format!(", {} lost by the camera", conducted.filmed.images.lost);
        }
        if let Some(data) = &data {
            text = format!("{text}\n{}", report::written(data, folder));
        }
        let warnings = data.map_or_else(|| degraded(folder).into_iter().collect(), |data| data.warnings);
        Ok(Outcome { run: Some(folder.into()), warnings, text, ..Outcome::default() })
    })
}

fn handed_in(args: &Args) -> Result<Outcome, Failure> {
    let config = std::path::absolute(&args.config).map_err(Failure::input)?;
    let why = Some(format!("rig run, by process {}", std::process::id()));
    let job = NewJob { why, ..NewJob::new(Work::Run { config, film_only: args.film_only }) };
    interruptible(async |interrupt| {
        let result = hand_in(&args.runs_dir, &job, interrupt, &mut Bar::new(interrupt.flag())).await?.result;
        Ok(Outcome {
            text: result.run.clone().unwrap_or_default(),
            run: result.run.map(PathBuf::from),
            verdict: result.verdict,
            ..Outcome::default()
        })
    })
}
