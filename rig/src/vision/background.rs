//! How much each pixel differs from the empty tank.
//!
//! Three ways to know the empty tank: a picture of it; what each pixel shows while the mechanism is elsewhere
//! (`temporal`: the values near its own bright end, for a dark mechanism); a smooth surface through the
//! picture's background (`flat`: a quadratic, fitted robustly). `auto` takes the temporal one and mends it
//! with the flat one wherever the mechanism never moves away: there the temporal one shows the mechanism
//! itself, which is told from scenery by its touching what moves.

use ident::statistics::{MEDIAN_TO_SIGMA, TUKEY_SIGMAS, median};
use image::GrayImage;
use nalgebra::{Matrix6, Vector6};

use super::component::components;
use super::config::{Background as Method, Polarity, VisionConfig};
use super::rejection::Rejection;
use super::sample::bilinear;
use super::{Mask, VisionError};
use crate::calibration::Px;

/// The empty tank, learnt.
#[derive(Debug, Clone)]
pub struct Background {
    /// Grey value of the empty tank at each pixel, shape (height, width); `None`: a surface through each image.
    reference: Option<Plane>,
    /// +1 for a dark mechanism, -1 for a bright one.
    sign: f32,
    /// Where the mechanism never is.
    blocked: Option<Mask>,
    /// Smallest silhouette that counts \[px\].
    min_area_px: f64,
}

#[derive(Debug, Clone)]
struct Plane {
    width: usize,
    height: usize,
    grey: Vec<f32>,
}

/// An image's difference from the empty tank: above zero where the mechanism is.
#[derive(Debug, Clone)]
pub struct Contrast {
    /// Image width \[px\].
    pub width: usize,
    /// Image height \[px\].
    pub height: usize,
    /// Differences in grey levels, shape (height, width); 0 under the static mask.
    pub values: Vec<f32>,
    /// What the mechanism differs by, typically \[grey levels\]; its edge is where half of it is reached.
    pub level: f32,
    /// Noise of one pixel, 1 sigma \[grey levels\].
    pub noise: f32,
}

/// Multiple of the noise that no background pixel reaches.
const NOISE_REACH: f32 = 4.0;
/// Contrast below which nothing is told apart even without noise \[grey levels\]: compression leaves as much.
const LEAST_CONTRAST: f32 = 6.0;
/// Largest share of an image that a mechanism may cover.
const MOST_COVER: f64 = 0.5;
/// One side's differences must weigh this many times the other's for `polarity = "auto"`.
const CLEAR_POLARITY: f64 = 2.0;
/// A pixel's clear view is looked for near this share of its sorted values: mirrors and bubbles lie above.
const CLEAR_SHARE: f64 = 0.9;
/// Values this many sigmas below that share are still the clear view.
const CLEAR_REACH: f32 = 6.0;
/// What never moves is the mechanism's when it touches what moves in this share of the images.
const TOUCHING_SHARE: f64 = 0.2;
/// Width of a blurred edge \[px\].
const SKIRT_PX: usize = 3;

impl Background {
    /// Learns the empty tank from `images`, a sample of the sequence; `empty` is the picture of it, if the
    /// config names one, and `blocked` the static mask.
    ///
    /// # Errors
    /// [`VisionError::NoBackground`] when neither polarity stands out, [`VisionError::Config`] when `temporal`
    /// meets images of several sizes.
    pub fn learn(
        images: &[&GrayImage],
        config: &VisionConfig,
        empty: Option<&GrayImage>,
        blocked: Option<Mask>,
    ) -> Result<Self, VisionError> {
        let first = images.first().ok_or(VisionError::NoImages)?;
        let sign = match config.polarity {
            Polarity::Dark => 1.0,
            Polarity::Bright => -1.0,
            Polarity::Auto => polarity(images)?,
        };
        let min_area_px = config.min_area_px.get();
        let mut background = Self { reference: None, sign, blocked, min_area_px };
        let same_size = images.iter().all(|image| image.dimensions() == first.dimensions());
        background.reference = match &config.background {
            Method::Picture(_) => empty.map(Plane::of),
            Method::Flat => None,
            Method::Auto if !same_size => None,
            Method::Temporal if !same_size => {
                return Err(VisionError::Config {
                    what: "background = \"temporal\" needs images of one size; use \"flat\"".into(),
                });
            }
            Method::Temporal => Some(clear_view(images, sign)),
            Method::Auto => Some(background.mended(images, clear_view(images, sign))),
        };
        Ok(background)
    }

