//! The one score: the logarithm of the evidence of a set of causes, by Laplace's approximation about a point.
//!
//! ln Z = -N/2 ln(2 pi s2) - q/(2 s2) + 1/2 ln|P| - 1/2 ln|A + P| + ln odds + ln prior of the scales, where q is what is left of the squares
//! of the whitened data once all sizes are integrated out, s2 the noise's variance over that of the floor, A the products of all columns and P
//! the precisions of what is believed of their sizes. ln s2 is known as well as the floor is, and less well the more is explained by laws that
//! are right to a share only; it is integrated out in the same way.
//!
//! # Source
//! D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415-447; L. Tierney, J. B. Kadane, "Accurate approximations for
//! posterior moments and marginal densities", Journal of the American Statistical Association 81 (1986) 82-86.

use std::f64::consts::{LN_2, PI, TAU};

use ground::statistics::chi2_survival;
use nalgebra::{DMatrix, DVector};

use super::atoms::Atoms;
use super::columns::{Belief, Column, has_deviations};
use super::gram::Gram;
use super::priors::{FORCE_SCALES, OFF, SLIP_SCALES, Scales, ln_scales};

/// What a by-run size may deviate by, in typical sizes, equally likely (a prototype, chosen).
const TAUS: [f64; 6] = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
/// Where tau starts: at a typical size.
pub(super) const TAU_START: usize = 3;

/// All places of taus.
pub(super) fn taus() -> std::ops::Range<usize> {
    0..TAUS.len()
}

/// Tau at its place in the grid, in typical sizes.
pub(super) fn tau(place: usize) -> f64 {
    TAUS[place]
}

/// A law is right to so large a share of what it does: friction, a stop and a current are no more than names for what they are in a tank
/// (chosen). What it gets wrong is noise to whatever else is asked.
const LAW_SHARE: f64 = 0.05;
/// Rounds in which the Cauchy beliefs find their widths: each is a Newton step, from far out.
const CAUCHY_ROUNDS: usize = 4;
/// Scales that are tried beside the neighbours of the one at hand, as places: 0, and into the middle of the grid, since the smallest ones
/// say nothing.
const JUMPS: [usize; 3] = [0, 3, 5];
/// A gain that is none but rounding, in nats.
const NO_GAIN: f64 = 1e-6;

/// What was found of a set of causes about a point.
#[derive(Debug, Clone)]
pub(super) struct Scored {
    pub(super) ln_z: f64,
    /// Scales of the unknown, and of by-run sizes.
    pub(super) scales: Scales,
    pub(super) tau: usize,
    /// The noise's variance over the floor's.
    pub(super) variance: f64,
    /// Squares at the best sizes, what is believed of them among these.
    pub(super) squares: f64,
    /// Best sizes by column, from neutral; those that the products say nothing about stay as they are.
    pub(super) sizes: Vec<Option<f64>>,
    /// Their covariance, for those that are there.
    pub(super) covariance: DMatrix<f64>,
}

/// What scores take.
#[derive(Clone, Copy)]
pub(super) struct Scorer<'a> {
    pub(super) atoms: &'a Atoms,
    pub(super) gram: &'a Gram,
    /// How well the noise floor is known: its standard deviation over itself.
    pub(super) noise_share: f64,
}

/// Logarithm of the prior odds of a set over the empty one.
pub(super) fn ln_odds(atoms: &Atoms, set: &[usize]) -> f64 {
    set.iter().map(|&atom| atoms.list[atom].ln_odds).sum()
}

