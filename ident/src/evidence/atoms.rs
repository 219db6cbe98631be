//! What hypotheses are made of: every cause in every form, from `sim`'s list of causes.
//!
//! An [`Atom`] is a cause in one place (all elements, or one), with its discrete choices made and its hidden numbers started, in one
//! [`Form`]. Its numbers are places in the model; which of them has which size in which run is what a form says (`columns`).

use std::collections::BTreeMap;

use sim::causes::{Kind, Role};

use crate::experiment::{Experiment, RunKind};
use crate::hypothesis::candidates::{Term, aliases, fitted, names, possible};
use crate::parameters::Parameters;

/// How the sizes of a cause go with the runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Form {
    /// The same in all runs.
    All,
    /// A common size and a deviation of each run.
    CommonAndByRun,
    /// Another size in each run, none in common: the null of the cause. A stand-in has another size in each run, a true cause has not.
    ByRunOnly,
    /// In runs that are let go only.
    DropsOnly,
    /// In runs that are let go only, in each by another size: so is a release that is written down by hand.
    DropsByRun,
    /// In this run only.
    OneRun(usize),
}

/// A number of a cause that hypotheses may turn.
#[derive(Debug, Clone)]
pub(super) struct Number {
    /// As in the model, `<cause>/<parameter>`.
    pub(super) name: String,
    /// The cause with the choices and hidden starts at which the number is looked at.
    pub(super) carrier: Term,
    /// Where it starts; sizes are absent there.
    pub(super) neutral: f64,
    pub(super) bounds: [f64; 2],
    /// Its usual size, SI, by the list of causes.
    pub(super) typical: f64,
    pub(super) is_hidden: bool,
    /// There or not, nothing in between: 1 where the atom is, never fitted.
    pub(super) is_switch: bool,
    /// Has a value of its own in each run by its nature, as a wave's phase.
    pub(super) each_run: bool,
}

/// A cause in one place and one form.
#[derive(Debug, Clone)]
pub(super) struct Atom {
    pub(super) term: Term,
    pub(super) form: Form,
    /// Its sizes and switches, then its hidden numbers, as places in [`Atoms::numbers`].
    pub(super) numbers: Vec<usize>,
    /// Runs in which it can act, and those of them that are let go.
    pub(super) runs: Vec<usize>,
    pub(super) drops: Vec<usize>,
    /// Logarithm of its prior odds over its absence.
    pub(super) ln_odds: f64,
    /// The name that its cause shares with those that no video tells from it.
    pub(super) class: String,
    /// Whether it acts in the camera and does differ from run to run, as its clock and its place do.
    pub(super) differs: bool,
    /// Whether it exerts forces, and so may stand in for a force that nobody knows.
    pub(super) is_force: bool,
    /// Whether it has numbers of its own in each run by its nature, as waves have their phase.
    pub(super) each_run: bool,
}

/// All that may be at work.
#[derive(Debug, Clone)]
pub(super) struct Atoms {
    pub(super) numbers: Vec<Number>,
    pub(super) list: Vec<Atom>,
}

/// Chance of each cause before any data: one in 25, so that about one of the list is at work in a rig (a prototype, chosen).
const CAUSE_CHANCE: f64 = 0.04;
/// Share of a cause's chance that goes to all of its elements together; the rest is spread over single ones (a prototype, chosen).
const ALL_ELEMENTS_SHARE: f64 = 0.5;
/// Shares of a cause's chance by form: common, common and by run, by run only (a prototype, chosen).
const FORCE_SHARES: [f64; 3] = [0.8, 0.05, 0.15];
/// The same for the camera's clock and place, which do differ, with what is left for drops only, for these by run, and for
/// one run, each.
const CAMERA_SHARES: [f64; 6] = [0.6, 0.05, 0.1, 0.1, 0.05, 0.1];

impl Atom {
    pub(super) fn cause(&self) -> &'static str {
        self.term.cause.name()
    }

    /// Whether it names its cause; by run only it says that something differs from run to run and resembles it, but where causes do differ.
    pub(super) fn is_named(&self) -> bool {
        self.differs || self.form != Form::ByRunOnly
    }

    /// Whether it is `other` but for its form and where its hidden numbers start.
    pub(super) fn is_placed_as(&self, other: &Self) -> bool {
        self.term.cause == other.term.cause
            && self.term.element == other.term.element
            && self.term.choices == other.term.choices
    }

    /// The cause and the choice made of its laws.
    pub(super) fn law(&self) -> String {
        format!("{} {:?}", self.cause(), self.term.choices)
    }

    /// The cause and its element.
    pub(super) fn place(&self) -> String {
        self.term.element().map_or(self.cause().to_owned(), |element| format!("{}/{element}", self.cause()))
    }

    /// The cause, its element and its form.
    pub(super) fn label(&self) -> String {
        let form = match self.form {
            Form::All => String::new(),
            Form::CommonAndByRun => " (common, and by run)".into(),
            Form::ByRunOnly => " (by run only)".into(),
            Form::DropsOnly => " (drops only)".into(),
            Form::DropsByRun => " (drops only, by run)".into(),
            Form::OneRun(run) => format!(" (run {} only)", run + 1),
        };
        format!("{}{form}", self.place())
    }
}

