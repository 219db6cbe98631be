//! The score test: what each candidate would gain, from its derivatives at neutral alone.
//!
//! Derivatives of all candidates are exact and taken together, several causes a pass. What the baseline's coefficients,
//! the starts of the runs and their priors could do as well is projected out of them; what is left, times the residuals,
//! says how much cost the best value would save. A value of the wrong sign saves nothing.
//!
//! # Source
//! C. R. Rao, "Large sample tests of statistical hypotheses concerning several parameters", Mathematical Proceedings of
//! the Cambridge Philosophical Society 44 (1948) 50-57.

use nalgebra::{DMatrix, DMatrixViewMut, DVector};
use rayon::prelude::*;
use sim::Model;

use super::candidates::Term;
use super::nuisances::Nuisances;
use super::state::State;
use crate::fit::counts::Counts;
use crate::fit::problem::Linear;
use crate::simulate::Numbers;

/// One derivative: of all keypoints of one run, or of all runs, by one number.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    /// Which of the candidates.
    pub(crate) candidate: usize,
    /// The number's name.
    pub(crate) name: String,
    /// The run, where each has its own.
    pub(crate) run: Option<usize>,
    /// Furthest that the number can go from neutral.
    room: [f64; 2],
}

/// Columns that are projected together.
const COLUMNS_TOGETHER: usize = 8;

/// All candidates against one state.
#[derive(Clone)]
pub(crate) struct Scores {
    pub(crate) list: Vec<Term>,
    pub(crate) columns: Vec<Column>,
    /// Derivatives of the whitened residuals with everything projected out that is fitted anyway, per unit of each number, shape (rows,
    /// columns).
    pub(crate) projected: DMatrix<f64>,
    pub(crate) nuisances: Nuisances,
}

/// Directions that share a pass.
struct Pack {
    model: Model,
    /// The causes in it, by candidate.
    candidates: Vec<usize>,
    /// Names and places; those of one cause in several forms once.
    directions: Vec<(String, sim::model::Parameter)>,
}

impl Scores {
    /// Scores `candidates` at the optimum `state`; `counts` says whether anybody waits for it.
    pub(crate) fn new(state: &State<'_>, candidates: &[Term], counts: &Counts) -> Self {
        let packs = packs(&state.model, candidates);
        let nuisances = Nuisances::new(state);
        let tasks: Vec<(usize, usize)> =
            (0..packs.len()).flat_map(|pack| (0..state.terms.len()).map(move |run| (pack, run))).collect();
        let linear = |&(pack, run): &(usize, usize)| {
            if counts.is_stopped() { None } else { packs[pack].linear(state, run) }
        };
        let parts: Vec<Option<Linear>> = tasks.par_iter().map(linear).collect();

        let runs = state.terms.len();
        let mut columns: Vec<Column> = Vec::new();
        let mut sources: Vec<(usize, usize)> = Vec::new();
        for (index, candidate) in candidates.iter().enumerate() {
            let Some(pack) = packs.iter().position(|pack| pack.candidates.contains(&index)) else { continue };
            for (name, per_run, bounds) in candidate.directions(&packs[pack].model) {
                let Some(place) = packs[pack].place(&name) else { continue };
                let neutral = packs[pack].model.parameter(&name).unwrap_or(0.0);
                let room = [bounds[0] - neutral, bounds[1] - neutral];
                for run in if per_run { (0..runs).map(Some).collect() } else { vec![None] } {
                    columns.push(Column { candidate: index, name: name.clone(), run, room });
                    sources.push((pack, place));
                }
            }
        }
        let rows = nuisances.len();
        let mut raw = DMatrix::zeros(rows, columns.len());
        let filled = raw.as_mut_slice().par_chunks_mut(rows.max(1)).zip(&columns).zip(&sources);
        filled.for_each(|((whole, column), &(pack, place))| {
            for run in (0..runs).filter(|run| column.run.is_none_or(|own| own == *run)) {
                if let Some(linear) = &parts[pack * runs + run] {
                    whole[nuisances.of_run(run)].copy_from_slice(linear.jacobian.column(place).as_slice());
                }
            }
        });
        let mut projected = raw;
        projected.as_mut_slice().par_chunks_mut(COLUMNS_TOGETHER * rows.max(1)).for_each(|several| {
            let mut several = DMatrixViewMut::from_slice(several, rows, several.len() / rows);
            // in units of their own length, so that none is lost beside a larger one
            let lengths: Vec<f64> =
                several.column_iter().map(|column| column.norm().max(f64::MIN_POSITIVE)).collect();
            several.column_iter_mut().zip(&lengths).for_each(|(mut column, length)| column /= *length);
            nuisances.take_out(several.as_view_mut());
            several.column_iter_mut().zip(&lengths).for_each(|(mut column, length)| column *= *length);
        });
        let list = candidates.to_vec();
        Self { list, columns, projected, nuisances }
    }

