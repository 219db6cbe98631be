//! What is fitted anyway, and must be taken out of what a cause would do.

use nalgebra::{DMatrix, DMatrixViewMut, DVector};
use rayon::prelude::*;

use super::state::State;
use crate::parameters::ON_BOUND_SHARE;

/// Everything that is fitted anyway, to be taken out of what a cause would do; what a bound stops is not, as it cannot follow.
#[derive(Clone)]
pub(crate) struct Nuisances {
    /// Of each run, an orthonormal basis of what its own numbers do, shape (rows, own).
    own: Vec<DMatrix<f64>>,
    /// Of all runs one below the other, an orthonormal basis of what the common numbers do beyond that.
    common: DMatrix<f64>,
    /// First row of each run, and the end of the last.
    rows: Vec<usize>,
    /// Rows of priors at the end.
    priors: usize,
}

impl Nuisances {
    pub(crate) fn new(state: &State<'_>) -> Self {
        Self::except(state, None)
    }

    /// Everything that is fitted but the common number `left_out`.
    pub(crate) fn except(state: &State<'_>, left_out: Option<usize>) -> Self {
        let free = state.parameters.len();
        let mut rows = vec![0];
        for linear in &state.linear {
            rows.push(rows[rows.len() - 1] + linear.residuals.len());
        }
        let data = rows[rows.len() - 1];
        let own: Vec<DMatrix<f64>> =
            state.linear.iter().map(|linear| basis(&linear.jacobian, free)).collect();
        let mut common = DMatrix::zeros(data + free, free);
        for (run, linear) in state.linear.iter().enumerate() {
            let mut part = linear.jacobian.columns(0, free).into_owned();
            take_out(&own[run], part.as_view_mut());
            common.rows_mut(rows[run], part.nrows()).copy_from(&part);
        }
        for (column, parameter) in state.parameters.free.iter().enumerate() {
            let width = parameter.scale.width().max(f64::MIN_POSITIVE);
            let std = parameter.prior.map_or(width, |prior| prior.std.get().min(width));
            common[(data + column, column)] = 1.0 / std;
        }
        for mut column in common.column_iter_mut() {
            let norm = column.norm();
            column /= norm.max(f64::MIN_POSITIVE);
        }
        let gone: Vec<usize> =
            (0..free).filter(|&which| left_out == Some(which) || is_stopped(state, which)).collect();
        let common = orthonormal(common.remove_columns_at(&gone));
        Self { own, common, rows, priors: free }
    }

    /// Rows of the data and the priors.
    pub(crate) fn len(&self) -> usize {
        self.rows[self.rows.len() - 1] + self.priors
    }

    /// Degrees of freedom that the fitted numbers have taken from the data.
    pub(crate) fn used(&self) -> f64 {
        let own: usize = self.own.iter().map(DMatrix::ncols).sum();
        own as f64 + self.common.rows(0, self.len() - self.priors).norm_squared()
    }

    /// The rows of a run.
    pub(crate) fn of_run(&self, run: usize) -> std::ops::Range<usize> {
        self.rows[run]..self.rows[run + 1]
    }

    /// Takes out of `columns`, shape (len, any), what the fitted numbers can do.
    pub(crate) fn take_out(&self, mut columns: DMatrixViewMut<'_, f64>) {
        for (run, own) in self.own.iter().enumerate() {
            let range = self.of_run(run);
            take_out(own, columns.rows_mut(range.start, range.len()));
        }
        take_out(&self.common, columns);
    }

    /// The residuals of all runs one below the other, what the fitted numbers can do taken out.
    pub(crate) fn residuals(&self, state: &State<'_>) -> DVector<f64> {
        self.left_of(state.linear.iter().map(|linear| &linear.residuals))
    }

    /// The same of any `residuals`, by run.
    pub(crate) fn left_of<'r>(&self, residuals: impl Iterator<Item = &'r DVector<f64>>) -> DVector<f64> {
        let mut all = DMatrix::zeros(self.len(), 1);
        for (run, residuals) in residuals.enumerate() {
            let range = self.of_run(run);
            all.view_mut((range.start, 0), (range.len(), 1)).copy_from(residuals);
        }
        self.take_out(all.as_view_mut());
        all.column(0).into_owned()
    }
}

/// Whether the common number `which` rests on a bound beyond which the data would have it.
fn is_stopped(state: &State<'_>, which: usize) -> bool {
    let (scale, value) = (state.parameters.free[which].scale, state.point.values[which]);
    let near = ON_BOUND_SHARE * scale.width();
    let slope: f64 =
        state.linear.iter().map(|linear| linear.jacobian.column(which).dot(&linear.residuals)).sum();
    slope > 0.0 && value - scale.lower() <= near || slope < 0.0 && scale.upper() - value <= near
}

/// Covariance of the common numbers of `state`, as far as all is linear, shape (P, P); even bounds count as beliefs.
pub(crate) fn covariance(state: &State<'_>) -> Option<DMatrix<f64>> {
    joint_covariance(state, None)
}

/// Covariance of the common numbers and, behind them, of those that run `run` has its own of, its pose among them.
pub(crate) fn joint_covariance(state: &State<'_>, run: Option<usize>) -> Option<DMatrix<f64>> {
    let gram = joint_information(state, run);
    let size = gram.nrows();
    let units: Vec<f64> = gram.diagonal().iter().map(|x| x.sqrt()).collect();
    let scaled = DMatrix::from_fn(size, size, |i, j| gram[(i, j)] / (units[i] * units[j]));
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(size, size, |i, j| inverse[(i, j)] / (units[i] * units[j])))
}

