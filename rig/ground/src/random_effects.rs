//! One number as several recordings give it: whether it is the same in all of them, how far it differs where it does not, and whether it
//! follows something that is known of them.
//!
//! Model: recording i gives y_i = mu + b_i + e_i, with e_i of the known standard deviation s_i, and b_i of the variance tau^2, which is 0 where
//! the number is the same everywhere.
//!
//! # Sources
//! * tau^2: R. DerSimonian, N. Laird, "Meta-analysis in clinical trials", Controlled Clinical Trials 7 (1986) 177: the estimate of moments.
//! * The mean's interval: J. Hartung, G. Knapp, Statistics in Medicine 20 (2001) 3875, never narrower than by the weights alone
//!   (C. Röver, G. Knapp, T. Friede, BMC Medical Research Methodology 15 (2015) 99).
//! * tau^2's interval: W. Viechtbauer, Statistics in Medicine 26 (2007) 37: profile of Q.
//! * I^2: J. P. T. Higgins, S. G. Thompson, Statistics in Medicine 21 (2002) 1539.
//! * Trends: S. G. Thompson, S. J. Sharp, Statistics in Medicine 18 (1999) 2693, with the estimate of moments.

use crate::statistics::{chi2_survival, student_t_beyond, student_t_survival};

/// A number as one recording gives it, in its SI unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Its value.
    pub value: f64,
    /// Its standard deviation, above 0.
    pub std: f64,
}

/// What several recordings say of one number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomEffects {
    /// How many recordings.
    pub count: usize,
    /// The mean of what it is everywhere.
    pub mean: f64,
    /// 95 % interval of that mean.
    pub mean_ci95: [f64; 2],
    /// Variance from recording to recording, beyond what their standard deviations say.
    pub tau2: f64,
    /// Its 95 % interval; the end may be infinite.
    pub tau2_ci95: [f64; 2],
    /// Share of all scatter that is from recording to recording, between 0 and 1.
    pub i2: f64,
    /// Cochran's Q: squared distances from the common mean in standard deviations.
    pub q: f64,
    /// Probability of as much scatter, were it the same number everywhere.
    pub p_same: f64,
}

/// Whether a number follows something that is known of the recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trend {
    /// Change per unit of what it may follow.
    pub slope: f64,
    /// 95 % interval of that.
    pub slope_ci95: [f64; 2],
    /// Probability of as large a slope, did it not follow it.
    pub p: f64,
}

/// Probability outside of a 95 % interval.
const OUTSIDE_95: f64 = 0.05;

/// Random effects of `measured`, of which there must be two or more, each with a value and a standard deviation above 0; else `None`.
pub fn random_effects(measured: &[Measured]) -> Option<RandomEffects> {
    if measured.len() < 2 || !are_usable(measured) {
        return None;
    }
    let degrees = (measured.len() - 1) as f64;
    let q = q_about(measured, 0.0);
    let tau2 = ((q - degrees) / effective_weight(measured)).max(0.0);
    let (mean, weight) = weighted_mean(measured, tau2);
    let spread = (q_about(measured, tau2) / degrees).max(1.0);
    let half = student_t_beyond(OUTSIDE_95, degrees) * (spread / weight).sqrt();
    Some(RandomEffects {
        count: measured.len(),
        mean,
        mean_ci95: [mean - half, mean + half],
        tau2,
        tau2_ci95: [0.5 * OUTSIDE_95, 1.0 - 0.5 * OUTSIDE_95].map(|share| tau2_where(measured, share)),
        i2: if q > 0.0 { ((q - degrees) / q).max(0.0) } else { 0.0 },
        q,
        p_same: chi2_survival(q, degrees),
    })
}

/// The slope of `measured` over `x`, one for each; `None` with fewer than three, or where all `x` are the same.
pub fn trend(measured: &[Measured], x: &[f64]) -> Option<Trend> {
    if measured.len() < 3 || x.len() != measured.len() || !are_usable(measured) {
        return None;
    }
    // about the middle of x, so that large numbers (seconds since 1970) lose no digits
    let middle = x.iter().sum::<f64>() / x.len() as f64;
    let x: Vec<f64> = x.iter().map(|x| x - middle).collect();
    let degrees = (measured.len() - 2) as f64;
    let line = Line::of(measured, &x, 0.0)?;
    // trace of W - W X (X' W X)^-1 X' W: what Q grows by per unit of tau^2
    let squares = |weight: f64| weight * weight;
    let [ww, wwx, wwxx] = sums(measured, &x, |one| squares(weight_of(one, 0.0)));
    let [w, wx, wxx] = line.sums;
    let trace = w - (wxx * ww - 2.0 * wx * wwx + w * wwxx) / line.determinant;
    let tau2 = if trace > 0.0 { ((line.q - degrees) / trace).max(0.0) } else { 0.0 };
    let line = Line::of(measured, &x, tau2)?;
    let std = ((line.q / degrees).max(1.0) * line.sums[0] / line.determinant).sqrt();
    let half = student_t_beyond(OUTSIDE_95, degrees) * std;
    Some(Trend {
        slope: line.slope,
        slope_ci95: [line.slope - half, line.slope + half],
        p: student_t_survival(line.slope / std, degrees),
    })
}

