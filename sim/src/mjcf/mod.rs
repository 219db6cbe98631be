//! MJCF, MuJoCo's model format, read and written.
//!
//! Supported: compiler `angle`, `autolimits`, `eulerseq`; option `timestep`, `integrator`, `gravity`, `density`,
//! `viscosity`, `wind`; default classes; the body tree with inertial, joints, geoms, gravcomp and sites; position,
//! velocity and motor actuators on hinges and slides. What only draws, senses or serves contact is passed
//! over. Whatever else would change the motion is refused by name and line, unless it says what holds
//! anyway. Causes beyond MuJoCo ([`crate::causes`]) stand as `<custom>` numbers called `<cause>/<parameter>`, which MuJoCo
//! passes over. `<text name="kutta_lift" data="before-3.14"/>` there asks for the lift of
//! older engines ([`KuttaLift`](crate::model::KuttaLift)). Contact is not simulated, but watched where somebody asks for it: see
//! [`ContactWatch`](crate::ContactWatch).

mod assemble;
mod attributes;
mod body;
mod defaults;
mod tables;
mod write;

use crate::model::Model;

/// The `<custom>` text that says which engines' Kutta lift a model has, and what it says.
const LIFT: &str = "kutta_lift";
const BEFORE_3_14: &str = "before-3.14";

/// Why MJCF text was refused.
#[derive(Debug, thiserror::Error)]
pub enum MjcfError {
    /// Not XML.
    #[error("model is not well-formed XML")]
    Xml(#[from] roxmltree::Error),
    /// An element that is not supported.
    #[error("line {line}: element <{element}> is not supported here and would change the motion; remove it")]
    Element {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
    },
    /// An attribute that is not supported, or not with this value.
    #[error("line {line}: <{element}> attribute {attribute}=\"{value}\" is not supported; {instead}")]
    Attribute {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
        /// The attribute.
        attribute: String,
        /// Its value.
        value: String,
        /// What to do.
        instead: String,
    },
    /// A value of the wrong form or out of range.
    #[error("line {line}: <{element}> attribute {attribute}=\"{value}\" must be {wanted}")]
    Value {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
        /// The attribute.
        attribute: String,
        /// Its value.
        value: String,
        /// What it must be.
        wanted: String,
    },
    /// An attribute that must be there.
    #[error("line {line}: <{element}> needs the attribute {attribute}")]
    Missing {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
        /// The attribute.
        attribute: String,
    },
    /// A name used twice.
    #[error("line {line}: <{element}> name \"{name}\" is taken by an earlier one")]
    Duplicate {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
        /// The name.
        name: String,
    },
    /// Elements that do not fit together.
    #[error("line {line}: <{element}> \"{name}\" {problem}")]
    Inconsistent {
        /// Line in the text.
        line: u32,
        /// The element.
        element: String,
        /// Its name.
        name: String,
        /// What is wrong and what to do.
        problem: String,
    },
}

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
        write::model(self, comment)
    }
}
