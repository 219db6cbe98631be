//! Products of whitened columns, and what is left of them once everything common to all hypotheses is integrated out.
//!
//! Order of elimination: of each run its start and its own force; then, over all runs, what is fitted anyway, the repeatable force's weights
//! and the slip; what is left are the numbers of causes, run by run. A hypothesis takes its few columns from there.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::linear::RunColumns;
use super::priors::{Beliefs, FORCE_SCALES, SLIP_SCALES, Scales};

/// By this share diagonals are raised, so that columns that depend on each other have a factor.
const JITTER_SHARE: f64 = 1e-9;

/// What stands at one run's columns of base, start and numbers, from the centres of what is believed of them.
#[derive(Debug, Clone)]
pub(super) struct Standing {
    pub(super) base: Vec<f64>,
    pub(super) start: Vec<f64>,
    pub(super) numbers: BTreeMap<usize, f64>,
}

/// The parts that columns fall into, in their order: first those that stay, then those of the run alone.
#[derive(Debug, Clone)]
struct Layout {
    base: Range<usize>,
    weights: Range<usize>,
    slips: Range<usize>,
    numbers: Range<usize>,
    /// The data, with all sizes taken back to where beliefs have their centre.
    data: usize,
    /// The residuals as they are.
    residual: usize,
    start: Range<usize>,
    own: Range<usize>,
}

#[derive(Debug)]
struct RunGram {
    layout: Layout,
    products: DMatrix<f64>,
}

/// All runs about one point.
#[derive(Debug)]
pub(super) struct Gram {
    runs: Vec<RunGram>,
    /// Places in [`super::atoms::Atoms::numbers`] of the columns by number.
    pub(super) numbers: Vec<usize>,
    pub(super) observations: usize,
    /// Where hidden numbers stand, from their centres. The data has no part of theirs: without the size that they belong to they do nothing.
    hidden: BTreeMap<usize, f64>,
    pub(super) beliefs: Arc<Beliefs>,
    memory: Mutex<BTreeMap<Scales, Option<Arc<Reduced>>>>,
}

/// One run with its start and its own force integrated out.
struct RunReduced {
    /// Products of base, weights, slips, numbers, data, residual.
    products: DMatrix<f64>,
    /// The same with its own force alone integrated out: its start stands where it stands.
    standing: DMatrix<f64>,
    ln_determinants: f64,
}

/// All but the numbers of causes integrated out, at some scales of the unknown.
#[derive(Debug)]
pub(super) struct Reduced {
    /// Of each run: products of its columns by number, and with the data.
    numbers: Vec<DMatrix<f64>>,
    with_data: Vec<DVector<f64>>,
    /// Of each run, its columns by number as the common ones see them: these are taken off.
    common: Vec<DMatrix<f64>>,
    common_data: DVector<f64>,
    /// The factor of the common ones, and which these are.
    factor: Cholesky<f64, Dyn>,
    pub(super) kept: Vec<usize>,
    /// Squares of the data that nothing common explains.
    pub(super) squares: f64,
    /// The same of the residuals: what a point costs.
    pub(super) cost: f64,
    /// Sum of half logarithms of prior over posterior precisions.
    pub(super) ln_determinants: f64,
}

