//! The tank as a camera sees it.

use ident::strict::Finite;
use image::GrayImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Tank;
use super::render::{Look, Renderer};
use crate::camera::CameraConfig;
use crate::camera::mock::{Scene, StampTruth};
use crate::clock::MonotonicNs;
use crate::vision::Plane;

/// A camera's view of the tank.
pub struct TankScene {
    tank: Tank,
    renderer: Renderer,
    noise: Noise,
}

impl Scene for TankScene {
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String> {
        let qpos = self.tank.qpos(at).map_err(|error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
            format!("{error}{}", cause.unwrap_or_default())
        })?;
        let mut picture = self.renderer.draw(self.tank.model(), &qpos);
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
        let view = &self.config().view;
        let plane = Plane::square(view.metres_per_pixel.get(), view.origin_px.map(Finite::get));
        let look = Look {
            water: view.water_grey.get(),
            mechanism: view.mechanism_grey.get(),
            blur_px: view.blur_px.get(),
            falloff: view.falloff.get(),
            ..Look::plain(camera.width_px, camera.height_px)
        };
        let noise = Noise::new(view.noise_grey.get(), self.config().seed);
        TankScene { tank: self.clone(), renderer: Renderer::new(plane, look), noise }
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