    /// The static mask.
    pub fn blocked(&self) -> Option<&Mask> {
        self.blocked.as_ref()
    }

    /// What `image` shows beside the empty tank.
    ///
    /// # Errors
    /// [`Rejection::NoContrast`] when nothing of the wanted size stands out of the noise, or too much does.
    pub fn contrast(&self, image: &GrayImage) -> Result<Contrast, Rejection> {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let noise = noise(image);
        let surface;
        let reference = match &self.reference {
            Some(plane) if (plane.width, plane.height) == (width, height) => plane,
            Some(plane) => {
                return Err(Rejection::Size { wanted: [plane.width, plane.height], got: [width, height] });
            }
            None => {
                surface = Plane::through(image);
                &surface
            }
        };
        let difference = |(empty, seen): (&f32, &u8)| self.sign * (empty - f32::from(*seen));
        let mut values: Vec<f32> = reference.grey.iter().zip(image.as_raw()).map(difference).collect();
        if let Some(blocked) = &self.blocked {
            for (y, values) in values.chunks_exact_mut(width.max(1)).enumerate() {
                let right = values.iter_mut().skip(blocked.left);
                right.zip(blocked.row(y)).filter(|(_, bit)| **bit).for_each(|(value, _)| *value = 0.0);
            }
        }
        let level = level(&values, noise, self.min_area_px)?;
        Ok(Contrast { width, height, values, level, noise })
    }

    /// `clear` with a smooth surface in place of everything that belongs to the mechanism but never moves.
    fn mended(&self, images: &[&GrayImage], mut clear: Plane) -> Plane {
        let (width, height) = (clear.width, clear.height);
        let surface = Plane::through(&clear.image());
        let flat = Self { reference: Some(surface.clone()), ..self.clone() };
        let mut levels: Vec<f32> =
            images.iter().filter_map(|image| Some(flat.contrast(image).ok()?.level)).collect();
        let Some(level) = median(&mut levels, f32::total_cmp) else { return clear };
        let half = level / 2.0;
        let mut still = Mask::empty(0, 0, width, height);
        for (i, bit) in still.bits.iter_mut().enumerate() {
            let free =
                self.blocked.as_ref().is_none_or(|b| !b.at((i % width) as isize, (i / width) as isize));
            *bit = free && self.sign * (surface.grey[i] - clear.grey[i]) > half;
        }
        let still = components(&still, SKIRT_PX * SKIRT_PX);
        if still.is_empty() {
            return clear;
        }
        let moving: Vec<Vec<bool>> = images
            .iter()
            .map(|image| {
                let moved = |(empty, seen): (&f32, &u8)| self.sign * (empty - f32::from(*seen)) > half;
                clear.grey.iter().zip(image.as_raw()).map(moved).collect::<Vec<bool>>()
            })
            .filter(|moving| moving.iter().filter(|&&m| m).count() as f64 > self.min_area_px / 4.0)
            .collect();
        for part in still {
            let wide = part.mask.grown(SKIRT_PX);
            let wide = || wide.pixels().filter(|&(x, y)| x < width && y < height);
            let touches =
                |moving: &&Vec<bool>| wide().filter(|&(x, y)| moving[y * width + x]).count() >= SKIRT_PX;
            let touching = moving.iter().filter(touches).count();
            if touching as f64 >= TOUCHING_SHARE * moving.len() as f64 {
                for (x, y) in wide() {
                    clear.grey[y * width + x] = surface.grey[y * width + x];
                }
            }
        }
        clear
    }
}

impl Contrast {
    /// Where half the mechanism's contrast is passed, as a mask of the whole image.
    pub fn silhouette(&self) -> Mask {
        let mut mask = Mask::empty(0, 0, self.width, self.height);
        let half = self.level / 2.0;
        for (bit, value) in mask.bits.iter_mut().zip(&self.values) {
            *bit = *value > half;
        }
        mask
    }

    /// The difference at `px`, bilinear; 0 outside the image.
    #[inline]
    pub fn at(&self, px: Px) -> f64 {
        bilinear(&self.values, self.width, self.height, px)
    }

    /// The difference of the pixel that `px` lies in; 0 outside the image.
    #[inline]
    pub fn nearest(&self, [x, y]: Px) -> f32 {
        if !(x >= 0.0 && y >= 0.0) {
            return 0.0;
        }
        let (column, row) = ((x + 0.5) as i32 as usize, (y + 0.5) as i32 as usize);
        if column < self.width && row < self.height { self.values[row * self.width + column] } else { 0.0 }
    }
}

