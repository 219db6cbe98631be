//! MJCF, MuJoCo's model format, read and written.
//!
//! Supported: compiler `angle`, `autolimits`, `eulerseq`; option `timestep`, `integrator`, `gravity`, `density`,
//! `viscosity`, `wind`; default classes; the body tree with inertial, joints, geoms, gravcomp and sites; position,
//! velocity and motor actuators on hinges and slides. Geoms' contact parameters are read too. What only draws or senses is passed
//! over. Whatever else would change the motion is refused by name and line, unless it says what holds
//! anyway. Causes beyond MuJoCo ([`crate::causes`]) stand as `<custom>` numbers called `<cause>/<parameter>`, which MuJoCo
//! passes over. `<text name="kutta_lift" data="before-3.14"/>` there asks for the lift of
//! older engines ([`KuttaLift`](crate::model::KuttaLift)). Contact is simulated between a plane and any other
//! shape, spheres and capsules, and boxes; other pairs pass through each other, and are watched where somebody asks for it: see
//! [`ContactWatch`](crate::ContactWatch).

mod assemble;
mod attributes;
mod body;
mod compiler;
mod defaults;
mod error;
mod tables;
mod write;

pub use error::MjcfError;

use crate::model::{Model, State};

impl Model<f64> {
    /// Reads a model from MJCF `text`.
    ///
    /// # Errors
    /// [`MjcfError`], with the line.
    ///
    /// # Example
    /// ```
    /// let model = sim::Model::from_mjcf(
    ///     r#"<mujoco><worldbody><body>
    ///          <joint name="hinge" axis="0 -1 0" damping="1e-6"/>
    ///          <geom type="sphere" size="0.01" pos="0 0 -0.1"/>
    ///        </body></worldbody></mujoco>"#,
    /// )?;
    /// assert_eq!(model.parameter("hinge/damping").ok(), Some(1e-6));
    /// # Ok::<(), sim::MjcfError>(())
    /// ```
    pub fn from_mjcf(text: &str) -> Result<Self, MjcfError> {
        let options = roxmltree::ParsingOptions { allow_dtd: false, ..Default::default() };
        assemble::model(&roxmltree::Document::parse_with_options(text, options)?)
    }

    /// Writes the model as MJCF that MuJoCo loads and moves the same way, but for the causes it carries, which are written
    /// for ourselves and named at the head; [`Model::folded`] writes into it what MJCF can hold. `comment` stands first.
    pub fn to_mjcf(&self, comment: &str) -> String {
        write::model(self, comment, &[])
    }

    /// The same with a keyframe for each of `starts`, called after it: there MuJoCo, and whoever looks at the model, begins.
    pub fn to_mjcf_from(&self, comment: &str, starts: &[(&str, &State)]) -> String {
        write::model(self, comment, starts)
    }
}
