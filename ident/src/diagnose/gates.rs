//! Gates that a description must pass before it is called a cause: what is left is noise, and each number is the same in
//! all runs.

use nalgebra::{DMatrix, DVector};

use super::result::{ConstancyTest, GoodnessOfFit, PerRun};
use super::sets::{NEGLIGIBLE_M, negligible};
use crate::hypothesis::candidates::Term;
use crate::hypothesis::nuisances::{Nuisances, joint_covariance};
use crate::hypothesis::state::State;
use crate::noise::floor::{Floor, slow_part};
use crate::noise::series;
use ground::statistics::{chi2_survival, one_value};

/// Lags of the portmanteau test.
const PORTMANTEAU_LAGS: usize = 8;
/// Slow residuals this many standard deviations beyond noise are none.
pub(super) const BEYOND_NOISE_Z: f64 = 6.0;
/// The variance of what pictures get wrong with the pose is known to this share of it, 1 sigma: it is told by other pictures than
/// these.
const POSE_VARIANCE_STD: f64 = 0.5;
/// What is left beyond noise is no objection below this share of what was explained.
pub(super) const LEFT_OVER_SHARE: f64 = 0.03;
/// Correlation that is no objection, however certain.
const LITTLE_CORRELATION: f64 = 0.1;
/// Probability below which chance is no explanation.
const NO_CHANCE_P: f64 = 1e-6;
/// Probability below which runs that differ do so not by chance, and the share of what was explained from which on it
/// matters: a stand-in drifts, a cause that is modelled to a percent hardly does.
const RUNS_DIFFER_P: f64 = 1e-4;
const RUNS_DIFFER_SHARE: f64 = 0.015;
/// A run sees a number when its effect there is worth this many standard deviations.
const SEEN_IN_RUN_Z: f64 = 3.0;

/// Residuals of `state` against the noise of `floor`.
pub(super) fn goodness_of_fit(state: &State<'_>, floor: &Floor) -> GoodnessOfFit {
    let nuisances = Nuisances::new(state);
    let residuals: Vec<DVector<f64>> = state.linear.iter().map(|linear| linear.residuals.clone()).collect();
    goodness_of(state, floor, &residuals, nuisances.used(), 0.0)
}

/// The same of any `residuals` of the runs of `state`, of which `used` degrees of freedom are gone, and that have cost `lost`
/// elsewhere.
pub(super) fn goodness_of(
    state: &State<'_>,
    floor: &Floor,
    residuals: &[DVector<f64>],
    used: f64,
    lost: f64,
) -> GoodnessOfFit {
    let mut sums = [0.0; 4];
    let (mut products, mut squares, mut metres) = ([0.0; PORTMANTEAU_LAGS], 0.0, 0.0);
    let mut steep = 0.0;
    for (run, whole) in residuals.iter().enumerate() {
        let term = &state.terms[run];
        let interval_s = floor.runs.get(run).map_or(1.0, |run| run.interval_s);
        let time_s = &term.rehearsal.run.trajectory.time_s;
        let slow = slow_part(&term.observations, whole, time_s, state.start_s(run), interval_s);
        let add = [slow.squares, slow.functions, slow.all, slow.count];
        sums.iter_mut().zip(add).for_each(|(sum, x)| *sum += x);
        for series in series(&term.observations) {
            for (lag, product) in products.iter_mut().enumerate() {
                let pairs = series.iter().zip(series.iter().skip(lag + 1));
                *product += pairs.map(|(&a, &b)| whole[a] * whole[b]).sum::<f64>();
            }
        }
        squares += whole.norm_squared();
        if let Some(raw) = state.raw_residuals(run) {
            metres += raw.iter().map(|x| x * x).sum::<f64>();
        }
        // how the spectrum at 4 Hz follows the correlation
        let turn = std::f64::consts::TAU * 4.0 * interval_s;
        let rho = floor.correlation;
        let slope = 2.0 * (turn.cos() - rho) / (1.0 + rho * rho - 2.0 * rho * turn.cos());
        steep = f64::max(steep, slope.abs());
    }
    let [slow, functions, all, count] = sums;
    let fast = (count - functions).max(1.0);
    let level = ((all - slow) / fast).max(f64::MIN_POSITIVE);
    let left = (functions - used).max(1.0);
    let excess = slow / level - left + lost;
    let pose = if floor.pose_std_m.is_some() { POSE_VARIANCE_STD * left } else { 0.0 };
    let spread =
        2.0 * left * (1.0 + left / fast) + (steep * floor.correlation_std * left).powi(2) + pose * pose;
    let correlations: Vec<f64> =
        products.iter().map(|product| product / squares.max(f64::MIN_POSITIVE)).collect();
    let portmanteau = count * correlations.iter().map(|r| r * r).sum::<f64>();
    GoodnessOfFit {
        rms_m: (metres / count.max(1.0)).sqrt(),
        chi2: all,
        degrees: count - used,
        excess,
        z: excess / spread.sqrt(),
        portmanteau_p: chi2_survival(portmanteau, PORTMANTEAU_LAGS as f64),
        correlation: (correlations.iter().map(|r| r * r).sum::<f64>() / PORTMANTEAU_LAGS as f64).sqrt(),
    }
}

