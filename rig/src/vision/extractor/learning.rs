//! What an extractor learns from a sample before it takes images: the empty tank, what is usual, what nobody has said.

use std::path::Path;

use image::GrayImage;

use super::{Extractor, Last, in_parallel};
use crate::calibration::Plane;
use crate::images::TimedImage;
use crate::vision::background::Background;
use crate::vision::config::{Background as Method, Mode, VisionConfig, picture};
use crate::vision::exposure::Exposure;
use crate::vision::gates::Sizes;
use crate::vision::keypoints::Shape;
use crate::vision::outline::Outline;
use crate::vision::{VisionError, ends, static_mask};

/// A sample for [`Extractor::learn`] needs no more images than this.
pub const LEARN_FROM: usize = 41;
/// A number of the mechanism's shape that the images told.
#[derive(Debug, Clone, PartialEq)]
pub struct Learned {
    /// The `[vision]` key that would say it.
    pub key: &'static str,
    /// Its value, in the key's unit.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// Three roundings are told apart, half of the way from one to the next is no error.
const ROUNDING_STD: f64 = 0.15;

impl Extractor {
    /// Learns background and usual size from `sample` (at most [`LEARN_FROM`] are worth giving). Pictures named by the
    /// config are looked for in `folder`.
    ///
    /// # Errors
    /// [`VisionError`]: a config that contradicts itself, an unreadable picture, no readable image, or none with
    /// a silhouette.
    pub fn learn(
        sample: &[TimedImage],
        config: &VisionConfig,
        outline: &Outline,
        plane: Plane,
        folder: &Path,
    ) -> Result<Self, VisionError> {
        let images: Vec<&GrayImage> = sample.iter().filter_map(|image| image.grey.as_ref().ok()).collect();
        if images.is_empty() {
            return Err(VisionError::NoImages);
        }
        let size = images[0].dimensions();
        let empty = match &config.background {
            Method::Picture(path) => Some(picture("background", folder, path, size)?),
            _ => None,
        };
        let blocked = match &config.static_mask {
            Some(path) => Some(static_mask::read(folder, path, size)?),
            None => None,
        };
        let background = Background::learn(&images, config, empty.as_ref(), blocked)?;
        let mut extractor = Self {
            config: config.clone(),
            base: config.base().or(outline.base_m.map(|base| plane.pixel(base))),
            outline: outline.clone(),
            learned: Vec::new(),
            plane,
            exposure: Exposure::usual(&images),
            background,
            usual: None,
            length_scatter_px: 0.0,
            masks: None,
            last: Last::default(),
        };
        let found = in_parallel(&images, |image| {
            let parts = extractor.parts(image)?;
            let chosen = extractor.choice(&parts, None)?;
            extractor.candidate(&parts.seen(chosen)).map(|candidate| candidate.sizes)
        });
        let sizes: Vec<Sizes> = found.iter().filter_map(|sizes| sizes.as_ref().ok().copied()).collect();
        extractor.usual = Sizes::usual(&sizes);
        extractor.length_scatter_px = Sizes::length_scatter_px(&sizes);
        match (extractor.usual, found.into_iter().find_map(Result::err)) {
            (None, Some(why)) => {
                Err(VisionError::NoBackground { images: images.len(), what: why.to_string() })
            }
            _ => {
                extractor.learn_ends(&images);
                Ok(extractor)
            }
        }
    }

    /// Learns from `images` what nobody has said of the links' ends.
    fn learn_ends(&mut self, images: &[&GrayImage]) {
        let known = self.outline.overhang_m.is_some() && self.outline.end_rounding.is_some();
        if known || self.outline.mode != Mode::Links {
            return;
        }
        let seen = in_parallel(images, |image| {
            let parts = self.parts(image)?;
            let chosen = self.choice(&parts, None)?;
            Ok(parts.seen(chosen))
        });
        let oriented = self.oriented_all(&seen);
        self.last = Last::default();
        let shapes: Vec<Shape<'_>> = oriented.iter().flatten().map(|oriented| self.shape(oriented)).collect();
        let Some(ends) = ends::learn(&self.outline, &self.plane, &shapes) else { return };
        if self.outline.overhang_m.is_none() {
            let (value, std) = ends.overhang_m;
            self.outline.overhang_m = Some((value, std));
            self.learned.push(Learned { key: "overhang_m", value, std });
        }
        if self.outline.end_rounding.is_none() {
            self.outline.end_rounding = Some(ends.rounding);
            self.learned.push(Learned { key: "end_rounding", value: ends.rounding, std: ROUNDING_STD });
        }
    }

    /// What nobody had said of the mechanism's shape and the sample told.
    pub fn learned(&self) -> &[Learned] {
        &self.learned
    }
}
