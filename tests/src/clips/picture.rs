//! A picture: light on shapes, through a lens, onto a noisy sensor.

use image::GrayImage;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::shape::{Px, Shape};

/// Samples of a pixel that an outline crosses.
const SAMPLES_PER_PIXEL: usize = 64;

/// Each sample lies in its own row and its own column of them, so many rows below the one in the column before: upright and level
/// outlines get 64 shares too, and the samples' middle is the pixel's.
const SAMPLE_ROW_STEP: usize = 39;

/// Linear light \[grey levels\], shape (height, width).
#[derive(Debug, Clone)]
pub struct Picture {
    /// Width \[px\].
    pub width: usize,
    /// Height \[px\].
    pub height: usize,
    light: Vec<f64>,
}

impl Picture {
    /// A picture of what `light` says of each place.
    pub fn of(width: usize, height: usize, light: impl Fn(Px) -> f64) -> Self {
        let at = |i: usize| light([(i % width) as f64, (i / width) as f64]);
        Self { width, height, light: (0..width * height).map(at).collect() }
    }

    /// Draws `shapes` as one body: each pixel's light becomes `paint(place, light before)` by the share that they cover.
    pub fn draw(&mut self, shapes: &[Shape], paint: impl Fn(Px, f64) -> f64) {
        let bounds: Vec<[f64; 4]> = shapes.iter().map(Shape::bounds).collect();
        let mut close: Vec<&Shape> = Vec::new();
        for row in 0..self.height {
            for column in 0..self.width {
                let p = [column as f64, row as f64];
                let near = |b: &&[f64; 4]| {
                    p[0] > b[0] - 1.0 && p[1] > b[1] - 1.0 && p[0] < b[2] + 1.0 && p[1] < b[3] + 1.0
                };
                close.clear();
                close.extend(shapes.iter().zip(&bounds).filter(|(_, b)| near(b)).map(|(shape, _)| shape));
                if close.is_empty() {
                    continue;
                }
                let distance = |p: Px| close.iter().map(|s| s.distance(p)).fold(f64::INFINITY, f64::min);
                let middle = distance(p);
                let cover = match middle {
                    d if d > 0.8 => 0.0,
                    d if d < -0.8 => 1.0,
                    _ => {
                        let off = |k: usize| {
                            [k, k * SAMPLE_ROW_STEP % SAMPLES_PER_PIXEL]
                                .map(|k| (k as f64 + 0.5) / SAMPLES_PER_PIXEL as f64 - 0.5)
                        };
                        let inside = (0..SAMPLES_PER_PIXEL)
                            .map(off)
                            .filter(|off| distance([p[0] + off[0], p[1] + off[1]]) < 0.0);
                        inside.count() as f64 / SAMPLES_PER_PIXEL as f64
                    }
                };
                let light = &mut self.light[row * self.width + column];
                *light += cover * (paint(p, *light) - *light);
            }
        }
    }

    /// Multiplies the light of each place.
    pub fn shine(&mut self, factor: impl Fn(Px) -> f64) {
        for (i, light) in self.light.iter_mut().enumerate() {
            *light *= factor([(i % self.width) as f64, (i / self.width) as f64]);
        }
    }

    /// Blurs as a lens does, by a normal distribution of `sigma` \[px\].
    pub fn blur(&mut self, sigma: f64) {
        let reach = (3.5 * sigma).ceil() as isize;
        let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
        let sum: f64 = kernel.iter().sum();
        let (width, height) = (self.width as isize, self.height as isize);
        for (dx, dy) in [(1, 0), (0, 1)] {
            let before = self.light.clone();
            let at = |x: isize, y: isize| {
                before[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize]
            };
            for (i, light) in self.light.iter_mut().enumerate() {
                let (x, y) = (i as isize % width, i as isize / width);
                let share = |(k, weight): (isize, &f64)| weight * at(x + k * dx, y + k * dy);
                *light = (-reach..=reach).zip(&kernel).map(share).sum::<f64>() / sum;
            }
        }
    }

    /// What a sensor makes of it: read noise of `noise` \[grey levels\], and shot noise as strong at half of the range.
    pub fn expose(&self, noise: f64, random: &mut ChaCha8Rng) -> GrayImage {
        let grey = self.light.iter().map(|&light| {
            let normal: f64 = StandardNormal.sample(random);
            let sigma = noise * (0.5 + 0.5 * (light.max(0.0) / 128.0)).sqrt();
            (light + sigma * normal).round().clamp(0.0, 255.0) as u8
        });
        GrayImage::from_raw(self.width as u32, self.height as u32, grey.collect()).unwrap_or_default()
    }
}

/// Evenly between two numbers.
pub fn between(random: &mut ChaCha8Rng, least: f64, most: f64) -> f64 {
    least + (most - least) * random.random::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_edge_has_its_half_level_where_it_is_and_the_area_is_kept() {
        for edge in [20.0, 20.3, 20.77] {
            let mut picture = Picture::of(60, 40, |_| 200.0);
            let bar = Shape::Bar {
                ends: [[edge - 10.0, 20.0], [edge, 20.0]],
                past: [0.0; 2],
                half: 8.0,
                round: 0.0,
            };
            picture.draw(&[bar], |_, _| 50.0);
            let dark: f64 = picture.light.iter().map(|light| (200.0 - light) / 150.0).sum();
            assert!((dark - 160.0).abs() < 1.0, "{dark}");
            picture.blur(0.8);
            let row = &picture.light[20 * 60..21 * 60];
            let cross = (15..30).find(|&x| row[x] < 125.0 && row[x + 1] >= 125.0).unwrap();
            let at = cross as f64 + (125.0 - row[cross]) / (row[cross + 1] - row[cross]);
            assert!((at - edge).abs() < 0.05, "{at} {edge}");
        }
    }
}
