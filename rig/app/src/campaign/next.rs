//! What to do after a run.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use ident::design::Prospect;
use ident::design::runs::Proposal;
use ident::diagnose::{Diagnosis, NamedCause, Verdict, prospects};
use ident::experiment::Experiment;
use ident::parameters::Parameters;

use super::record::{Record, Standing, Step};
use super::{Campaign, EXPERIMENT};
use crate::design::write_configs;
use crate::diagnose::diagnosed;
use crate::fit::FitJob;
use crate::{Failure, Watcher, on_threads};
use config::RigConfig;
use record::outputs::OutputFolder;
use servo::profile::Profile;
use store::goal::{Known, Target};

/// Configs of the runs that were proposed, in the campaign's folder.
pub(super) const CONFIGS: &str = "next";
/// The diagnosis of runs that were made for a number, in the folder of a step.
const DIAGNOSIS: &str = "diagnosis";
/// Share by which a run must reduce the largest standard deviation to be worth making. Chosen.
const MIN_STD_REDUCTION_SHARE: f64 = 0.01;
/// Unexplained share of the squared residuals beyond noise up to which a campaign ends: another run would name no further cause. Chosen.
const NEGLIGIBLE_REMAINDER_SHARE: f64 = 0.1;

/// The next thing to do.
#[derive(Debug)]
pub(super) enum Next {
    /// One more run.
    Run {
        /// Its config.
        config: PathBuf,
        /// What for.
        why: String,
    },
    /// Nothing, for this reason.
    End(Standing, String),
}

