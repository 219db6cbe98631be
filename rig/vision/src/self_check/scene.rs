//! A film's own tank, light, sharpness and noise, to draw its mechanism in again.

use ground::statistics::median;
use image::GrayImage;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::Mask;
use crate::background::{Background, Contrast};
use camera::calibration::Px;
use camera::coverage::Coverage;

/// What a camera shows beside the mechanism, and how.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    width: usize,
    height: usize,
    /// The tank without the mechanism, shape (height, width) \[grey levels\].
    empty: Vec<f32>,
    /// Where something still may be before it.
    still: Option<Mask>,
    /// What the mechanism differs by from that \[grey levels\]; negative where it is brighter.
    step: f32,
    /// Noise of twice as many pixels as a picture has \[grey levels\]: each picture takes it from another place on.
    noise: Vec<f32>,
    /// Blur of the lens, 1 sigma \[px\].
    blur_px: f64,
}

/// The steepest slope of an edge is a share of its step \[1/px\]. It tells the blur: that of the lens, a pixel's box, the interpolation
/// and the two pixels between which it was measured add up, by their variances \[px2\].
const MEASURED_BY_PX2: f64 = 1.0 / 12.0 + 1.0 / 6.0 + 1.0 / 3.0;
/// No lens is sharper \[px\].
const LEAST_BLUR_PX: f64 = 0.2;

impl Scene {
    /// Of a sample's `images`, `contrasts` and the slopes of edges in them, each as a share of its step \[1/px\].
    pub(super) fn of(
        background: &Background,
        images: &[&GrayImage],
        contrasts: &[&Contrast],
        mut slopes: Vec<f64>,
    ) -> Option<Self> {
        let (width, height) = (images.first()?.width() as usize, images.first()?.height() as usize);
        let middle = |of: fn(&Contrast) -> f32| {
            median(&mut contrasts.iter().map(|one| of(one)).collect::<Vec<f32>>(), f32::total_cmp)
        };
        let (level, noise) = (middle(|one| one.level)?, middle(|one| one.noise)?);
        let slope = median(&mut slopes, f64::total_cmp)?;
        let seen_px = 1.0 / (std::f64::consts::TAU.sqrt() * slope);
        let blur_px = (seen_px * seen_px - MEASURED_BY_PX2).max(LEAST_BLUR_PX * LEAST_BLUR_PX).sqrt();
        let empty = background.empty_tank(images);
        let still = background.still().cloned();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let noise = (0..2 * width * height).map(|_| -> f32 {
            let normal: f32 = StandardNormal.sample(&mut random);
            noise * normal
        });
        let noise = noise.collect();
        Some(Self { width, height, empty, still, step: background.sign() * level, noise, blur_px })
    }

    /// The picture of convex `polygons` \[px\], with the noise that `seed` draws.
    pub(super) fn draw(&self, polygons: &[Vec<Px>], seed: u64) -> GrayImage {
        let mut grey = self.empty.clone();
        if let Some(cover) = Coverage::of(polygons, self.blur_px, self.width as u32, self.height as u32) {
            let open = |i: usize| self.still.as_ref().is_none_or(|still| !still.bits[i]);
            let pixels = cover.pixels().map(|(x, y, share)| (y * self.width + x, share));
            for (i, share) in pixels.filter(|(i, _)| open(*i)) {
                grey[i] -= share * self.step;
            }
        }
        let from = ChaCha8Rng::seed_from_u64(seed).random_range(0..grey.len().max(1));
        let noise = self.noise.iter().skip(from);
        let mut image = GrayImage::new(self.width as u32, self.height as u32);
        // Truncating after the half is rounding, and below 0 it ends there.
        let exposed = grey.iter().zip(noise).map(|(grey, noise)| (grey + noise + 0.5) as u8);
        image.iter_mut().zip(exposed).for_each(|(pixel, grey)| *pixel = grey);
        image
    }
}
