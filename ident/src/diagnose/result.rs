//! `diagnosis.json`.

use serde::{Deserialize, Serialize};

use super::force::UnknownForce;
use super::next;
use crate::description::Suspect;
use crate::loss::REFERENCE_END;
use crate::noise::floor::RunFloor;

/// What the simulation gets wrong, as far as the runs tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// In a word.
    pub verdict: Verdict,
    /// The verdict in a sentence.
    pub sentence: String,
    /// What is wrong with the files rather than with the tank; causes are about the runs with that put right.
    #[serde(default)]
    pub suspects: Vec<Suspect>,
    /// What is named; empty unless the verdict names something.
    pub causes: Vec<NamedCause>,
    /// Other sets of causes that these runs cannot tell from the named one.
    pub alternatives: Vec<Alternative>,
    /// Causes that are no candidates: their parameters are fitted.
    pub fitted: Vec<String>,
    /// Whether the residuals are noise, before and after.
    pub whiteness: Whiteness,
    /// Keypoint noise, one standard deviation per coordinate \[m\].
    pub noise_m: f64,
    /// Where the noise floor comes from.
    pub noise: NoiseFloor,
    /// What naming it gains on runs that it was not fitted to; absent where nothing is named, or no run is left to tell.
    pub heldout: Option<HeldOut>,
    /// For each cause the smallest size that these runs would have shown.
    pub detectable: Vec<Detectable>,
    /// Runs that would tell more, the best first.
    pub next_experiments: Vec<NextExperiment>,
    /// With `unexplained`: the best description there is, which is no cause.
    pub partial: Vec<NamedCause>,
    /// With `unexplained`: the causes that are beyond doubt all the same.
    #[serde(default)]
    pub established: Vec<NamedCause>,
    /// With `unexplained`: what is left beside these.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remainder: Option<Remainder>,
    /// What the runs say of what has no name.
    #[serde(default)]
    pub unknown: Unknown,
    /// How probable sets of causes are, together, that were scored but not fitted: what is left to be searched.
    #[serde(default)]
    pub unfitted: f64,
    /// How the gain was checked: `holdout`, `leave-one-out`, or `none`.
    #[serde(default)]
    pub checked: String,
    /// Whether the search came to its end, and was not ended by its limit or by a signal.
    #[serde(default = "ended")]
    pub complete: bool,
    /// Coefficients of the baseline that had bent to cover for what is named.
    pub bent: Vec<Bent>,
    /// Residuals of the baseline, and what they follow.
    pub residuals: Residuals,
    /// Why the named causes were not accepted, or what else to know; one sentence each.
    pub remarks: Vec<String>,
}

impl Diagnosis {
    /// Puts what is wrong with the files before all else.
    pub(super) fn lead_with(&mut self, suspects: Vec<Suspect>) {
        if suspects.is_empty() {
            return;
        }
        let said: Vec<&str> = suspects.iter().map(|suspect| suspect.sentence.as_str()).collect();
        let mut rest = self.sentence.clone();
        if let Some(first) = rest.get_mut(..1) {
            first.make_ascii_lowercase();
        }
        self.sentence = format!("The files first: {}. With that put right, {rest}", said.join("; "));
        if self.verdict == Verdict::NothingDetectable {
            self.verdict = Verdict::Suspected;
        }
        let looks = suspects
            .iter()
            .map(|suspect| next::measured(&suspect.check, std::slice::from_ref(&suspect.name)));
        self.next_experiments.splice(0..0, looks);
        self.suspects = suspects;
    }
}

/// As diagnoses from before there was a limit were.
fn ended() -> bool {
    true
}

/// Forces and slips that no cause has, which stand in every description; all 0 where noise is all that is left.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// By how much it raises the logarithm of the evidence, with what only differs from run to run.
    pub gain: f64,
    /// Scale of a force that is the same function of pose and rate in all runs, over the one that moves keypoints by their noise.
    pub repeatable_force: f64,
    /// The same of a force over time that each run has its own of.
    pub own_force: f64,
    /// Scale of a slip of keypoints over pose, over their noise.
    pub slip: f64,
}

