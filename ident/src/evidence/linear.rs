//! A hypothesis at a point: residuals of all runs, and their whitened derivatives by whatever is asked for.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sim::Model;
use sim::model::Parameter;
use sim::transitions::Transitions;

use super::atoms::Atoms;
use super::columns::{Column, columns};
use super::unknown::{PIECE_S, Unknown, UnknownColumns};
use crate::fit::counts::Counts;
use crate::fit::problem::Term;
use crate::hypothesis::state::State;
use crate::loss::residuals;
use crate::simulate::Numbers;

/// Where a hypothesis stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    /// The numbers that are fitted anyway, SI.
    pub(super) base: Vec<f64>,
    /// What is uncertain about each run's start.
    pub(super) offsets: Vec<Vec<f64>>,
    /// The sizes of the hypothesis' columns, SI; from its start for a hidden number.
    pub(super) sizes: Vec<f64>,
}

/// One run's whitened residuals and derivatives.
#[derive(Debug, Clone)]
pub(super) struct RunColumns {
    pub(super) residuals: DVector<f64>,
    /// By what is fitted anyway, then by the run's own start.
    pub(super) base: DMatrix<f64>,
    /// By numbers of causes, and which these are.
    pub(super) numbers: Vec<(usize, DVector<f64>)>,
    /// By the slip of keypoints, where it is asked for.
    pub(super) slips: DMatrix<f64>,
    pub(super) unknown: Option<UnknownColumns>,
}

/// A hypothesis laid out: its atoms, columns and model.
#[derive(Debug, Clone)]
pub(super) struct Setting {
    /// Places in [`Atoms::list`], rising.
    pub(super) set: Vec<usize>,
    pub(super) columns: Vec<Column>,
    model: Model,
    /// The numbers of its causes that are turned, and those that are set: switches.
    pub(super) numbers: Vec<usize>,
    places: Vec<Parameter>,
}

/// The runs to be explained, and all that is the same for every hypothesis.
pub(super) struct Bench<'a> {
    /// The model as it stands, fitted.
    pub(super) state: State<'a>,
    pub(super) atoms: Atoms,
    pub(super) unknown: Unknown,
}

impl Setting {
    pub(super) fn new(atoms: &Atoms, base: &Model, set: &[usize]) -> Self {
        let mut model = base.clone();
        let mut numbers: Vec<usize> = Vec::new();
        for &atom in set {
            let atom = &atoms.list[atom];
            model = atom.term.added_to(&model);
            atom.term.switched_on(&mut model);
            numbers.extend(&atom.numbers);
        }
        numbers.sort_unstable();
        numbers.dedup();
        let mut places = Vec::new();
        // names come from the model itself
        numbers.retain(|&number| match model.find_parameter(&atoms.numbers[number].name) {
            Ok(place) => {
                places.push(place);
                true
            }
            Err(_) => false,
        });
        Self { set: set.to_vec(), columns: columns(atoms, set), model, numbers, places }
    }

    /// The values of [`Setting::numbers`] in `run`.
    pub(super) fn values(&self, atoms: &Atoms, sizes: &[f64], run: usize) -> Vec<f64> {
        let value = |&number: &usize| {
            let known = &atoms.numbers[number];
            let start = if known.is_switch { 1.0 } else { known.neutral };
            let own = self.columns.iter().zip(sizes);
            let own = own.filter(|(column, _)| column.number == number && column.acts_in(run));
            let own = own.filter(|_| !known.is_switch);
            (start + own.map(|(_, size)| size).sum::<f64>()).clamp(known.bounds[0], known.bounds[1])
        };
        self.numbers.iter().map(value).collect()
    }
}

/// Numbers looked at in one pass: those of one form of each cause at most, as many as share a pass.
struct Pack {
    model: Model,
    numbers: Vec<usize>,
}

impl<'a> Bench<'a> {
    /// Runs at the state's point, with units for the unknown. `None` where it cannot be simulated.
    pub(super) fn new(state: State<'a>, atoms: Atoms, counts: &mut Counts) -> Option<Self> {
        let point = Point {
            base: state.point.values.clone(),
            offsets: state.point.offsets.clone(),
            sizes: Vec::new(),
        };
        let model = state.calibrated();
        let setting = Setting::new(&atoms, &state.model, &[]);
        let mut bench = Self { unknown: Unknown::new(&model, &[], &[]), state, atoms };
        let at = bench.transitions(&setting, &point, counts)?;
        bench.unknown = Unknown::new(&model, &bench.state.terms, &at);
        Some(bench)
    }

    /// The same, with nothing seen in any run but the first `fitted` ones.
    pub(super) fn seeing(&self, fitted: usize) -> Self {
        let mut state = self.state.clone();
        for term in state.terms.iter_mut().skip(fitted) {
            term.observations.clear();
            term.whitening = None;
        }
        let mut unknown = self.unknown.clone();
        unknown.forget_from(fitted);
        Self { state, atoms: self.atoms.clone(), unknown }
    }

