//! How much each pixel differs from the empty tank.
//!
//! Three ways to know the empty tank: a picture of it; what each pixel shows while the mechanism is elsewhere
//! (`temporal`: the values near its own bright end, for a dark mechanism); a smooth surface through the
//! picture's background (`flat`: a quadratic, fitted robustly). What never moves and is as dark as the mechanism
//! may be a part of it (its root), or hide it (a motor before the root), or only look like it (a bar behind): [`Still`].
//! Lamps flicker: an image is compared with the empty tank as light as its own.

mod clear;
mod levels;

use ground::statistics::{MEDIAN_TO_SIGMA, TUKEY_SIGMAS, median};
use image::GrayImage;
use nalgebra::{Matrix6, Vector6};

use super::component::components;
use super::config::{Background as Method, Polarity, VisionConfig};
use super::rejection::Rejection;
use super::sample::bilinear;
use super::{Mask, VisionError};
use camera::calibration::Px;
use clear::clear_view;
use levels::{LEAST_CONTRAST, NOISE_REACH, level, noise};

/// The empty tank, learnt.
#[derive(Debug, Clone)]
pub struct Background {
    /// Grey value of the empty tank at each pixel, shape (height, width); `None`: a surface through each image.
    reference: Option<Plane>,
    /// +1 for a dark mechanism, -1 for a bright one.
    sign: f32,
    /// Where the mechanism never is.
    blocked: Option<Mask>,
    /// Where something still is as dark as the mechanism, and not taken for it.
    still: Option<Mask>,
    /// Smallest silhouette that counts \[px\].
    min_area_px: f64,
}

/// What is made of things as dark as the mechanism that never move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Still {
    /// Those that touch what moves are the mechanism's own.
    Own,
    /// None is: they are a part of the tank, and say nothing of what is before or behind them.
    Foreign,
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

/// One side's differences must weigh this many times the other's for `polarity = "auto"`.
const CLEAR_POLARITY: f64 = 2.0;
/// What never moves is the mechanism's when it touches what moves in this share of the images.
const TOUCHING_SHARE: f64 = 0.2;
/// Width of a blurred edge \[px\].
const SKIRT_PX: usize = 3;

impl Background {
    /// Learns the empty tank from `images`, a sample of the sequence; `empty` is the picture of it, if the
    /// config names one, and `blocked` the static mask. `still` counts where images and not a picture of it tell.
    ///
    /// # Errors
    /// [`VisionError::NoBackground`] when neither polarity stands out, [`VisionError::Config`] when `temporal`
    /// meets images of several sizes.
    pub fn learn(
        images: &[&GrayImage],
        config: &VisionConfig,
        empty: Option<&GrayImage>,
        blocked: Option<Mask>,
        still: Still,
    ) -> Result<Self, VisionError> {
        let first = images.first().ok_or(VisionError::NoImages)?;
        let sign = match config.polarity {
            Polarity::Dark => 1.0,
            Polarity::Bright => -1.0,
            Polarity::Auto => polarity(images)?,
        };
        let min_area_px = config.min_area_px.get();
        let mut background = Self { reference: None, sign, blocked, still: None, min_area_px };
        let same_size = images.iter().all(|image| image.dimensions() == first.dimensions());
        let clear = match &config.background {
            Method::Picture(_) => empty.map(Plane::of),
            Method::Flat => None,
            Method::Auto if !same_size => None,
            Method::Temporal if !same_size => {
                return Err(VisionError::Config {
                    what: "background = \"temporal\" needs images of one size; use \"flat\"".into(),
                });
            }
            Method::Temporal | Method::Auto => Some(clear_view(images, sign)),
        };
        let Some(clear) = clear else { return Ok(background) };
        let surface = Plane::through(&clear.image());
        let level = background.level_before(&surface, images);
        let alike = level.map(|level| background.alike(&clear, &surface, level / 2.0));
        background.reference = Some(match (still, &config.background, level, alike) {
            (Still::Own, Method::Auto, Some(level), Some(alike)) => {
                background.mended(images, clear, &surface, &alike, level / 2.0)
            }
            (Still::Foreign, _, _, Some(alike)) => {
                let still = alike.grown(SKIRT_PX).over(alike.width, alike.height);
                let reference = clear.with(&surface, &still);
                background.still = Some(still);
                reference
            }
            _ => clear,
        });
        Ok(background)
    }