/// What no named cause explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Remainder {
    /// Root mean square of the residuals of the fitted runs \[m\].
    pub rms_m: f64,
    /// Its squares beyond the noise's, as a share of the baseline's.
    pub share: f64,
    /// By run.
    pub runs: Vec<RunRemainder>,
    /// A force that accounts for some of it, where one helps on runs that it was not fitted to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<UnknownForce>,
}

/// What is left of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRemainder {
    /// The run.
    pub id: String,
    /// Root mean square of its residuals \[m\].
    pub rms_m: f64,
}

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The simulation repeats the runs down to their noise.
    NothingDetectable,
    /// Causes that explain the runs, but nothing has checked them: there is no other run.
    Suspected,
    /// One cause.
    Cause,
    /// Several causes.
    Causes,
    /// Causes that these runs cannot tell apart.
    Ambiguous,
    /// Something is wrong that no known cause explains.
    Unexplained,
}

impl Verdict {
    /// As `diagnosis.json` spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::NothingDetectable => "nothing-detectable",
            Self::Suspected => "suspected",
            Self::Cause => "cause",
            Self::Causes => "causes",
            Self::Ambiguous => "ambiguous",
            Self::Unexplained => "unexplained",
        }
    }

    /// 0 for nothing, 10 named, 11 ambiguous, 12 unexplained.
    pub fn exit_code(self) -> u8 {
        match self {
            Self::NothingDetectable => 0,
            Self::Suspected | Self::Cause | Self::Causes => 10,
            Self::Ambiguous => 11,
            Self::Unexplained => 12,
        }
    }
}

/// A cause with its values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedCause {
    /// Its name.
    pub name: String,
    /// The link, hinge, shape or keypoint that it sits in, where it is one alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element: Option<String>,
    /// Whether it is another in each run: then its sizes are those of the runs, `<cause>/<parameter>@<run>`.
    #[serde(default, skip_serializing_if = "is_false")]
    pub by_run: bool,
    /// In which runs it is at work, where it is not all: `drops only`, `drops only, in each by another size`, `driven-1 only`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub form: Option<String>,
    /// What it says.
    pub sentence: String,
    /// What to look at, at the tank.
    #[serde(default)]
    pub check: String,
    /// The term it adds.
    pub formula: String,
    /// Causes that no video of these runs tells from it.
    pub aliases: Vec<String>,
    /// Its values.
    pub parameters: Vec<CauseParameter>,
    /// How probable it is, or one that no video tells from it, over all sets of causes that were tried.
    #[serde(default)]
    pub probability: f64,
    /// Twice the logarithm of the evidence of the best set of causes over that of the best without this one: what a difference of BIC
    /// stands for.
    pub delta_bic: f64,
    /// What each run by itself would say.
    pub per_run: Vec<PerRun>,
}

/// A value of a cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CauseParameter {
    /// `<cause>/<parameter>`, with `@<run>` where each run has its own.
    pub name: String,
    /// SI.
    pub value: f64,
    /// 95 % interval; absent for what was chosen, not fitted.
    pub ci95: Option<[f64; 2]>,
    /// Its unit.
    pub unit: String,
}

/// What one run by itself would say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PerRun {
    /// The run.
    pub run: String,
    /// The parameter.
    pub parameter: String,
    /// Its value, SI.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// A set of causes as good as the named one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    /// Its causes.
    pub names: Vec<String>,
    /// How probable it is.
    #[serde(default)]
    pub probability: f64,
    /// Twice the logarithm of its evidence over that of no cause.
    pub delta_bic: f64,
}

