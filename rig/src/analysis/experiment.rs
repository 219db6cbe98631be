//! A run as a fit takes it.

use ident::experiment::{Experiment, Run, RunKind};
use sim::{Model, Trajectory};

use super::error::AnalysisError;
use super::timeline::Timeline;
use crate::config::RigConfig;
use crate::record::RecordError;
use crate::record::folder::RunFolder;

/// The model that `run` was made with.
pub(super) fn model(run: &RunFolder) -> Result<Model, AnalysisError> {
    let path = run.file(&run.start().model);
    let text = std::fs::read_to_string(&path).map_err(RecordError::io("reading", &path))?;
    Model::from_mjcf(&text).map_err(|source| AnalysisError::Model { path, source })
}

/// `run` as a fit takes it, with the keypoints of its `trajectory`.
pub(super) fn experiment(
    run: &RunFolder,
    config: &RigConfig,
    timeline: &Timeline,
    trajectory: Trajectory,
) -> Result<Experiment, AnalysisError> {
    let start = run.start();
    let mut model = model(run)?;
    let mut fit = config.fit.clone();
    config.mechanism.weights().put_into(&config.water.water(), &mut model, &mut fit)?;
    let kind = start.kind;
    let run = Run {
        command: timeline.command.clone().filter(|_| kind == RunKind::Driven),
        prescribed: start.prescribed && kind == RunKind::Driven,
        ..Run::new(start.id.as_str(), kind, trajectory)
    };
    Ok(Experiment { model, noise_m: None, fit, runs: vec![run] })
}
