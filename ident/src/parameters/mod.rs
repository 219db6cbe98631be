//! Named, bounded, scaled parameters: which numbers of a model a fit may turn, and how far.
//!
//! [`Parameters::select`] reads the `[fit]` table against a model. A fit then sees a vector, one entry per
//! free parameter: as SI values ([`Parameters::apply`]), or between 0 and 1 ([`Parameters::values`],
//! [`Parameters::units`]) for a search that wants every direction alike. Tied names share one entry, proportional ones too.

mod error;
mod scale;
mod select;

use sim::Model;

pub use error::ParameterError;
pub(crate) use scale::ON_BOUND_SHARE;
pub use scale::Scale;

use crate::config::Prior;

/// One free number of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeParameter {
    /// Its name; more than one where names are tied or proportional.
    pub names: Vec<String>,
    /// Where it stands in the model, for each name.
    pub places: Vec<sim::model::Parameter>,
    /// What stands there, as a share of what stands at the first: 1 where names are tied.
    pub shares: Vec<f64>,
    /// Where a fit starts, within the bounds.
    pub start: f64,
    /// Bounds and scale.
    pub scale: Scale,
    /// What is known beforehand.
    pub prior: Option<Prior>,
}

impl FreeParameter {
    /// The first of its names.
    pub fn name(&self) -> &str {
        &self.names[0]
    }

    /// Whether it is a joint's dry friction.
    pub(crate) fn is_friction(&self) -> bool {
        self.places.iter().all(|place| matches!(place, sim::model::Parameter::FrictionLoss(_)))
    }
}

/// The free parameters of a fit, in the order of the model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// The parameters, shape (P).
    pub free: Vec<FreeParameter>,
}

impl Parameters {
    /// Number of free parameters.
    pub fn len(&self) -> usize {
        self.free.len()
    }

    /// Whether nothing is free.
    pub fn is_empty(&self) -> bool {
        self.free.is_empty()
    }

    /// The same parameters with the one at `index` held at `value`.
    pub(crate) fn pinned(&self, index: usize, value: f64) -> Self {
        let mut pinned = self.clone();
        pinned.free[index].scale = pinned.free[index].scale.pinned(value);
        pinned
    }

    /// Start values, shape (P), SI.
    pub fn start(&self) -> Vec<f64> {
        self.free.iter().map(|parameter| parameter.start).collect()
    }

    /// SI values at a point of the unit box, shape (P).
    pub fn values(&self, units: &[f64]) -> Vec<f64> {
        self.free.iter().zip(units).map(|(parameter, &unit)| parameter.scale.value(unit)).collect()
    }

    /// The point of the unit box at SI values, shape (P).
    pub fn units(&self, values: &[f64]) -> Vec<f64> {
        self.free.iter().zip(values).map(|(parameter, &value)| parameter.scale.unit(value)).collect()
    }

    /// Every place in the model that a parameter stands for, parameter by parameter.
    pub fn places(&self) -> Vec<sim::model::Parameter> {
        self.free.iter().flat_map(|parameter| parameter.places.iter().copied()).collect()
    }

    /// Which of [`Parameters::places`] belong to each parameter, with the rate at which each changes with it, shape (P).
    pub fn rates(&self) -> Vec<Vec<(usize, f64)>> {
        let mut first = 0;
        let rates = |parameter: &FreeParameter| {
            let places = first..;
            first += parameter.places.len();
            places.zip(parameter.shares.iter().copied()).collect()
        };
        self.free.iter().map(rates).collect()
    }

    /// The value at each of [`Parameters::places`], from SI `values`, shape (P).
    pub fn spread(&self, values: &[f64]) -> Vec<f64> {
        let each = self.free.iter().zip(values);
        each.flat_map(|(parameter, &value)| parameter.shares.iter().map(move |share| share * value)).collect()
    }

    /// Puts SI `values`, shape (P), into `model`, which has the shape of the one selected from.
    pub fn apply(&self, values: &[f64], model: &mut Model) {
        for (parameter, &value) in self.free.iter().zip(values) {
            for (&place, share) in parameter.places.iter().zip(&parameter.shares) {
                model.set(place, share * value);
            }
        }
    }

    /// `model` with SI `values`, shape (P).
    pub fn applied(&self, values: &[f64], model: &Model) -> Model {
        let mut model = model.clone();
        self.apply(values, &mut model);
        model
    }
}

#[cfg(test)]
mod tests;
