//! Which causes may be at work, and what of each is free.

use std::collections::BTreeMap;

use sim::causes::{AliasWhen, CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use sim::model::{Parameter, encoded_joint};
use sim::{Cause, Model};

use crate::config::Prior;
use crate::experiment::{DiagnoseConfig, Experiment, Run, RunKind, Use};
use crate::parameters::{FreeParameter, Parameters, Scale};
use crate::simulate::Nuisance;
use ground::names::glob;

/// A cause with its discrete choices made: what is refitted as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Term {
    pub(crate) cause: Cause,
    /// Names and values of parameters that are chosen, not fitted.
    pub(crate) choices: Vec<(String, f64)>,
    /// Names and start values of parameters that say nothing at neutral sizes.
    pub(crate) hidden: Vec<(String, f64)>,
    /// The one element that it sits in; `None` for all of them together.
    pub(crate) element: Option<Element>,
    /// Whether each run has its own size.
    pub(crate) by_run: bool,
    /// How likely it is before any run is looked at, over what a cause usually is.
    pub(crate) odds: f64,
    /// What is known of its numbers beforehand, by name.
    pub(crate) known: Vec<(String, Prior)>,
}

/// A link, hinge, shape or keypoint that a cause sits in, chosen among several.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Element {
    /// The parameter that is its size there, `<cause>/<element>`.
    pub(crate) size: String,
    /// How many it could have been.
    of: usize,
}

/// Most elements that a cause is tried in one by one, a choice: each costs a derivative, and of twenty segments of an arm no film tells
/// which.
const MOST_ELEMENTS: usize = 12;
/// Most runs in which a cause is tried with a size for each, a choice: so many numbers are no explanation any more.
const MOST_RUNS: usize = 12;

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
    model.known_causes().filter(|cause| places.iter().any(|place| covers(cause, place))).collect()
}

/// The causes that may be at work beside what is `fitted`.
pub(crate) fn possible(experiment: &Experiment, fitted: &[Cause]) -> Vec<Cause> {
    let DiagnoseConfig { exclude, .. } = &experiment.diagnose;
    let may_be = |cause: &Cause| {
        let excluded = exclude.iter().any(|name| name == cause.name());
        let is_seen = !needs_side_view(*cause, experiment) && !FITTED_ONLY.contains(&cause.name());
        !excluded && !fitted.contains(cause) && is_seen
    };
    experiment.model.known_causes().filter(may_be).collect()
}

/// Causes that are fitted where a fit names them, and no candidates: a second-order loop with a damping ratio of 0.7 is a delay up to the third
/// order in frequency, and the rates of a stroke do not tell the two apart, by a camera or by an encoder.
const FITTED_ONLY: [&str; 1] = ["servo_loop"];

/// Causes in a camera that have to do with time alone, or with a link's own length.
const WITHOUT_AXES: [&str; 2] = ["camera_delay", "keypoint_slip"];

/// Whether `cause` acts along the axes of a camera that looks from the side, x and z, and a run was filmed from above, in x and y: then
/// it is no candidate.
pub(crate) fn needs_side_view(cause: Cause, experiment: &Experiment) -> bool {
    let info = cause.info();
    let has_axes = info.in_picture_plane || info.kind == Kind::Camera && !WITHOUT_AXES.contains(&info.name);
    // whoever writes a cause down knows where the camera is
    has_axes && !cause.is_own() && experiment.runs.iter().any(from_above)
}

fn from_above(run: &Run) -> bool {
    let has = |axis: usize| run.trajectory.position_m.iter().any(|place| place[axis].is_finite());
    has(1) && !has(2)
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
            // encoders are read by another clock than the camera's
            let is_timed = |run: &Run| match run.kind {
                RunKind::Drop => run.release_s.is_some(),
                RunKind::Driven | RunKind::Free => {
                    run.trajectory.keypoints.iter().any(|mark| encoded_joint(mark).is_some())
                }
            };
            !fitted().any(is_timed)
        }
    };
    // what a prior holds is part of the model already
    let held = |name: &str| experiment.fit.prior.keys().any(|held| held.split('/').next() == Some(name));
    let aliases = cause.info().aliases.iter().filter(|alias| holds(alias.when) && !held(alias.name));
    aliases.map(|alias| alias.name).collect()
}

