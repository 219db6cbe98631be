//! A model's numbers as they are in one run: some are so many times what they are elsewhere, some are the run's own.

use std::borrow::Cow;

use sim::Model;
use sim::batch::Candidate;
use sim::model::Parameter;

use super::{Nuisance, Rehearsal};
use crate::initial::Start;

impl Rehearsal<'_> {
    pub(super) fn candidate(
        &self,
        model: &Model,
        parameters: &[Parameter],
        values: &[f64],
        offsets: &[f64],
    ) -> Candidate {
        let Start { state, start_s } = self.start_with(model, offsets);
        let run_values = self.run_parameters(offsets).map(|(_, value)| value);
        let factors = self.factors(model, parameters);
        let values = values.iter().zip(factors).map(|(value, times)| value * times);
        Candidate { values: values.chain(run_values).collect(), state, start_s }
    }

    /// The places in `model` of what is another number of times in this run, with that number.
    fn times<'b>(&'b self, model: &'b Model) -> impl Iterator<Item = (Parameter, f64)> + 'b {
        let named = self.run.times.iter();
        named.filter_map(|(name, &times)| Some((model.find_parameter(name).ok()?, times)))
    }

    /// How many times its value each of `parameters` is in this run.
    pub(super) fn factors(&self, model: &Model, parameters: &[Parameter]) -> Vec<f64> {
        let mut factors = vec![1.0; parameters.len()];
        for (place, times) in self.times(model) {
            let same = factors.iter_mut().zip(parameters).filter(|(_, other)| **other == place);
            same.for_each(|(factor, _)| *factor *= times);
        }
        factors
    }

    /// `model` with its numbers as they are in this run.
    pub(super) fn as_in_run<'b>(&self, model: &'b Model) -> Cow<'b, Model> {
        let mut run_model = Cow::Borrowed(model);
        for (place, times) in self.times(model) {
            let value = times * model.get(place);
            run_model.to_mut().set(place, value);
        }
        run_model
    }

    /// Parameters with a value per run, and this run's values, SI.
    pub(super) fn run_parameters<'b>(
        &'b self,
        offsets: &'b [f64],
    ) -> impl Iterator<Item = (Parameter, f64)> + 'b {
        self.nuisances.iter().zip(offsets).filter_map(|(nuisance, &value)| match *nuisance {
            Nuisance::Own { place, .. } => Some((place, value)),
            Nuisance::Coordinate(_) | Nuisance::Rate { .. } | Nuisance::Release { .. } => None,
        })
    }

    /// `parameters`, then those with a value per run.
    pub(super) fn places(&self, parameters: &[Parameter]) -> Vec<Parameter> {
        let run_places = self.nuisances.iter().filter_map(|nuisance| match *nuisance {
            Nuisance::Own { place, .. } => Some(place),
            Nuisance::Coordinate(_) | Nuisance::Rate { .. } | Nuisance::Release { .. } => None,
        });
        parameters.iter().copied().chain(run_places).collect()
    }
}