/// What [`joint_covariance`] is the inverse of.
pub(crate) fn joint_information(state: &State<'_>, run: Option<usize>) -> DMatrix<f64> {
    let free = state.parameters.len();
    let nuisances = run.map_or(&[][..], |run| &state.terms[run].rehearsal.nuisances);
    let size = free + nuisances.len();
    let mut gram = DMatrix::zeros(size, size);
    for (which, linear) in state.linear.iter().enumerate() {
        if run == Some(which) {
            gram.gemm_tr(1.0, &linear.jacobian, &linear.jacobian, 1.0);
        } else {
            let mut part = linear.jacobian.columns(0, free).into_owned();
            take_out(&basis(&linear.jacobian, free), part.as_view_mut());
            gram.view_mut((0, 0), (free, free)).gemm_tr(1.0, &part, &part, 1.0);
        }
    }
    let common = state.parameters.free.iter().map(|parameter| {
        let width = parameter.scale.width().max(f64::MIN_POSITIVE);
        parameter.prior.map_or(width, |prior| prior.std.get().min(width))
    });
    for (i, std) in common.chain(nuisances.iter().map(|nuisance| nuisance.belief())).enumerate() {
        gram[(i, i)] += std.powi(-2);
    }
    gram
}

/// What each run of `state` costs at the optimum of all others, summed, as far as all is linear; each run's own numbers follow. `None`
/// where that is not determined.
pub(crate) fn crossed_cost(state: &State<'_>) -> Option<f64> {
    let free = state.parameters.len();
    let mut runs: Vec<(DMatrix<f64>, DVector<f64>, f64)> = Vec::new();
    let (mut gram, mut slope) = (DMatrix::zeros(free, free), DVector::zeros(free));
    for (i, parameter) in state.parameters.free.iter().enumerate() {
        let width = parameter.scale.width().max(f64::MIN_POSITIVE);
        let std = parameter.prior.map_or(width, |prior| prior.std.get().min(width));
        gram[(i, i)] = std.powi(-2);
        if let Some(prior) = parameter.prior {
            slope[i] = (state.point.values[i] - prior.mean.get()) * std.powi(-2);
        }
    }
    for linear in &state.linear {
        let own = basis(&linear.jacobian, free);
        let mut part = linear.jacobian.columns(0, free).into_owned();
        take_out(&own, part.as_view_mut());
        let mut left = DMatrix::from_column_slice(linear.residuals.len(), 1, linear.residuals.as_slice());
        take_out(&own, left.as_view_mut());
        let left = left.column(0);
        let one = (part.tr_mul(&part), part.tr_mul(&left), left.norm_squared());
        gram += &one.0;
        slope += &one.1;
        runs.push(one);
    }
    let cost = |(own_gram, own_slope, cost): &(DMatrix<f64>, DVector<f64>, f64)| {
        let others = &gram - own_gram;
        let units: Vec<f64> = others.diagonal().iter().map(|x| x.sqrt()).collect();
        let scaled = DMatrix::from_fn(free, free, |i, j| others[(i, j)] / (units[i] * units[j]));
        let wanted = DVector::from_fn(free, |i, _| (own_slope[i] - slope[i]) / units[i]);
        let mut step = scaled.cholesky()?.solve(&wanted);
        step.iter_mut().zip(&units).for_each(|(step, unit)| *step /= unit);
        Some(cost + 2.0 * own_slope.dot(&step) + step.dot(&(own_gram * &step)))
    };
    runs.iter().map(cost).sum()
}

/// An orthonormal basis of the columns from `first` on.
fn basis(jacobian: &DMatrix<f64>, first: usize) -> DMatrix<f64> {
    let mut own = jacobian.columns(first, jacobian.ncols() - first).into_owned();
    for mut column in own.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    orthonormal(own)
}

/// Rows that are made triangular together.
const BLOCK_ROWS: usize = 500;

/// An orthonormal basis of the span of `columns`, which are many times longer than there are of them: blocks of rows are
/// made triangular first, then all their triangles, and the columns are divided by the last one.
fn orthonormal(columns: DMatrix<f64>) -> DMatrix<f64> {
    let (rows, count) = columns.shape();
    if count == 0 {
        return columns;
    }
    let blocks: Vec<usize> = (0..rows).step_by(BLOCK_ROWS).collect();
    let triangles: Vec<DMatrix<f64>> = blocks
        .par_iter()
        .map(|&from| columns.rows(from, BLOCK_ROWS.min(rows - from)).into_owned().qr().unpack_r())
        .collect();
    let mut stacked = DMatrix::zeros(triangles.iter().map(DMatrix::nrows).sum(), count);
    let mut from = 0;
    for triangle in triangles {
        stacked.rows_mut(from, triangle.nrows()).copy_from(&triangle);
        from += triangle.nrows();
    }
    let triangle = stacked.qr().unpack_r();
    let largest = triangle.diagonal().amax();
    match triangle.clone().try_inverse() {
        Some(inverse) if triangle.diagonal().iter().all(|x| x.abs() > SINGULAR_SHARE * largest) => {
            columns * inverse
        }
        // columns that depend on each other
        _ => columns.qr().q(),
    }
}

/// A diagonal entry this small beside the largest is none.
const SINGULAR_SHARE: f64 = 1e-9;

fn take_out(basis: &DMatrix<f64>, mut columns: DMatrixViewMut<'_, f64>) {
    if basis.ncols() > 0 {
        let within = basis.tr_mul(&columns);
        columns.gemm(-1.0, basis, &within, 1.0);
    }
}