impl Scorer<'_> {
    /// The evidence of `set` with its `columns`, at these scales and the best of these `taus`. `None` where a column of it was never looked at,
    /// or digits are lost.
    pub(super) fn score(
        &self,
        set: &[usize],
        columns: &[Column],
        scales: Scales,
        taus: std::ops::Range<usize>,
    ) -> Option<Scored> {
        let reduced = self.gram.reduced(scales)?;
        let mut asked: Vec<(usize, &[usize])> = Vec::new();
        let mut beliefs: Vec<&Column> = Vec::new();
        let mut places: Vec<Option<usize>> = Vec::new();
        for column in columns {
            match self.gram.numbers.binary_search(&column.number) {
                Ok(place) => {
                    places.push(Some(asked.len()));
                    asked.push((place, &column.runs));
                    beliefs.push(column);
                }
                // what says nothing at neutral has its prior as its posterior, and a switch that is on has no column
                Err(_) if matches!(column.belief, Belief::Hidden(_) | Belief::Given) => places.push(None),
                Err(_) => return None,
            }
        }
        let (products, mut data) = reduced.of(&asked);
        // of hidden numbers only those of the set have a part in the data
        let hidden = self.gram.hidden(&asked);
        let hidden_squares = (&products * &hidden + 2.0 * &data).dot(&hidden);
        data += &products * &hidden;
        // a switch takes its column off the data
        let mut switched = 0.0;
        for place in (0..beliefs.len()).filter(|&place| beliefs[place].belief == Belief::Given) {
            switched += products[(place, place)] - 2.0 * data[place];
            data -= products.column(place);
        }
        let ln_prior = ln_scales(scales) + ln_odds(self.atoms, set)
            - if has_deviations(columns) { (TAUS.len() as f64).ln() } else { 0.0 };
        let mut best: Option<Scored> = None;
        for tau in taus {
            let Some(posterior) = Posterior::new(&products, &data, &beliefs, TAUS[tau]) else { continue };
            let squares =
                (reduced.squares + hidden_squares + switched - posterior.explained).max(f64::MIN_POSITIVE);
            let count = self.gram.observations as f64;
            let width = self.width((posterior.explained - switched).max(0.0));
            let variance = self.variance(squares, width);
            let ln_z = reduced.ln_determinants
                + posterior.ln_prior
                + posterior.ln_width
                + posterior.penalty_back / (2.0 * variance)
                - 0.5 * (count * (TAU * variance).ln() + squares / variance)
                - 0.5 * (variance.ln() / width).powi(2)
                - 0.5 * (0.5 * width * width * squares / variance).ln_1p()
                + ln_prior;
            if ln_z.is_finite() && best.as_ref().is_none_or(|best| ln_z > best.ln_z) {
                best = Some(Scored {
                    ln_z,
                    scales,
                    tau,
                    variance,
                    squares,
                    sizes: places.iter().map(|place| Some(posterior.sizes[(*place)?])).collect(),
                    covariance: posterior.covariance * variance,
                });
            }
        }
        best
    }

    /// How well the variance's logarithm is known where causes explain so many `squares`: as the noise floor is, and as their laws are right.
    fn width(&self, squares: f64) -> f64 {
        let law = LAW_SHARE.powi(2) * squares / self.gram.observations as f64;
        (2.0 * self.noise_share).hypot(law.ln_1p())
    }

    /// The variance that is most likely with `squares` left and the floor's as its prior, its logarithm known to `width`: Newton in that.
    fn variance(&self, squares: f64, width: f64) -> f64 {
        let count = self.gram.observations as f64;
        let weight = width.powi(-2);
        // from above: there the slope is the steeper the further
        let mut ln = (squares / count).ln().max(0.0);
        for _ in 0..20 {
            let left = 0.5 * squares * (-ln).exp();
            let slope = -0.5 * count + left - weight * ln;
            ln += slope / (left + weight);
        }
        // pictures are as wrong as they are said to be, however much alike their errors are in these runs
        if self.gram.states_errors() { ln.max(0.0).exp() } else { ln.exp() }
    }

    /// The best scales for `set`, by steps of one of them at a time from `from`; the unknown stays off unless it is `free`.
    pub(super) fn tuned(
        &self,
        set: &[usize],
        columns: &[Column],
        from: (Scales, usize),
        free: bool,
    ) -> Option<Scored> {
        let free = free && self.gram.has_unknown();
        let scales = if free { from.0 } else { OFF };
        let mut best = self.score(set, columns, scales, from.1..from.1 + 1);
        if free && scales != OFF {
            best = better(best, self.score(set, columns, OFF, from.1..from.1 + 1));
        }
        let counts = [FORCE_SCALES.len(), FORCE_SCALES.len(), SLIP_SCALES.len(), TAUS.len()];
        let has_tau = has_deviations(columns);
        loop {
            let before = best.as_ref()?.ln_z;
            for (which, &count) in counts.iter().enumerate() {
                if if which < 3 { !free } else { !has_tau } {
                    continue;
                }
                let Scored { scales, tau, .. } = best.as_ref()?.clone();
                let at = if which < 3 { scales[which] } else { tau };
                let mut tried: Vec<usize> =
                    JUMPS.into_iter().chain([at + 1]).chain(at.checked_sub(1)).collect();
                tried.retain(|&place| place < count && place != at);
                tried.sort_unstable();
                tried.dedup();
                for place in tried {
                    let (mut scales, mut tau) = (scales, tau);
                    *(if which < 3 { &mut scales[which] } else { &mut tau }) = place;
                    best = better(best, self.score(set, columns, scales, tau..tau + 1));
                }
            }
            if best.as_ref()?.ln_z <= before + NO_GAIN {
                return best;
            }
        }
    }
}

