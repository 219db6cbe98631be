//! A model with some causes, fitted: what all tests start from.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sim::{Model, Trajectory};

use super::candidates::Term as CauseTerm;
use super::floor::Floor;
use crate::fit::FittedRun;
use crate::fit::counts::Counts;
use crate::fit::least_squares::Descent;
use crate::fit::objective::Objective;
use crate::fit::problem::{Linear, Point, Problem, Term};
use crate::fit::whitening::Whitening;
use crate::parameters::Parameters;

/// A model with some causes at its optimum.
#[derive(Debug, Clone)]
pub(crate) struct State<'a> {
    /// The causes added to the baseline, in the order in which they were found.
    pub(crate) causes: Vec<CauseTerm>,
    /// The model with neutral causes.
    pub(crate) model: Model,
    /// The baseline's parameters first, then those of the causes.
    pub(crate) parameters: Parameters,
    pub(crate) terms: Vec<Term<'a>>,
    pub(crate) point: Point,
    /// Squares of whitened residuals, priors included.
    pub(crate) cost: f64,
    /// Residuals and derivatives at the point, by run.
    pub(crate) linear: Vec<Linear>,
    /// Numbers that the causes have added.
    pub(crate) added: usize,
}

/// Deviations that a trajectory states for its cells, over what is usual for their keypoint; 1 where none is stated. Shape
/// (N, K). How large noise is the residuals say; what is stated says only where there is more of it.
fn relative_std(trajectory: &Trajectory) -> Vec<f64> {
    let width = trajectory.keypoints.len();
    let cells = trajectory.time_s.len() * width;
    let stated = |cell: usize| {
        let std = trajectory.std_m.as_ref().map(|std| std[cell]);
        std.filter(|std| std.is_finite() && *std > 0.0)
    };
    let usual: Vec<f64> = (0..width)
        .map(|keypoint| {
            let squares: Vec<f64> =
                (keypoint..cells).step_by(width).filter_map(stated).map(|std| std * std).collect();
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        })
        .collect();
    (0..cells).map(|cell| stated(cell).map_or(1.0, |std| std / usual[cell % width])).collect()
}

/// A share of the cost that is not worth a step: a twentieth of what could matter to anyone.
const SMALL: f64 = 1e-5;
/// Most steps of one descent: a fit that needs more is told apart by the next one.
const MOST_STEPS: usize = 25;

impl<'a> State<'a> {
    /// The baseline before any fit.
    pub(crate) fn baseline(model: &Model, parameters: Parameters, terms: Vec<Term<'a>>) -> Self {
        let offsets = terms.iter().map(|term| vec![0.0; term.rehearsal.nuisances.len()]).collect();
        let point = Point { values: parameters.start(), offsets };
        Self {
            causes: Vec::new(),
            model: model.clone(),
            parameters,
            terms,
            point,
            cost: f64::INFINITY,
            linear: Vec::new(),
            added: 0,
        }
    }

