//! The `[[cause]]` tables: user-defined causes, which a diagnosis tries in addition to the built-in ones.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};
use sim::Model;
use sim::causes::own::{Acts, OwnCause, OwnCauseError, OwnParameter, Place};

use ground::names::did_you_mean;
use ground::strict::{Finite, Positive};

/// A `[[cause]]` of an `experiment.toml` or of a rig config. It acts on one joint, body or keypoint of the model, in the ways of
/// [`Acts`] that go with it; [`Place`] says what expressions may speak of there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CauseConfig {
    /// Name of the cause.
    pub name: String,
    /// What the report says of it, without a full stop; left out, where it acts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sentence: Option<String>,
    /// The hinge or slide that `torque` acts on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<String>,
    /// The body that `force_x`, `force_y` and `force_z` act on, at `point`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<String>,
    /// In the body's axes \[m\]; left out, its origin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec<Finite>>,
    /// The keypoint that `shift_x`, `shift_y` and `shift_z` put elsewhere in the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keypoint: Option<String>,
    /// Torque on the joint \[N m\], force on a slide \[N\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<String>,
    /// Force on the body along x \[N\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_x: Option<String>,
    /// Force on the body along y \[N\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_y: Option<String>,
    /// Force on the body along z \[N\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_z: Option<String>,
    /// How much further along x the keypoint is taken to be \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift_x: Option<String>,
    /// How much further along y the keypoint is taken to be \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift_y: Option<String>,
    /// How much further along z the keypoint is taken to be \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift_z: Option<String>,
    /// Its parameters, by their names in the expressions.
    pub parameters: BTreeMap<String, CauseParameterConfig>,
}

/// A parameter of a `[[cause]]`. Without `hidden` it is a size: at 0 the cause is absent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CauseParameterConfig {
    /// Unit, SI.
    #[serde(default = "no_unit")]
    pub unit: String,
    /// Least and greatest value.
    #[serde(deserialize_with = "two")]
    pub bounds: [Finite; 2],
    /// A typical value, SI: the scale on which a search varies it.
    pub typical: Positive,
    /// Values that a search starts from, of a number that says nothing while the sizes are 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hidden: Option<Vec<Finite>>,
    /// Description for the report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub meaning: Option<String>,
}

fn no_unit() -> String {
    "1".into()
}

/// serde alone would take the first two of any number.
fn two<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[Finite; 2], D::Error> {
    let numbers = Vec::<Finite>::deserialize(deserializer)?;
    let count = numbers.len();
    let wrong = |_| serde::de::Error::custom(format!("bounds are [lower, upper], not {count} numbers"));
    numbers.try_into().map_err(wrong)
}

/// Why a `[[cause]]` was refused.
#[derive(Debug, Clone, PartialEq)]
pub struct CauseError {
    pub(crate) error: OwnCauseError,
    /// Whether somebody else shows the place that is meant.
    pub(crate) is_located: bool,
}

impl CauseError {
    fn new(cause: &str, text: &str, reason: &str) -> Self {
        let error = OwnCauseError {
            cause: cause.into(),
            text: text.into(),
            meant: (0, text.chars().count()),
            reason: reason.into(),
            unknown: None,
        };
        error.into()
    }
}

impl From<OwnCauseError> for CauseError {
    fn from(error: OwnCauseError) -> Self {
        Self { error, is_located: false }
    }
}

impl std::fmt::Display for CauseError {
    /// The reason, then, unless somebody else shows it, the text that is meant with carets beneath.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let OwnCauseError { cause, text, meant: (at, width), reason, unknown } = &self.error;
        let hint = unknown.as_ref().map_or(String::new(), |(name, known)| did_you_mean(name, known));
        write!(f, "cause `{cause}`: {reason}{hint}")?;
        if !self.is_located && text != cause {
            write!(f, "\n  | {text}\n  | {}{}", " ".repeat(*at), "^".repeat(*width))?;
        }
        Ok(())
    }
}

impl std::error::Error for CauseError {}

impl CauseConfig {
    /// Makes each of `causes` known to `model`.
    ///
    /// # Errors
    /// [`CauseError`] for the first that says too little or too much, or that the model refuses.
    pub fn define(causes: &[Self], model: &mut Model) -> Result<(), CauseError> {
        for cause in causes {
            model.define_cause(&cause.definition()?)?;
        }
        Ok(())
    }

    fn definition(&self) -> Result<OwnCause, CauseError> {
        let refuse = |text: &str, reason: &str| CauseError::new(&self.name, text, reason);
        let place = match (&self.joint, &self.body, &self.keypoint) {
            (Some(joint), None, None) => Place::Joint(joint.clone()),
            (None, Some(body), None) => Place::Body { body: body.clone(), point_m: self.point_m()? },
            (None, None, Some(keypoint)) => Place::Keypoint(keypoint.clone()),
            (None, None, None) => {
                return Err(refuse(
                    &self.name,
                    "it acts nowhere: add `joint = \"...\"`, `body` or `keypoint`",
                ));
            }
            _ => {
                let reason = "it acts in one place: keep one of `joint`, `body` and `keypoint`, and write another [[cause]]";
                return Err(refuse(&self.name, reason));
            }
        };
        if self.point.is_some() && self.body.is_none() {
            return Err(refuse("point", "`point` belongs to a `body`: remove it"));
        }
        let text = |acts: Acts| match acts {
            Acts::Torque => &self.torque,
            Acts::Force(0) => &self.force_x,
            Acts::Force(1) => &self.force_y,
            Acts::Force(_) => &self.force_z,
            Acts::Shift(0) => &self.shift_x,
            Acts::Shift(1) => &self.shift_y,
            Acts::Shift(_) => &self.shift_z,
        };
        let term = |acts: Acts| text(acts).as_ref().map(|text| (acts, text.clone()));
        if let Some((name, _)) =
            self.parameters.iter().find(|(_, of)| of.hidden.as_ref().is_some_and(Vec::is_empty))
        {
            return Err(refuse(name, "`hidden` needs one start value at least"));
        }
        let parameter = |(name, of): (&String, &CauseParameterConfig)| OwnParameter {
            name: name.clone(),
            unit: of.unit.clone(),
            bounds: of.bounds.map(Finite::get),
            typical: of.typical.get(),
            hidden: of.hidden.iter().flatten().map(|start| start.get()).collect(),
            meaning: of.meaning.clone(),
        };
        Ok(OwnCause {
            name: self.name.clone(),
            sentence: self.sentence.clone(),
            place,
            terms: Acts::ALL.into_iter().filter_map(term).collect(),
            parameters: self.parameters.iter().map(parameter).collect(),
        })
    }

    fn point_m(&self) -> Result<[f64; 3], CauseError> {
        let Some(point) = &self.point else { return Ok([0.0; 3]) };
        let numbers: Vec<f64> = point.iter().map(|x| x.get()).collect();
        let count = numbers.len();
        let reason = || format!("`point` is [x, y, z] in metres, not {count} numbers");
        numbers.try_into().map_err(|_| CauseError::new(&self.name, "point", &reason()))
    }
}