impl Term {
    /// Every way in which `cause` may be at work, by the grids of its discrete and hidden parameters; none where the
    /// model has nothing that it could act on. `runs` is how many are fitted; `odds`: see [`Term::odds`].
    /// `elements`: see [`DiagnoseConfig::elements`].
    pub(crate) fn all(cause: Cause, model: &Model, runs: usize, odds: f64, elements: &[String]) -> Vec<Self> {
        let mut with = model.clone();
        if with.add_cause(cause.name()).is_err() {
            return Vec::new();
        }
        let Some(effect) = with.causes().iter().find(|effect| effect.cause() == cause) else {
            return Vec::new();
        };
        let mut list: Vec<Self> = forms(effect, elements)
            .into_iter()
            .map(|element| Self {
                cause,
                choices: Vec::new(),
                hidden: Vec::new(),
                element,
                by_run: false,
                odds,
                known: Vec::new(),
            })
            .collect();
        // in one element alone it is tried where the cause leads
        let by_run = list.iter().filter(|term| term.element.is_none()).filter_map(|term| term.by_run(runs));
        list.extend(by_run.collect::<Vec<_>>());
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

    /// `terms` with what `prior` says of their numbers: hidden ones start there.
    pub(crate) fn knowing(terms: Vec<Self>, prior: &BTreeMap<String, Prior>) -> Vec<Self> {
        let mut list: Vec<Self> = Vec::new();
        for mut term in terms {
            let own = prior.iter().filter(|(name, _)| term.owns(name));
            term.known = own.map(|(name, prior)| (name.clone(), *prior)).collect();
            for (name, value) in &mut term.hidden {
                if let Some((_, prior)) = term.known.iter().find(|(known, _)| known == name) {
                    *value = prior.mean.get();
                }
            }
            if !list.contains(&term) {
                list.push(term);
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

    /// The same with a size of its own in each of `runs` runs, where these may differ.
    fn by_run(&self, runs: usize) -> Option<Self> {
        let mut sizes = self.info().parameters.iter().filter(|parameter| parameter.role == Role::Size);
        let may = (2..=MOST_RUNS).contains(&runs) && sizes.any(|size| size.may_differ);
        may.then(|| Self { by_run: true, ..self.clone() })
    }

    /// Whether the parameter called `name` is one of this cause's.
    pub(crate) fn owns(&self, name: &str) -> bool {
        name.split('/').next() == Some(self.cause.name())
    }

    /// Whether `parameter`, called `name`, is another number in each run.
    fn is_own(&self, name: &str, parameter: &ParameterInfo) -> bool {
        parameter.per_run || self.by_run && self.is_size(name, parameter)
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
            let is_free = matches!(parameter.role, Role::Hidden(_)) || self.is_size(&name, &parameter);
            if !is_free || self.is_idle(&parameter) {
                continue;
            }
            let Ok(place) = model.find_parameter(&name) else { continue };
            let [lower, upper] = self.bounds(&parameter);
            if self.is_own(&name, &parameter) {
                added.own.push((name, Nuisance::Own { place, lower, upper }));
            } else {
                let known = self.known.iter().find(|(known, _)| *known == name);
                added.free.push(FreeParameter {
                    start: model.get(place),
                    names: vec![name],
                    places: vec![place],
                    shares: vec![1.0],
                    scale: Scale::new(lower, upper),
                    prior: known.map(|(_, prior)| *prior),
                });
            }
        }
        added
    }

    /// The numbers along which a score test looks: name, whether each run has its own, least and greatest.
    pub(crate) fn directions(&self, model: &Model) -> Vec<(String, bool, [f64; 2])> {
        let sizes = names(self.cause, model).into_iter();
        sizes
            .filter(|(name, parameter)| parameter.role == Role::Switch || self.is_size(name, parameter))
            .map(|(name, parameter)| {
                let (own, bounds) = (self.is_own(&name, &parameter), self.bounds(&parameter));
                (name, own, bounds)
            })
            .collect()
    }

    /// Whether the parameter called `name` is how strong the cause is.
    fn is_size(&self, name: &str, parameter: &ParameterInfo) -> bool {
        match &self.element {
            Some(element) => element.size == name,
            None => parameter.role == Role::Size,
        }
    }

    /// Bounds of `parameter`: of an element's size, which adds to the common one, those of that one.
    fn bounds(&self, parameter: &ParameterInfo) -> [f64; 2] {
        let common = || {
            let mut sizes = self.info().parameters.iter().filter(|other| other.role == Role::Size);
            sizes.find(|other| other.per == Per::Model)
        };
        let is_element = parameter.role == Role::Detail;
        if is_element { common().map_or(parameter.bounds, |size| size.bounds) } else { parameter.bounds }
    }

    /// The element that it sits in, by the element's own name.
    pub(crate) fn element(&self) -> Option<&str> {
        let element = self.element.as_ref()?;
        Some(element.size.split_once('/').map_or(&element.size, |(_, name)| name))
    }

    /// Whether it is one of several forms of its cause, which are no further causes.
    pub(crate) fn is_choice(&self) -> bool {
        self.by_run || self.element.as_ref().is_some_and(|element| element.of > 1)
    }

    /// Whether what it needs of a model beside sizes is what `other`, of the same cause, needs.
    pub(crate) fn is_form_of(&self, other: &Self) -> bool {
        (self.cause, &self.choices, &self.hidden) == (other.cause, &other.choices, &other.hidden)
    }
}

/// Where `effect` may sit: in all elements together, and where there are several in each alone, or in each that a glob of `elements` means. An effect
/// with but one element sits there.
fn forms(effect: &CauseValues, elements: &[String]) -> Vec<Option<Element>> {
    let of_elements = |parameter: &ParameterInfo| parameter.per != Per::Model;
    let sizes =
        || effect.parameters().filter(|parameter| matches!(parameter.role, Role::Size | Role::Switch));
    let members = effect.names().iter().zip(effect.parameters());
    let members: Vec<&String> =
        members.filter(|(_, parameter)| of_elements(parameter)).map(|(name, _)| name).collect();
    let count = members.len();
    let common = sizes().any(|parameter| !of_elements(parameter));
    let meant = |name: &&String| {
        let own = name.split_once('/').map_or("", |(_, own)| own);
        elements.is_empty() || elements.iter().any(|element| glob(element, own))
    };
    let alone = count > 1 || !common;
    let meant: Vec<&String> = members.into_iter().filter(meant).collect();
    let of = meant.len();
    let each = meant.into_iter().map(|name| Some(Element { size: name.clone(), of }));
    let each = each.filter(|_| alone && of <= MOST_ELEMENTS);
    let together = common || count > MOST_ELEMENTS || count > 1 && sizes().next().is_some();
    together.then_some(None).into_iter().chain(each).collect()
}

/// The parameters of `cause` in `model`, named.
pub(crate) fn names(cause: Cause, model: &Model) -> Vec<(String, ParameterInfo)> {
    let effect = model.causes().iter().find(|effect| effect.cause() == cause);
    effect.map_or(Vec::new(), |effect| {
        effect.names().iter().cloned().zip(effect.parameters().copied()).collect()
    })
}
