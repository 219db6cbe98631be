//! What a study found, as `findings.json` holds it and its page shows it.

use serde::{Deserialize, Serialize};

/// What a study found. Values in SI units.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StudyFindings {
    /// The study's name.
    pub name: String,
    /// Version of the program.
    pub rig_version: String,
    /// Experiments, variations and tasks.
    pub size: StudySize,
    /// What is not as it should be, one sentence each.
    pub warnings: Vec<String>,
    /// Each number over all experiments.
    pub common: Vec<CommonNumber>,
    /// What a number follows.
    pub trends: Vec<FollowedTrend>,
    /// How many such trends were looked for; the probabilities hold for all of them together.
    pub trends_sought: usize,
    /// Groups of coefficients of which only a combination is seen.
    pub twins: Vec<Twins>,
    /// Pairs of experiments that disagree.
    pub disagreements: Vec<Disagreement>,
    /// How many pairs were compared; the probabilities hold for all of them together.
    pub pairs_compared: usize,
    /// Variations that say otherwise of the same experiments.
    pub shifts: Vec<Shift>,
    /// What diagnoses say.
    pub verdicts: Vec<VerdictCount>,
    /// Tasks that are set aside.
    pub set_aside: Vec<SetAside>,
    /// Commands for the runs that would settle what disagrees.
    pub to_settle: Vec<ToSettle>,
}

/// How large a study is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StudySize {
    /// Experiments.
    pub experiments: usize,
    /// Variations.
    pub variations: usize,
    /// Tasks.
    pub tasks: usize,
    /// Tasks with a result.
    pub done: usize,
}

/// A number over all experiments, by random effects.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CommonNumber {
    /// The variation.
    pub variation: String,
    /// The number.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Experiments that determine it.
    pub count: usize,
    /// Experiments that do not: left to prior or bounds, or on a bound.
    pub left_out: usize,
    /// Mean over what it is everywhere; absent with fewer than two experiments.
    pub mean: Option<f64>,
    /// 95 % interval of that.
    pub mean_ci95: Option<[f64; 2]>,
    /// Standard deviation from experiment to experiment, beyond their own.
    pub tau: Option<f64>,
    /// 95 % interval of that; no upper end where it is not bounded.
    pub tau_ci95: Option<(f64, Option<f64>)>,
    /// Share of the scatter that is from experiment to experiment.
    pub i2: Option<f64>,
    /// Probability of as much scatter, were it one number; for all numbers of a variation together.
    pub p_same: Option<f64>,
    /// Whether it is the same everywhere.
    pub says: Sameness,
    /// What each experiment says, where it determines it: name, value, standard deviation.
    pub each: Vec<(String, f64, f64)>,
}

/// Whether a number is the same in all experiments.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sameness {
    /// Nothing speaks against it.
    Same,
    /// It differs.
    Differs,
    /// Fewer than two experiments determine it.
    #[default]
    Open,
}

/// A number that follows something known of the experiments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FollowedTrend {
    /// The variation.
    pub variation: String,
    /// The number.
    pub name: String,
    /// What it follows: `time`, `temperature`, `tank`, `mechanism`.
    pub follows: String,
    /// Change per unit of that, where it is a number.
    pub slope: Option<f64>,
    /// 95 % interval of the slope.
    pub slope_ci95: Option<[f64; 2]>,
    /// Unit of the slope.
    pub unit: String,
    /// Probability of as much by chance.
    pub p: f64,
}

/// Coefficients of which only a combination is seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Twins {
    /// The variation.
    pub variation: String,
    /// The coefficients.
    pub names: Vec<String>,
    /// In so many fits.
    pub count: usize,
    /// Of so many.
    pub of: usize,
}

/// Two experiments that disagree on a number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Disagreement {
    /// The variation.
    pub variation: String,
    /// The number.
    pub name: String,
    /// The experiments.
    pub experiments: [String; 2],
    /// What they say.
    pub values: [f64; 2],
    /// Standard deviations of that.
    pub stds: [f64; 2],
    /// Their distance in standard deviations.
    pub sigmas: f64,
    /// Probability of as much by chance.
    pub p: f64,
}

/// Two variations that say otherwise of the same experiments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// The variations.
    pub variations: [String; 2],
    /// The number.
    pub name: String,
    /// Experiments that determine it in both.
    pub count: usize,
    /// Distance in the larger of both standard deviations, of the experiment in the middle.
    pub median_sigmas: f64,
}

/// How often diagnoses say something.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct VerdictCount {
    /// The variation.
    pub variation: String,
    /// The verdict.
    pub verdict: String,
    /// In so many.
    pub count: usize,
}

/// A task that is set aside.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetAside {
    /// The task.
    pub task: String,
    /// What it is.
    pub words: String,
    /// Why.
    pub why: String,
}

/// A command that would settle a disagreement.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ToSettle {
    /// What is asked.
    pub question: String,
    /// What to type.
    pub commands: Vec<String>,
}
