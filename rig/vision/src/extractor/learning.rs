//! What an extractor learns from a sample before it takes images: the empty tank, what is usual, what nobody has said.

use std::path::Path;
use std::sync::Arc;

use image::GrayImage;

use super::tracking::Learnt;
use super::{Extractor, Last, in_parallel};
use crate::background::{Background, Contrast, Still};
use crate::bridges::Bridges;
use crate::config::{Background as Method, Mode, VisionConfig, picture};
use crate::exposure::Exposure;
use crate::figure::chain::OVERHANG;
use crate::gates::Sizes;
use crate::keypoints::{CLEAR_PX, Shape};
use crate::outline::Outline;
use crate::parts::Seen;
use crate::rejection::Rejection;
use crate::silhouettes::Silhouettes;
use crate::{VisionError, ends, static_mask};
use camera::calibration::Plane;
use camera::source::TimedImage;

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

/// Explanations of a sample that differ by less are as good as each other.
const SAME_EVIDENCE: f64 = 0.03;
/// So far around what is still the empty tank was hardly ever seen clear \[px\].
const SHADED_PX: usize = 2;
/// Three roundings are told apart, half of the way from one to the next is no error.
const ROUNDING_STD: f64 = 0.15;

impl Extractor {
    /// Learns background and usual size from `sample` (at most [`LEARN_FROM`] are worth giving). Pictures named by the
    /// config are looked for in `folder`. `silhouettes`: of the whole sequence, where something else than the difference from the
    /// empty tank has found them.
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
        silhouettes: Option<Arc<Silhouettes>>,
    ) -> Result<Self, VisionError> {
        let readable = sample.iter().filter_map(|image| Some((image.grey.as_ref().ok()?, image.time_s)));
        let (images, times_s): (Vec<&GrayImage>, Vec<f64>) = readable.unzip();
        if images.is_empty() {
            return Err(VisionError::NoImages);
        }
        let size = images[0].dimensions();
        let empty = match &config.background {
            Method::Picture(path) => Some(picture("background", folder, path, size)?.grey),
            _ => None,
        };
        let blocked = match &config.static_mask {
            Some(path) => Some(static_mask::read(folder, path, size)?),
            None => None,
        };
        let learn = |still: Still| {
            let background = Background::learn(&images, config, empty.as_ref(), blocked.clone(), still)?;
            let before = Self::before(background, &images, config, outline, &plane);
            Self { silhouettes: silhouettes.clone(), ..before }.usual(&images, &times_s)
        };
        let own = learn(Still::Own);
        let held = own.as_ref().map_or(true, |(extractor, _)| extractor.base.is_some());
        if !(held && Background::depends_on_still(config)) {
            return own.map(|(extractor, _)| extractor);
        }
        // What is still is the mechanism's own where that explains the pictures as well as leaving it out.
        match (own, learn(Still::Foreign)) {
            (Ok((own, explained)), Ok((foreign, better))) => {
                Ok(if explained >= better - SAME_EVIDENCE { own } else { foreign })
            }
            (Ok((own, _)), Err(_)) => Ok(own),
            (Err(_), Ok((foreign, _))) => Ok(foreign),
            (Err(why), Err(_)) => Err(why),
        }
    }

    /// One that has looked at the empty tank alone.
    fn before(
        background: Background,
        images: &[&GrayImage],
        config: &VisionConfig,
        outline: &Outline,
        plane: &Plane,
    ) -> Self {
        let hidden = [
            background.blocked().map(|blocked| blocked.grown(CLEAR_PX as usize)),
            background.still().map(|still| still.grown(SHADED_PX).over(still.width, still.height)),
        ];
        let hidden = hidden.into_iter().flatten().reduce(|mut all, one| {
            all.bits.iter_mut().zip(&one.bits).for_each(|(all, one)| *all |= one);
            all
        });
        Self {
            config: config.clone(),
            base: config.base().or(outline.base_m.map(|base| plane.pixel(plane.view().seen(base)))),
            outline: outline.clone(),
            learned: Vec::new(),
            plane: plane.clone(),
            exposure: Exposure::usual(images),
            bridges: background.still().map(Bridges::over).unwrap_or_default(),
            hidden,
            background,
            film: None,
            usual: None,
            bodies: Default::default(),
            swim: Default::default(),
            length_scatter_px: 0.0,
            masks: None,
            silhouettes: None,
            last: Last::default(),
        }
    }

    /// The same with what is usual in `images`, taken at `times_s`, and how well they are explained: 1 is best.
    fn usual(mut self, images: &[&GrayImage], times_s: &[f64]) -> Result<(Self, f64), VisionError> {
        let timed: Vec<(&GrayImage, f64)> = images.iter().copied().zip(times_s.iter().copied()).collect();
        let seen = in_parallel(&timed, |(image, time_s)| {
            let parts = match self.parts(image, *time_s) {
                Ok(parts) => parts,
                Err(why) => return (None, Err(why)),
            };
            match self.choice(&parts, None) {
                Ok(chosen) => {
                    let (contrast, seen) = parts.seen(chosen);
                    (Some(contrast), Ok(seen))
                }
                Err(why) => (Some(parts.contrast), Err(why)),
            }
        });
        let (contrasts, seen): (Vec<_>, Vec<_>) = seen.into_iter().unzip();
        match self.outline.mode {
            Mode::Centroid => return self.usual_body(&contrasts, &seen).map(|extractor| (extractor, 0.0)),
            Mode::Arms => return self.usual_arms(&contrasts, &seen).map(|extractor| (extractor, 0.0)),
            Mode::Links | Mode::Arc | Mode::Paper => {}
        }
        let found = self.oriented_all(&contrasts, &seen);
        self.last = Last::default();
        let sizes: Vec<Sizes> = found.iter().flatten().map(|one| one.candidate.sizes).collect();
        self.usual = Sizes::usual(&sizes);
        self.length_scatter_px = Sizes::length_scatter_px(&sizes);
        if self.usual.is_none()
            && let Some(why) = found.iter().find_map(|found| found.as_ref().err())
        {
            return Err(VisionError::NoBackground { images: images.len(), what: why.to_string() });
        }
        self.certain_of_it(&contrasts, &seen, &found)?;
        if let Some(learnt) = self.learn_film(&contrasts, &found) {
            let explained = learnt.evidence.explained * (1.0 - learnt.evidence.misfit);
            self.take_film(learnt);
            return Ok((self, explained));
        }
        self.learn_ends(&contrasts, &seen);
        Ok((self, 0.0))
    }

    fn take_film(&mut self, Learnt { film, rounding, .. }: Learnt) {
        if self.outline.mode == Mode::Links && self.outline.overhang_m.is_none() {
            let (value, std) = film.shared(OVERHANG);
            let (value, std) = (value * film.scale_m(), std * film.scale_m());
            self.outline.overhang_m = Some((value, std));
            self.learned.push(Learned { key: "overhang_m", value, std });
        }
        if self.outline.mode == Mode::Links && self.outline.end_rounding.is_none() {
            self.outline.end_rounding = Some(rounding);
            self.learned.push(Learned { key: "end_rounding", value: rounding, std: ROUNDING_STD });
        }
        self.film = Some(Arc::new(film));
    }

    /// Learns what nobody has said of the links' ends.
    fn learn_ends(&mut self, contrasts: &[Option<Contrast>], seen: &[Result<Seen, Rejection>]) {
        let known = self.outline.overhang_m.is_some() && self.outline.end_rounding.is_some();
        if known || self.outline.mode != Mode::Links {
            return;
        }
        let oriented = self.oriented_all(contrasts, seen);
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