    /// For each candidate, what share of `change`, a change of all residuals with everything projected out that is fitted anyway, it could
    /// bring about.
    pub(crate) fn shares(&self, change: &DVector<f64>) -> Vec<f64> {
        let all = change.norm_squared().max(f64::MIN_POSITIVE);
        let slopes = -self.projected.tr_mul(change);
        let share = |(index, term): (usize, &Term)| {
            let own = (0..self.columns.len()).filter(|&column| self.columns[column].candidate == index);
            gain(&self.projected, &slopes, &self.columns, own.collect(), term.is_switch()) / all
        };
        self.list.iter().enumerate().map(share).collect()
    }
}

/// Cost saved by the best values of the columns `own` that have the right signs.
fn gain(
    projected: &DMatrix<f64>,
    slopes: &DVector<f64>,
    columns: &[Column],
    mut own: Vec<usize>,
    is_switch: bool,
) -> f64 {
    loop {
        // what the fitted numbers imitate to the last digit gains nothing
        own.retain(|&column| projected.column(column).norm_squared() > f64::MIN_POSITIVE);
        if own.is_empty() {
            return 0.0;
        }
        let part = projected.select_columns(&own);
        let mut gram = part.tr_mul(&part);
        let slope = DVector::from_iterator(own.len(), own.iter().map(|&column| slopes[column]));
        if is_switch {
            // the way there is not straight: only its direction counts
            return if slope[0] < 0.0 { slope[0].powi(2) / gram[(0, 0)] } else { 0.0 };
        }
        for i in 0..own.len() {
            gram[(i, i)] *= 1.0 + 1e-9;
        }
        let Some(factor) = gram.cholesky() else { return 0.0 };
        let step = -factor.solve(&slope);
        let wrong: Vec<usize> = (0..own.len())
            .filter(|&i| {
                let [lower, upper] = columns[own[i]].room;
                step[i] < 0.0 && lower >= 0.0 || step[i] > 0.0 && upper <= 0.0
            })
            .map(|i| own[i])
            .collect();
        if wrong.is_empty() {
            return -slope.dot(&step);
        }
        own.retain(|column| !wrong.contains(column));
    }
}

/// Puts the directions of all candidates into as few passes as there can be: one value of a hidden number of each cause
/// a pass, as many directions as share one.
fn packs(model: &Model, candidates: &[Term]) -> Vec<Pack> {
    let room = sim::Isa::best().directions();
    let mut packs: Vec<Pack> = Vec::new();
    for (index, candidate) in candidates.iter().enumerate() {
        let names: Vec<String> =
            candidate.directions(&candidate.added_to(model)).into_iter().map(|(name, ..)| name).collect();
        let fits = |pack: &Pack| {
            let more = names.iter().filter(|name| pack.place(name).is_none()).count();
            pack.directions.len() + more <= room
                && pack
                    .candidates
                    .iter()
                    .map(|&other| &candidates[other])
                    .all(|other| other.cause != candidate.cause || other.is_form_of(candidate))
        };
        let place = packs.iter().position(fits).unwrap_or_else(|| {
            packs.push(Pack { model: model.clone(), candidates: Vec::new(), directions: Vec::new() });
            packs.len() - 1
        });
        let pack = &mut packs[place];
        pack.model = candidate.added_to(&pack.model);
        pack.candidates.push(index);
        for name in names {
            if let (None, Ok(parameter)) = (pack.place(&name), pack.model.find_parameter(&name)) {
                pack.directions.push((name, parameter));
            }
        }
    }
    packs
}

impl Pack {
    fn place(&self, name: &str) -> Option<usize> {
        self.directions.iter().position(|(own, _)| own == name)
    }

    fn linear(&self, state: &State<'_>, run: usize) -> Option<Linear> {
        let mut places = state.parameters.places();
        let mut values = state.parameters.spread(&state.point.values);
        let first = places.len();
        for (_, place) in &self.directions {
            places.push(*place);
            values.push(self.model.get(*place));
        }
        let varied: Vec<_> = (first..places.len()).map(|place| vec![(place, 1.0)]).collect();
        let at = Numbers { places: &places, values: &values, varied: &varied };
        state.terms[run].linear(&self.model, &at, &state.point.offsets[run], 0..varied.len())
    }
}