/// The better of two.
pub(super) fn better(one: Option<Scored>, other: Option<Scored>) -> Option<Scored> {
    match (one, other) {
        (Some(one), Some(other)) if other.ln_z > one.ln_z + NO_GAIN => Some(other),
        (Some(one), _) => Some(one),
        (None, other) => other,
    }
}

/// Sizes of a hypothesis' columns about a point.
struct Posterior {
    sizes: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Squares explained, what beliefs cost taken off.
    explained: f64,
    /// That cost, which the logarithm of the prior has instead.
    penalty_back: f64,
    ln_prior: f64,
    ln_width: f64,
}

impl Posterior {
    fn new(products: &DMatrix<f64>, data: &DVector<f64>, beliefs: &[&Column], tau: f64) -> Option<Self> {
        let mut data = data.clone();
        // from where the data alone would have them
        let mut sizes: Vec<f64> = beliefs
            .iter()
            .map(|column| match column.belief {
                Belief::Size(scale) => FAR * scale,
                _ => 0.0,
            })
            .collect();
        let mut rounds = CAUCHY_ROUNDS;
        loop {
            let precision = |(column, size): (&&Column, &f64)| column.belief.precision(*size, tau);
            let precisions: Vec<f64> = beliefs.iter().zip(&sizes).map(precision).collect();
            let mut all = products.clone();
            for (place, precision) in precisions.iter().enumerate() {
                all[(place, place)] += precision;
                if beliefs[place].belief == Belief::Given {
                    all.row_mut(place).fill(0.0);
                    all.column_mut(place).fill(0.0);
                    all[(place, place)] = 1.0;
                    data[place] = 0.0;
                }
            }
            let factor = all.cholesky()?;
            let found = factor.solve(&data);
            rounds -= 1;
            if rounds > 0 {
                sizes = found.as_slice().to_vec();
                continue;
            }
            let ln_posterior: f64 = factor.l_dirty().diagonal().iter().map(|x: &f64| x.ln()).sum();
            let covariance = factor.inverse();
            let (mut ln_prior, mut penalty) = (0.0, 0.0);
            for (place, column) in beliefs.iter().enumerate() {
                let size = found[place];
                match column.belief {
                    Belief::Size(scale) => {
                        penalty += precisions[place] * size * size;
                        ln_prior += 0.5 * TAU.ln() - (PI * scale).ln() - (size / scale).powi(2).ln_1p();
                    }
                    Belief::Given => {}
                    Belief::Deviation(_) | Belief::Hidden(_) => ln_prior += 0.5 * precisions[place].ln(),
                }
                if column.is_positive {
                    ln_prior += LN_2 + ln_normal(size / covariance[(place, place)].sqrt());
                }
            }
            return Some(Self {
                explained: found.dot(&data),
                sizes: found,
                covariance,
                penalty_back: penalty,
                ln_prior,
                ln_width: -ln_posterior,
            });
        }
    }
}

/// A size so many times its scale is where the first round looks: almost free.
const FAR: f64 = 30.0;

/// Logarithm of the normal distribution function: half of what a chi-square of one degree leaves beyond the square; from where that
/// underflows on, the beginning of its continued fraction.
///
/// # Source
/// M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions, 1964, 26.2.14.
fn ln_normal(x: f64) -> f64 {
    /// No double holds the function's values much farther down.
    const UNDERFLOW: f64 = -30.0;
    if x < UNDERFLOW {
        return -0.5 * x * x - (-x * TAU.sqrt()).ln() - (1.0 / (x * x)).ln_1p();
    }
    let tail = 0.5 * chi2_survival(x * x, 1.0);
    if x < 0.0 { tail.ln() } else { (-tail).ln_1p() }
}

#[cfg(test)]
mod tests {
    use super::ln_normal;

    #[test]
    fn the_normal_distribution_is_that_of_tables() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.841_344_746), (-2.0, 0.022_750_132), (-5.0, 2.866_515_7e-7)] {
            assert!((ln_normal(x) - f64::ln(p)).abs() < 1e-7, "{x}: {} {}", ln_normal(x).exp(), p);
        }
        let [above, below] = [-29.999, -30.001].map(ln_normal);
        assert!((above - below - 0.06).abs() < 1e-3, "{above} {below}");
    }
}
