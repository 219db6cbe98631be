//! How residuals compare with noise: numbers of a report, which decide nothing.

use nalgebra::DVector;

use super::result::GoodnessOfFit;
use crate::hypothesis::nuisances::Nuisances;
use crate::hypothesis::state::State;
use crate::noise::floor::{Floor, slow_part};
use crate::noise::series;
use ground::statistics::chi2_survival;

/// Lags of the portmanteau test.
const PORTMANTEAU_LAGS: usize = 8;
/// The variance of what pictures get wrong with the pose is known to this share of it, 1 sigma: it is told by other pictures than
/// these.
const POSE_VARIANCE_STD: f64 = 0.5;

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
