//! Causes: what a simulation may lack, each one file behind one small interface.
//!
//! A model carries its causes ([`Model::causes`]). [`Model::add_cause`] adds one with neutral
//! values, at which it changes nothing; its numbers are then parameters of the model like any other, called
//! `<cause>/<parameter>`, so that fits and derivatives need nothing new:
//!
//! ```
//! # let text = r#"<mujoco><option density="1000"/><worldbody><body gravcomp="0.8">
//! #   <joint name="hinge" axis="0 -1 0"/><geom name="link" type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125"
//! #   density="1240" fluidshape="ellipsoid"/><site name="P1" pos="0 0 -0.0275"/></body></worldbody></mujoco>"#;
//! let mut model = sim::Model::from_mjcf(text)?;
//! model.add_cause("added_mass")?;
//! model.set_parameter("added_mass/scale", 1.0)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Each cause is a file, in the folder of the place where it sits. There are four ways in which a cause acts, one section of
//! the list below each. Adding a cause is its file, with its [`CauseInfo`] and that section's hook, and one line of the list:
//!
//! - `model`: it changes the model's own numbers before anything moves (`fn alter`). Nothing in a step knows of it.
//! - `step`: it exerts forces or has inertia (`hooks::Step`), after those before it in the list; `+ alter` where one of its forms changes the model's own numbers instead.
//! - `drive`: it changes the command on its way to the drives (`drive::stage::Stage`), in the order of the list; `+ start` where how the
//!   drives followed says where its hidden numbers begin, `among` how many.
//! - `picture`: it changes what the camera sees (`camera::look::Look`), in the order of the list.
//!
//! A cause may also be written down as an expression, without compiling anything: [`own`].
//!
//! A cause that is absent costs nothing and leaves the motion the same to the bit.

#[macro_use]
mod list;

mod body;
mod camera;
mod command_path;
mod drive;
mod hooks;
mod joint;
pub mod own;
mod tether;
mod water;

pub use command_path::CommandPath;
pub(crate) use hooks::Moment;
pub(crate) use joint::coulomb_friction::is_soft;

pub use crate::model::cause::{
    Alias, AliasWhen, Cause, CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role,
};

use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::Vector;
use crate::model::Model;
use crate::scalar::Scalar;
use crate::scalar::tuned;
use crate::space::Space;
use camera::look::Look;
pub use drive::stage::Following;
use drive::stage::{Piece, Pieces, Stage, StageState};
use hooks::Step;

causes! {
    model {
        current in water,
        buoyancy in water,
        link_mass in water,
        joint_damping in joint,
        stiffness in joint,
        keypoint_slip in camera,
        inertia in body,
        link_length in body,
        joint_zero in joint,
        back_emf in drive,
        gear_friction in drive,
        drive_offset in drive,
        dead_band in drive,
    }
    step {
        added_mass in water,
        slosh in water,
        cob_offset in water,
        linear_drag in water,
        drag_exponent in water,
        wall in water,
        basset in water,
        coulomb_friction in joint + alter,
        one_sided_stiffness in joint,
        end_stop in joint,
        tether in self,
        medium_drag in body,
        load_friction in joint,
    }
    drive {
        servo_gain in drive,
        servo_sag in drive,
        servo_refresh in drive + start among starts,
        servo_rate_limit in drive,
        servo_loop in drive,
        servo_lag in drive,
        backlash in drive,
        servo_delay in drive,
    }
    picture {
        camera_delay in camera,
        rolling_shutter in camera,
        lens in camera,
        camera_tilt in camera,
        camera_scale in camera,
        camera_rotation in camera,
        camera_offset in camera,
    }
}

/// The name is not that of a known cause.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no cause `{name}`; the causes are {known}")]
pub struct UnknownCause {
    /// The name looked for.
    pub name: String,
    /// The causes there are, listed.
    pub known: String,
}

impl std::str::FromStr for Cause {
    type Err = UnknownCause;

    fn from_str(name: &str) -> Result<Self, UnknownCause> {
        Self::ALL.iter().copied().find(|cause| cause.name() == name).ok_or_else(|| UnknownCause {
            name: name.into(),
            known: Self::ALL.iter().map(|cause| cause.name()).collect::<Vec<_>>().join(", "),
        })
    }
}

impl<T: Scalar> Model<T> {
    /// Adds the cause called `name`, one of the model's own or of [`Cause::ALL`], with neutral values, at which it changes nothing.
    /// One that is there stays as it is.
    ///
    /// # Errors
    /// [`UnknownCause`].
    pub fn add_cause(&mut self, name: &str) -> Result<Cause, UnknownCause> {
        let own = self.own.iter().copied().find(|cause| cause.name() == name);
        let cause = own.map_or_else(|| name.parse(), Ok)?;
        self.carry(cause);
        Ok(cause)
    }

    /// The model with the causes that change its own numbers at work in them; `None` when it carries no such cause.
    pub fn altered(&self) -> Option<Self> {
        if self.causes.is_empty() {
            return None;
        }
        let mut model = self.clone();
        let mut changed = false;
        for carried in &self.causes {
            changed |= alter(carried, &mut model);
        }
        changed.then_some(model)
    }
}

impl Model<f64> {
    /// The model as plain MJCF holds it: its causes written into its numbers, where MJCF can. Also the causes that MJCF
    /// cannot hold, which are left out, and those that MuJoCo has in a slightly other form.
    pub fn folded(&self) -> Folded {
        let mut model = self.clone();
        model.causes.clear();
        let (mut lost, mut altered) = (Vec::new(), Vec::new());
        for carried in &self.causes {
            match carried.cause().info().mjcf {
                Some(mjcf) => {
                    (mjcf.fold)(carried, &mut model);
                    if !(mjcf.exact)(carried) {
                        altered.push(carried.cause());
                    }
                }
                None => lost.push(carried.cause()),
            }
        }
        Folded { model, lost, altered }
    }
}

/// A model as plain MJCF holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct Folded {
    /// The model, which carries no causes.
    pub model: Model<f64>,
    /// Causes that MJCF cannot hold: the model moves without them.
    pub lost: Vec<Cause>,
    /// Causes that MuJoCo has in a slightly other form.
    pub altered: Vec<Cause>,
}

#[cfg(test)]
mod tests;