/// Whether residuals are noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Whiteness {
    /// Of the baseline.
    pub before: GoodnessOfFit,
    /// With the causes named, or with the partial description.
    pub after: GoodnessOfFit,
    /// Of the held-out runs, with what is named and all fitted numbers projected out; where these runs object and a fit of all
    /// runs together repeats them, after that fit, with what the fitted runs lose by it in `excess`.
    pub heldout: Option<GoodnessOfFit>,
    /// Share of the baseline's squared residuals that is no noise: what could be explained at all.
    pub explainable: f64,
    /// Whether each named number is the same in all runs.
    pub constancy: Vec<ConstancyTest>,
}

/// How residuals compare with the noise floor.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GoodnessOfFit {
    /// Root mean square of the residuals \[m\].
    pub rms_m: f64,
    /// Squares of whitened residuals in noise variances.
    pub chi2: f64,
    /// Degrees of freedom that are left of them.
    pub degrees: f64,
    /// Squares of what is slow among them beyond what noise leaves there.
    pub excess: f64,
    /// The same in its standard deviations.
    pub z: f64,
    /// Probability that white noise looks as correlated over the first eight lags.
    pub portmanteau_p: f64,
    /// Root mean square of these correlations.
    pub correlation: f64,
}

/// Whether a number is the same in all runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConstancyTest {
    /// The number.
    pub parameter: String,
    /// How far apart the runs are.
    pub chi2: f64,
    /// Runs that see it, less one.
    pub degrees: usize,
    /// Probability of as much by noise.
    pub p: f64,
}

/// Where the noise floor comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoiseFloor {
    /// What it was taken from, in words.
    pub source: String,
    /// Standard deviation of `noise_m` \[m\].
    pub std_m: f64,
    /// Correlation from one image to the next.
    pub correlation: f64,
    /// Its standard deviation.
    pub correlation_std: f64,
    /// Degrees of freedom that told it.
    pub degrees: f64,
    /// What the experiment says the noise is \[m\].
    pub stated_m: Option<f64>,
    /// What pictures get wrong with the pose, which is no noise and in every picture all the same, where it is stated: one standard
    /// deviation \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_std_m: Option<f64>,
    /// By how much the times of images scatter about their stamps, where that is seen: one standard deviation \[s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stamp_std_s: Option<f64>,
    /// By run and keypoint.
    pub runs: Vec<RunFloor>,
}

/// Errors on runs that nothing was fitted to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square coordinate residual of the baseline \[m\].
    pub rms_before_m: f64,
    /// With what is named \[m\].
    pub rms_after_m: f64,
    /// What noise alone leaves \[m\].
    pub noise_floor_m: f64,
    /// (before - after) / before.
    pub gain: f64,
    /// From a bootstrap over runs, or pieces of 0.5 s.
    pub gain_ci95: [f64; 2],
    /// `holdout` for runs held out, `leave-one-out` where each fitted run in turn was left out.
    pub how: String,
    /// By run and keypoint.
    pub runs: Vec<HeldOutRun>,
}

/// Errors on one held-out run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOutRun {
    /// The run.
    pub id: String,
    /// Keypoints.
    pub keypoints: Vec<String>,
    /// By keypoint \[m\].
    pub rms_before_m: Vec<f64>,
    /// By keypoint \[m\].
    pub rms_after_m: Vec<f64>,
    /// By keypoint \[m\].
    pub noise_floor_m: Vec<f64>,
}

/// The smallest size of a cause that these runs would have shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detectable {
    /// `<cause>/<parameter>`.
    pub name: String,
    /// The size at which the cost would rise by 30; absent where the runs would not show it at all. Of a rate limit, the
    /// highest that would be seen.
    pub smallest: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// A run, or a look elsewhere, that would tell more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// `drop`, `driven`, or `measurement` for a ruler, a balance, a lamp.
    pub kind: String,
    /// In words.
    pub what: String,
    /// What to type; empty for what is no run, and until [`Self::to_type`] says where the rig's configs are.
    pub command: String,
    /// The run that is proposed, which its config is called after; none for what is no run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proposal: Option<String>,
    /// The two rivals, or the loose parameter.
    pub separates: Vec<String>,
    /// Cost by which the rivals differ now; of a loose parameter, its standard deviation.
    pub before: f64,
    /// And with this run as well, as predicted.
    pub after: f64,
}