impl Campaign<'_> {
    /// Diagnoses the experiment of all runs, in the `folder` of a step.
    pub(super) fn resolved(
        &self,
        folder: &OutputFolder,
        step: &mut Step,
        record: &mut Record,
        watcher: &mut dyn Watcher,
    ) -> Result<Next, Failure> {
        let experiment = &folder.path().join(EXPERIMENT);
        let (found, _) = diagnosed(experiment, folder, self.threads, Some(self.config), watcher)?;
        let diagnosis = &found.diagnosis;
        step.verdict = Some(diagnosis.verdict.name().into());
        step.sentence = Some(diagnosis.sentence.clone());
        step.established = established(diagnosis);
        record.says.clone_from(&diagnosis.sentence);
        record.needs = by_hand(diagnosis);
        watcher.event(&format!("{}: {}", diagnosis.verdict.name(), diagnosis.sentence));
        let end = |state| Ok(Next::End(state, diagnosis.sentence.clone()));
        match diagnosis.verdict {
            // one run may have been too gentle to show anything: decide after a more informative one
            Verdict::NothingDetectable if record.runs.len() == 1 => {
                match self.config_of(&self.most_informative(experiment)?, |config| record.times(config))? {
                    Some((config, proposal)) => Ok(Next::Run {
                        config,
                        why: format!("to see more than nothing: {}", proposal.words()),
                    }),
                    None => end(Standing::Reached),
                }
            }
            Verdict::NothingDetectable | Verdict::Cause | Verdict::Causes => end(Standing::Reached),
            Verdict::Unexplained if is_conclusive(diagnosis, step, record) => end(Standing::Reached),
            // what differs between two equal runs is no property of the mechanism
            Verdict::Unexplained if record.runs.len() == 1 => Ok(Next::Run {
                config: self.config.into(),
                why: "the same again: what differs is no property of the mechanism".into(),
            }),
            Verdict::Unexplained | Verdict::Ambiguous | Verdict::Suspected => {
                let mut list = found.next.clone();
                if list.is_empty() && (!diagnosis.complete || diagnosis.verdict == Verdict::Unexplained) {
                    // no run was designed, for lack of time or of rival causes: take the most informative ones
                    list = self.most_informative(experiment)?;
                }
                match self.config_of(&list, |config| record.times(config))? {
                    Some((config, proposal)) => {
                        let why = format!("{}{}", rivals(diagnosis), proposal.words());
                        Ok(Next::Run { config, why })
                    }
                    None => end(Standing::NeedsAHand),
                }
            }
        }
    }

    /// The runs that reduce the standard deviations of all fitted parameters most, best first.
    fn most_informative(&self, experiment: &Path) -> Result<Vec<Proposal>, Failure> {
        let runs = Experiment::read(experiment)?;
        let fitted = Parameters::select(&runs.model, &runs.fit).map_err(Failure::input)?;
        let names: Vec<String> = fitted.free.iter().map(|one| one.name().to_owned()).collect();
        let mut list = on_threads(self.threads, || Ok(prospects(&runs, &names)?))?;
        let open = |prospect: &Prospect| prospect.std.iter().map(|std| std.ln()).sum::<f64>();
        list.sort_by(|a, b| open(a).total_cmp(&open(b)));
        Ok(list.into_iter().map(|prospect| prospect.proposal).collect())
    }

    /// Fits the experiment of all runs, in the `folder` of a step, for the parameters `targets`.
    pub(super) fn precise(
        &self,
        folder: &OutputFolder,
        targets: &[Target],
        step: &mut Step,
        record: &mut Record,
        watcher: &mut dyn Watcher,
    ) -> Result<Next, Failure> {
        let experiment = &folder.path().join(EXPERIMENT);
        let job = FitJob {
            experiment,
            out: folder,
            threads: self.threads,
            resume: false,
            profile: false,
            prior: None,
        };
        let (data, _) = job.carry_out(watcher)?;
        let fit = data.fit.as_ref().ok_or_else(|| Failure::Internal(anyhow!("the fit has no result")))?;
        let known = |target: &Target| {
            target
                .known(fit)
                .ok_or_else(|| Failure::Internal(anyhow!("the fit does not say {}", target.name)))
        };
        step.known = targets.iter().map(known).collect::<Result<_, _>>()?;
        let states: Vec<String> = step.known.iter().map(Known::to_string).collect();
        record.says = states.join("; ");
        watcher.event(&record.says);
        record.needs.clear();
        let is_reached = step.known.iter().all(|known| known.ratio() <= 1.0);
        // a parameter may have a small deviation in a model that lacks something; one run proves no cause
        if is_reached || record.runs.len() > 1 {
            let is_biased = self.check_for_bias(folder, step, record, watcher)?;
            if is_reached || is_biased {
                let state = if is_reached { Standing::Reached } else { Standing::NeedsAHand };
                return Ok(Next::End(state, record.says.clone()));
            }
        }
        watcher.status("planning the next run".into());
        let runs = Experiment::read(experiment)?;
        let names: Vec<String> = targets.iter().map(|target| target.name.clone()).collect();
        let list = on_threads(self.threads, || Ok(prospects(&runs, &names)?))?;
        // repeating the same run may be the best
        let best = self.config_of(&ranked(list, &step.known), |_| 0)?;
        watcher.clear();
        Ok(match best {
            Some((config, proposal)) => Next::Run { config, why: proposal.words() },
            None => {
                record.needs = vec![
                    "no run of the servo determines them better: change what is filmed (a finer picture, a pose by hand), or ask for less".into(),
                ];
                Next::End(Standing::NeedsAHand, record.says.clone())
            }
        })
    }

    /// Diagnoses the runs. Returns whether a named and checked cause biases the wanted parameters by more than the wanted standard
    /// deviation: then more runs would make them more certain, not more correct.
    fn check_for_bias(
        &self,
        folder: &OutputFolder,
        step: &mut Step,
        record: &mut Record,
        watcher: &mut dyn Watcher,
    ) -> Result<bool, Failure> {
        let experiment = &folder.path().join(EXPERIMENT);
        let (found, _) =
            diagnosed(experiment, &folder.folder(DIAGNOSIS), self.threads, Some(self.config), watcher)?;
        let diagnosis = &found.diagnosis;
        step.verdict = Some(diagnosis.verdict.name().into());
        step.sentence = Some(diagnosis.sentence.clone());
        if diagnosis.verdict == Verdict::NothingDetectable {
            return Ok(false);
        }
        record.says = format!("{}; but {}", record.says, diagnosis.sentence);
        record.needs = by_hand(diagnosis);
        let biased = biased(diagnosis, &step.known);
        let is_biased = !biased.is_empty() && diagnosis.verdict != Verdict::Suspected;
        record.needs.extend(biased);
        Ok(is_biased)
    }

    /// The first of `list` that this rig can do, with its config; those that are `put_off` more come later.
    fn config_of(
        &self,
        list: &[Proposal],
        put_off: impl Fn(&Path) -> usize,
    ) -> Result<Option<(PathBuf, Proposal)>, Failure> {
        let folder = self.out.folder(CONFIGS);
        write_configs(self.config, list, &folder)?;
        let path = |proposal: &Proposal| folder.path().join(format!("{}.toml", proposal.id));
        let mut order: Vec<(PathBuf, &Proposal)> = list.iter().map(|one| (path(one), one)).collect();
        order.sort_by_key(|(path, _)| put_off(path));
        let mut feasible = order.into_iter().filter(|(path, _)| is_feasible(path));
        Ok(feasible.next().map(|(path, proposal)| (path, proposal.clone())))
    }
}