    /// Whether [`Still`] makes a difference under `config`.
    pub fn depends_on_still(config: &VisionConfig) -> bool {
        config.background != Method::Flat
    }

    /// The static mask.
    pub fn blocked(&self) -> Option<&Mask> {
        self.blocked.as_ref()
    }

    /// Where something still is as dark as the mechanism, and an edge's width around it: there the mechanism cannot be told from
    /// what else it may be, and a smooth surface stands for the empty tank.
    pub fn still(&self) -> Option<&Mask> {
        self.still.as_ref()
    }

    /// +1 for a dark mechanism, -1 for a bright one.
    pub(super) fn sign(&self) -> f32 {
        self.sign
    }

    /// Grey value of the tank without the mechanism at each pixel, shape (height, width), as `images` show what in it is still.
    pub(super) fn empty_tank(&self, images: &[&GrayImage]) -> Vec<f32> {
        let reference = self.reference.clone().unwrap_or_else(|| Plane::through(images[0]));
        match &self.still {
            Some(still) => reference.with(&clear_view(images, self.sign), still).grey,
            None => reference.grey,
        }
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
        let light = self.reference.as_ref().map_or(1.0, |plane| plane.light_of(image));
        let difference = |(empty, seen): (&f32, &u8)| self.sign * (light * empty - f32::from(*seen));
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

    /// What the mechanism usually differs by from `surface` \[grey levels\].
    fn level_before(&self, surface: &Plane, images: &[&GrayImage]) -> Option<f32> {
        let flat = Self { reference: Some(surface.clone()), ..self.clone() };
        let mut levels: Vec<f32> =
            images.iter().filter_map(|image| Some(flat.contrast(image).ok()?.level)).collect();
        median(&mut levels, f32::total_cmp)
    }

    /// Where `clear` differs from `surface` as the mechanism does, by more than `half` \[grey levels\].
    fn alike(&self, clear: &Plane, surface: &Plane, half: f32) -> Mask {
        let (width, height) = (clear.width, clear.height);
        let mut alike = Mask::empty(0, 0, width, height);
        for (i, bit) in alike.bits.iter_mut().enumerate() {
            let free =
                self.blocked.as_ref().is_none_or(|b| !b.at((i % width) as isize, (i / width) as isize));
            *bit = free && self.sign * (surface.grey[i] - clear.grey[i]) > half;
        }
        alike
    }

    /// `clear` with a smooth surface in place of everything that belongs to the mechanism but never moves: what of `alike` touches
    /// what moves.
    fn mended(
        &self,
        images: &[&GrayImage],
        mut clear: Plane,
        surface: &Plane,
        alike: &Mask,
        half: f32,
    ) -> Plane {
        let (width, height) = (clear.width, clear.height);
        let alike = components(alike, SKIRT_PX * SKIRT_PX);
        if alike.is_empty() {
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
        for part in alike {
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

    /// The same with `other` where `mask`, of the whole picture, is set.
    fn with(mut self, other: &Self, mask: &Mask) -> Self {
        let pixels = self.grey.iter_mut().zip(&other.grey).zip(&mask.bits);
        pixels.filter(|(_, bit)| **bit).for_each(|((grey, other), _)| *grey = *other);
        self
    }

    fn image(&self) -> GrayImage {
        let at = |x: u32, y: u32| self.grey[y as usize * self.width + x as usize];
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            image::Luma([at(x, y).round().clamp(0.0, 255.0) as u8])
        })
    }

    /// How light `image` is beside this: the middle of its pixels' ratios. Most of a picture is background.
    fn light_of(&self, image: &GrayImage) -> f32 {
        /// Every so many-th pixel says enough.
        const STRIDE_PX: usize = 211;
        /// Darker pixels' ratios are those of their noise \[grey levels\].
        const LEAST_GREY: f32 = 8.0;
        /// No lamp flickers by more than this share, either way: what is farther off says something else.
        const MOST_FLICKER: f32 = 0.3;
        let pixels = self.grey.iter().zip(image.as_raw()).step_by(STRIDE_PX);
        let ratio = |(empty, seen): (&f32, &u8)| f32::from(*seen) / empty;
        let mut ratios: Vec<f32> = pixels.filter(|(empty, _)| **empty > LEAST_GREY).map(ratio).collect();
        let light = median(&mut ratios, f32::total_cmp).unwrap_or(1.0);
        if (light - 1.0).abs() < MOST_FLICKER { light } else { 1.0 }
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
