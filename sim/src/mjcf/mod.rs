//! MJCF, MuJoCo's model format, read and written.
//!
//! A model's text is read in steps: its elements with their lines (`element`), the files it includes (`files`), copies written out
//! (`replicate`), then `compiler`, `option` and default classes, and with these the body tree (`body`, `joint`, `geom`), actuators
//! (`drive`, `law`), and what couples (`coupling`). Which attributes are read stands in `tables`. What only draws or senses is passed
//! over. Whatever else would change the motion is refused by name and line, unless it says what holds
//! anyway; reading goes on after that, so that [`MjcfError`] holds all of it. Causes beyond MuJoCo ([`crate::causes`]) stand as `<custom>` numbers called `<cause>/<parameter>`, which MuJoCo
//! passes over. `<text name="kutta_lift" data="before-3.14"/>` there asks for the lift of
//! older engines ([`KuttaLift`](crate::model::KuttaLift)). Contact is simulated between a plane and any other
//! shape, spheres and capsules, and boxes; other pairs pass through each other, and are watched where somebody asks for it: see
//! [`ContactWatch`](crate::ContactWatch).

mod assemble;
mod attributes;
mod body;
mod compiler;
mod coupling;
mod defaults;
mod drive;
mod element;
mod error;
mod files;
mod geom;
mod joint;
mod law;
mod option;
mod replicate;
mod tables;
mod write;

pub use error::{MjcfError, Place, Refusal};

use std::path::Path;

use attributes::Attributes;
use compiler::Compiler;
use defaults::Defaults;
use element::Element;
use error::Refusals;
use files::{FOLDERS_VARIABLE, Files};
use option::Options;
use replicate::Replicator;

use crate::model::{Model, State};

/// The model at `path` as a text that needs no other file: its own where it includes none.
///
/// # Errors
/// [`MjcfError`].
pub fn alone(path: &Path) -> Result<String, MjcfError> {
    let text = std::fs::read_to_string(path)?;
    if !text.contains("<include") {
        return Ok(text);
    }
    let from = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(Model::read_mjcf(path)?.to_mjcf(&format!("{from} with the files that it includes.")))
}

/// Reads `text`; where something was refused, the model is not as it should be.
fn read(text: &str, mut files: Files<'_>, refusals: &Refusals) -> Option<Model> {
    let mut root = Element::parse(text, None, refusals)?;
    files.expand(&mut root);
    let compiler = Compiler::read(&root, refusals);
    Replicator::new(&compiler.angles, refusals).expand(&mut root);
    root.number();
    assemble::model(&root, compiler, refusals)
}

/// What all elements are read with.
struct Reader<'a> {
    compiler: Compiler,
    defaults: Defaults<'a>,
    options: Options,
    refusals: &'a Refusals,
}

impl<'a> Reader<'a> {
    /// The element's attributes, its defaults included; `class`: of elements that name none.
    fn attributes(&self, element: &'a Element, class: Option<&str>) -> Attributes<'a> {
        Attributes::new(element, self.defaults.of(element, class), self.refusals)
    }
}

impl Model<f64> {
    /// Reads a model from MJCF `text`, which can include no files.
    ///
    /// # Errors
    /// [`MjcfError`], with the lines.
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
        let model = read(text, Files::none(&refusals), &refusals);
        refusals.unless_refused(model)
    }

    /// Reads the model at `path` and the files that it includes. Those are looked for beside the file that names them, then beside the
    /// model, and only in the model's folder, what is below it, and the folders in the environment's `RIG_MODEL_FOLDERS`.
    ///
    /// # Errors
    /// [`MjcfError`], with the lines, of included files with their names.
    pub fn read_mjcf(path: &Path) -> Result<Self, MjcfError> {
        let text = std::fs::read_to_string(path)?;
        let refusals = Refusals::default();
        let allowed = std::env::var_os(FOLDERS_VARIABLE);
        let model = read(&text, Files::of(path, allowed.as_deref(), &refusals)?, &refusals);
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
