//! What a model and the way it is stepped ask for and is not there.

use super::engine::Stepper;
use crate::dynamics::plant::{Drive, Plant};
use crate::error::RolloutError;
use crate::model::{ActuatorKind, Integrator, JointKind, Model};
use crate::options::RolloutOptions;
use crate::scalar::Scalar;
use crate::space::Space;

/// Refuses what cannot be simulated.
pub(super) fn check<S: Space>(
    model: &Model<S::T>,
    plant: &Plant<S>,
    stepper: Stepper,
    options: &RolloutOptions,
) -> Result<(), RolloutError> {
    let refuse =
        |what: String, instead: &str| Err(RolloutError::Unsupported { what, instead: instead.into() });
    let integrator = options.integrator.unwrap_or(model.settings.integrator);
    // on lone free bodies it is implicitfast
    let implicit = options.steps.is_none() && integrator == Integrator::Implicit;
    if implicit && 6 * plant.lone.len() < plant.nv {
        return refuse(
            "integrator implicit, which the model asks for,".into(),
            "take implicitfast, euler or rk4, or steps as exact as an accuracy asks for",
        );
    }
    let coupled = |drive: &Drive<S::T>| !drive.also.is_empty();
    let damps = plant.tendons.iter().any(|tendon| tendon.damping != [S::T::ZERO; 3])
        || plant.drives.iter().any(|drive| coupled(drive) && drive.damping != S::T::ZERO);
    if stepper == Stepper::ImplicitFast && damps {
        return refuse(
            "integrator implicitfast with a tendon that damps".into(),
            "take euler or rk4, or steps as exact as an accuracy asks for",
        );
    }
    let mut drives = plant.drives.iter().zip(&model.actuators);
    if options.prescribed
        && let Some((_, actuator)) =
            drives.find(|(drive, actuator)| coupled(drive) && actuator.kind == ActuatorKind::Position)
    {
        return refuse(
            format!("prescribing `{}`, which moves several joints by a tendon,", actuator.name),
            "let drives push: leave out that they are prescribed",
        );
    }
    let mut joints = model.joints.iter();
    if let (Some(_), Some(free)) = (&options.base, joints.find(|joint| joint.kind == JointKind::Free)) {
        return refuse(
            format!("a moving base under `{}`, which floats freely", model.bodies[free.body].name),
            "leave out the base, or hold the body by other joints than a free one",
        );
    }
    Ok(())
}
