//! Curves as points: arc length, even spacing, smoothing.

use camera::calibration::Px;

/// Arc length from the first point to each, shape as `points` \[px\].
pub fn arc_lengths(points: &[Px]) -> Vec<f64> {
    let mut total = 0.0;
    let mut lengths = Vec::with_capacity(points.len());
    for (i, p) in points.iter().enumerate() {
        if i > 0 {
            total += distance(*p, points[i - 1]);
        }
        lengths.push(total);
    }
    lengths
}

/// The point at arc length `s` along `points`, whose [`arc_lengths`] are `lengths`; the ends beyond them.
pub fn point_at(points: &[Px], lengths: &[f64], s: f64) -> Px {
    let next = lengths.partition_point(|&l| l < s).clamp(1, points.len() - 1);
    let (a, b) = (points[next - 1], points[next]);
    let step = lengths[next] - lengths[next - 1];
    let share = if step > 0.0 { ((s - lengths[next - 1]) / step).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
}

/// `count` points, at least 2, evenly spaced along the arc length from `from` to `to`.
pub fn resampled(points: &[Px], from: f64, to: f64, count: usize) -> Vec<Px> {
    let lengths = arc_lengths(points);
    let step = (to - from) / (count - 1) as f64;
    (0..count).map(|i| point_at(points, &lengths, from + step * i as f64)).collect()
}

/// Unit tangents, shape as `points`: central differences, one-sided at the ends.
pub fn tangents(points: &[Px]) -> Vec<Px> {
    let last = points.len() - 1;
    (0..=last).map(|i| unit(points[i.saturating_sub(1)], points[(i + 1).min(last)])).collect()
}

/// The smoothing spline through evenly spaced `points`: minimises the sum of `weights`-weighted squared
/// distances plus `scale`⁴ (in spacings) times the sum of squared second differences.
///
/// Waves shorter than 2π `scale` are taken out; straight lines pass unchanged. Weights are not negative, and at
/// least two of them positive.
///
/// # Source
/// Eilers, "A perfect smoother", Anal. Chem. 75 (2003) 3631-3636, with second differences.
pub fn smoothed(points: &[Px], weights: &[f64], scale: f64) -> Vec<Px> {
    let n = points.len();
    if n < 3 {
        return points.to_vec();
    }
    let lambda = scale.powi(4);
    // W + lambda D'D has two bands beside its diagonal; D'D by summing the outer products of (1, -2, 1).
    let mut bands = vec![[0.0; 3]; n];
    for (band, weight) in bands.iter_mut().zip(weights) {
        band[0] = *weight;
    }
    for i in 0..n - 2 {
        for (offset, values) in [[1.0, -2.0, 1.0], [4.0, -2.0, 0.0], [1.0, 0.0, 0.0]].iter().enumerate() {
            for (k, value) in values.iter().enumerate() {
                bands[i + offset][k] += lambda * value;
            }
        }
    }
    // L D L' in place: bands become D and the two sub-diagonals of L.
    for i in 0..n {
        let pivot = bands[i][0];
        let (one, two) = (bands[i][1] / pivot, bands[i][2] / pivot);
        if i + 1 < n {
            bands[i + 1][0] -= one * bands[i][1];
            bands[i + 1][1] -= one * bands[i][2];
        }
        if i + 2 < n {
            bands[i + 2][0] -= two * bands[i][2];
        }
        bands[i][1] = one;
        bands[i][2] = two;
    }
    let mut out: Vec<Px> = points.iter().zip(weights).map(|(p, w)| [p[0] * w, p[1] * w]).collect();
    for i in 0..n {
        for k in 1..=i.min(2) {
            let before = out[i - k];
            out[i] = moved(out[i], before, -bands[i - k][k]);
        }
    }
    for i in (0..n).rev() {
        out[i] = out[i].map(|value| value / bands[i][0]);
        for k in 1..=2.min(n - 1 - i) {
            let after = out[i + k];
            out[i] = moved(out[i], after, -bands[i][k]);
        }
    }
    out
}

/// Distance \[px\].
pub fn distance(a: Px, b: Px) -> f64 {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    // Pixels cannot overflow: no need of the slower `hypot`.
    (dx * dx + dy * dy).sqrt()
}

/// Unit vector from `a` to `b`; `[1, 0]` where they coincide.
pub fn unit(a: Px, b: Px) -> Px {
    let length = distance(a, b);
    if length > 0.0 { [(b[0] - a[0]) / length, (b[1] - a[1]) / length] } else { [1.0, 0.0] }
}

/// `point` plus `by` times `direction`.
pub fn moved(point: Px, direction: Px, by: f64) -> Px {
    [point[0] + by * direction[0], point[1] + by * direction[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a banded solve of well scaled numbers.
    const ROUNDING: f64 = 1e-8;

    #[test]
    fn straight_line_passes_the_smoother_unchanged_whatever_the_weights() {
        let line: Vec<Px> = (0..40).map(|i| [f64::from(i), 3.0 - 0.5 * f64::from(i)]).collect();
        let weights: Vec<f64> = (0..40).map(|i| f64::from(i % 3)).collect();
        for (a, b) in line.iter().zip(smoothed(&line, &weights, 3.0)) {
            assert!(distance(*a, b) < ROUNDING, "{a:?} {b:?}");
        }
    }

    #[test]
    fn wave_is_damped_by_the_factor_of_the_penalty() {
        let (n, scale, omega) = (400, 2.0, 0.3f64);
        let wave: Vec<Px> = (0..n).map(|i| [f64::from(i), (omega * f64::from(i)).sin()]).collect();
        let out = smoothed(&wave, &vec![1.0; n as usize], scale);
        let second = 2.0 - 2.0 * omega.cos();
        let factor = 1.0 / (1.0 + scale.powi(4) * second * second);
        for i in 150..250 {
            assert!((out[i][1] - factor * wave[i][1]).abs() < 1e-6, "{i}");
        }
    }

    #[test]
    fn even_spacing_keeps_the_ends_and_halves_the_length() {
        let bent = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]];
        assert_eq!(resampled(&bent, 0.0, 4.0, 3), vec![[0.0, 0.0], [2.0, 0.0], [3.0, 1.0]]);
        assert_eq!(point_at(&bent, &arc_lengths(&bent), 99.0), [3.0, 1.0]);
    }
}
