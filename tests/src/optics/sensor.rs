//! The sensor: lens blur, drift, noise, gamma, chroma of half the resolution, and JPEG.

use crate::optics::picture::Picture;
use crate::optics::vec::v3;
use image::codecs::jpeg::JpegEncoder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// What is drawn about a sensor.
#[derive(Clone, Debug)]
pub(crate) struct Sensor {
    pub(crate) blur_px: f64,
    /// Variance of shot noise at full scale, and standard deviation of read noise, in linear full scales.
    pub(crate) shot_variance: f64,
    pub(crate) read_std: f64,
    /// Slow drifts, as shares: of exposure, and of red against blue.
    pub(crate) exposure_drift: f64,
    pub(crate) white_drift: f64,
    pub(crate) drift_hz: f64,
    pub(crate) jpeg_quality: u8,
}

impl Sensor {
    pub(crate) fn drawn(rng: &mut ChaCha8Rng) -> Sensor {
        Sensor {
            blur_px: rng.random_range(0.5..0.75),
            shot_variance: rng.random_range(0.0002..0.0008),
            read_std: rng.random_range(0.0008..0.002),
            exposure_drift: rng.random_range(0.004..0.015),
            white_drift: rng.random_range(0.004..0.015),
            drift_hz: rng.random_range(0.15..0.5),
            jpeg_quality: rng.random_range(85..=92),
        }
    }

    /// What the sensor makes of the light: 8-bit RGB.
    pub(crate) fn develop(&self, light: &Picture, t_s: f64, key: u64) -> Vec<u8> {
        let blurred = light.blurred(self.blur_px);
        let gain = 1.0 + self.exposure_drift * (TAU * self.drift_hz * t_s + 0.4).sin();
        let white = self.white_drift * (TAU * self.drift_hz * 0.7 * t_s + 1.1).sin();
        let gains = v3(gain * (1.0 + white), gain, gain * (1.0 - white));
        let mut rng = ChaCha8Rng::seed_from_u64(key);
        let mut rgb = Vec::with_capacity(blurred.light.len() * 3);
        for p in &blurred.light {
            let p = v3(p[0] as f64, p[1] as f64, p[2] as f64).times(gains);
            for c in [p.x, p.y, p.z] {
                let n: f64 = StandardNormal.sample(&mut rng);
                let std = (self.shot_variance * c.max(0.0) + self.read_std * self.read_std).sqrt();
                let v = (c + n * std).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0;
                rgb.push(v as f32);
            }
        }
        halve_chroma(&rgb, light.width_px, light.height_px)
    }

    /// The file of an image.
    pub(crate) fn jpeg(&self, rgb: &[u8], width_px: usize, height_px: usize) -> Result<Vec<u8>, String> {
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, self.jpeg_quality)
            .encode(rgb, width_px as u32, height_px as u32, image::ExtendedColorType::Rgb8)
            .map_err(|e| format!("cannot encode an image: {e}"))?;
        Ok(file)
    }
}

/// Gives each block of 2 x 2 pixels its mean chroma.
fn halve_chroma(rgb: &[f32], width_px: usize, height_px: usize) -> Vec<u8> {
    let mut out = vec![0u8; rgb.len()];
    let luma = |p: &[f32]| 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2];
    for r in (0..height_px).step_by(2) {
        for c in (0..width_px).step_by(2) {
            let block = [(r, c), (r, c + 1), (r + 1, c), (r + 1, c + 1)]
                .map(|(r, c)| (r.min(height_px - 1) * width_px + c.min(width_px - 1)) * 3);
            let (mut blue, mut red) = (0.0, 0.0);
            for i in block {
                let p = &rgb[i..i + 3];
                blue += 0.25 * 0.564 * (p[2] - luma(p));
                red += 0.25 * 0.713 * (p[0] - luma(p));
            }
            for i in block {
                let y = luma(&rgb[i..i + 3]);
                let v = [y + 1.402 * red, y - 0.344 * blue - 0.714 * red, y + 1.772 * blue];
                for k in 0..3 {
                    out[i + k] = v[k].round().clamp(0.0, 255.0) as u8;
                }
            }
        }
    }
    out
}
