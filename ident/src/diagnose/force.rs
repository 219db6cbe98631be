//! The unknown force in `diagnosis.json`.

use serde::{Deserialize, Serialize};

use super::result::HeldOut;

/// A force that the simulation lacks and no cause accounts for, as a smooth function of each joint's own angle and rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnknownForce {
    /// By joint.
    pub joints: Vec<JointForce>,
    /// What it gains on runs that it was not fitted to, beyond what is established.
    pub heldout: HeldOut,
    /// Causes that could do a good part of what it does, the best first.
    pub resembles: Vec<Resembled>,
}

/// The unknown force on one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointForce {
    /// The hinge or slide.
    pub joint: String,
    /// What acts on it, an expression of `q` \[rad\] and `v` \[rad/s\] (\[m\] and \[m/s\] on a slide) as a `[[cause]]` takes it.
    pub torque: String,
    /// `N m`, or `N` on a slide.
    pub unit: String,
    /// Least and greatest `q` of the runs that it was fitted to: beyond, it says nothing.
    pub angle: [f64; 2],
    /// Least and greatest `v`.
    pub rate: [f64; 2],
    /// The same in numbers, over the rate: at the least, the middle and the greatest angle.
    pub curves: Vec<ForceCurve>,
    /// The same at no rate, over the angle.
    pub at_rest: RestCurve,
}

/// The unknown force on a joint that does not turn, over its angle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RestCurve {
    /// Angles \[rad\]; \[m\] on a slide.
    pub angle: Vec<f64>,
    /// The force there, in the joint's unit.
    pub force: Vec<f64>,
}

/// The unknown force on a joint over its rate, at one angle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceCurve {
    /// The angle \[rad\]; \[m\] on a slide.
    pub angle: f64,
    /// Rates \[rad/s\]; \[m/s\] on a slide.
    pub rate: Vec<f64>,
    /// The force there, in the joint's unit.
    pub force: Vec<f64>,
}

/// A cause that resembles the unknown force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Resembled {
    /// The cause, with its element.
    pub name: String,
    /// What of the force's doing it could do, 0 to 1, whatever the fitted numbers do beside.
    pub share: f64,
}

impl JointForce {
    /// The force as a `[[cause]]` for an experiment.toml or a rig config, whose one size is 1 where it is as strong as here.
    pub fn to_cause(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let name: String = self.joint.chars().map(plain).collect();
        format!(
            "[[cause]]\nname = \"unknown_force_{name}\"\njoint = {:?}\ntorque = \"size * ({})\"\nparameters = {{ size = {{ unit = \"1\", bounds = [-10.0, 10.0], typical = 1.0 }} }}\n",
            self.joint, self.torque
        )
    }
}
