//! `fit.json`.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::checkpoint::Origin;
use crate::experiment::{LostMark, Spike, Use};
use crate::loss::KeypointError;

/// The outcome of a fit, as `fit.json` holds it: equal input gives equal bytes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
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
    /// Keypoint noise \[m\], one standard deviation per coordinate: as stated; or what the residuals leave, if that
    /// is no more than the images by themselves show; or what these show.
    pub noise_m: f64,
    /// Source of `noise_m`.
    #[serde(default)]
    pub noise_source: NoiseSource,
    /// How far off the calibrated model is on the runs it was fitted to \[m\], as [`AxisError`](crate::loss::AxisError) says; of the
    /// same kind as `noise_m`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error_m: Option<f64>,
    /// The same on held-out runs \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holdout_error_m: Option<f64>,
    /// The fitted parameters.
    pub parameters: Vec<FittedParameter>,
    /// Errors of each run, fitted or held out, over its scored images.
    pub runs: Vec<RunErrors>,
    /// What errors are stated as shares of \[m\].
    pub characteristic_length_m: f64,
    /// Groups of parameters of which the data determine only a combination.
    pub unidentifiable: Vec<Vec<String>>,
    /// The same groups in numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub combinations: Vec<Combination>,
    /// How many parameters the data determine, counted over all directions; at most the number of parameters.
    #[serde(default)]
    pub effective_parameters: f64,
    /// Where each start of `hybrid` ended, in the order they were tried; empty where one sufficed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub starts: Vec<StartLoss>,
    /// What the data say about all parameters together: the belief a later fit starts from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub information: Option<JointInformation>,
    /// What became of an earlier fit that this one started from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recalibration: Option<Recalibration>,
}

/// Where [`Fit::noise_m`] comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NoiseSource {
    /// The experiment states it.
    Stated,
    /// What the fit leaves of the keypoints: no more than their images by themselves show.
    Residuals,
    /// The keypoints' paths alone: still images, and how rough the others are.
    #[default]
    Images,
}

/// What became of an earlier fit when a new run came.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recalibration {
    /// Whether the new fit passed all gates and may replace the earlier one.
    pub accepted: bool,
    /// Why not, one sentence each.
    pub reasons: Vec<String>,
    /// Whether the mechanism is still the same; absent where both fits see nothing in common.
    pub drift: Option<Drift>,
}

/// Chi-square test that the earlier and the new data have one set of parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drift {
    /// Squared difference of both estimates in its standard deviations.
    pub chi2: f64,
    /// Number of directions that both fits determine.
    pub degrees: usize,
    /// Probability of so much without drift.
    pub p: f64,
    /// Determined parameters that changed by more than three standard deviations of the difference.
    pub parameters: Vec<String>,
}

/// A weighted sum of parameters of one group of [`Fit::unidentifiable`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Combination {
    /// Index of the group in [`Fit::unidentifiable`].
    pub group: usize,
    /// Whether the data determine the sum; else the weights are changes that leave the keypoints where they are.
    pub seen: bool,
    /// Weight by name; the largest is 1 or -1.
    pub weights: BTreeMap<String, f64>,
    /// The sum in SI units, where the data determine it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Its standard deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std: Option<f64>,
}

/// Where one start of `hybrid` ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartLoss {
    /// Where the descent began.
    pub from: Origin,
    /// Its approximate loss \[m2\]; absent where the start could not be simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss_m2: Option<f64>,
    /// Whether it came to the best loss and, within three standard deviations, to the same determined values.
    pub agrees: bool,
}

/// Inverse covariance of several parameters, without priors and bounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointInformation {
    /// Parameters; of tied ones the first.
    pub names: Vec<String>,
    /// Rows, shape (names, names), in the inverse SI units of both.
    pub matrix: Vec<Vec<f64>>,
}

/// One fitted parameter, in its SI unit.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedParameter {
    /// Name of the parameter, such as `g1/blunt`.
    pub name: String,
    /// Its unit, `1` for none; empty in a `fit.json` that did not say it yet.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// Fitted value, SI.
    pub value: f64,
    /// Standard deviation; as wide as the bounds where nothing is known.
    pub std: f64,
    /// Lower bound, SI.
    pub lower: f64,
    /// Upper bound, SI.
    pub upper: f64,
    /// Whether the value lies on a bound.
    pub at_bound: bool,
    /// Whether the data determine it, rather than its prior or bounds.
    pub determined: bool,
    /// 95 % interval from the profile of the likelihood, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
    /// Value that each run which determines it gives by itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub per_run: Vec<RunValue>,
    /// Test that these are one value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constancy: Option<Constancy>,
}

/// A parameter as one run determines it, the other parameters adjusted with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunValue {
    /// Id of the run.
    pub run: String,
    /// One Gauss-Newton step from the common optimum.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// Chi-square test that a parameter is one value in all runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constancy {
    /// Squared differences from the common value in their standard deviations.
    pub chi2: f64,
    /// Degrees of freedom: runs that determine it, less one.
    pub degrees: usize,
    /// Probability of so much if it is one value.
    pub p: f64,
}

/// The noise of a fitted run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseEstimate {
    /// As assumed beforehand where the trajectory states none, one standard deviation per coordinate \[m\].
    pub assumed_m: f64,
    /// Root mean square of the residuals, per coordinate and degree of freedom \[m\].
    pub residual_m: f64,
    /// Correlation of the residuals from one image to the next.
    pub correlation: f64,
    /// Squares of the residuals in assumed standard deviations, per degree of freedom: about 1 where nothing but
    /// noise is left.
    pub chi2_per_degree: f64,
}

/// Errors of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunErrors {
    /// Id of the run.
    pub id: String,
    /// Fitted or held out.
    #[serde(rename = "use")]
    pub usage: Use,
    /// Errors by keypoint.
    pub keypoints: Vec<KeypointError>,
    /// Marks that stand for a keypoint that was not seen, and count nowhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lost: Vec<LostMark>,
    /// Its keypoints that were misread in single images, and count nowhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set_aside: Vec<Spike>,
    /// Its noise, where it was fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseEstimate>,
    /// The first contact of its simulation that is not simulated, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub touch: Option<FirstTouch>,
}

/// Two geoms of the model that touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirstTouch {
    /// Names of the two geoms.
    pub geoms: [String; 2],
    /// Time of the first contact \[s\].
    pub time_s: f64,
}

impl fmt::Display for FirstTouch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([a, b], time_s) = (&self.geoms, self.time_s);
        write!(
            f,
            "geoms `{a}` and `{b}` touch at {time_s:.4} s; contact of their shapes is not simulated, so they pass through each other from then on"
        )
    }
}

impl From<sim::Touch> for FirstTouch {
    fn from(touch: sim::Touch) -> Self {
        Self { geoms: touch.geoms.geoms, time_s: touch.time_s }
    }
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