    pub(super) fn setting(&self, set: &[usize]) -> Setting {
        Setting::new(&self.atoms, &self.state.model, set)
    }

    pub(super) fn runs(&self) -> usize {
        self.state.terms.len()
    }

    /// Places and values of all numbers that `setting` turns, in `run` at `point`.
    fn numbers(&self, setting: &Setting, point: &Point, run: usize) -> (Vec<Parameter>, Vec<f64>) {
        let mut places = self.state.parameters.places();
        let mut values = self.state.parameters.spread(&point.base);
        places.extend(&setting.places);
        values.extend(setting.values(&self.atoms, &point.sizes, run));
        (places, values)
    }

    fn transitions(&self, setting: &Setting, point: &Point, counts: &mut Counts) -> Option<Vec<Transitions>> {
        let directions = setting.model.nq() + 3 * setting.model.nv();
        counts.rollouts += (self.runs() * directions) as u64;
        let one = |run: usize| {
            if counts.is_stopped() {
                return None;
            }
            let (places, values) = self.numbers(setting, point, run);
            let term = &self.state.terms[run];
            let at = (&values[..], &point.offsets[run][..]);
            term.rehearsal.transitions(&setting.model, &places, at, PIECE_S, term.instants).ok()
        };
        (0..self.runs()).into_par_iter().map(one).collect()
    }

    /// Adds the unknown's columns at `point` to `columns`; whether there are any.
    pub(super) fn add_unknown(
        &self,
        setting: &Setting,
        point: &Point,
        columns: &mut [RunColumns],
        counts: &mut Counts,
    ) -> bool {
        let Some(at) = self.transitions(setting, point, counts) else { return false };
        columns.par_iter_mut().zip(&at).enumerate().for_each(|(run, (columns, at))| {
            columns.slips = self.unknown.slips(run).clone();
            columns.unknown = Some(self.unknown.columns(run, at, &self.state.terms[run]));
        });
        true
    }

    /// Residuals and derivatives by what is fitted anyway, by the starts, and by the numbers of `setting`.
    pub(super) fn linear(
        &self,
        setting: &Setting,
        point: &Point,
        counts: &mut Counts,
    ) -> Option<Vec<RunColumns>> {
        let free = self.state.parameters.len();
        let base_places: usize = self.state.parameters.free.iter().map(|free| free.places.len()).sum();
        let turned: Vec<usize> = (0..setting.numbers.len())
            .filter(|&place| !self.atoms.numbers[setting.numbers[place]].is_switch)
            .collect();
        let mut varied = self.state.parameters.rates();
        varied.extend(turned.iter().map(|place| vec![(base_places + place, 1.0)]));
        let together = sim::Isa::best().directions();
        let tasks: Vec<(usize, usize)> = (0..self.runs())
            .flat_map(|run| {
                let all = varied.len() + self.state.terms[run].rehearsal.nuisances.len();
                (0..all.max(1)).step_by(together).map(move |first| (run, first))
            })
            .collect();
        counts.rollouts += (tasks.len() * together) as u64;
        let parts: Vec<Option<crate::fit::problem::Linear>> = tasks
            .par_iter()
            .map(|&(run, first)| {
                if counts.is_stopped() {
                    return None;
                }
                let (places, values) = self.numbers(setting, point, run);
                let at = Numbers { places: &places, values: &values, varied: &varied };
                let columns = first..first + together;
                self.state.terms[run].linear(&setting.model, &at, &point.offsets[run], columns)
            })
            .collect();
        let mut runs: Vec<Vec<crate::fit::problem::Linear>> = vec![Vec::new(); self.runs()];
        for ((run, _), part) in tasks.into_iter().zip(parts) {
            runs[run].push(part?);
        }
        let slips = |run: usize, rows: usize| match self.unknown.stated_slip > 0.0 {
            true => self.unknown.slips(run).clone(),
            false => DMatrix::zeros(rows, 0),
        };
        let joined = runs.into_iter().enumerate().map(|(run, mut parts)| {
            let columns: Vec<DVector<f64>> = parts
                .iter()
                .flat_map(|part| part.jacobian.column_iter().map(|column| column.into_owned()))
                .collect();
            let rows = parts[0].residuals.len();
            let of_numbers = free..free + turned.len();
            let base = columns.iter().enumerate().filter(|(place, _)| !of_numbers.contains(place));
            let base: Vec<DVector<f64>> = base.map(|(_, column)| column.clone()).collect();
            RunColumns {
                residuals: std::mem::replace(&mut parts[0].residuals, DVector::zeros(0)),
                base: match base.is_empty() {
                    true => DMatrix::zeros(rows, 0),
                    false => DMatrix::from_columns(&base),
                },
                numbers: turned
                    .iter()
                    .map(|&place| setting.numbers[place])
                    .zip(columns[of_numbers].iter().cloned())
                    .collect(),
                slips: slips(run, rows),
                unknown: None,
            }
        });
        Some(joined.collect())
    }

