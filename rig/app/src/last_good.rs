//! The last good fit of a rig: updated by each run that does not contradict it, kept where one does.

use std::path::{Path, PathBuf};

use ident::experiment::Experiment;
use ident::fit::{Drift, Fitted, Observer, fit, recalibrate};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Failure;
use super::drift::Moved;
use super::results::{earlier, write_fit};
use record::folder::file;
use record::outputs::Outputs;

/// The folder of the last good fit, among the run folders: `fit.json` and `model.xml`.
pub const FOLDER: &str = "last-good";

/// Where the last good fit is kept.
#[derive(Debug, Clone)]
pub struct LastGood {
    folder: PathBuf,
}

/// What became of the last good fit, in the folder of the run that came: [`Recalibrated`].
pub const VERDICT: &str = "recalibration.json";

/// The effect of a run on the last good fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recalibrated {
    /// What became of the last good fit.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// Coefficients that have moved over many runs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moved: Vec<Moved>,
}

/// Whether a run has updated the last good fit, and why not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether the run's fit is the last good one now.
    pub updated: bool,
    /// Whether there was none before.
    pub first: bool,
    /// Why it was kept, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub why: Vec<String>,
    /// The run lacks too many images to be looked at: that was told when it ended.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub degraded: bool,
    /// Whether the mechanism is still the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drift: Option<Drift>,
}

impl Recalibrated {
    /// The alert that it raises: kind and text; none where nothing has changed.
    pub fn alert(&self) -> Option<(&'static str, String)> {
        let Verdict { updated, why, degraded, drift, .. } = &self.verdict;
        if *degraded {
            return None;
        }
        if !updated {
            return Some(("recalibration-kept", format!("the last good fit stays: {}", why.join("; "))));
        }
        let abrupt = drift.iter().flat_map(|drift| &drift.parameters);
        let abrupt = abrupt.map(|name| format!("{name} has changed beyond three standard deviations"));
        let changes: Vec<String> = abrupt.chain(self.moved.iter().map(Moved::to_string)).collect();
        (!changes.is_empty()).then(|| ("drift", changes.join("; ")))
    }
}

impl LastGood {
    /// That of the rig whose run folders are in `runs_dir`.
    pub fn among(runs_dir: &Path) -> Self {
        Self { folder: runs_dir.join(FOLDER) }
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The runs that it was made from, by their names; none where there is no last good fit.
    ///
    /// # Errors
    /// [`Failure::Input`] where it cannot be read.
    pub fn runs(&self) -> Result<Vec<String>, Failure> {
        let path = self.folder.join(file::FIT);
        if !path.exists() {
            return Ok(Vec::new());
        }
        let text = std::fs::read(&path).map_err(Failure::input)?;
        let fit: Value = serde_json::from_slice(&text).map_err(Failure::input)?;
        let runs = fit["runs"].as_array().into_iter().flatten();
        Ok(runs.filter_map(|run| Some(run["id"].as_str()?.to_owned())).collect())
    }

    /// What becomes of it by a run that lacks too many images, as `why` says: it is kept, and nothing is fitted.
    pub fn keep(&self, why: String) -> Verdict {
        let first = !self.folder.join(file::FIT).exists();
        Verdict { updated: false, first, why: vec![why], degraded: true, drift: None }
    }

    /// Fits `experiment` with what the last good fit found as a prior. It becomes the last good fit unless it fails a gate:
    /// then the old one stays. Without an old one, a fit that has converged is good. `source` says in the model what it was fitted to.
    ///
    /// # Errors
    /// [`Failure::Data`] and [`Failure::Input`] as the fit says, [`Failure::Internal`] when the folder cannot be written. The old
    /// one stays.
    pub fn update(
        &self,
        experiment: &Experiment,
        source: &str,
        observer: &mut dyn Observer,
    ) -> Result<Verdict, Failure> {
        let path = self.folder.join(file::FIT);
        let first = !path.exists();
        let fitted = match first {
            true => fit(experiment, observer)?,
            false => recalibrate(experiment, &earlier(&path)?, observer)?,
        };
        let verdict = judged(&fitted, first);
        if verdict.updated {
            let folder = Outputs::default().folder(&self.folder, &[file::MODEL, file::FIT])?;
            write_fit(&fitted, source, &folder)?;
        }
        Ok(verdict)
    }
}

fn judged(fitted: &Fitted, first: bool) -> Verdict {
    let judged = fitted.fit.recalibration.as_ref();
    let mut why = judged.map_or(Vec::new(), |verdict| verdict.reasons.clone());
    if why.is_empty() && !fitted.fit.has_converged() {
        why.push(format!("the new fit did not converge ({})", fitted.fit.stop_reason));
    }
    let drift = judged.and_then(|verdict| verdict.drift.clone());
    Verdict { updated: why.is_empty(), first, why, degraded: false, drift }
}

#[cfg(test)]
mod tests {
    use ident::experiment::{FitConfig, Method, Run, RunKind};
    use sim::{Command, Model, RolloutOptions, State, rollout};

