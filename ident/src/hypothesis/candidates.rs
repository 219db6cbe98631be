//! Which causes may be at work, and what of each is free.

use sim::causes::{AliasWhen, CauseInfo, ParameterInfo, Role};
use sim::model::Parameter;
use sim::{Cause, Model};

use crate::experiment::{Experiment, RunKind, Use};
use crate::parameters::{FreeParameter, Parameters, Scale};
use crate::simulate::Nuisance;

/// A cause with its discrete choices made: what is refitted as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Term {
    pub(crate) cause: Cause,
    /// Names and values of parameters that are chosen, not fitted.
    pub(crate) choices: Vec<(String, f64)>,
    /// Names and start values of parameters that say nothing at neutral sizes.
    pub(crate) hidden: Vec<(String, f64)>,
}

/// What a cause adds to a fit.
pub(crate) struct Added {
    /// Free numbers common to all runs.
    pub(crate) free: Vec<FreeParameter>,
    /// Free numbers of each run, with their names.
    pub(crate) own: Vec<(String, Nuisance)>,
}

/// Causes that are no candidates because their parameters are fitted anyway.
pub(crate) fn fitted(model: &Model, parameters: &Parameters) -> Vec<Cause> {
    let is = |name: &str, cause: &Cause| cause.name() == name;
    let covers = |cause: &Cause, place: &Parameter| match *place {
        Parameter::Damping(_) => is("joint_damping", cause),
        Parameter::FrictionLoss(_) => is("coulomb_friction", cause),
        Parameter::Stiffness(_, 0) => is("stiffness", cause),
        Parameter::Mass(_) => is("link_mass", cause),
        Parameter::Cause(carried, _) => model.causes()[carried].cause() == *cause,
        _ => false,
    };
    let places = parameters.places();
    Cause::ALL.iter().copied().filter(|cause| places.iter().any(|place| covers(cause, place))).collect()
}

/// Names of the causes that no video of these runs tells from `cause`.
pub(crate) fn aliases(cause: Cause, experiment: &Experiment) -> Vec<&'static str> {
    let weighed = |ending: &str| experiment.fit.prior.keys().any(|name| name.contains(ending));
    let fitted = || experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    let carried = experiment.model.bodies.iter().any(|body| body.gravity_compensation != 0.0);
    let holds = |when: AliasWhen| match when {
        // the water's share that a model has forgotten is nothing a mass could stand for
        AliasWhen::UnlessWeighed => carried && !(weighed("/mass") && weighed("buoyancy/")),
        AliasWhen::NoReleaseStated => {
            !fitted().any(|run| run.kind == RunKind::Drop && run.release_s.is_some())
        }
    };
    cause.info().aliases.iter().filter(|alias| holds(alias.when)).map(|alias| alias.name).collect()
}

impl Term {
    /// Every way in which `cause` may be at work, by the grids of its discrete and hidden parameters; none where the
    /// model has nothing that it could act on.
    pub(crate) fn all(cause: Cause, model: &Model) -> Vec<Self> {
        let mut with = model.clone();
        if with.add_cause(cause.name()).is_err() {
            return Vec::new();
        }
        let Some(effect) = with.causes().iter().find(|effect| effect.cause() == cause) else {
            return Vec::new();
        };
        let is_size = |parameter: &ParameterInfo| matches!(parameter.role, Role::Size | Role::Switch);
        if !effect.parameters().any(is_size) {
            return Vec::new();
        }
        let mut list = vec![Self { cause, choices: Vec::new(), hidden: Vec::new() }];
        let all = || effect.names().iter().zip(effect.parameters());
        for (name, parameter) in all() {
            if let Role::Choice(values) = parameter.role {
                let chosen = |term: &Self, value: f64| {
                    let choices = [&term.choices[..], &[(name.clone(), value)]].concat();
                    Self { choices, ..term.clone() }
                };
                list = list.iter().flat_map(|term| values.iter().map(|&value| chosen(term, value))).collect();
            }
        }
        for (name, parameter) in all() {
            if let Role::Hidden(values) = parameter.role {
                let started = |term: &Self| match term.is_idle(parameter) {
                    true => vec![term.clone()],
                    false => values.iter().map(|&value| term.hidden_at(name, value)).collect(),
                };
                list = list.iter().flat_map(started).collect();
            }
        }
        list
    }

