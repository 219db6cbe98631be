//! What a task leaves: `results/<id>.json`, the same bytes wherever and however often it was carried out.

use ident::diagnose::Diagnosis;
use ident::fit::{Fit, FittedParameter};
use serde::{Deserialize, Serialize};

use ground::statistics::NORMAL_95;

/// A task's result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskResult {
    /// The task.
    pub task: String,
    /// Every number that came out.
    pub numbers: Vec<Number>,
    /// Groups of parameters of which the data determine only a combination.
    pub unidentifiable: Vec<Vec<String>>,
    /// The diagnosis's verdict, in a word.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub verdict: Option<String>,
    /// The whole `fit.json`; of the data as they are only.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub fit: Option<Fit>,
    /// The whole `diagnosis.json`; likewise.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub diagnosis: Option<Box<Diagnosis>>,
}

/// What a number is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// A fitted parameter of the model.
    Parameter,
    /// The size of a cause that a diagnosis names.
    Cause,
    /// How well the fit does.
    Fit,
    /// How well it does on one keypoint of one run, `<run>/<keypoint>`.
    Keypoint,
}

impl Quantity {
    /// As tables spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parameter => "parameter",
            Self::Cause => "cause",
            Self::Fit => "fit",
            Self::Keypoint => "keypoint",
        }
    }
}

/// A number with its interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Number {
    /// What it is about.
    pub quantity: Quantity,
    /// Its name.
    pub name: String,
    /// Its unit, `1` for none.
    pub unit: String,
    /// SI.
    pub value: f64,
    /// Standard deviation, where there is one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub std: Option<f64>,
    /// 95 % interval, where there is one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ci95: Option<[f64; 2]>,
    /// Whether the data determine it, rather than its prior or bounds.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub determined: Option<bool>,
    /// Whether it lies on a bound.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub at_bound: Option<bool>,
}

impl Number {
    fn plain(quantity: Quantity, name: impl Into<String>, unit: &str, value: f64) -> Self {
        let (name, unit) = (name.into(), unit.into());
        Self { quantity, name, unit, value, std: None, ci95: None, determined: None, at_bound: None }
    }
}

impl TaskResult {
    /// What the fit `fit` says; with all of it where it is `whole`.
    pub fn of_fit(task: &str, fit: Fit, whole: bool) -> Self {
        let mut numbers: Vec<Number> = fit.parameters.iter().map(parameter).collect();
        numbers.push(Number::plain(Quantity::Fit, "loss", "m2", fit.loss_m2));
        numbers.push(Number::plain(Quantity::Fit, "noise", "m", fit.noise_m));
        let errors = [("error", fit.error_m), ("holdout_error", fit.holdout_error_m)];
        let errors = errors.into_iter().filter_map(|(name, error_m)| Some((name, error_m?)));
        numbers.extend(errors.map(|(name, error_m)| Number::plain(Quantity::Fit, name, "m", error_m)));
        for run in &fit.runs {
            numbers.extend(run.keypoints.iter().map(|keypoint| {
                let name = format!("{}/{}", run.id, keypoint.name);
                Number::plain(Quantity::Keypoint, name, "m", keypoint.mean_error_m)
            }));
        }
        Self {
            task: task.into(),
            numbers,
            unidentifiable: fit.unidentifiable.clone(),
            verdict: None,
            fit: whole.then_some(fit),
            diagnosis: None,
        }
    }

    /// What the diagnosis `diagnosis` says; with all of it where it is `whole`.
    pub fn of_diagnosis(task: &str, diagnosis: Diagnosis, whole: bool) -> Self {
        let mut numbers = Vec::new();
        for cause in &diagnosis.causes {
            numbers.extend(cause.parameters.iter().map(|parameter| {
                let name = match &cause.element {
                    Some(element) => format!("{}@{element}", parameter.name),
                    None => parameter.name.clone(),
                };
                let std = parameter.ci95.map(|[low, high]| 0.5 * (high - low) / NORMAL_95);
                Number {
                    std,
                    ci95: parameter.ci95,
                    determined: Some(parameter.ci95.is_some()),
                    ..Number::plain(Quantity::Cause, name, &parameter.unit, parameter.value)
                }
            }));
        }
        numbers.push(Number::plain(Quantity::Fit, "noise", "m", diagnosis.noise_m));
        Self {
            task: task.into(),
            numbers,
            unidentifiable: Vec::new(),
            verdict: Some(diagnosis.verdict.name().into()),
            fit: None,
            diagnosis: whole.then(|| Box::new(diagnosis)),
        }
    }
}

fn parameter(parameter: &FittedParameter) -> Number {
    let half = NORMAL_95 * parameter.std;
    let (lower, upper) = (parameter.lower, parameter.upper);
    let by_std = [parameter.value - half, parameter.value + half].map(|end| end.clamp(lower, upper));
    let unit = if parameter.unit.is_empty() { "1" } else { &parameter.unit };
    Number {
        std: Some(parameter.std),
        ci95: Some(parameter.ci95.unwrap_or(by_std)),
        determined: Some(parameter.determined),
        at_bound: Some(parameter.at_bound),
        ..Number::plain(Quantity::Parameter, parameter.name.as_str(), unit, parameter.value)
    }
}
