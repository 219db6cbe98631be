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
mod drive;
mod element;
mod error;
mod geom;
mod joint;
mod option;
mod tables;
mod write;

pub use error::{MjcfError, Place, Refusal};

use std::collections::HashMap;

use attributes::Attributes;
use compiler::Compiler;
use defaults::Defaults;
use element::Element;
use error::Refusals;

use crate::model::{Model, State};

/// What all elements are read with.
struct Reader<'a> {
    compiler: Compiler,
    defaults: Defaults<'a>,
    refusals: &'a Refusals,
}

impl<'a> Reader<'a> {
    fn new(root: &'a Element, refusals: &'a Refusals) -> Self {
        Self { compiler: Compiler::read(root, refusals), defaults: Defaults::read(root, refusals), refusals }
    }

    /// The element's attributes, its defaults included; `class`: of elements that name none.
    fn attributes(&self, element: &'a Element, class: Option<&str>) -> Attributes<'a> {
        Attributes::new(element, self.defaults.of(element, class), self.refusals)
    }
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
        let refusals = Refusals::default();
        let model = Element::parse(text, None, &refusals).map(|mut root| {
            let mut met = HashMap::new();
            for world in root.children.iter_mut().filter(|section| section.tag == "worldbody") {
                world.number(&mut met);
            }
            assemble::model(&root, &refusals)
        });
        refusals.unless_refused(model)
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