    use super::*;

    const MODEL: &str = include_str!("../../../configs/models/chain-passive.xml");
    const NOISE_M: f64 = 4e-4;
    const RELEASE_S: f64 = 0.3;

    /// A drop of a chain whose tip has the drag `angular`, with some noise by `seed`.
    fn dropped(angular: f64, qpos: [f64; 3], seed: u64) -> Experiment {
        let model = Model::from_mjcf(MODEL).unwrap();
        let mut truth = model.clone();
        truth.set_parameter("g3/angular", angular).unwrap();
        let times: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.01).collect();
        let state = State { qpos: qpos.to_vec(), qvel: vec![0.0; 3] };
        let options =
            RolloutOptions { start_s: RELEASE_S, timestep_s: Some(5e-4), ..RolloutOptions::default() };
        let mut trajectory =
            rollout(&truth, &state, &Command::default(), &times, &options).unwrap().trajectory();
        // A multiplicative generator is random enough for noise.
        let mut random = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        for position in &mut trajectory.position_m {
            position[1] = f64::NAN;
            for axis in [0, 2] {
                let even = |random: &mut u64| {
                    *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    (*random >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
                };
                let normal = (0..12).map(|_| even(&mut random)).sum::<f64>();
                position[axis] += NOISE_M * normal;
            }
        }
        let run = Run { release_s: Some(RELEASE_S), ..Run::new("drop", RunKind::Drop, trajectory) };
        let fit = FitConfig {
            parameters: vec!["g3/angular".into()],
            method: Method::LeastSquares,
            ..FitConfig::default()
        };
        Experiment::new(model, fit, vec![run])
    }

    #[test]
    fn runs_sharpen_the_last_good_fit_until_one_contradicts_it() {
        let folder = tempfile::tempdir().unwrap();
        let good = LastGood::among(folder.path());
        let update = |experiment: &Experiment| good.update(experiment, "a test", &mut ()).unwrap();
        let kept = || std::fs::read(good.folder().join(file::FIT)).unwrap();
        let std = || earlier(&good.folder().join(file::FIT)).unwrap().parameters[0].std;

        let first = update(&dropped(1.5, [1.2, -0.8, 0.6], 1));
        assert!(first.updated && first.first, "{first:?}");
        let before = std();
        let second = update(&dropped(1.5, [1.4, 0.3, -0.5], 2));
        assert!(second.updated && !second.first && second.drift.is_some(), "{second:?}");
        assert!(std() < 0.9 * before, "{} after {before}", std());

        let bytes = kept();
        let worn = update(&dropped(2.5, [1.4, 0.3, -0.5], 3));
        println!("{worn:?}");
        assert!(!worn.updated && worn.why[0].contains("the mechanism has changed"), "{worn:?}");
        assert!(kept() == bytes, "the last good fit has changed");

        let mut blind = dropped(1.5, [1.2, -0.8, 0.6], 4);
        blind.runs[0].trajectory.position_m.fill([f64::NAN; 3]);
        let refused = good.update(&blind, "a test", &mut ()).unwrap_err();
        assert_eq!(refused.status(), "data-cannot-answer");
        assert!(kept() == bytes, "the last good fit has changed");

        // The same mechanism is welcome again.
        assert!(update(&dropped(1.5, [1.1, 0.1, 0.2], 5)).updated);
    }
}
