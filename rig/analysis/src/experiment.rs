//! A run as a fit takes it.

use config::measured;
use ident::experiment::{CauseConfig, Experiment, ExperimentError, Run, RunKind};
use sim::{Model, Trajectory};

use super::error::AnalysisError;
use super::timeline::Timeline;
use config::{MotionKind, RigConfig};
use record::RecordError;
use record::folder::RunFolder;

/// The model that `run` was made with.
pub(super) fn model(run: &RunFolder) -> Result<Model, AnalysisError> {
    let path = run.file(&run.start().model);
    let text = std::fs::read_to_string(&path).map_err(RecordError::io("reading", &path))?;
    Model::from_mjcf(&text).map_err(|source| AnalysisError::Model { path, source })
}

/// What `config` says of the fit, with `model`, before there is any run.
///
/// # Errors
/// [`ExperimentError`] where they do not go together.
pub fn prepared(config: &RigConfig, mut model: Model) -> Result<Experiment, ExperimentError> {
    let (mut fit, mut diagnose) = (config.fit.clone(), config.diagnose.clone());
    if config.run.kind == MotionKind::Driven {
        measured::put_into(&config.camera, config.servo.as_ref(), &mut fit, &mut diagnose);
    }
    config.mechanism.weights().put_into(&config.water.water(), &mut model, &mut fit)?;
    CauseConfig::define(&config.cause, &mut model)?;
    fit.add_named_causes(&mut model);
    let experiment = Experiment { diagnose, ..Experiment::new(model, fit, Vec::new()) };
    experiment.check_names()?;
    Ok(experiment)
}

/// `run` as a fit takes it, with the keypoints of its `trajectory`.
pub(super) fn experiment(
    run: &RunFolder,
    config: &RigConfig,
    timeline: &Timeline,
    trajectory: Trajectory,
) -> Result<Experiment, AnalysisError> {
    let start = run.start();
    let mut experiment = prepared(config, model(run)?)?;
    let kind = start.kind;
    if kind == RunKind::Driven && timeline.command.is_none() {
        return Err(AnalysisError::NothingMoved);
    }
    let run = Run {
        command: timeline.command.clone().filter(|_| kind == RunKind::Driven),
        measured: timeline.measured.clone(),
        prescribed: start.prescribed && kind == RunKind::Driven,
        ..Run::new(start.id.as_str(), kind, trajectory)
    };
    experiment.runs.push(run);
    experiment.take_in_measured();
    experiment.set_adrift();
    Ok(experiment)
}