    /// Adds to `columns` those of all numbers that `setting` has not, at neutral; hidden ones say nothing there. A switch has what it changes as its column.
    pub(super) fn add_candidates(
        &self,
        setting: &Setting,
        point: &Point,
        columns: &mut [RunColumns],
        counts: &mut Counts,
    ) {
        let packs = self.packs(setting);
        let tasks: Vec<(usize, usize)> =
            (0..packs.len()).flat_map(|pack| (0..self.runs()).map(move |run| (pack, run))).collect();
        counts.rollouts += (packs.iter().map(|pack| pack.numbers.len()).sum::<usize>() * self.runs()) as u64;
        let residuals: Vec<DVector<f64>> = columns.iter().map(|run| run.residuals.clone()).collect();
        let parts: Vec<Vec<(usize, DVector<f64>)>> = tasks
            .par_iter()
            .map(|&(pack, run)| {
                if counts.is_stopped() {
                    return Vec::new();
                }
                self.of_pack(setting, point, &packs[pack], run, &residuals[run])
            })
            .collect();
        for ((_, run), part) in tasks.into_iter().zip(parts) {
            columns[run].numbers.extend(part);
        }
    }

    fn of_pack(
        &self,
        setting: &Setting,
        point: &Point,
        pack: &Pack,
        run: usize,
        residuals: &DVector<f64>,
    ) -> Vec<(usize, DVector<f64>)> {
        let (mut places, mut values) = self.numbers(setting, point, run);
        let first = places.len();
        let mut numbers = Vec::new();
        for &number in &pack.numbers {
            let known = &self.atoms.numbers[number];
            if let Ok(place) = pack.model.find_parameter(&known.name) {
                places.push(place);
                values.push(known.neutral);
                numbers.push(number);
            }
        }
        let (term, offsets) = (&self.state.terms[run], &point.offsets[run]);
        // what it changes, over its size, at its typical one; a switch is on there
        let secant = |place: usize, number: usize| {
            let known = &self.atoms.numbers[number];
            let size = if known.is_switch { 1.0 } else { known.typical };
            let mut model = pack.model.clone();
            places.iter().zip(&values).for_each(|(&place, &value)| model.set(place, value));
            model.set(places[place], known.neutral + size);
            Some((number, (residuals_of(term, &model, offsets)? - residuals) / size))
        };
        if let [number] = numbers[..]
            && self.atoms.numbers[number].is_switch
        {
            return secant(first, number).into_iter().collect();
        }
        let varied: Vec<_> = (first..places.len()).map(|place| vec![(place, 1.0)]).collect();
        let at = Numbers { places: &places, values: &values, varied: &varied };
        let Some(linear) = term.linear(&pack.model, &at, offsets, 0..varied.len()) else { return Vec::new() };
        let column = |(place, number): (usize, usize)| {
            let slope = linear.jacobian.column(place);
            // some friction has no slope where there is none
            match slope.norm_squared() > 0.0 {
                true => Some((number, slope.into_owned())),
                false => secant(first + place, number),
            }
        };
        numbers.into_iter().enumerate().filter_map(column).collect()
    }

    /// All numbers beside those of `setting`, in as few passes as there can be.
    fn packs(&self, setting: &Setting) -> Vec<Pack> {
        let room = sim::Isa::best().directions();
        let mut packs: Vec<Pack> = Vec::new();
        let carried: Vec<_> = setting.set.iter().map(|&atom| &self.atoms.list[atom].term).collect();
        for (number, known) in self.atoms.numbers.iter().enumerate() {
            let clashes = |term: &&crate::hypothesis::candidates::Term| {
                term.cause == known.carrier.cause && !term.is_form_of(&known.carrier)
            };
            if known.is_hidden || setting.numbers.contains(&number) || carried.iter().any(clashes) {
                continue;
            }
            let fits = |pack: &Pack| {
                let same = |&other: &usize| {
                    let other = &self.atoms.numbers[other];
                    !other.is_switch
                        && (other.carrier.cause != known.carrier.cause
                            || other.carrier.is_form_of(&known.carrier))
                };
                !known.is_switch && pack.numbers.len() < room && pack.numbers.iter().all(same)
            };
            let place = packs.iter().position(fits).unwrap_or_else(|| {
                packs.push(Pack { model: setting.model.clone(), numbers: Vec::new() });
                packs.len() - 1
            });
            packs[place].model = known.carrier.added_to(&packs[place].model);
            packs[place].numbers.push(number);
        }
        packs
    }
}

fn residuals_of(term: &Term<'_>, model: &Model, offsets: &[f64]) -> Option<DVector<f64>> {
    let simulated = term.rehearsal.simulate(model, offsets, term.instants).ok()?;
    let width = term.rehearsal.run.trajectory.keypoints.len();
    let mut residuals = residuals(&term.observations, &simulated, width);
    if let Some(whitening) = &term.whitening {
        whitening.apply(&mut residuals);
    }
    Some(residuals.into())
}