    pub(crate) fn problem(&self) -> Problem<'_> {
        Problem { model: &self.model, parameters: &self.parameters, terms: self.terms.clone() }
    }

    /// Weighs residuals with the noise of `floor`, whitened.
    pub(crate) fn weigh(&mut self, floor: &Floor) {
        for (term, run) in self.terms.iter_mut().zip(&floor.runs) {
            let trajectory = &term.rehearsal.run.trajectory;
            let width = trajectory.keypoints.len();
            let relative = relative_std(trajectory);
            for observation in &mut term.observations {
                let relative = relative[observation.instant * width + observation.keypoint];
                observation.per_m = 1.0 / (run.std_m[observation.keypoint] * relative);
            }
            let whitening =
                Whitening::new(&term.observations, &trajectory.time_s, floor.correlation, run.interval_s);
            term.whitening = Some(whitening);
        }
        self.linear.clear();
    }

    /// Goes to the nearest optimum; whether there is one. Leaves the linearisation there.
    pub(crate) fn descend(&mut self, counts: &mut Counts) -> bool {
        self.steps(MOST_STEPS, counts) && self.linearised(counts)
    }

    /// Takes up to `most` steps towards the nearest optimum; whether any can be simulated. The linearisation is left
    /// where it is that of the point.
    pub(crate) fn steps(&mut self, most: usize, counts: &mut Counts) -> bool {
        let mut linear = std::mem::take(&mut self.linear);
        let (point, cost, linear) = {
            let objective = Objective::squares(self.problem());
            let mut descent = Descent::new(self.point.clone(), None);
            for _ in 0..most {
                if linear.is_empty() {
                    let Some(found) = objective.problem.linearise(&descent.point, true, counts) else {
                        return false;
                    };
                    linear = found;
                }
                let before = descent.point.clone();
                descent.step_with(&objective, &linear, SMALL, counts);
                if descent.point != before {
                    linear.clear();
                }
                if descent.end.is_some() {
                    break;
                }
            }
            let Some(cost) = descent.cost else { return false };
            (descent.point, cost, linear)
        };
        (self.point, self.cost, self.linear) = (point, cost, linear);
        true
    }

    /// Stays where it is; whether that can be simulated.
    pub(crate) fn stay(&mut self, counts: &mut Counts) -> bool {
        self.cost = self.problem().costs(std::slice::from_ref(&self.point), counts)[0];
        self.linearised(counts)
    }

    /// Sees to the linearisation at the point; whether there is one.
    fn linearised(&mut self, counts: &mut Counts) -> bool {
        if self.linear.is_empty() {
            let Some(linear) = self.problem().linearise(&self.point, true, counts) else { return false };
            self.linear = linear;
        }
        true
    }

    /// This state with `cause` added, neutral, before any fit.
    pub(crate) fn with(&self, cause: &CauseTerm) -> Self {
        let mut next = Self { linear: Vec::new(), ..self.clone() };
        next.model = cause.added_to(&self.model);
        cause.switched_on(&mut next.model);
        let added = cause.free(&next.model);
        next.added += added.free.len() + added.own.len() * self.terms.len();
        next.point.values.extend(added.free.iter().map(|parameter| parameter.start));
        next.parameters.free.extend(added.free);
        for (term, offsets) in next.terms.iter_mut().zip(&mut next.point.offsets) {
            for (_, nuisance) in &added.own {
                term.rehearsal.nuisances.push(*nuisance);
                offsets.push(0.0);
            }
        }
        next.causes.push(cause.clone());
        next
    }

    /// The model with all its numbers, but those that each run has its own of.
    pub(crate) fn calibrated(&self) -> Model {
        self.parameters.applied(&self.point.values, &self.model)
    }

    /// Observations in all.
    pub(crate) fn count(&self) -> usize {
        self.terms.iter().map(|term| term.observations.len()).sum()
    }

    /// What an added number must gain at least to be worth it.
    pub(crate) fn ln_count(&self) -> f64 {
        (self.count() as f64).max(2.0).ln()
    }

    /// Bayesian information criterion, up to a constant.
    pub(crate) fn bic(&self) -> f64 {
        self.cost + self.added as f64 * self.ln_count()
    }

    /// Residuals of a run before whitening \[m\], over how much less certain than usual the cell says it is.
    pub(crate) fn raw_residuals(&self, run: usize) -> Option<Vec<f64>> {
        let term = &self.terms[run];
        let model = self.calibrated();
        let simulated = term.rehearsal.simulate(&model, &self.point.offsets[run], term.instants).ok()?;
        let trajectory = &term.rehearsal.run.trajectory;
        let width = trajectory.keypoints.len();
        let relative = relative_std(trajectory);
        let raw = term.observations.iter().map(|o| {
            let cell = o.instant * width + o.keypoint;
            (o.measured_m - simulated[cell][o.axis]) / relative[cell]
        });
        Some(raw.collect())
    }

    /// Fitted runs beside their simulation.
    pub(crate) fn repeated(&self) -> Vec<FittedRun> {
        let model = self.calibrated();
        let one = |(term, offsets): (&Term<'a>, &Vec<f64>)| {
            let run = term.rehearsal.run;
            let measured = run.trajectory.clone();
            let position_m = term.rehearsal.simulate(&model, offsets, measured.time_s.len()).ok()?;
            let start = term.rehearsal.start_with(&model, offsets);
            let simulated = Trajectory {
                time_s: measured.time_s.clone(),
                keypoints: measured.keypoints.clone(),
                position_m,
                std_m: None,
            };
            Some(FittedRun {
                id: run.id.clone(),
                usage: run.usage,
                initial: start.state,
                start_s: start.start_s,
                scored_from_s: start.start_s,
                simulated,
                measured,
            })
        };
        self.terms.iter().zip(&self.point.offsets).filter_map(one).collect()
    }

    /// When the motion of a run starts \[s\].
    pub(crate) fn start_s(&self, run: usize) -> f64 {
        let rehearsal = &self.terms[run].rehearsal;
        rehearsal.start_with(&self.model, &self.point.offsets[run]).start_s
    }
}