/// Probability of as large differences between the means of groups, `group` giving that of each of `measured`, were it one number up to the
/// scatter within groups; `None` where there are not two groups, or no group has two.
pub fn same_in_groups<G: PartialEq + Copy>(measured: &[Measured], group: &[G]) -> Option<f64> {
    if group.len() != measured.len() || !are_usable(measured) {
        return None;
    }
    let mut names: Vec<G> = Vec::new();
    group.iter().for_each(|name| {
        if !names.contains(name) {
            names.push(*name);
        }
    });
    let of = |name: &G| -> Vec<Measured> {
        measured.iter().zip(group).filter(|(_, own)| *own == name).map(|(one, _)| *one).collect()
    };
    let groups: Vec<Vec<Measured>> = names.iter().map(of).collect();
    if groups.len() < 2 || groups.len() == measured.len() {
        return None;
    }
    let within: f64 = groups.iter().map(|group| q_about(group, 0.0)).sum();
    let weight: f64 = groups.iter().map(|group| effective_weight(group)).sum();
    let degrees = (measured.len() - groups.len()) as f64;
    let tau2 = if weight > 0.0 { ((within - degrees) / weight).max(0.0) } else { 0.0 };
    let all = weighted_mean(measured, tau2).0;
    let between = |group: &Vec<Measured>| {
        let (mean, weight) = weighted_mean(group, tau2);
        weight * (mean - all).powi(2)
    };
    Some(chi2_survival(groups.iter().map(between).sum(), (groups.len() - 1) as f64))
}

/// Probabilities of tests made together, each as it must be read so that a false alarm among all of them stays as rare as in one.
///
/// # Source
/// S. Holm, Scandinavian Journal of Statistics 6 (1979) 65.
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&a, &b| p[a].total_cmp(&p[b]));
    let mut adjusted = vec![0.0; p.len()];
    let mut largest: f64 = 0.0;
    for (rank, &place) in order.iter().enumerate() {
        largest = largest.max((p.len() - rank) as f64 * p[place]).min(1.0);
        adjusted[place] = largest;
    }
    adjusted
}

fn are_usable(measured: &[Measured]) -> bool {
    measured.iter().all(|one| one.value.is_finite() && one.std.is_finite() && one.std > 0.0)
}

fn weight_of(one: &Measured, tau2: f64) -> f64 {
    1.0 / (one.std * one.std + tau2)
}

/// The weighted mean, and the sum of the weights.
fn weighted_mean(measured: &[Measured], tau2: f64) -> (f64, f64) {
    let weight: f64 = measured.iter().map(|one| weight_of(one, tau2)).sum();
    let sum: f64 = measured.iter().map(|one| weight_of(one, tau2) * one.value).sum();
    (sum / weight, weight)
}

/// Squared distances from the weighted mean, in standard deviations.
fn q_about(measured: &[Measured], tau2: f64) -> f64 {
    let mean = weighted_mean(measured, tau2).0;
    measured.iter().map(|one| weight_of(one, tau2) * (one.value - mean).powi(2)).sum()
}

/// By how much Q is expected to grow per unit of tau^2.
fn effective_weight(measured: &[Measured]) -> f64 {
    let weight: f64 = measured.iter().map(|one| weight_of(one, 0.0)).sum();
    weight - measured.iter().map(|one| weight_of(one, 0.0).powi(2)).sum::<f64>() / weight
}

