//! What is believed beforehand of what stands in every hypothesis: the unknown's scales, coefficients, starts.

use nalgebra::DMatrix;

/// Scales of the unknown, as places in [`FORCE_SCALES`] (repeatable, own) and [`SLIP_SCALES`].
pub(super) type Scales = [usize; 3];
/// Scales of a force in its units, half decades: from what no run shows to thirty times what a hinge's friction is
/// (a prototype, chosen).
pub(super) const FORCE_SCALES: [f64; 9] = [0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0];
/// Scales of the slip, over the noise (chosen by a prototype: 0.03, 0.1, 0.3 mm at 0.3 mm of noise; one more above).
pub(super) const SLIP_SCALES: [f64; 5] = [0.0, 0.1, 0.3, 1.0, 3.0];
/// Without any unknown.
pub(super) const OFF: Scales = [0; 3];
/// Chance that a scale of the unknown is 0 before any data (chosen by a prototype: nothing was tuned to it).
const CHANCE_OF_NONE: f64 = 0.7;

/// What is believed of what is fitted anyway, of one run's start, and of its own force.
#[derive(Debug, Clone)]
pub(super) struct Beliefs {
    /// Precision of each number that is fitted anyway; infinite where a bound holds it.
    pub(super) base: Vec<f64>,
    /// Precisions of each run's start.
    pub(super) starts: Vec<Vec<f64>>,
    /// Standard deviation of the slip that pictures are said to have, over the noise: it is there whatever the unknown's is.
    pub(super) stated_slip: f64,
    /// Of each run, the inverse covariance of its own force and the logarithm of the covariance's determinant.
    pub(super) own: Vec<(DMatrix<f64>, f64)>,
}

/// Logarithm of the chance of `scales`.
pub(super) fn ln_scales(scales: Scales) -> f64 {
    let counts = [FORCE_SCALES.len(), FORCE_SCALES.len(), SLIP_SCALES.len()];
    let ln = |(place, count): (usize, usize)| match place {
        0 => CHANCE_OF_NONE.ln(),
        _ => ((1.0 - CHANCE_OF_NONE) / (count - 1) as f64).ln(),
    };
    scales.into_iter().zip(counts).map(ln).sum()
}
