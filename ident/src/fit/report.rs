//! `fit.json`.

use serde::{Deserialize, Serialize};

use crate::experiment::Use;
use crate::loss::KeypointError;

/// The outcome of a fit, as `fit.json` holds it: equal input gives equal bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// How the optimum was sought.
    pub method: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Parameter vectors tried.
    pub evaluations: u64,
    /// Runs simulated.
    pub rollouts: u64,
    /// Why the fit ended.
    pub stop_reason: String,
    /// The paper's loss over the fitted runs in motion \[m2\]: mean over images of the sum over keypoints of
    /// squared distances.
    pub loss_m2: f64,
    /// Keypoint noise \[m\], one standard deviation per coordinate: as stated, or what the residuals leave.
    pub noise_m: f64,
    /// The fitted parameters.
    pub parameters: Vec<FittedParameter>,
    /// Errors of each run, fitted or held out, over its scored images.
    pub runs: Vec<RunErrors>,
    /// What errors are stated as shares of \[m\].
    pub characteristic_length_m: f64,
    /// Parameters of which only a combination is seen.
    pub unidentifiable: Vec<Vec<String>>,
}

/// One fitted parameter, in its SI unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedParameter {
    /// Name.
    pub name: String,
    /// Best value.
    pub value: f64,
    /// Standard deviation; as wide as the bounds where nothing is known.
    pub std: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether the value lies on a bound.
    pub at_bound: bool,
    /// Whether the data settle it, rather than its prior or bounds.
    pub determined: bool,
}

/// Errors of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunErrors {
    /// The run.
    pub id: String,
    /// Fitted or held out.
    #[serde(rename = "use")]
    pub usage: Use,
    /// By keypoint.
    pub keypoints: Vec<KeypointError>,
}

impl Fit {
    /// The text of `fit.json`, ending in a line break.
    ///
    /// # Errors
    /// None that finite numbers can cause.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        Ok(text)
    }
}