    pub(crate) fn info(&self) -> &'static CauseInfo {
        self.cause.info()
    }

    fn hidden_at(&self, name: &str, value: f64) -> Self {
        let hidden = [&self.hidden[..], &[(name.to_owned(), value)]].concat();
        Self { hidden, ..self.clone() }
    }

    /// Whether `parameter` has no say beside the choices made.
    fn is_idle(&self, parameter: &ParameterInfo) -> bool {
        parameter.idle_where.is_some_and(|(choice, value)| {
            let name = format!("{}/{choice}", self.cause.name());
            self.choices.iter().any(|(own, chosen)| *own == name && *chosen == value)
        })
    }

    /// Whether the cause is there or not, and nothing in between.
    pub(crate) fn is_switch(&self) -> bool {
        self.info().parameters.iter().any(|parameter| parameter.role == Role::Switch)
    }

    /// Whether what it does is far from linear in its numbers, so that one step says little.
    pub(crate) fn is_strongly_bent(&self) -> bool {
        self.is_switch() || !self.hidden.is_empty()
    }

    /// `model` with this cause: its choices made, its hidden numbers at their start, its switch off.
    pub(crate) fn added_to(&self, model: &Model) -> Model {
        let mut model = model.clone();
        // names come from the model itself
        let _ = model.add_cause(self.cause.name());
        for (name, value) in self.choices.iter().chain(&self.hidden) {
            let _ = model.set_parameter(name, *value);
        }
        model
    }

    /// Puts the cause to work in a model that has it: switches on.
    pub(crate) fn switched_on(&self, model: &mut Model) {
        for (name, parameter) in names(self.cause, model) {
            if parameter.role == Role::Switch {
                let _ = model.set_parameter(&name, 1.0);
            }
        }
    }

    /// What is free of this cause in `model`, which has it.
    pub(crate) fn free(&self, model: &Model) -> Added {
        let mut added = Added { free: Vec::new(), own: Vec::new() };
        for (name, parameter) in names(self.cause, model) {
            if !matches!(parameter.role, Role::Size | Role::Hidden(_)) || self.is_idle(&parameter) {
                continue;
            }
            let Ok(place) = model.find_parameter(&name) else { continue };
            let [lower, upper] = parameter.bounds;
            if parameter.per_run {
                added.own.push((name, Nuisance::Own { place, lower, upper }));
            } else {
                added.free.push(FreeParameter {
                    start: model.get(place),
                    names: vec![name],
                    places: vec![place],
                    scale: Scale::new(lower, upper),
                    prior: None,
                });
            }
        }
        added
    }

    /// The numbers along which a score test looks: name, whether each run has its own, least and greatest.
    pub(crate) fn directions(&self, model: &Model) -> Vec<(String, bool, [f64; 2])> {
        let sizes = names(self.cause, model).into_iter();
        sizes
            .filter(|(_, parameter)| matches!(parameter.role, Role::Size | Role::Switch))
            .map(|(name, parameter)| (name, parameter.per_run, parameter.bounds))
            .collect()
    }

    /// Free numbers it adds to a fit of `runs` runs.
    pub(crate) fn count(&self, model: &Model, runs: usize) -> usize {
        let added = self.free(&self.added_to(model));
        added.free.len() + added.own.len() * runs
    }
}

/// The parameters of `cause` in `model`, named.
pub(crate) fn names(cause: Cause, model: &Model) -> Vec<(String, ParameterInfo)> {
    let effect = model.causes().iter().find(|effect| effect.cause() == cause);
    effect.map_or(Vec::new(), |effect| {
        effect.names().iter().cloned().zip(effect.parameters().copied()).collect()
    })
}
