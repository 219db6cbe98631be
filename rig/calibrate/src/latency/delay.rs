//! How late a film is, from the images in which the LED turned.
//!
//! An image whose exposure holds a turn is lit by a share that tells the turn's place in it; one whose exposure holds none tells on which
//! side of it the turn was. Both are one likelihood: an image is as bright as the share of its exposure that is lit, plus noise, the
//! exposure's middle being normal about the image's time less the lateness; now and then a stamp is far off. The share is linear in the
//! middle between corners (a turn at either end of the exposure), so that the integral over the middle is a sum of error functions.
//! Lateness, exposure and the stamps' scatter are weighed on a grid, and the latter two summed over.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use rayon::prelude::*;

use super::film::LedSignal;
use super::light::Light;

/// Latency with its standard deviation, scatter of single stamps and exposure time, all in seconds.
pub(super) struct Delay {
    pub(super) mean_s: f64,
    pub(super) std_s: f64,
    pub(super) jitter_s: f64,
    pub(super) exposure_s: f64,
}

/// Scatters of single stamps on the grid \[s\] (chosen).
const JITTERS_S: [f64; 9] = [5e-5, 1.5e-4, 3e-4, 5e-4, 8e-4, 1.2e-3, 1.8e-3, 2.7e-3, 4.5e-3];
/// Number of exposure times on the grid (chosen).
const EXPOSURE_STEPS: usize = 8;
/// The exposure time is sought within this factor of the stated one (chosen).
const STATED_EXPOSURE_FACTOR: f64 = 3.0;
/// Shortest exposure as a share of the period, where none is stated (chosen).
const EXPOSURE_SHARE_MIN: f64 = 0.02;
/// Steps of the grid of latencies: wide first, then finer about the result, this many standard deviations either way (all chosen).
const WIDE_GRID_STEPS: usize = 120;
const FINE_GRID_STEPS: usize = 60;
const FINE_GRID_RANGE_SIGMAS: f64 = 5.0;
/// Probability that a stamp is an outlier (chosen).
const OUTLIER_PROBABILITY: f64 = 0.01;
/// Middles of exposures beyond this many standard deviations of the scatter are left out (chosen).
const SCATTER_RANGE_SIGMAS: f64 = 4.0;
/// Smallest standard deviation of a latency \[s\] (chosen): half of what the LED's turns may be late by on a small board.
const LATENCY_SIGMA_MIN_S: f64 = 3e-5;

/// Latency of the film that shows `led` against the board's `light`.
pub(super) fn delay(led: &LedSignal, light: &Light, period_s: f64, exposure_s: Option<f64>) -> Delay {
    let [shortest, longest] = match exposure_s {
        Some(stated) => [stated / STATED_EXPOSURE_FACTOR, stated * STATED_EXPOSURE_FACTOR],
        None => [EXPOSURE_SHARE_MIN * period_s, period_s],
    };
    let longest = longest.min(period_s).max(1.01 * shortest);
    let ratio = (longest / shortest).powf(1.0 / (EXPOSURE_STEPS - 1) as f64);
    let reach_s = period_s.max(0.008);
    let exposures: Vec<Exposures> = (0..EXPOSURE_STEPS)
        .map(|k| Exposures::new(led, light, shortest * ratio.powi(k as i32), [reach_s, longest]))
        .collect();

    let wide = weigh(&exposures, led.noise, [led.late_s, reach_s], WIDE_GRID_STEPS);
    let about_s = (FINE_GRID_RANGE_SIGMAS * wide.std_s).max(4.0 * LATENCY_SIGMA_MIN_S).min(reach_s);
    let fine = weigh(&exposures, led.noise, [wide.mean_s, about_s], FINE_GRID_STEPS);
    Delay { std_s: fine.std_s.hypot(LATENCY_SIGMA_MIN_S), ..fine }
}

/// The images in which the LED may have turned, for one exposure time.
struct Exposures {
    exposure_s: f64,
    images: Vec<Image>,
}

/// An image in whose exposure the LED may have turned: no others tell anything.
struct Image {
    time_s: f64,
    brightness: f64,
    /// Middles of the exposure, and the share of it that is lit then; linear between them.
    corners: Vec<[f64; 2]>,
}