impl Gram {
    /// `sizes`, by run: where the point stands; `hidden`: where numbers do that say nothing without others.
    pub(super) fn new(
        columns: &[RunColumns],
        sizes: &[Standing],
        hidden: BTreeMap<usize, f64>,
        beliefs: Arc<Beliefs>,
    ) -> Self {
        let mut numbers: Vec<usize> =
            columns.iter().flat_map(|run| run.numbers.iter().map(|(number, _)| *number)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let free = beliefs.base.len();
        let runs = columns
            .par_iter()
            .zip(sizes)
            .map(|(run, sizes)| RunGram::new(run, sizes, free, &numbers))
            .collect();
        let observations = columns.iter().map(|run| run.residuals.len()).sum();
        Self { runs, numbers, observations, hidden, beliefs, memory: Mutex::default() }
    }

    /// Whether the unknown's columns are there.
    pub(super) fn has_unknown(&self) -> bool {
        self.runs.iter().any(|run| !run.layout.own.is_empty())
    }

    /// Whether pictures are said to have errors of their own.
    pub(super) fn states_errors(&self) -> bool {
        self.beliefs.stated_slip > 0.0
    }

    /// Where `columns`, as [`Reduced::of`] takes them, stand that are hidden numbers; 0 for the others.
    pub(super) fn hidden(&self, columns: &[(usize, &[usize])]) -> DVector<f64> {
        let at = |(number, _): &(usize, &[usize])| self.hidden.get(&self.numbers[*number]).copied();
        DVector::from_iterator(columns.len(), columns.iter().map(|column| at(column).unwrap_or(0.0)))
    }

    /// See [`Reduced`]; `None` where digits are lost.
    pub(super) fn reduced(&self, scales: Scales) -> Option<Arc<Reduced>> {
        let known = |memory: &BTreeMap<Scales, Option<Arc<Reduced>>>| memory.get(&scales).cloned();
        // what is remembered stays whole whatever a thread does that holds it
        let lock = || self.memory.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(known) = known(&lock()) {
            return known;
        }
        let reduced = self.reduce(scales).map(Arc::new);
        lock().insert(scales, reduced.clone());
        reduced
    }

    fn reduce(&self, scales: Scales) -> Option<Reduced> {
        let own = FORCE_SCALES[scales[1]];
        let runs: Option<Vec<RunReduced>> = (0..self.runs.len())
            .into_par_iter()
            .map(|run| self.runs[run].reduced(&self.beliefs.starts[run], &self.beliefs.own[run], own))
            .collect();
        let runs = runs?;
        let layout = &self.runs[0].layout;
        let mut kept: Vec<usize> =
            layout.base.clone().filter(|&place| self.beliefs.base[place].is_finite()).collect();
        let mut precision: Vec<f64> = kept.iter().map(|&place| self.beliefs.base[place]).collect();
        let slip = SLIP_SCALES[scales[2]].hypot(self.beliefs.stated_slip);
        for (part, scale) in [(&layout.weights, FORCE_SCALES[scales[0]]), (&layout.slips, slip)] {
            if scale > 0.0 {
                kept.extend(part.clone());
                precision.extend(part.clone().map(|_| scale.powi(-2)));
            }
        }
        let mut products = DMatrix::zeros(kept.len(), kept.len());
        let mut data = DVector::zeros(kept.len());
        let (mut squares, mut ln_determinants) = (0.0, 0.0);
        for run in &runs {
            let part = |i: usize, j: usize| run.products[(kept[i], kept[j])];
            products += DMatrix::from_fn(kept.len(), kept.len(), part);
            data += DVector::from_fn(kept.len(), |i, _| run.products[(kept[i], layout.data)]);
            squares += run.products[(layout.data, layout.data)];
            ln_determinants += run.ln_determinants;
        }
        for (i, precision) in precision.iter().enumerate() {
            products[(i, i)] += precision + JITTER_SHARE * products[(i, i)];
        }
        let free = kept.iter().filter(|place| layout.base.contains(place)).count();
        let cost = standing_cost(&runs, &kept[free..], &precision[free..], layout.residual)?;
        let factor = products.cholesky()?;
        let half = |columns: &DMatrix<f64>| factor.l_dirty().solve_lower_triangular(columns);
        let diagonal = factor.l_dirty().diagonal();
        ln_determinants += precision.iter().map(|x| 0.5 * x.ln()).sum::<f64>();
        ln_determinants -= diagonal.iter().map(|x: &f64| x.ln()).sum::<f64>();
        let common_data = factor.l_dirty().solve_lower_triangular(&data)?;
        squares -= common_data.norm_squared();
        let (mut numbers, mut with_data, mut common) = (Vec::new(), Vec::new(), Vec::new());
        for run in &runs {
            let range = layout.numbers.clone();
            let size = range.len();
            numbers.push(run.products.view((range.start, range.start), (size, size)).into_owned());
            with_data.push(DVector::from_fn(size, |i, _| run.products[(range.start + i, layout.data)]));
            let seen = DMatrix::from_fn(kept.len(), size, |i, j| run.products[(kept[i], range.start + j)]);
            common.push(half(&seen)?);
        }
        Some(Reduced {
            numbers,
            with_data,
            common,
            common_data,
            kept,
            factor,
            squares,
            cost,
            ln_determinants,
        })
    }

    /// The starts, where what is fitted anyway and the unknown common to all runs have the sizes `common`, by [`Reduced::kept`], and the numbers
    /// these `sizes`, by run; all from the centres of what is believed of them.
    pub(super) fn starts(
        &self,
        scales: Scales,
        common: &[f64],
        sizes: &[DVector<f64>],
    ) -> Option<Vec<Vec<f64>>> {
        let reduced = self.reduced(scales)?;
        let mut all = DVector::zeros(self.runs[0].layout.slips.end);
        for (&place, size) in reduced.kept.iter().zip(common) {
            all[place] = *size;
        }
        let own = FORCE_SCALES[scales[1]];
        let of_run = |(run, (gram, sizes)): (usize, (&RunGram, &DVector<f64>))| {
            gram.start(&self.beliefs.starts[run], &self.beliefs.own[run], own, &all, sizes)
        };
        self.runs.iter().zip(sizes).enumerate().map(of_run).collect()
    }
}

/// Squares of the residuals of `runs` once the unknown and the slips, at the places `unknown`, are integrated out; all else stands where it stands.
fn standing_cost(runs: &[RunReduced], unknown: &[usize], precision: &[f64], residual: usize) -> Option<f64> {
    let sum = |i: usize, j: usize| runs.iter().map(|run| run.standing[(i, j)]).sum::<f64>();
    let cost = sum(residual, residual);
    if unknown.is_empty() {
        return Some(cost);
    }
    let mut products = DMatrix::from_fn(unknown.len(), unknown.len(), |i, j| sum(unknown[i], unknown[j]));
    for (i, precision) in precision.iter().enumerate() {
        products[(i, i)] += precision + JITTER_SHARE * products[(i, i)];
    }
    let with = DVector::from_fn(unknown.len(), |i, _| sum(unknown[i], residual));
    Some(cost - with.dot(&products.cholesky()?.solve(&with)))
}

impl Reduced {
    /// Products of the common ones and then of `columns`, and with the data; beliefs about the common ones are in them.
    pub(super) fn joint(&self, columns: &[(usize, &[usize])]) -> (DMatrix<f64>, DVector<f64>) {
        let (own, own_data) = self.of(columns);
        let (first, count) = (self.kept.len(), columns.len());
        let half = self.factor.l();
        let mut products = DMatrix::zeros(first + count, first + count);
        products.view_mut((0, 0), (first, first)).gemm(1.0, &half, &half.transpose(), 0.0);
        let mut data = DVector::zeros(first + count);
        data.rows_mut(0, first).copy_from(&(&half * &self.common_data));
        if count > 0 {
            let seen = DMatrix::from_columns(&self.seen(columns));
            let across = &half * &seen;
            products.view_mut((0, first), (first, count)).copy_from(&across);
            products.view_mut((first, 0), (count, first)).copy_from(&across.transpose());
            products.view_mut((first, first), (count, count)).copy_from(&(own + seen.tr_mul(&seen)));
            data.rows_mut(first, count).copy_from(&(own_data + seen.tr_mul(&self.common_data)));
        }
        (products, data)
    }

