//! Causes that the tank contains and the fitted model does not: effects in its water, its joints, its servos and its camera.
//!
//! Forces on the mechanism act in the simulation itself. Effects between pulse and drive, and between mechanism and picture, are computed
//! here by code of the tank's own, so that a diagnosis is not tested on its own code.

use std::collections::BTreeMap;

use ground::strict::Finite;
use sim::Model;

use super::error::TankError;

/// The tank's causes: numbers by cause and parameter, as in `added_mass = { scale = 0.8 }`.
pub type Causes = BTreeMap<String, BTreeMap<String, Finite>>;

/// `parameter` of `cause`; 0 where it is not stated.
fn number(causes: &Causes, cause: &str, parameter: &str) -> f64 {
    causes.get(cause).and_then(|numbers| numbers.get(parameter)).map_or(0.0, |number| number.get())
}

/// Adds `causes` to the mechanism.
///
/// # Errors
/// [`TankError::Cause`] for one that is unknown, has no such parameter, or cannot be filmed.
pub(super) fn add_to_model(model: &mut Model, causes: &Causes) -> Result<(), TankError> {
    let refuse = |cause: &str, reason: String| TankError::Cause { cause: cause.to_owned(), reason };
    for (cause, numbers) in causes {
        if cause == "keypoint_slip" {
            let reason = "nothing in a picture slips; move the site in the model that is fitted".to_owned();
            return Err(refuse(cause, reason));
        }
        model.add_cause(cause).map_err(|error| refuse(cause, error.to_string()))?;
        for (parameter, value) in numbers {
            let name = format!("{cause}/{parameter}");
            model.set_parameter(&name, value.get()).map_err(|error| refuse(cause, error.to_string()))?;
        }
    }
    Ok(())
}

/// The effects between a pulse and the drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Linkage {
    /// Angle that the servo takes over the commanded angle.
    pub(super) gain: f64,
    /// Fastest turn \[rad/s\].
    pub(super) rate_limit: f64,
    /// Additional lag of the servo \[s\].
    pub(super) lag_s: f64,
    /// Half the backlash behind it \[rad\].
    pub(super) play: f64,
    /// Delay from the pulse to the servo \[s\].
    pub(super) delay_s: f64,
}

impl Linkage {
    pub(super) fn new(causes: &Causes) -> Self {
        let limited = number(causes, "servo_rate_limit", "share") > 0.5;
        let rate_limit = if limited { number(causes, "servo_rate_limit", "rate") } else { f64::INFINITY };
        Self {
            gain: 1.0 + number(causes, "servo_gain", "scale"),
            rate_limit,
            lag_s: number(causes, "servo_lag", "time"),
            play: number(causes, "backlash", "half_width"),
            delay_s: number(causes, "servo_delay", "delay"),
        }
    }
}

/// The distortions of the camera's picture of the plane of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Optics {
    /// How much later than its stamp says an image is taken \[s\].
    pub(super) delay_s: f64,
    /// How much later a row is taken per metre that it shows higher \[s/m\].
    pub(super) slowness: f64,
    radial: f64,
    axis: [f64; 2],
    tilt: [f64; 2],
    scale: f64,
    turn: f64,
}

impl Optics {
    pub(super) fn new(causes: &Causes) -> Self {
        let get = |cause, parameter| number(causes, cause, parameter);
        Self {
            delay_s: get("camera_delay", "delay"),
            slowness: get("rolling_shutter", "slowness"),
            radial: get("lens", "radial"),
            axis: [get("lens", "x"), get("lens", "z")],
            tilt: [get("camera_tilt", "x"), get("camera_tilt", "z")],
            scale: 1.0 + get("camera_scale", "scale"),
            turn: get("camera_rotation", "angle"),
        }
    }

    /// The apparent position of the point `[x, z]` \[m\].
    pub(super) fn apparent(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        let [dx, dz] = [x - self.axis[0], z - self.axis[1]];
        let grown = self.radial * (dx * dx + dz * dz);
        let [x, z] = [x + dx * grown, z + dz * grown];
        let larger = self.scale * (1.0 + self.tilt[0] * x + self.tilt[1] * z);
        let (sin, cos) = self.turn.sin_cos();
        [larger * (cos * x - sin * z), larger * (sin * x + cos * z)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn causes(text: &str) -> Causes {
        ground::strict::parse(text, std::path::Path::new("tank.toml")).unwrap()
    }

    const LINK: &str = "<mujoco><worldbody><body name='link'><joint name='q' axis='0 -1 0'/>
        <geom name='g' type='sphere' size='0.01' mass='0.01' fluidshape='ellipsoid'/><site name='P1'/></body></worldbody></mujoco>";

    #[test]
    fn an_unknown_cause_or_parameter_is_named_and_a_slip_cannot_be_filmed() {
        let refused = |text: &str| {
            let mut model = Model::from_mjcf(LINK).unwrap();
            add_to_model(&mut model, &causes(text)).unwrap_err().to_string()
        };
        assert!(refused("added_maas = { scale = 1.0 }").contains("added_maas"));
        assert!(refused("added_mass = { skale = 1.0 }").contains("added_mass/skale"));
        assert!(refused("keypoint_slip = { P1 = 0.001 }").contains("keypoint_slip"));
        let mut model = Model::from_mjcf(LINK).unwrap();
        add_to_model(&mut model, &causes("added_mass = { scale = 0.8 }")).unwrap();
        assert_eq!(model.parameter("added_mass/scale"), Ok(0.8));
    }

    #[test]
    fn camera_turns_and_stretches_as_the_causes_are_defined() {
        let optics = |text: &str| Optics::new(&causes(text));
        let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-15;
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(close(
            optics(&format!("camera_rotation = {{ angle = {quarter} }}")).apparent([1.0, 0.0]),
            [0.0, 1.0]
        ));
        assert!(close(optics("camera_scale = { scale = 0.1 }").apparent([1.0, -2.0]), [1.1, -2.2]));
        assert!(close(optics("camera_tilt = { x = 0.5 }").apparent([2.0, 1.0]), [4.0, 2.0]));
        assert!(close(optics("lens = { radial = 0.5, z = 1.0 }").apparent([2.0, 1.0]), [6.0, 1.0]));
    }
}