/// Everything that is fitted anyway, to be taken out of what a cause would do; what a bound stops is not, as it cannot follow.
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
            take_out(&own[run], &mut part);
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
    pub(crate) fn take_out(&self, columns: &mut DMatrix<f64>) {
        for (run, own) in self.own.iter().enumerate() {
            let range = self.of_run(run);
            let mut part = columns.rows(range.start, range.len()).into_owned();
            take_out(own, &mut part);
            columns.rows_mut(range.start, range.len()).copy_from(&part);
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
        self.take_out(&mut all);
        all.column(0).into_owned()
    }
}

/// Whether the common number `which` rests on a bound beyond which the data would have it.
fn is_stopped(state: &State<'_>, which: usize) -> bool {
    let (scale, value) = (state.parameters.free[which].scale, state.point.values[which]);
    let near = AT_BOUND * scale.width();
    let slope: f64 =
        state.linear.iter().map(|linear| linear.jacobian.column(which).dot(&linear.residuals)).sum();
    slope > 0.0 && value - scale.lower() <= near || slope < 0.0 && scale.upper() - value <= near
}

/// A number this near to a bound, as a share of their distance, rests on it.
const AT_BOUND: f64 = 1e-9;

/// Covariance of the common numbers of `state`, as far as all is linear, shape (P, P); even bounds count as beliefs.
pub(crate) fn covariance(state: &State<'_>) -> Option<DMatrix<f64>> {
    joint_covariance(state, None)
}

/// Covariance of the common numbers and, behind them, of those that run `run` has its own of, its pose among them.
pub(crate) fn joint_covariance(state: &State<'_>, run: Option<usize>) -> Option<DMatrix<f64>> {
    let free = state.parameters.len();
    let nuisances = run.map_or(&[][..], |run| &state.terms[run].rehearsal.nuisances);
    let size = free + nuisances.len();
    let mut gram = DMatrix::zeros(size, size);
    for (which, linear) in state.linear.iter().enumerate() {
        if run == Some(which) {
            gram.gemm_tr(1.0, &linear.jacobian, &linear.jacobian, 1.0);
        } else {
            let mut part = linear.jacobian.columns(0, free).into_owned();
            take_out(&basis(&linear.jacobian, free), &mut part);
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
    let units: Vec<f64> = gram.diagonal().iter().map(|x| x.sqrt()).collect();
    let scaled = DMatrix::from_fn(size, size, |i, j| gram[(i, j)] / (units[i] * units[j]));
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(size, size, |i, j| inverse[(i, j)] / (units[i] * units[j])))
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
const BLOCK: usize = 500;

/// An orthonormal basis of the span of `columns`, which are many times longer than there are of them: blocks of rows are
/// made triangular first, then all their triangles, and the columns are divided by the last one.
fn orthonormal(columns: DMatrix<f64>) -> DMatrix<f64> {
    let (rows, count) = columns.shape();
    if count == 0 {
        return columns;
    }
    let blocks: Vec<usize> = (0..rows).step_by(BLOCK).collect();
    let triangles: Vec<DMatrix<f64>> = blocks
        .par_iter()
        .map(|&from| columns.rows(from, BLOCK.min(rows - from)).into_owned().qr().unpack_r())
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
        Some(inverse) if triangle.diagonal().iter().all(|x| x.abs() > SINGULAR * largest) => {
            columns * inverse
        }
        // columns that depend on each other
        _ => columns.qr().q(),
    }
}

/// A diagonal entry this small beside the largest is none.
const SINGULAR: f64 = 1e-9;

fn take_out(basis: &DMatrix<f64>, columns: &mut DMatrix<f64>) {
    if basis.ncols() > 0 {
        let within = basis.tr_mul(columns);
        columns.gemm(-1.0, basis, &within, 1.0);
    }
}