impl Exposures {
    /// With what the lateness may be off by, and the longest exposure thought of: the same images for every one.
    fn new(led: &LedSignal, light: &Light, exposure_s: f64, [reach_s, longest_s]: [f64; 2]) -> Self {
        let scatter_s = SCATTER_RANGE_SIGMAS * JITTERS_S.iter().copied().fold(0.0, f64::max);
        let image = |(&time_s, &brightness): (&f64, &f64)| {
            let around = [-1.0, 1.0].map(|side| time_s - led.late_s + side * (2.0 * reach_s + scatter_s));
            let half_s = exposure_s / 2.0;
            let turns: Vec<f64> =
                light.turns_s(around[0] - longest_s / 2.0, around[1] + longest_s / 2.0).collect();
            if turns.is_empty() {
                return None;
            }
            let mut corners: Vec<f64> =
                turns.iter().flat_map(|turn_s| [turn_s - half_s, turn_s + half_s]).collect();
            corners.retain(|middle_s| (around[0]..around[1]).contains(middle_s));
            corners.extend(around);
            corners.sort_by(f64::total_cmp);
            let corners =
                corners.into_iter().map(|middle_s| [middle_s, light.share(middle_s, exposure_s)]).collect();
            Some(Image { time_s, brightness, corners })
        };
        Self { exposure_s, images: led.times_s.iter().zip(&led.brightness).filter_map(image).collect() }
    }

    fn log_likelihood(&self, late_s: f64, jitter_s: f64, noise: f64) -> f64 {
        let image = |image: &Image| {
            // With an outlying stamp, any brightness between dark and lit is equally likely.
            (OUTLIER_PROBABILITY + (1.0 - OUTLIER_PROBABILITY) * image.density(late_s, jitter_s, noise)).ln()
        };
        self.images.iter().map(image).sum()
    }
}

impl Image {
    /// Probability density of its brightness.
    fn density(&self, late_s: f64, jitter_s: f64, noise: f64) -> f64 {
        let mean_s = self.time_s - late_s;
        let reach_s = SCATTER_RANGE_SIGMAS * jitter_s;
        let mut density = 0.0;
        for pair in self.corners.windows(2) {
            let [[from_s, from], [to_s, to]] = [pair[0], pair[1]];
            if to_s < mean_s - reach_s || from_s > mean_s + reach_s || to_s <= from_s {
                continue;
            }
            let slope = (to - from) / (to_s - from_s);
            density += if slope.abs() * jitter_s < 1e-3 * noise {
                // The same all along.
                normal(self.brightness, from, noise) * within([from_s, to_s], mean_s, jitter_s)
            } else {
                // In the middle's own terms a normal likelihood, whose product with the normal scatter is one again.
                let (implied_s, implied_std_s) =
                    (from_s + (self.brightness - from) / slope, noise / slope.abs());
                let sum = jitter_s * jitter_s + implied_std_s * implied_std_s;
                let product_s =
                    (mean_s * implied_std_s * implied_std_s + implied_s * jitter_s * jitter_s) / sum;
                let product_std_s = jitter_s * implied_std_s / sum.sqrt();
                normal(implied_s, mean_s, sum.sqrt()) / slope.abs()
                    * within([from_s, to_s], product_s, product_std_s)
            };
        }
        density
    }
}

/// Density of a normal distribution.
fn normal(x: f64, mean: f64, std: f64) -> f64 {
    let z = (x - mean) / std;
    (-0.5 * z * z).exp() / (std * TAU.sqrt())
}

/// What of a normal distribution lies between two places.
fn within(ends: [f64; 2], mean: f64, std: f64) -> f64 {
    let [from, to] = ends.map(|end| (end - mean) / std * FRAC_1_SQRT_2);
    0.5 * (libm::erf(to) - libm::erf(from))
}

/// Weighs the lateness about and within the two of `grid`, in so many steps.
fn weigh(exposures: &[Exposures], noise: f64, grid: [f64; 2], steps: usize) -> Delay {
    let [about_s, reach_s] = grid;
    let weighed: Vec<[f64; 4]> = (0..=steps)
        .into_par_iter()
        .flat_map_iter(|k| {
            let late_s = about_s + reach_s * (2.0 * k as f64 / steps as f64 - 1.0);
            exposures.iter().flat_map(move |images| {
                JITTERS_S.iter().map(move |&jitter_s| {
                    [late_s, images.exposure_s, jitter_s, images.log_likelihood(late_s, jitter_s, noise)]
                })
            })
        })
        .collect();
    let best = weighed.iter().map(|point| point[3]).fold(f64::NEG_INFINITY, f64::max);
    let mean = |of: &dyn Fn(&[f64; 4]) -> f64| {
        let (sum, all) = weighed.iter().fold((0.0, 0.0), |(sum, all), point| {
            let weight = (point[3] - best).exp();
            (sum + weight * of(point), all + weight)
        });
        sum / all
    };
    let mean_s = mean(&|point| point[0]);
    let std_s = mean(&|point| (point[0] - mean_s).powi(2)).sqrt();
    Delay { mean_s, std_s, exposure_s: mean(&|point| point[1]), jitter_s: mean(&|point| point[2]) }
}