/// A coefficient that had bent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bent {
    /// Its name.
    pub name: String,
    /// Without what is named.
    pub before: f64,
    /// With it.
    pub after: f64,
    /// Standard deviation of the latter.
    pub std: f64,
}

/// Residuals of the baseline and what they follow.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Residuals {
    /// By run and keypoint: root mean square \[m\], before and after.
    pub rms: Vec<RunResiduals>,
    /// Correlation of slow residuals, all keypoints together, with where they are, how fast, how they speed up.
    pub follows: Vec<Follows>,
    /// Frequency that holds most of the baseline's residuals \[Hz\].
    pub frequency_hz: Option<f64>,
    /// Worst stretches of time, worst first.
    pub worst: Vec<WorstInterval>,
}

/// Residuals of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunResiduals {
    /// The run.
    pub id: String,
    /// Keypoints.
    pub keypoints: Vec<String>,
    /// By keypoint \[m\].
    pub before_m: Vec<f64>,
    /// By keypoint \[m\].
    pub after_m: Vec<f64>,
    /// By keypoint \[m\].
    pub noise_m: Vec<f64>,
}

/// What residuals follow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Follows {
    /// `position`, `velocity`, `acceleration`, `link` (along and across it) ...
    pub what: String,
    /// Share of the residuals' squares that goes with it, 0 to 1.
    pub share: f64,
}

/// A stretch of time with large residuals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstInterval {
    /// The run.
    pub run: String,
    /// The keypoint.
    pub keypoint: String,
    /// From \[s\].
    pub from_s: f64,
    /// To \[s\].
    pub to_s: f64,
    /// Root mean square residual \[m\].
    pub rms_m: f64,
    /// Mean position \[m\], where it was seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_m: Option<f64>,
    /// Mean position \[m\], where it was seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_m: Option<f64>,
    /// Mean position \[m\], where it was seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z_m: Option<f64>,
    /// Mean speed \[m/s\].
    pub speed_m_s: f64,
}

impl NextExperiment {
    /// Says what makes each proposed run of `list`, called so, where this computer has what it takes.
    pub fn to_type(list: &mut [Self], command: impl Fn(&str) -> Option<String>) {
        for next in list {
            let typed = next.proposal.as_deref().and_then(&command);
            next.command = typed.unwrap_or_default();
        }
    }
}

impl NamedCause {
    /// Its name and, where it sits in one element alone, that: `buoyancy/link3`.
    pub fn label(&self) -> String {
        self.element.as_ref().map_or_else(|| self.name.clone(), |element| format!("{}/{element}", self.name))
    }
}

impl Diagnosis {
    /// How far off the simulation is on the fitted runs \[m\], as [`AxisError`](crate::loss::AxisError) says: before anything is named, or
    /// after.
    pub fn error_m(&self, after: bool) -> Option<f64> {
        let of_run = |run: &RunResiduals| {
            let all = if after { &run.after_m } else { &run.before_m };
            let scored =
                run.keypoints.iter().zip(all).filter(|(name, rms_m)| *name != REFERENCE_END && **rms_m > 0.0);
            scored.map(|(_, rms_m)| rms_m * rms_m).collect::<Vec<_>>()
        };
        let squares: Vec<f64> = self.residuals.rms.iter().flat_map(of_run).collect();
        (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }

    /// What would be left if nothing were wrong \[m\]: noise, and what pictures get wrong with the pose.
    pub fn floor_m(&self) -> f64 {
        self.noise_m.hypot(self.noise.pose_std_m.unwrap_or(0.0))
    }

    /// The bytes of `diagnosis.json`.
    ///
    /// # Errors
    /// Those of `serde_json`, for numbers that JSON does not know.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        Ok(text)
    }
}

fn is_false(value: &bool) -> bool {
    !value
}
