//! `rig diagnose`: what the simulation of an experiment gets wrong, why, and what naming it gains.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::diagnose::{Diagnosed, diagnose};
use ident::experiment::{Experiment, Use};

use super::design::{failure, write_configs};
use super::progress::Bar;
use super::signal::Interrupt;
use super::{Failure, Outcome, experiment::unfit, fit::name};
use crate::record::folder::{file, write_whole};
use crate::record::timing::{Stage, Timing};
use crate::report::{self, DiagnosisFigures, ReportData};

/// Says what the simulation gets wrong, and why.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml, as written by hand or by `rig experiment`
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Folder for diagnosis.json, the extended model.xml, report.html and timing.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Threads that simulate; the result is the same for any number [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Config of the rig: with it, configs of the runs to make next are written to DIR/next
    #[arg(long, value_name = "RIG.toml")]
    config: Option<PathBuf>,
    /// Exit with 0 where nothing is detectable, 10 where a cause is named, 11 where several would do, 12 where none does
    #[arg(long)]
    exit_code: bool,
}

/// Carries out `rig diagnose`.
///
/// # Errors
/// [`Failure::Input`] for an experiment that contradicts itself, [`Failure::Data`] for one whose runs hold no
/// answer, [`Failure::Interrupted`] after Ctrl-C.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.threads == Some(0) {
        return Err(Failure::Input(anyhow!("--threads 0: at least one thread must simulate")));
    }
    let experiment = Experiment::read(&args.experiment).map_err(unfit)?;
    let text = std::fs::read_to_string(&args.experiment)
        .with_context(|| format!("reading {}", args.experiment.display()))
        .map_err(Failure::Input)?;
    let runtime = tokio::runtime::Runtime::new().map_err(Failure::internal)?;
    let interrupt = runtime.block_on(async { Interrupt::listen() }).map_err(Failure::internal)?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("creating {}", args.out.display()))
        .map_err(Failure::Input)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0))
        .build()
        .map_err(Failure::internal)?;
    let mut bar = Bar::new(interrupt.flag());
    let diagnosed = pool.install(|| diagnose(&experiment, &mut bar));
    drop(bar);
    let diagnosed = diagnosed.map_err(failure)?;

    let source = args.experiment.display().to_string();
    let timing = Timing {
        workers: diagnosed.timing.threads,
        stages: vec![Stage { name: "diagnosis".into(), wall_s: diagnosed.timing.wall.as_secs_f64() }],
    };
    let held_out = experiment.runs.iter().filter(|run| run.usage == Use::Holdout).count();
    let data = ReportData {
        id: name(&args.experiment),
        date: jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%S UTC").to_string(),
        description: format!(
            "Diagnosis of {} on {} runs, {held_out} held out.",
            experiment.model.name,
            experiment.runs.len() - held_out
        ),
        timing: timing.clone(),
        provenance: vec![
            ("rig".into(), env!("CARGO_PKG_VERSION").into()),
            ("experiment".into(), source.clone()),
            ("model".into(), experiment.model.name.clone()),
        ],
        config_toml: Some(text),
        diagnosis: Some(DiagnosisFigures::new(&diagnosed)),
        ..ReportData::default()
    };
    write_results(&diagnosed, &source, &args.out)?;
    timing.write(&args.out.join(file::TIMING)).map_err(Failure::internal)?;
    write_whole(&args.out.join(file::REPORT), report::render(&data).as_bytes()).map_err(Failure::internal)?;

    if let Some(config) = &args.config {
        write_configs(config, &diagnosed.next, &args.out.join("next"))?;
    }
    let verdict = diagnosed.diagnosis.verdict;
    Ok(Outcome {
        out: Some(args.out.clone()),
        verdict: Some(verdict.name().into()),
        exit_code: if args.exit_code { verdict.exit_code() } else { 0 },
        text: format!(
            "{}\n{}\n",
            report::diagnosis_summary(&diagnosed.diagnosis),
            args.out.join(file::REPORT).display()
        ),
        ..Outcome::default()
    })
}

/// Writes `diagnosis.json` and the extended `model.xml` to `folder`; `source` says in the model what it was made from.
///
/// # Errors
/// [`Failure::Internal`] when the folder cannot be written.
pub fn write_results(diagnosed: &Diagnosed, source: &str, folder: &Path) -> Result<(), Failure> {
    let diagnosis = &diagnosed.diagnosis;
    let json = diagnosis.to_json().map_err(Failure::internal)?;
    write_whole(&folder.join(file::DIAGNOSIS), json.as_bytes()).map_err(Failure::internal)?;
    let folded = diagnosed.model.folded();
    let mut comment =
        format!("Diagnosed by rig {} on {source}: {}.", env!("CARGO_PKG_VERSION"), diagnosis.verdict.name());
    let names: Vec<&str> = diagnosis.causes.iter().map(|cause| cause.name.as_str()).collect();
    if !names.is_empty() {
        comment.push_str(&format!(" Extended by {}, kept as custom numbers.", names.join(", ")));
    }
    if !folded.lost.is_empty() {
        let lost: Vec<&str> = folded.lost.iter().map(|cause| cause.name()).collect();
        comment.push_str(&format!(" MuJoCo itself moves without {}.", lost.join(", ")));
    }
    write_whole(&folder.join(file::MODEL), diagnosed.model.to_mjcf(&comment).as_bytes())
        .map_err(Failure::internal)
}