/// The tau^2 at which Q is exceeded with probability `share`; 0 where it would have to be below.
fn tau2_where(measured: &[Measured], share: f64) -> f64 {
    let degrees = (measured.len() - 1) as f64;
    let exceeded = |tau2: f64| chi2_survival(q_about(measured, tau2), degrees);
    if exceeded(0.0) >= share {
        return 0.0;
    }
    let least = measured.iter().map(|one| one.std * one.std).fold(f64::INFINITY, f64::min);
    let (mut low, mut high) = (0.0, least);
    while exceeded(high) < share {
        (low, high) = (high, 2.0 * high);
        if !high.is_finite() {
            return f64::INFINITY;
        }
    }
    for _ in 0..f64::MANTISSA_DIGITS {
        let middle = 0.5 * (low + high);
        if exceeded(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Sums of `weight`, times x, times x^2.
fn sums(measured: &[Measured], x: &[f64], weight: impl Fn(&Measured) -> f64) -> [f64; 3] {
    measured.iter().zip(x).fold([0.0; 3], |[sum, first, second], (one, x)| {
        let weight = weight(one);
        [sum + weight, first + weight * x, second + weight * x * x]
    })
}

/// A weighted straight line.
struct Line {
    slope: f64,
    /// Of its residuals.
    q: f64,
    sums: [f64; 3],
    determinant: f64,
}

impl Line {
    fn of(measured: &[Measured], x: &[f64], tau2: f64) -> Option<Self> {
        let weight = |one: &Measured| weight_of(one, tau2);
        let sums = sums(measured, x, weight);
        let [w, wx, wxx] = sums;
        let determinant = w * wxx - wx * wx;
        // all x the same, but for rounding
        if determinant <= 1e-12 * w * wxx {
            return None;
        }
        let (mut wy, mut wxy) = (0.0, 0.0);
        for (one, x) in measured.iter().zip(x) {
            wy += weight(one) * one.value;
            wxy += weight(one) * one.value * x;
        }
        let slope = (w * wxy - wx * wy) / determinant;
        let start = (wy - slope * wx) / w;
        let q = measured
            .iter()
            .zip(x)
            .map(|(one, x)| weight(one) * (one.value - start - slope * x).powi(2))
            .sum();
        Some(Self { slope, q, sums, determinant })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(numbers: &[(f64, f64)]) -> Vec<Measured> {
        numbers.iter().map(|&(value, std)| Measured { value, std }).collect()
    }

    /// Trials of BCG against tuberculosis: vaccinated ill and well, others ill and well. G. A. Colditz et al., JAMA 271 (1994) 698, as in the
    /// data set `dat.bcg` of the R package metafor.
    const BCG: [[f64; 4]; 13] = [
        [4.0, 119.0, 11.0, 128.0],
        [6.0, 300.0, 29.0, 274.0],
        [3.0, 228.0, 11.0, 209.0],
        [62.0, 13536.0, 248.0, 12619.0],
        [33.0, 5036.0, 47.0, 5761.0],
        [180.0, 1361.0, 372.0, 1079.0],
        [8.0, 2537.0, 10.0, 619.0],
        [505.0, 87886.0, 499.0, 87892.0],
        [29.0, 7470.0, 45.0, 7232.0],
        [17.0, 1699.0, 65.0, 1600.0],
        [186.0, 50448.0, 141.0, 27197.0],
        [5.0, 2493.0, 3.0, 2338.0],
        [27.0, 16886.0, 29.0, 17825.0],
    ];
    /// Their absolute latitudes \[degrees\].
    const LATITUDES: [f64; 13] =
        [44.0, 55.0, 42.0, 52.0, 13.0, 44.0, 19.0, 13.0, 27.0, 42.0, 18.0, 33.0, 33.0];

    fn bcg() -> Vec<Measured> {
        let log_risk_ratio = |[ill, well, ill_other, well_other]: [f64; 4]| {
            let (all, others) = (ill + well, ill_other + well_other);
            let variance = 1.0 / ill - 1.0 / all + 1.0 / ill_other - 1.0 / others;
            Measured { value: (ill / all / (ill_other / others)).ln(), std: variance.sqrt() }
        };
        BCG.map(log_risk_ratio).to_vec()
    }

    #[test]
    fn equal_deviations_leave_what_the_sample_variance_exceeds_them_by() {
        let values = [1.0, 3.0, 4.0, 8.0];
        let found = random_effects(&of(&values.map(|value| (value, 0.5)))).unwrap();
        let variance = 26.0 / 3.0;
        assert!((found.mean - 4.0).abs() < 1e-12 && (found.tau2 - (variance - 0.25)).abs() < 1e-12);
        // the interval is then Student's of the plain sample
        let half = 3.182_446 * (variance / 4.0_f64).sqrt();
        assert!((found.mean_ci95[1] - 4.0 - half).abs() < 1e-5, "{found:?}");
        // and that of tau^2 the chi-square interval of a sample variance: 5 % points of chi-square with three degrees
        let [low, high] = [9.348_404, 0.215_795].map(|quantile| 26.0 / quantile - 0.25);
        assert!(
            (found.tau2_ci95[0] - low).abs() < 1e-4 && (found.tau2_ci95[1] / high - 1.0).abs() < 1e-4,
            "{found:?} {high}"
        );
    }

    #[test]
    fn one_number_has_no_scatter_and_the_mean_of_its_weights() {
        let found = random_effects(&of(&[(2.0, 0.1), (2.0, 0.4), (2.0, 1.0)])).unwrap();
        assert_eq!((found.tau2, found.i2, found.q, found.p_same), (0.0, 0.0, 0.0, 1.0));
        assert!((found.mean - 2.0).abs() < 1e-12 && found.tau2_ci95[0] == 0.0);
        assert!(random_effects(&of(&[(2.0, 0.1)])).is_none());
        assert!(random_effects(&of(&[(2.0, 0.1), (2.0, 0.0)])).is_none());
    }

    #[test]
    fn exact_recordings_weigh_alike_and_scatter_like_a_sample() {
        let found = random_effects(&of(&[(1.0, 1e-6), (2.0, 2e-6), (4.0, 3e-6)])).unwrap();
        let mean = 7.0 / 3.0;
        assert!((found.mean - mean).abs() < 1e-6 && found.i2 > 1.0 - 1e-9, "{found:?}");
    }

    #[test]
    fn other_units_and_another_zero_change_nothing_else() {
        let numbers = [(1.0, 0.3), (2.5, 0.2), (1.8, 0.6)];
        let [here, there] = [1.0, -250.0].map(|unit| {
            let moved = |&(value, std): &(f64, f64)| (unit * value + 7.0, f64::abs(unit) * std);
            random_effects(&of(&numbers.iter().map(moved).collect::<Vec<_>>())).unwrap()
        });
        assert!((there.mean - (-250.0 * (here.mean - 7.0) + 7.0)).abs() < 1e-9);
        assert!((there.tau2 / here.tau2 - 62_500.0).abs() < 1e-5 && (there.i2 - here.i2).abs() < 1e-12);
    }

    #[test]
    fn trials_of_bcg_are_as_metafor_has_them() {
        let found = random_effects(&bcg()).unwrap();
        // rma(yi, vi, method = "DL"), and confint() of it, which does not depend on the method
        for (name, ours, theirs, digits) in [
            ("Q", found.q, 152.2330, 1e-4),
            ("tau2", found.tau2, 0.3088, 5e-5),
            ("mean", found.mean, -0.7141, 5e-5),
            ("I2", found.i2, 0.9212, 5e-5),
            ("tau2 from", found.tau2_ci95[0], 0.1197, 5e-5),
            ("tau2 to", found.tau2_ci95[1], 1.1115, 5e-5),
        ] {
            assert!((ours - theirs).abs() <= digits, "{name}: {ours}, theirs {theirs}");
        }
        // rma(yi, vi, mods = ~ ablat, method = "DL")
        let by_latitude = trend(&bcg(), &LATITUDES).unwrap();
        assert!((by_latitude.slope + 0.0292).abs() < 1e-4, "{by_latitude:?}");
        assert!(by_latitude.p < 0.01, "{by_latitude:?}");
    }

    #[test]
    fn a_straight_line_is_found_and_scatter_alone_is_none() {
        let x: Vec<f64> = (0..6).map(|i| 1.7e9 + 86_400.0 * f64::from(i)).collect();
        let line: Vec<Measured> =
            x.iter().map(|x| Measured { value: 3.0 + 1e-6 * (x - 1.7e9), std: 0.01 }).collect();
        let found = trend(&line, &x).unwrap();
        assert!((found.slope / 1e-6 - 1.0).abs() < 1e-6 && found.p < 1e-3, "{found:?}");
        let flat = of(&[(1.0, 0.1), (1.1, 0.1), (1.0, 0.1), (1.1, 0.1), (1.0, 0.1), (1.1, 0.1)]);
        assert!(trend(&flat, &x).unwrap().p > 0.3);
        assert!(trend(&flat, &[5.0; 6]).is_none());
    }

    #[test]
    fn groups_that_differ_are_told_from_groups_that_do_not() {
        let apart = of(&[(1.0, 0.1), (1.1, 0.1), (2.0, 0.1), (2.1, 0.1)]);
        assert!(same_in_groups(&apart, &["a", "a", "b", "b"]).unwrap() < 1e-6);
        assert!(same_in_groups(&apart, &["a", "b", "a", "b"]).unwrap() > 0.5);
        assert_eq!(same_in_groups(&apart, &["a"; 4]), None);
    }

    #[test]
    fn one_test_of_many_must_be_clearer() {
        let adjusted = holm(&[0.01, 0.04, 0.03]);
        for (ours, wanted) in adjusted.iter().zip([0.03, 0.06, 0.06]) {
            assert!((ours - wanted).abs() < 1e-12, "{adjusted:?}");
        }
    }
}
