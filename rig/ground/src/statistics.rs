//! Medians, quantiles, the chi-square test and Student's t, as the fits need them.

use std::cmp::Ordering;

use nalgebra::DVector;

/// The chi-square of one degree of freedom that 95 % stay below: the square of [`NORMAL_95`].
pub const CHI2_95: f64 = 3.841_458_820_694_124;
/// Standard deviations to either side that hold 95 % of a normal variable.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// Factor from the median absolute value of normal deviations to their standard deviation: 1 / quantile(3/4).
pub const MEDIAN_TO_SIGMA: f64 = 1.4826;
/// Tukey's biweight constant: deviations of more standard deviations than this get no weight; 95 % efficient on normal ones.
pub const TUKEY_SIGMAS: f64 = 4.685;

/// The middle of `values` in this total `order`, of an even number the upper one; `None` without any. They are reordered.
pub fn median<T: Copy>(values: &mut [T], order: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, order).1)
}

/// Chi-square test that all `values` measure the same number, where `weigh` multiplies by their inverse covariance: chi-square,
/// degrees of freedom, and the probability of as much by chance.
pub fn one_value(values: &DVector<f64>, weigh: impl Fn(&DVector<f64>) -> DVector<f64>) -> (f64, usize, f64) {
    let weights = weigh(&DVector::from_element(values.len(), 1.0));
    let mean = weights.dot(values) / weights.sum();
    let apart = values.add_scalar(-mean);
    let chi2 = apart.dot(&weigh(&apart)).max(0.0);
    let degrees = values.len() - 1;
    (chi2, degrees, chi2_survival(chi2, degrees as f64))
}

/// Probability that a chi-square of `degrees` degrees of freedom exceeds `value`: the regularised upper incomplete
/// gamma function Q(degrees / 2, value / 2).
///
/// By hand, as written results hold it to the last digit: crate `statrs` agrees to 1e-13 only, and panics at 0 and infinity.
///
/// # Source
/// M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions": series 6.5.29 below the mean, continued
/// fraction 6.5.31 above.
pub fn chi2_survival(value: f64, degrees: f64) -> f64 {
    let (a, x) = (degrees / 2.0, value / 2.0);
    if a <= 0.0 || x <= 0.0 || !x.is_finite() {
        return if x > 0.0 { 0.0 } else { 1.0 };
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * f64::EPSILON {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return (1.0 - front * sum).clamp(0.0, 1.0);
    }
    // Lentz's evaluation: numerators -n (n - a), denominators x + 2n + 1 - a.
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / f64::MIN_POSITIVE;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for n in 1..MAX_FRACTION_TERMS {
        let n = f64::from(n);
        let numerator = -n * (n - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        fraction *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    (front * fraction).clamp(0.0, 1.0)
}

/// Most terms of the continued fraction, chosen: it converges in some sqrt(degrees) terms, and there are never more than a million
/// degrees.
const MAX_FRACTION_TERMS: u32 = 10_000;

/// The quantile of Student's t with `degrees` degrees of freedom that |t| exceeds with probability `beyond`, between 0 and 1.
pub fn student_t_beyond(beyond: f64, degrees: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while student_t_survival(high, degrees) > beyond && high < f64::MAX.sqrt() {
        (low, high) = (high, 2.0 * high);
    }
    // halved as often as a double has bits
    for _ in 0..f64::MANTISSA_DIGITS + 8 {
        let middle = 0.5 * (low + high);
        if student_t_survival(middle, degrees) > beyond { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that the size of Student's t with `degrees` degrees of freedom exceeds that of `value`: the regularised incomplete beta
/// function I(degrees / (degrees + value^2); degrees / 2, 1 / 2).
///
/// # Source
/// M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions": 26.7.1, continued fraction 26.5.8.
pub fn student_t_survival(value: f64, degrees: f64) -> f64 {
    let (a, b, x) = (degrees / 2.0, 0.5, degrees / (degrees + value * value));
    // beyond the mean of the beta distribution the fraction of the mirrored function converges
    let share = if x < (a + 1.0) / (a + b + 2.0) {
        beta_share(a, b, x, 1.0 - x)
    } else {
        1.0 - beta_share(b, a, 1.0 - x, x)
    };
    share.clamp(0.0, 1.0)
}

/// I(x; a, b), where `rest` is 1 - x.
fn beta_share(a: f64, b: f64, x: f64, rest: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * rest.ln()).exp() / a;
    // Lentz's evaluation of 1 + d1 / (1 + d2 / (1 + ...))
    let (mut fraction, mut c, mut d) = (1.0_f64, 1.0_f64, 0.0_f64);
    for n in 1..MAX_FRACTION_TERMS {
        let m = f64::from(n / 2);
        let term = match n % 2 {
            0 => m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            _ => -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        };
        d = 1.0 / (1.0 + term * d);
        c = 1.0 + term / c;
        fraction *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    front / fraction
}

/// Logarithm of the gamma function for x > 0: Stirling's series (6.1.41), moved up to where it holds to 1e-15.
fn ln_gamma(mut x: f64) -> f64 {
    let mut shift = 0.0;
    while x < 12.0 {
        shift -= x.ln();
        x += 1.0;
    }
    let inverse = 1.0 / (x * x);
    let series = (1.0 / 12.0
        - inverse * (1.0 / 360.0 - inverse * (1.0 / 1260.0 - inverse * (1.0 / 1680.0 - inverse / 1188.0))))
        / x;
    shift + (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_degrees_fall_off_exponentially() {
        // Q(1, x / 2) = exp(-x / 2), on both sides of where series and fraction meet.
        for value in [1e-3, 0.5, 2.0, 3.9, 4.1, 20.0, 100.0_f64] {
            let wanted = (-value / 2.0).exp();
            assert!((chi2_survival(value, 2.0) / wanted - 1.0).abs() < 1e-12, "{value}");
        }
    }

    #[test]
    fn student_s_t_is_cauchy_s_with_one_degree_and_normal_with_many() {
        for value in [0.1, 1.0, 3.0, 12.706_f64] {
            let cauchy = 1.0 - 2.0 / std::f64::consts::PI * value.atan();
            assert!((student_t_survival(value, 1.0) - cauchy).abs() < 1e-12, "{value}");
            let normal = chi2_survival(value * value, 1.0);
            assert!((student_t_survival(value, 1e7) - normal).abs() < 1e-6, "{value}");
        }
        // Abramowitz and Stegun, table 26.10: 5 % points of |t|.
        for (degrees, value) in [(1.0, 12.706), (2.0, 4.303), (5.0, 2.571), (30.0, 2.042)] {
            assert!((student_t_beyond(0.05, degrees) - value).abs() < 5e-4, "{degrees}");
        }
    }

    #[test]
    fn tabled_quantiles_are_met() {
        // Abramowitz and Stegun, table 26.8: 5 % points.
        for (degrees, value) in [(1.0, CHI2_95), (5.0, 11.0705), (10.0, 18.307), (30.0, 43.773)] {
            assert!((chi2_survival(value, degrees) - 0.05).abs() < 1e-5, "{degrees}");
        }
        assert!((NORMAL_95 * NORMAL_95 - CHI2_95).abs() < 1e-12);
        assert_eq!(chi2_survival(0.0, 3.0), 1.0);
    }
}
