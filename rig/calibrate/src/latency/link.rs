//! How late pictures are, from how the driven link follows its servo: for a camera that has no sync LED in view.
//!
//! The link's angle is taken for the command, later by a delay, through a lag of first order, times a gain, from a zero. A lag bends what it delays
//! and a delay does not, so that the two come apart; what a servo does between its pulse and its first motion is a delay as well, and stays in
//! it. Where the servo measures its angle itself, that is followed instead, without a lag.

use nalgebra::{Matrix3, Vector3};

/// How the driven link of a run follows its command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Following {
    /// Delay from the command to the link's motion in the pictures, in addition to the lag \[s\].
    pub delay_s: f64,
    /// Its standard deviation, from the link's residuals \[s\].
    pub std_s: f64,
    /// The lag's time constant \[s\].
    pub lag_s: f64,
    /// Turn of the link per turn of the command.
    pub gain: f64,
    /// Root mean square of the residuals \[rad\].
    pub rms_rad: f64,
    /// The delay of strokes that turn the link one way, less that of the others \[s\]: 0 but for noise.
    pub two_ways_s: f64,
}

/// The angle that the link follows: its servo's command or measured angle.
#[derive(Debug, Clone, Copy)]
pub struct Followed<'a> {
    /// Times \[s\], rising.
    pub time_s: &'a [f64],
    /// Angles at these times \[rad\]; linear between them.
    pub angle_rad: &'a [f64],
}

/// Ranges of delays and lags that are sought \[s\] (chosen).
const DELAY_RANGE_S: [f64; 2] = [-0.05, 0.3];
const LAG_RANGE_S: [f64; 2] = [0.0, 0.15];
/// Step of the first grid \[s\], factor by which each following grid is finer, and number of grids (all chosen).
const GRID_STEP_S: f64 = 0.005;
const GRID_REFINEMENT: f64 = 5.0;
const GRID_ROUNDS: usize = 4;
/// Step in which the lag is integrated \[s\] (chosen).
const INTEGRATION_STEP_S: f64 = 5e-4;

impl Followed<'_> {
    fn at(&self, time_s: f64) -> f64 {
        let next = self.time_s.partition_point(|&row_s| row_s <= time_s);
        match (next.checked_sub(1), self.time_s.get(next)) {
            (None, _) => self.angle_rad.first().copied().unwrap_or_default(),
            (Some(last), None) => self.angle_rad[last],
            (Some(before), Some(&to_s)) => {
                let from_s = self.time_s[before];
                let share = (time_s - from_s) / (to_s - from_s);
                self.angle_rad[before] + share * (self.angle_rad[next] - self.angle_rad[before])
            }
        }
    }

    /// The angle behind a lag of first order, every [`INTEGRATION_STEP_S`] from `from_s` to `until_s`; exact for a straight line over each.
    fn lagged(&self, from_s: f64, until_s: f64, lag_s: f64) -> Vec<f64> {
        let count = ((until_s - from_s) / INTEGRATION_STEP_S).ceil().max(0.0) as usize + 2;
        let input = (0..count).map(|k| self.at(from_s + k as f64 * INTEGRATION_STEP_S));
        if lag_s <= 0.0 {
            return input.collect();
        }
        let keep = (-INTEGRATION_STEP_S / lag_s).exp();
        let lead = 1.0 - (1.0 - keep) * lag_s / INTEGRATION_STEP_S;
        let (mut before, mut lagged) = (self.at(from_s), self.at(from_s));
        input
            .map(|now| {
                lagged = keep * lagged + (1.0 - keep - lead) * before + lead * now;
                before = now;
                lagged
            })
            .collect()
    }
}

/// Fits the delay to a link seen at `angle_rad` at the instants `time_s` \[s\]; `lags`: whether what is followed may lag. None where nothing
/// moves, or there are fewer than ten images.
pub fn following(followed: Followed<'_>, time_s: &[f64], angle_rad: &[f64], lags: bool) -> Option<Following> {
    let (first_s, last_s) = (*time_s.first()?, *time_s.last()?);
    if time_s.len() < 10 || time_s.len() != angle_rad.len() {
        return None;
    }
    let begin_s = first_s - DELAY_RANGE_S[1] - 1.0;
    let try_lag = |lag_s: f64| followed.lagged(begin_s, last_s - DELAY_RANGE_S[0], lag_s);
    let mut grids = [DELAY_RANGE_S, if lags { LAG_RANGE_S } else { [0.0, 0.0] }];
    let mut step_s = GRID_STEP_S;
    let mut best: Option<(f64, f64, f64)> = None;
    for _ in 0..GRID_ROUNDS {
        let steps = |[from, to]: [f64; 2]| {
            let count = ((to - from) / step_s).round() as usize;
            (0..=count).map(move |k| from + k as f64 * step_s)
        };
        for lag_s in steps(grids[1]) {
            let path = try_lag(lag_s.max(0.0));
            for delay_s in steps(grids[0]) {
                let square = Line::fit(&path, begin_s + delay_s, time_s, angle_rad, |_| true)?.square;
                if best.is_none_or(|(least, ..)| square < least) {
                    best = Some((square, delay_s, lag_s.max(0.0)));
                }
            }
        }
        let (_, delay_s, lag_s) = best?;
        grids = [
            [delay_s - step_s, delay_s + step_s],
            if lags { [(lag_s - step_s).max(0.0), lag_s + step_s] } else { [0.0, 0.0] },
        ];
        step_s /= GRID_REFINEMENT;
    }
    let (square, delay_s, lag_s) = best?;
    let path = try_lag(lag_s);
    let line = Line::fit(&path, begin_s + delay_s, time_s, angle_rad, |_| true)?;
    if line.moved.abs() < f64::EPSILON {
        return None;
    }
    // A Gauss-Newton step of the delay, with zero and gain, for each direction of turning by itself.
    let way = |wanted: f64| {
        Line::fit(&path, begin_s + delay_s, time_s, angle_rad, |rate| rate * wanted > 0.0)
            .map(|line| line.late_s)
    };
    let two_ways_s = way(1.0).zip(way(-1.0)).map_or(0.0, |(one, other)| one - other);
    let rms_rad = (square / time_s.len() as f64).sqrt();
    Some(Following { delay_s, std_s: line.late_std_s, lag_s, gain: line.gain, rms_rad, two_ways_s })
}