    /// Columns as the common ones see them.
    fn seen(&self, columns: &[(usize, &[usize])]) -> Vec<DVector<f64>> {
        let of = |(number, runs): &(usize, &[usize])| {
            let mut sum = DVector::zeros(self.common_data.len());
            for &run in *runs {
                sum += self.common[run].column(*number);
            }
            sum
        };
        columns.iter().map(of).collect()
    }

    /// Products of columns, each a number's place in [`Gram::numbers`] and its runs, and their products with the data.
    pub(super) fn of(&self, columns: &[(usize, &[usize])]) -> (DMatrix<f64>, DVector<f64>) {
        let seen = self.seen(columns);
        let count = columns.len();
        let mut products = DMatrix::zeros(count, count);
        let mut data = DVector::zeros(count);
        for (i, (number, runs)) in columns.iter().enumerate() {
            for (j, (other, others)) in columns.iter().enumerate().take(i + 1) {
                let shared = runs.iter().filter(|run| others.contains(run));
                let own: f64 = shared.map(|&run| self.numbers[run][(*number, *other)]).sum();
                products[(i, j)] = own - seen[i].dot(&seen[j]);
                products[(j, i)] = products[(i, j)];
            }
            data[i] = runs.iter().map(|&run| self.with_data[run][*number]).sum::<f64>()
                - seen[i].dot(&self.common_data);
        }
        (products, data)
    }
}

impl RunGram {
    fn new(
        run: &RunColumns,
        Standing { base, start, numbers: sizes }: &Standing,
        free: usize,
        numbers: &[usize],
    ) -> Self {
        let rows = run.residuals.len();
        let mut end = 0;
        let mut next = |count: usize| {
            end += count;
            end - count..end
        };
        let unknown = run.unknown.as_ref();
        let count = |part: fn(&super::unknown::UnknownColumns) -> &DMatrix<f64>| {
            unknown.map_or(0, |unknown| part(unknown).ncols())
        };
        let layout = Layout {
            base: next(free),
            weights: next(count(|unknown| &unknown.weights)),
            slips: next(run.slips.ncols()),
            numbers: next(numbers.len()),
            data: next(1).start,
            residual: next(1).start,
            start: next(run.base.ncols() - free),
            own: next(count(|unknown| &unknown.own)),
        };
        let mut all = DMatrix::zeros(rows, end);
        all.columns_mut(0, free).copy_from(&run.base.columns(0, free));
        all.columns_mut(layout.start.start, layout.start.len())
            .copy_from(&run.base.columns(free, layout.start.len()));
        all.columns_mut(layout.slips.start, layout.slips.len()).copy_from(&run.slips);
        if let Some(unknown) = unknown {
            for (part, range) in [(&unknown.weights, &layout.weights), (&unknown.own, &layout.own)] {
                all.columns_mut(range.start, range.len()).copy_from(part);
            }
        }
        let standing = DVector::from_iterator(run.base.ncols(), base.iter().chain(start).copied());
        let mut data = &run.base * standing - &run.residuals;
        for (number, column) in &run.numbers {
            if let Ok(place) = numbers.binary_search(number) {
                all.column_mut(layout.numbers.start + place).copy_from(column);
            }
            if let Some(&size) = sizes.get(number) {
                data.axpy(size, column, 1.0);
            }
        }
        all.column_mut(layout.data).copy_from(&data);
        all.column_mut(layout.residual).copy_from(&run.residuals);
        Self { products: all.transpose() * &all, layout }
    }

