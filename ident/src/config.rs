//! The tables `[fit]`, what is fitted and how, `[diagnose]`, what may be wrong and how long it is sought, and `[design]`, which runs could
//! be made.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};
use sim::Model;

use crate::cmaes::Restarts;
use ground::strict::{Finite, Positive};

/// The `[fit]` table of an `experiment.toml` or of a rig config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FitConfig {
    /// Kinds (`fluidcoef` per geom; `damping`, `frictionloss`, `stiffness` per passive joint; any last part of
    /// a parameter's name), single names or globs.
    pub parameters: Vec<String>,
    /// Names or globs left as the model says.
    pub fixed: Vec<String>,
    /// Groups of names or globs that share one value.
    pub tie: Vec<Vec<String>>,
    /// Groups of names or globs that share one factor: they stay in the ratios that the model has.
    pub proportional: Vec<Vec<String>>,
    /// How the optimum is sought.
    pub method: Method,
    /// How much a residual counts in least squares.
    pub loss: Loss,
    /// What `cma-es` does once it has converged, while `max_evaluations` last.
    pub restarts: Restarts,
    /// Whether 95 % intervals are taken from the profile of the likelihood; costs a few fits per parameter.
    pub profile: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Most candidates tried.
    pub max_evaluations: u64,
    /// `[lower, upper]` by name, glob or kind, in the parameter's SI unit.
    #[serde(deserialize_with = "pairs")]
    pub bounds: BTreeMap<String, [Finite; 2]>,
    /// What is known beforehand, by name; it makes the parameter a fitted one.
    pub prior: BTreeMap<String, Prior>,
}

/// A lower and an upper bound; serde alone would take the first two of any number.
#[derive(Deserialize)]
#[serde(try_from = "Vec<Finite>")]
struct Pair([Finite; 2]);

impl TryFrom<Vec<Finite>> for Pair {
    type Error = String;

    fn try_from(numbers: Vec<Finite>) -> Result<Self, String> {
        let count = numbers.len();
        numbers.try_into().map(Self).map_err(|_| format!("bounds are [lower, upper], not {count} numbers"))
    }
}

fn pairs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, [Finite; 2]>, D::Error> {
    let pairs = BTreeMap::<String, Pair>::deserialize(deserializer)?;
    Ok(pairs.into_iter().map(|(name, pair)| (name, pair.0)).collect())
}

/// The kinds fitted where nobody says otherwise.
const DEFAULT_PARAMETERS: [&str; 3] = ["fluidcoef", "damping", "frictionloss"];

impl Default for FitConfig {
    fn default() -> Self {
        Self {
            parameters: DEFAULT_PARAMETERS.map(str::to_owned).to_vec(),
            fixed: Vec::new(),
            tie: Vec::new(),
            proportional: Vec::new(),
            method: Method::default(),
            loss: Loss::default(),
            restarts: Restarts::default(),
            profile: false,
            seed: 1,
            max_evaluations: 5000,
            bounds: BTreeMap::new(),
            prior: BTreeMap::new(),
        }
    }
}

impl FitConfig {
    /// Adds to `model` the causes of which parameters are named, `<cause>/<parameter>` in `parameters`, `prior` or `fixed`, with
    /// neutral values; one that is there stays as it is.
    pub fn add_named_causes(&self, model: &mut Model) {
        for name in self.parameters.iter().chain(self.prior.keys()).chain(&self.fixed) {
            let is_known = model.parameter_names().contains(name);
            if let Some((cause, _)) = name.split_once('/').filter(|_| !is_known) {
                // What is no cause is for the selection of parameters to find, or to refuse.
                let _ = model.add_cause(cause);
            }
        }
    }
}

/// The `[diagnose]` table of an `experiment.toml` or of a rig config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DiagnoseConfig {
    /// Causes that cannot be.
    pub exclude: Vec<String>,
    /// Globs of the elements (bodies, joints, geoms, keypoints) in which alone a cause may sit; none: each, where there are few.
    pub elements: Vec<String>,
    /// How likely a cause is before any run is looked at, over what a cause usually is.
    pub odds: BTreeMap<String, Positive>,
    /// What is known of a cause's numbers, by name, should it be at work. Makes nothing a fitted parameter.
    pub prior: BTreeMap<String, Prior>,
    /// How long causes are sought \[s\]; the best found by then is what is said.
    pub limit_s: Positive,
}

impl Default for DiagnoseConfig {
    fn default() -> Self {
        Self {
            exclude: Vec::new(),
            elements: Vec::new(),
            odds: BTreeMap::new(),
            prior: BTreeMap::new(),
            limit_s: DEFAULT_LIMIT_S,
        }
    }
}

/// A minute, about as long as somebody at the tank waits.
const DEFAULT_LIMIT_S: Positive = Positive::literal(60.0);

/// The `[design]` table: which runs the rig could make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DesignConfig {
    /// The angle that strokes swing about \[rad\].
    pub centre_rad: Finite,
    /// Strokes go no further to either side of it \[rad\].
    pub amplitude_limit_rad: Positive,
    /// Strokes are no faster \[rad/s\]. Default 6: three quarters of what a common hobby servo turns without a load, 60 degrees in
    /// 0.13 s; one that is driven to its limit is late for that reason, which tells nothing of others.
    pub rate_limit_rad_per_s: Positive,
    /// How long a run is, rest apart \[s\].
    pub run_s: Positive,
    /// Whether somebody is there to put the mechanism into a pose and let go.
    pub drops: bool,
}

impl Default for DesignConfig {
    fn default() -> Self {
        Self {
            centre_rad: Finite::literal(0.0),
            amplitude_limit_rad: Positive::literal(0.9),
            rate_limit_rad_per_s: Positive::literal(6.0),
            run_s: Positive::literal(3.0),
            drops: true,
        }
    }
}

/// How the optimum is sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// CMA-ES on the mean squared keypoint error, as published.
    Paper,
    /// The same sampler on the weighted error with priors.
    CmaEs,
    /// Bounded Levenberg-Marquardt from the model's values.
    LeastSquares,
    /// Least squares from several starts, one of them found by a short CMA-ES.
    #[default]
    Hybrid,
}

impl Method {
    /// The name as config and `fit.json` spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::CmaEs => "cma-es",
            Self::LeastSquares => "least-squares",
            Self::Hybrid => "hybrid",
        }
    }
}

/// How much a residual counts in least squares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Its square.
    #[default]
    Squares,
    /// Its square up to 1.345 standard deviations, beyond them in proportion: a few wild keypoints do little harm.
    Huber,
}

/// A Gaussian belief about a parameter, in its SI unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    /// Most probable value.
    pub mean: Finite,
    /// Standard deviation.
    pub std: Positive,
}

impl Prior {
    /// The belief about what times `share` is what this one is about; `None` where that is no number.
    pub(crate) fn divided(&self, share: f64) -> Option<Self> {
        let mean = Finite::new(self.mean.get() / share)?;
        Some(Self { mean, std: Positive::new(self.std.get() / share)? })
    }
}