impl Plane {
    fn of(image: &GrayImage) -> Self {
        let grey = image.as_raw().iter().map(|&v| f32::from(v)).collect();
        Self { width: image.width() as usize, height: image.height() as usize, grey }
    }

    fn image(&self) -> GrayImage {
        let at = |x: u32, y: u32| self.grey[y as usize * self.width + x as usize];
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            image::Luma([at(x, y).round().clamp(0.0, 255.0) as u8])
        })
    }

    /// The quadratic surface through most of `image`: Tukey's biweight, reweighted from the median outward, so
    /// that a mechanism that covers up to a third of the picture does not bend it.
    fn through(image: &GrayImage) -> Self {
        const SURFACE_SAMPLES: usize = 4000;
        const ROUNDS: usize = 8;
        /// Quantisation: a perfectly even background still has this residual [grey levels].
        const LEAST_SCALE: f64 = 0.5;
        let (width, height) = (image.width() as usize, image.height() as usize);
        let terms = |x: f64, y: f64| {
            let (u, v) = (2.0 * x / width as f64 - 1.0, 2.0 * y / height as f64 - 1.0);
            Vector6::new(1.0, u, v, u * u, u * v, v * v)
        };
        let stride = ((width * height) as f64 / SURFACE_SAMPLES as f64).sqrt().ceil().max(1.0) as usize;
        let mut samples = Vec::new();
        for y in (stride / 2..height).step_by(stride) {
            for x in (stride / 2..width).step_by(stride) {
                samples.push((terms(x as f64, y as f64), f64::from(image.as_raw()[y * width + x])));
            }
        }
        let middle = |values: &mut Vec<f64>| median(values, f64::total_cmp).unwrap_or(0.0);
        let mut values: Vec<f64> = samples.iter().map(|s| s.1).collect();
        let mut surface = Vector6::new(middle(&mut values), 0.0, 0.0, 0.0, 0.0, 0.0);
        for _ in 0..ROUNDS {
            let mut sizes: Vec<f64> = samples.iter().map(|(t, v)| (v - t.dot(&surface)).abs()).collect();
            let reach = TUKEY_SIGMAS * (MEDIAN_TO_SIGMA * middle(&mut sizes)).max(LEAST_SCALE);
            let (mut normal, mut right) = (Matrix6::identity() * 1e-9, Vector6::zeros());
            for (t, value) in &samples {
                let off = (value - t.dot(&surface)) / reach;
                if off.abs() < 1.0 {
                    let weight = (1.0 - off * off).powi(2);
                    normal += weight * t * t.transpose();
                    right += weight * value * t;
                }
            }
            match normal.cholesky() {
                Some(factor) => surface = factor.solve(&right),
                None => break,
            }
        }
        let grey = (0..width * height)
            .map(|i| terms((i % width) as f64, (i / width) as f64).dot(&surface) as f32)
            .collect();
        Self { width, height, grey }
    }
}

/// What each pixel shows while nothing dark (`sign` > 0) or bright covers it: the median of its values within
/// reach of its own clear end.
fn clear_view(images: &[&GrayImage], sign: f32) -> Plane {
    let mut noises: Vec<f32> = images.iter().map(|image| noise(image)).collect();
    let reach = CLEAR_REACH * median(&mut noises, f32::total_cmp).unwrap_or(0.0);
    let mut plane = Plane::of(images[0]);
    let mut values = vec![0u8; images.len()];
    for (i, grey) in plane.grey.iter_mut().enumerate() {
        for (value, image) in values.iter_mut().zip(images) {
            *value = image.as_raw()[i];
        }
        values.sort_unstable();
        if sign < 0.0 {
            values.reverse();
        }
        let clear = f32::from(values[((values.len() - 1) as f64 * CLEAR_SHARE).round() as usize]);
        let first = values.partition_point(|&v| sign * (clear - f32::from(v)) > reach);
        let seen = &values[first..];
        *grey = (f32::from(seen[(seen.len() - 1) / 2]) + f32::from(seen[seen.len() / 2])) / 2.0;
    }
    plane
}