impl GoodnessOfFit {
    /// Whether something beyond the noise of `floor` is left that matters, by itself, in `count` observations, and beside
    /// `explained`, the cost saved so far.
    pub(super) fn objects(&self, explained: f64, floor: &Floor, count: usize) -> bool {
        let beside = LEFT_OVER_SHARE * explained;
        // of runs that state none, held-out ones perhaps, no more is asked than of those that do
        let seen = floor.pose_std_m.is_none_or(|std_m| self.rms_m > std_m);
        let slow = seen && self.z > BEYOND_NOISE_Z && self.excess > beside.max(negligible(floor, count));
        let left_m = floor.noise_m * (self.chi2 / self.degrees.max(1.0)).sqrt();
        let correlated = self.portmanteau_p < NO_CHANCE_P && self.correlation > LITTLE_CORRELATION;
        slow || correlated && self.chi2 > beside && left_m > NEGLIGIBLE_M
    }
}

/// Whether the numbers of the causes are the same in all runs, and what each run would say.
pub(super) fn constancy(state: &State<'_>, baseline: usize) -> Vec<(ConstancyTest, Vec<PerRun>)> {
    let common = (baseline..state.parameters.len()).filter_map(|which| common(state, which));
    // what differs from run to run is asked for no constancy
    let own = state.causes.iter().filter(|term| !term.by_run).filter_map(|term| amplitudes(state, term));
    common.chain(own).collect()
}

fn ids(state: &State<'_>) -> Vec<String> {
    state.terms.iter().map(|term| term.rehearsal.run.id.clone()).collect()
}

/// A number common to all runs: a value for each, all others following.
fn common(state: &State<'_>, which: usize) -> Option<(ConstancyTest, Vec<PerRun>)> {
    let parameter = &state.parameters.free[which];
    let value = state.point.values[which];
    let nuisances = Nuisances::except(state, Some(which));
    let seen: Vec<usize> = (0..state.terms.len())
        .filter(|&run| state.linear[run].jacobian.column(which).norm() * value.abs() > SEEN_IN_RUN_Z)
        .collect();
    if seen.len() < 2 {
        return None;
    }
    let mut columns = DMatrix::zeros(nuisances.len(), seen.len());
    for (place, &run) in seen.iter().enumerate() {
        let rows = nuisances.of_run(run);
        columns
            .view_mut((rows.start, place), (rows.len(), 1))
            .copy_from(&state.linear[run].jacobian.column(which));
    }
    nuisances.take_out(columns.as_view_mut());
    let slope = columns.tr_mul(&nuisances.residuals(state));
    let mut gram = columns.tr_mul(&columns);
    let ridge = 1e-9 * gram.diagonal().max() + f64::MIN_POSITIVE;
    for i in 0..seen.len() {
        gram[(i, i)] += ridge;
    }
    let factor = gram.clone().cholesky()?;
    let change = -factor.solve(&slope);
    let (chi2, degrees, p) = one_value(&change, |values| &gram * values);
    let covariance = factor.inverse();
    let ids = ids(state);
    let list = seen.iter().enumerate().map(|(place, &run)| PerRun {
        run: ids[run].clone(),
        parameter: parameter.name().to_owned(),
        value: value + change[place],
        std: covariance[(place, place)].sqrt(),
    });
    Some((ConstancyTest { parameter: parameter.name().to_owned(), chi2, degrees, p }, list.collect()))
}

/// Numbers that each run has its own of by their nature, as the phase of waves: their common amplitude.
fn amplitudes(state: &State<'_>, term: &Term) -> Option<(ConstancyTest, Vec<PerRun>)> {
    let count = state.parameters.len();
    let ids = ids(state);
    let name = format!("{}/amplitude", term.info().name);
    let mut list: Vec<PerRun> = Vec::new();
    for (run, id) in ids.iter().enumerate() {
        let nuisances = &state.terms[run].rehearsal.nuisances;
        let is_its = |&k: &usize| state.own_name(nuisances[k]).is_some_and(|name| term.owns(name));
        let own: Vec<usize> = (0..nuisances.len()).filter(is_its).collect();
        if own.is_empty() {
            continue;
        }
        let values = DVector::from_iterator(own.len(), own.iter().map(|&k| state.point.offsets[run][k]));
        let amplitude = values.norm();
        let joint = joint_covariance(state, Some(run))?;
        let covariance =
            DMatrix::from_fn(own.len(), own.len(), |i, j| joint[(count + own[i], count + own[j])]);
        let direction = if amplitude > 0.0 { &values / amplitude } else { values.clone() };
        let std = direction.dot(&(&covariance * &direction)).max(0.0).sqrt();
        list.push(PerRun { run: id.clone(), parameter: name.clone(), value: amplitude, std });
    }
    if list.len() < 2 {
        return None;
    }
    let weight = |run: &PerRun| 1.0 / run.std.powi(2).max(f64::MIN_POSITIVE);
    let total: f64 = list.iter().map(weight).sum();
    let mean = list.iter().map(|run| weight(run) * run.value).sum::<f64>() / total;
    let chi2 = list.iter().map(|run| weight(run) * (run.value - mean).powi(2)).sum();
    let degrees = list.len() - 1;
    Some((ConstancyTest { parameter: name, chi2, degrees, p: chi2_survival(chi2, degrees as f64) }, list))
}

impl ConstancyTest {
    /// Whether the runs differ by more than chance, and by what matters beside `explained`, the cost that the cause has saved.
    pub(super) fn objects(&self, explained: f64) -> bool {
        self.is_no_chance() && self.chi2 > RUNS_DIFFER_SHARE * explained
    }

    /// Whether the runs differ by more than chance.
    pub(super) fn is_no_chance(&self) -> bool {
        self.p < RUNS_DIFFER_P
    }
}