    /// The factor of what is the run's own, and half the logarithm of prior over posterior precisions.
    fn own_factor(
        &self,
        starts: &[f64],
        (inverse, ln_determinant): &(DMatrix<f64>, f64),
        scale: f64,
    ) -> Option<(Cholesky<f64, Dyn>, usize, f64)> {
        let first = self.layout.start.start;
        let has_own = scale > 0.0 && !self.layout.own.is_empty();
        let count = starts.len() + if has_own { self.layout.own.len() } else { 0 };
        let mut products = self.products.view((first, first), (count, count)).into_owned();
        for (place, precision) in starts.iter().enumerate() {
            products[(place, place)] += precision;
        }
        let mut ln_prior: f64 = starts.iter().map(|precision| 0.5 * precision.ln()).sum();
        if has_own {
            let size = self.layout.own.len();
            let mut own = products.view_mut((starts.len(), starts.len()), (size, size));
            own += inverse * scale.powi(-2);
            ln_prior -= 0.5 * ln_determinant + size as f64 * scale.ln();
        }
        let factor = products.cholesky()?;
        let ln_posterior: f64 = factor.l_dirty().diagonal().iter().map(|x: &f64| x.ln()).sum();
        Some((factor, count, ln_prior - ln_posterior))
    }

    fn reduced(&self, starts: &[f64], own: &(DMatrix<f64>, f64), scale: f64) -> Option<RunReduced> {
        let first = self.layout.start.start;
        let (factor, count, ln_determinants) = self.own_factor(starts, own, scale)?;
        let without = |factor: &Cholesky<f64, Dyn>, from: usize, count: usize| {
            let across = self.products.view((from, 0), (count, first)).into_owned();
            let half = factor.l_dirty().solve_lower_triangular(&across)?;
            let mut products = self.products.view((0, 0), (first, first)).into_owned();
            products.gemm(-1.0, &half.transpose(), &half, 1.0);
            Some(products)
        };
        let products = without(&factor, first, count)?;
        let (from, size) = (self.layout.own.start, count - starts.len());
        let standing = if size == 0 {
            self.products.view((0, 0), (first, first)).into_owned()
        } else {
            let own_products =
                self.products.view((from, from), (size, size)).into_owned() + &own.0 * scale.powi(-2);
            without(&own_products.cholesky()?, from, size)?
        };
        Some(RunReduced { products, standing, ln_determinants })
    }

    fn start(
        &self,
        starts: &[f64],
        own: &(DMatrix<f64>, f64),
        scale: f64,
        common: &DVector<f64>,
        sizes: &DVector<f64>,
    ) -> Option<Vec<f64>> {
        let first = self.layout.start.start;
        let (factor, count, _) = self.own_factor(starts, own, scale)?;
        let column = |place: usize| self.products.view((first, place), (count, 1)).into_owned();
        let mut with = column(self.layout.data);
        for (place, size) in common.iter().enumerate().filter(|(_, size)| **size != 0.0) {
            with -= column(place) * *size;
        }
        for (place, size) in sizes.iter().enumerate().filter(|(_, size)| **size != 0.0) {
            with -= column(self.layout.numbers.start + place) * *size;
        }
        Some(factor.solve(&with).as_slice()[..starts.len()].to_vec())
    }
}

#[cfg(test)]
mod tests;