/// The established causes of `diagnosis`, in order; of aliases the first one, as no run tells them apart.
fn established(diagnosis: &Diagnosis) -> Vec<String> {
    let first = |cause: &NamedCause| cause.aliases.iter().chain([&cause.name]).min().cloned();
    let mut names: Vec<String> = diagnosis.established.iter().filter_map(first).collect();
    names.sort();
    names.dedup();
    names
}

/// Whether a diagnosis that does not explain everything still ends the campaign: its established causes are those of the step before, runs
/// of more than one kind agree on them, and the remainder is small.
fn is_conclusive(diagnosis: &Diagnosis, step: &Step, record: &Record) -> bool {
    // a campaign that goes on may have been through this step already
    let before = record.steps.iter().take(record.runs.len() - 1).next_back().map(|step| &step.established);
    let differ = record.runs.windows(2).any(|pair| pair[0].config != pair[1].config);
    let left = diagnosis.remainder.as_ref().map_or(1.0, |remainder| remainder.share);
    !step.established.is_empty()
        && before == Some(&step.established)
        && differ
        && left <= NEGLIGIBLE_REMAINDER_SHARE
}

/// Whether the rig can make the run of the config at `path` without work by hand.
fn is_feasible(path: &Path) -> bool {
    let Ok(config) = RigConfig::read(path) else { return false };
    let (Some(servo), Some(profile)) = (&config.servo, &config.profile) else { return false };
    Profile::new(profile).is_ok_and(|profile| profile.pulses(servo).is_ok())
}

/// The runs that reduce the largest ratio of standard deviation to wanted one, best first.
fn ranked(mut list: Vec<Prospect>, known: &[Known]) -> Vec<Proposal> {
    let worst = |std: &mut dyn Iterator<Item = f64>| {
        std.zip(known).map(|(std, known)| std / known.wanted_std).fold(0.0, f64::max)
    };
    let now = worst(&mut known.iter().map(|known| known.std));
    let then = |prospect: &Prospect| worst(&mut prospect.std.iter().copied());
    list.retain(|prospect| then(prospect) < (1.0 - MIN_STD_REDUCTION_SHARE) * now);
    list.sort_by(|a, b| then(a).total_cmp(&then(b)));
    list.into_iter().map(|prospect| prospect.proposal).collect()
}

/// The causes to be told apart, or checked, as the beginning of a sentence; empty where none is named.
fn rivals(diagnosis: &Diagnosis) -> String {
    let mut about: Vec<String> = diagnosis.causes.iter().map(NamedCause::label).collect();
    let Some(first) = diagnosis.alternatives.first() else {
        return if about.is_empty() { String::new() } else { format!("{}: ", about.join(" + ")) };
    };
    about = vec![about.join(" + "), first.names.join(" + ")];
    match diagnosis.alternatives.len() {
        1 => format!("{}: ", about.join(" or ")),
        more => format!("{} (or {} more): ", about.join(" or "), more - 1),
    }
}

/// The parameters `known` that the named causes bias by more than the wanted standard deviation, each with what to do about it.
fn biased(diagnosis: &Diagnosis, known: &[Known]) -> Vec<String> {
    let at_work = || diagnosis.causes.iter().chain(&diagnosis.established);
    let causes = at_work().map(NamedCause::label).collect::<Vec<_>>().join(" + ");
    let fitted = at_work().flat_map(|cause| &cause.parameters).filter(|one| one.ci95.is_some());
    let mut names: Vec<String> =
        fitted.filter_map(|one| Some(format!("\"{}\"", one.name.split('@').next()?))).collect();
    names.dedup();
    // what is only possible is not to be fitted: more runs are wanted then
    if causes.is_empty() {
        return Vec::new();
    }
    let shifted = |known: &Known| {
        let shift = diagnosis.bent.iter().find(|shift| shift.name == known.name)?;
        ((shift.after - shift.before).abs() > known.wanted_std).then(|| {
            format!(
                "{} is {:.4e} with {causes} and {:.4e} without: add {} to [fit] parameters, or repair it at the tank",
                shift.name,
                shift.after,
                shift.before,
                names.join(", ")
            )
        })
    };
    known.iter().filter_map(shifted).collect()
}

/// The advice of a diagnosis that needs work by hand.
fn by_hand(diagnosis: &Diagnosis) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for next in &diagnosis.next_experiments {
        let what = match next.separates.is_empty() {
            true => next.what.clone(),
            false => format!("{}: {}", next.separates.join(" / "), next.what),
        };
        if matches!(next.kind.as_str(), "measurement" | "drop") && !list.contains(&what) {
            list.push(what);
        }
    }
    list
}