/// +1 when what stands out of the background is dark, -1 when it is bright.
fn polarity(images: &[&GrayImage]) -> Result<f32, VisionError> {
    let (mut dark, mut bright) = (0.0, 0.0);
    for image in images {
        let surface = Plane::through(image);
        let reach = (NOISE_REACH * noise(image)).max(LEAST_CONTRAST);
        for (empty, seen) in surface.grey.iter().zip(image.as_raw()) {
            let difference = empty - f32::from(*seen);
            if difference > reach {
                dark += f64::from(difference);
            } else if difference < -reach {
                bright -= f64::from(difference);
            }
        }
    }
    let no_background = |what: String| Err(VisionError::NoBackground { images: images.len(), what });
    if dark > CLEAR_POLARITY * bright {
        Ok(1.0)
    } else if bright > CLEAR_POLARITY * dark {
        Ok(-1.0)
    } else if dark + bright == 0.0 {
        no_background("nothing stands out of the noise".into())
    } else {
        no_background(format!(
            "dark and bright parts weigh {dark:.0} to {bright:.0}; set [vision] polarity to \"dark\" or \"bright\""
        ))
    }
}

/// What the mechanism differs by: the median of what exceeds half of itself, found by iteration.
fn level(values: &[f32], noise: f32, min_area_px: f64) -> Result<f32, Rejection> {
    const ROUNDS: usize = 12;
    let least = (NOISE_REACH * noise).max(LEAST_CONTRAST);
    let mut histogram = [0usize; 256];
    for block in values.chunks(64) {
        // Most of a picture is background: it is passed over a block at a time.
        if block.iter().fold(false, |any, &v| any | (v > least)) {
            block.iter().filter(|&&v| v > least).for_each(|&v| histogram[v as usize & 255] += 1);
        }
    }
    let mut threshold = least;
    for _ in 0..ROUNDS {
        let from = threshold as usize;
        let count: usize = histogram[from..].iter().sum();
        if (count as f64) < min_area_px {
            return Err(Rejection::NoContrast { least, area_px: count });
        }
        if count as f64 > MOST_COVER * values.len() as f64 {
            return Err(Rejection::NoContrast { least: threshold, area_px: count });
        }
        let mut passed = 0;
        let middle = (from..256).find(|&v| {
            passed += histogram[v];
            2 * passed >= count
        });
        let next = (middle.unwrap_or(255) as f32 / 2.0).max(least);
        if (next - threshold).abs() < 0.5 {
            break;
        }
        threshold = next;
    }
    Ok(2.0 * threshold)
}

/// Noise of one pixel \[grey levels\], from the differences of neighbours; at least that of quantisation.
fn noise(image: &GrayImage) -> f32 {
    /// The root undoes the sum of two noises.
    const DIFFERENCE_TO_SIGMA: f32 = MEDIAN_TO_SIGMA as f32 / std::f32::consts::SQRT_2;
    const QUANTISATION_GREY: f32 = 0.3;
    /// Most cameras' noise is below this.
    const USUAL_NOISE_GREY: usize = 15;
    let total = (image.width() as usize).saturating_sub(1) * image.height() as usize;
    // The median by halving its range: counting what is below a limit is quicker than a histogram. `below`
    // and `up_to` are how many differ by less than `least`, and by no more than `most`.
    let (mut least, mut below) = (0, 0);
    let (mut most, mut up_to) = (USUAL_NOISE_GREY, smaller_steps(image, USUAL_NOISE_GREY + 1));
    if 2 * up_to < total.max(1) {
        (least, below, most, up_to) = (USUAL_NOISE_GREY + 1, up_to, 255, total);
    }
    while least < most {
        let middle = (least + most) / 2;
        let count = smaller_steps(image, middle + 1);
        if 2 * count >= total.max(1) {
            (most, up_to) = (middle, count);
        } else {
            (least, below) = (middle + 1, count);
        }
    }
    // Sizes are rounded: the median lies inside this one, in proportion.
    let inside = (total as f32 / 2.0 - below as f32) / (up_to - below).max(1) as f32;
    ((least as f32 - 0.5 + inside).max(0.0) * DIFFERENCE_TO_SIGMA).max(QUANTISATION_GREY)
}

/// How many neighbours in a row differ by less than `limit` grey levels.
fn smaller_steps(image: &GrayImage, limit: usize) -> usize {
    /// No more than a byte can count, in whole registers.
    const BLOCK_PX: usize = 240;
    let Some(most) = limit.checked_sub(1) else { return 0 };
    let most = most.min(255) as u8;
    let mut count = 0;
    for row in image.as_raw().chunks_exact(image.width().max(1) as usize) {
        for (left, right) in row.chunks(BLOCK_PX).zip(row[1..].chunks(BLOCK_PX)) {
            let small = left
                .iter()
                .zip(right)
                .map(|(a, b)| u8::from((*a).max(*b).wrapping_sub((*a).min(*b)) <= most));
            count += usize::from(small.fold(0u8, u8::wrapping_add));
        }
    }
    count
}
