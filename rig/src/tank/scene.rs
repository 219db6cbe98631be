//! The tank as a camera sees it.

use image::GrayImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Tank;
use crate::camera::CameraConfig;
use crate::camera::mock::{Scene, StampTruth};
use crate::clock::MonotonicNs;

/// Draws the tank's mechanism at given coordinates.
pub type Draw = Box<dyn FnMut(&[f64]) -> GrayImage + Send>;

/// A camera's view of the tank.
pub struct TankScene {
    tank: Tank,
    draw: Draw,
    noise: Noise,
}

impl TankScene {
    /// The view of `tank` that `draw` gives, with the noise of the tank's config.
    pub fn new(tank: Tank, draw: Draw) -> Self {
        let config = tank.config();
        let noise = Noise::new(config.view.noise_grey.get(), config.seed);
        Self { tank, draw, noise }
    }
}

impl Scene for TankScene {
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String> {
        let qpos = self.tank.qpos(at).map_err(|error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
            format!("{error}{}", cause.unwrap_or_default())
        })?;
        let mut picture = (self.draw)(&qpos);
        self.noise.add(&mut picture, at);
        Ok(picture)
    }

    fn run_origin(&self) -> Option<MonotonicNs> {
        self.tank.run_origin()
    }
}

impl Tank {
    /// What a camera set up as `camera` says sees of this tank.
    pub fn scene(&self, camera: &CameraConfig) -> TankScene {
        TankScene::new(self.clone(), silhouette(self, camera))
    }

    /// How a mock camera's stamps depart from the truth in this tank.
    pub fn stamp_truth(&self) -> StampTruth {
        let config = self.config();
        StampTruth {
            latency_s: config.view.stamp_latency_s.get(),
            jitter_s: config.view.stamp_jitter_s.get(),
            seed: config.seed,
        }
    }
}

/// Thickness of the mechanism \[m\] and the grey levels of water and mechanism.
const THICKNESS_M: f64 = 0.010;
const WATER: u8 = 200;
const MECHANISM: u8 = 40;

/// Draws the mechanism dark on bright water, as a line of constant thickness from keypoint to keypoint.
fn silhouette(tank: &Tank, camera: &CameraConfig) -> Draw {
    let model = tank.model().clone();
    let view = tank.config().view.clone();
    let (width, height) = (camera.width_px, camera.height_px);
    Box::new(move |qpos| {
        let poses = model.poses(qpos);
        let [column, row] = view.origin_px.map(|px| px.get());
        let scale = view.metres_per_pixel.get();
        let points: Vec<[f64; 2]> = model
            .keypoint_sites()
            .into_iter()
            .map(|site| poses.site_pos[site].0)
            .map(|[x, _, z]| [column + x / scale, row - z / scale])
            .collect();
        let radius = THICKNESS_M / 2.0 / scale;
        let distance = |at: [f64; 2]| {
            points.windows(2).map(|ends| distance(at, ends[0], ends[1])).fold(f64::INFINITY, f64::min)
        };
        GrayImage::from_fn(width, height, |x, y| {
            let inside = (radius - distance([x.into(), y.into()]) + 0.5).clamp(0.0, 1.0);
            let grey = f64::from(WATER) + inside * (f64::from(MECHANISM) - f64::from(WATER));
            image::Luma([grey.round() as u8])
        })
    })
}

/// Distance of `at` from the line from `a` to `b`.
fn distance(at: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let to = [at[0] - a[0], at[1] - a[1]];
    let length2 = along[0].powi(2) + along[1].powi(2);
    let share = ((to[0] * along[0] + to[1] * along[1]) / length2.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (to[0] - share * along[0]).hypot(to[1] - share * along[1])
}

/// Length of the table that noise is taken from: a prime, so that rows of no picture line up with it.
const TABLE: usize = 1_048_573;

/// A sensor's noise: normal, independent from pixel to pixel. Drawn once into a table that each image enters at a place of
/// its own, since drawing 300 000 numbers for each image would take longer than the image's period.
struct Noise {
    table: Vec<i8>,
    seed: u64,
}

impl Noise {
    fn new(std_grey: f64, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut grey = || -> f64 { StandardNormal.sample(&mut random) };
        let table = if std_grey > 0.0 {
            (0..TABLE).map(|_| (grey() * std_grey).round() as i8).collect()
        } else {
            Vec::new()
        };
        Self { table, seed }
    }

    fn add(&self, picture: &mut GrayImage, at: MonotonicNs) {
        if self.table.is_empty() {
            return;
        }
        let enter = ChaCha8Rng::seed_from_u64(self.seed ^ at.0).random_range(0..TABLE);
        let noise = self.table[enter..].iter().chain(self.table.iter().cycle());
        for (pixel, &noise) in picture.iter_mut().zip(noise) {
            *pixel = pixel.saturating_add_signed(noise);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_stated_spread_and_differs_from_image_to_image() {
        let noise = Noise::new(3.0, 7);
        let picture = |at| {
            let mut picture = GrayImage::from_pixel(640, 480, image::Luma([100]));
            noise.add(&mut picture, MonotonicNs(at));
            picture
        };
        let first = picture(1);
        assert_eq!(first, picture(1));
        assert_ne!(first, picture(2));
        let count = 640.0 * 480.0;
        let deviations: Vec<f64> = first.iter().map(|&grey| f64::from(grey) - 100.0).collect();
        let mean = deviations.iter().sum::<f64>() / count;
        let variance = deviations.iter().map(|d| d * d).sum::<f64>() / count;
        // Rounding to whole levels adds a twelfth. Over 307 200 pixels the mean is good to 0.0055, the variance to
        // 0.023; five of each.
        assert!(mean.abs() < 0.03 && (variance - 9.083).abs() < 0.12, "{mean} {variance}");
    }

    #[test]
    fn no_noise_leaves_the_picture_alone() {
        let mut picture = GrayImage::from_pixel(4, 4, image::Luma([9]));
        Noise::new(0.0, 1).add(&mut picture, MonotonicNs(1));
        assert!(picture.iter().all(|&grey| grey == 9));
    }
}