/// Zero and gain of a link against a path, and by how much later still it would fit best.
struct Line {
    gain: f64,
    square: f64,
    late_s: f64,
    late_std_s: f64,
    /// Sum of the squared rates of the path.
    moved: f64,
}

impl Line {
    /// Against the `path` of steps of [`INTEGRATION_STEP_S`] from `begin_s`, at the instants at which the path's rate \[rad/s\] is one that `counts`.
    fn fit(
        path: &[f64],
        begin_s: f64,
        time_s: &[f64],
        angle_rad: &[f64],
        counts: impl Fn(f64) -> bool,
    ) -> Option<Self> {
        let places = time_s.iter().zip(angle_rad).map(|(&t, &angle)| {
            let place = ((t - begin_s) / INTEGRATION_STEP_S).clamp(0.0, (path.len() - 2) as f64);
            let before = place as usize;
            let slope = path[before + 1] - path[before];
            (path[before] + (place - before as f64) * slope, slope / INTEGRATION_STEP_S, angle)
        });
        let rows: Vec<(f64, f64, f64)> = places.filter(|(_, rate, _)| counts(*rate)).collect();
        let (mut normal, mut right, mut moved) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for &(value, rate, angle) in &rows {
            let row = Vector3::new(1.0, value, rate);
            normal += row * row.transpose();
            right += row * angle;
            moved += rate * rate;
        }
        // zero and gain alone, then with the delay's derivative, - gain * rate
        let two = normal.fixed_view::<2, 2>(0, 0).into_owned().try_inverse()?;
        let linear = two * right.fixed_rows::<2>(0);
        let residual = |&(value, _, angle): &(f64, f64, f64)| angle - linear[0] - linear[1] * value;
        let square: f64 = rows.iter().map(|row| residual(row).powi(2)).sum();
        let (mut late_s, mut late_std_s) = (0.0, f64::INFINITY);
        if let Some(inverse) = normal.try_inverse() {
            let free = inverse * right;
            late_s = -free[2] / linear[1];
            // Residuals of neighbours are correlated, so that they count for fewer.
            let (mut products, mut squares) = (0.0, f64::MIN_POSITIVE);
            for pair in rows.windows(2) {
                products += residual(&pair[0]) * residual(&pair[1]);
                squares += residual(&pair[0]).powi(2);
            }
            let correlation = (products / squares).clamp(0.0, 0.99);
            let variance = square / rows.len() as f64 * (1.0 + correlation) / (1.0 - correlation);
            late_std_s = (variance * inverse[(2, 2)]).sqrt() / linear[1].abs();
        }
        Some(Self { gain: linear[1], square, late_s, late_std_s, moved })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Strokes of 2:1, and a link that follows by small steps of the lag's own equation.
    fn strokes(delay_s: f64, lag_s: f64, noise_rad: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>) {
        let command_s = vec![0.0, 1.0, 2.0, 2.5, 3.5, 4.0, 5.0];
        let command_rad = vec![0.0, 0.0, 0.6, -0.6, 0.6, -0.6, 0.0];
        let command = Followed { time_s: &command_s, angle_rad: &command_rad };
        let step_s = 1e-5;
        let mut link = 0.0;
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let (mut time_s, mut angle_rad) = (Vec::new(), Vec::new());
        for k in 0..600_000_u32 {
            let t = f64::from(k) * step_s;
            link += (command.at(t - delay_s) - link) * step_s / lag_s;
            if k % 1000 == 370 {
                let noise: f64 = StandardNormal.sample(&mut random);
                time_s.push(t + step_s);
                angle_rad.push(-0.1 + 0.9 * link + noise_rad * noise);
            }
        }
        (command_s.clone(), command_rad.clone(), time_s, angle_rad)
    }

    #[test]
    fn delay_and_lag_come_apart() {
        for (delay_s, lag_s) in [(0.035, 0.02), (-0.01, 0.05), (0.12, 0.004)] {
            let (command_s, command_rad, time_s, angle_rad) = strokes(delay_s, lag_s, 0.002);
            let followed = Followed { time_s: &command_s, angle_rad: &command_rad };
            let found = following(followed, &time_s, &angle_rad, true).unwrap();
            assert!(
                (found.delay_s - delay_s).abs() < 1e-3 && (found.lag_s - lag_s).abs() < 1.5e-3,
                "{found:?}"
            );
            assert!(
                (found.gain - 0.9).abs() < 0.005 && found.std_s < 5e-4 && found.two_ways_s.abs() < 1e-3,
                "{found:?}"
            );
            assert!((found.rms_rad / 0.002 - 1.0).abs() < 0.2, "{found:?}");
        }
    }

    #[test]
    fn what_does_not_move_says_nothing() {
        let still = [0.5; 100];
        let time_s: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
        let followed = Followed { time_s: &[0.0, 1.0], angle_rad: &[0.2, 0.2] };
        assert_eq!(following(followed, &time_s, &still, true), None);
    }
}