impl Atoms {
    /// Every cause that may be at work in `runs` of `experiment` beside what `parameters` fit.
    pub(super) fn new(experiment: &Experiment, runs: &[RunKind], parameters: &Parameters) -> Self {
        let mut atoms = Self { numbers: Vec::new(), list: Vec::new() };
        let config = &experiment.diagnose;
        for cause in possible(experiment, &fitted(&experiment.model, parameters)) {
            let odds = config.odds.get(cause.name()).map_or(1.0, |odds| odds.get());
            let terms = Term::all(cause, &experiment.model, 1, odds, &config.elements);
            let terms = Term::knowing(terms, &config.prior);
            let same = |term: &Term| terms.iter().filter(|other| other.element == term.element).count();
            let singles: BTreeMap<_, _> =
                terms.iter().filter_map(|term| Some((term.element()?, ()))).collect();
            let has_all = terms.iter().any(|term| term.element.is_none());
            let names = aliases(cause, experiment);
            let class = names.iter().copied().chain([cause.name()]).min().unwrap_or(cause.name());
            for term in &terms {
                let place = match (&term.element, has_all, singles.len()) {
                    (None, _, 0) => 1.0,
                    (None, ..) => ALL_ELEMENTS_SHARE,
                    (Some(_), true, of) => (1.0 - ALL_ELEMENTS_SHARE) / of as f64,
                    (Some(_), false, of) => 1.0 / of as f64,
                };
                let chance =
                    (odds * CAUSE_CHANCE / (1.0 - CAUSE_CHANCE)).ln() + (place / same(term) as f64).ln();
                atoms.add_forms(term, runs, chance, class, &experiment.model);
            }
        }
        atoms
    }

    /// Adds `term` in every form that `runs` allow.
    fn add_forms(&mut self, term: &Term, runs: &[RunKind], ln_odds: f64, class: &str, model: &sim::Model) {
        let numbers = self.numbers_of(term, model);
        let kind = term.info().kind;
        let may_differ = term.info().parameters.iter().any(|parameter| parameter.may_differ);
        let differs = kind == Kind::Camera && may_differ;
        let can_act = |run: &usize| kind != Kind::Drive || runs[*run] != RunKind::Drop;
        let acting: Vec<usize> = (0..runs.len()).filter(can_act).collect();
        let each_run = numbers.iter().any(|&number| self.numbers[number].each_run);
        let is_drop = |run: &usize| runs[*run] == RunKind::Drop;
        let drops: Vec<usize> = acting.iter().copied().filter(is_drop).collect();
        let mut forms = vec![Form::All];
        if acting.len() > 1 && !each_run {
            if !term.is_switch() {
                forms.extend([Form::CommonAndByRun, Form::ByRunOnly]);
            }
            if differs {
                if drops.len() > 1 && drops.len() < acting.len() {
                    forms.extend([Form::DropsOnly, Form::DropsByRun]);
                }
                forms.extend(acting.iter().map(|&run| Form::OneRun(run)));
            }
        }
        for form in forms {
            let share = match (differs, form) {
                (false, Form::All) => FORCE_SHARES[0],
                (false, Form::CommonAndByRun) => FORCE_SHARES[1],
                (false, _) => FORCE_SHARES[2],
                (true, Form::All) => CAMERA_SHARES[0],
                (true, Form::CommonAndByRun) => CAMERA_SHARES[1],
                (true, Form::ByRunOnly) => CAMERA_SHARES[2],
                (true, Form::DropsOnly) => CAMERA_SHARES[3],
                (true, Form::DropsByRun) => CAMERA_SHARES[4],
                (true, Form::OneRun(_)) => CAMERA_SHARES[5] / acting.len() as f64,
            };
            self.list.push(Atom {
                term: term.clone(),
                form,
                numbers: numbers.clone(),
                runs: acting.clone(),
                drops: drops.clone(),
                ln_odds: ln_odds + share.ln(),
                class: class.to_owned(),
                differs,
                is_force: !matches!(kind, Kind::Camera | Kind::Drive),
                each_run,
            });
        }
    }

    /// The numbers of `term`, made where they are not there yet.
    fn numbers_of(&mut self, term: &Term, model: &sim::Model) -> Vec<usize> {
        let with = term.added_to(model);
        let directions = term.directions(&with);
        let mut list = Vec::new();
        let known = names(term.cause, &with);
        let info = |name: &str| known.iter().find(|(own, _)| own == name).map(|(_, info)| *info);
        let added = term.free(&with);
        let hidden = added.free.iter().filter(|free| directions.iter().all(|(name, ..)| name != free.name()));
        let hidden = hidden.map(|free| {
            let bounds = [free.scale.lower(), free.scale.upper()];
            (free.name().to_owned(), false, bounds, true)
        });
        let sizes = directions.iter().map(|(name, own, bounds)| (name.clone(), *own, *bounds, false));
        for (name, each_run, bounds, is_hidden) in sizes.chain(hidden) {
            let Some(info) = info(&name) else { continue };
            let same = |number: &Number| number.name == name && number.carrier.is_form_of(term);
            let place = self.numbers.iter().position(same).unwrap_or_else(|| {
                self.numbers.push(Number {
                    neutral: with.parameter(&name).unwrap_or(info.neutral),
                    carrier: Term { element: None, ..term.clone() },
                    bounds,
                    typical: info.typical,
                    is_hidden,
                    is_switch: info.role == Role::Switch,
                    each_run,
                    name,
                });
                self.numbers.len() - 1
            });
            list.push(place);
        }
        list
    }
}
