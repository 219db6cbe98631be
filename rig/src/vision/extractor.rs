//! A sequence of images through all stages.
//!
//! Offline and live are one: an [`Extractor`] learns the background and the usual size from a sample of images
//! (of the whole sequence, or the first still ones), then takes images in order, any number at a time.

mod learning;

pub use learning::{LEARN_FROM, Learned};

use std::collections::VecDeque;

use image::GrayImage;
use rayon::prelude::*;

use super::Mask;
use super::background::{Background, Contrast};
use super::centreline::Centreline;
use super::component::{choose, components};
use super::config::{Mode, VisionConfig};
use super::continuity::{Continuity, Marks};
use super::exposure::Exposure;
use super::gates::{Sizes, check_overlap};
use super::keypoints::{CLEAR_PX, Found, Shape, edge_points, place};
use super::outline::Outline;
use super::parts::{Parts, Seen};
use super::record::{ImageRecord, Keypoint, Status};
use super::rejection::Rejection;
use super::spline::{arc_lengths, distance, point_at};
use super::thin::{longest_path, radii, thinned};
use crate::calibration::Plane;
use crate::calibration::Px;
use crate::images::TimedImage;

/// Runs images through the stages, in order.
#[derive(Debug)]
pub struct Extractor {
    config: VisionConfig,
    outline: Outline,
    /// P0, roughly, where somebody says \[px\].
    base: Option<Px>,
    learned: Vec<Learned>,
    plane: Plane,
    exposure: Option<Exposure>,
    background: Background,
    usual: Option<Sizes>,
    /// Sigma of the usual length \[px\].
    length_scatter_px: f64,
    /// The silhouettes of the images to come, where they are given and not looked for.
    masks: Option<VecDeque<Option<Mask>>>,
    last: Last,
}

/// What an image takes from the ones before it.
#[derive(Debug, Default)]
struct Last {
    continuity: Continuity,
    centroid: Option<Px>,
    line: Option<Vec<Px>>,
    gap: usize,
    /// Another object that the border cuts came in sight and has not left it since.
    intruder: bool,
}

/// Points at which two lines are compared.
const COMPARED_POINTS: usize = 25;
/// A silhouette's end this close to static mask or border is not the mechanism's \[px\].
const COVERED_PX: f64 = 3.0;
/// A gap of twice this between two parts of a silhouette is no wider than their blurred edges: they may touch
/// \[px\].
const CONTACT_PX: usize = 2;
/// P0 may be this share of the picture's diagonal away from what is seen of the mechanism.
const BASE_REACH: f64 = 0.08;

/// The silhouette and all that is measured on it without looking at other images.
struct Candidate {
    line: Centreline,
    mask: Mask,
    edge: Vec<Px>,
    sizes: Sizes,
}

/// A candidate of known direction that passed its gates.
struct Oriented {
    candidate: Candidate,
    base_covered: bool,
    doubt: Option<String>,
}

impl Extractor {
    /// The same with the mechanism's silhouettes given, one for each image to come, instead of found: those of the
    /// records of another extraction give that extraction's results again. An image without one is rejected.
    #[must_use]
    pub fn with_masks(self, masks: Vec<Option<Mask>>) -> Self {
        Self { masks: Some(masks.into()), ..self }
    }

    /// Takes the next images of the sequence, in order, and gives one record for each. They are worked on by the threads of the
    /// caller's pool; results do not depend on how many those are.
    pub fn push(&mut self, images: &[TimedImage]) -> Vec<ImageRecord> {
        let marks = in_parallel(images, |image| readable(image).map(Marks::of));
        let own = marks.into_iter().map(|marks| self.last.continuity.take(marks?));
        let sound: Vec<Result<&GrayImage, Rejection>> =
            own.zip(images).map(|(own, image)| own.and_then(|()| readable(image))).collect();
        let parts = in_parallel(&sound, |image| {
            let image = image.as_ref().map_err(Clone::clone)?;
            self.exposure.as_ref().map_or(Ok(()), |usual| Exposure::of(image).check(usual))?;
            self.parts(image)
        });
        let seen = match self.masks.as_mut() {
            Some(masks) => {
                let masks: Vec<Option<Mask>> = parts.iter().map(|_| masks.pop_front().flatten()).collect();
                let given = |(parts, mask): (Result<Parts, Rejection>, Option<Mask>)| {
                    let parts = parts?;
                    match mask {
                        Some(mask) => parts.with(&mask),
                        None => self.choice(&parts, None).and(Err(Rejection::NoMask)),
                    }
                };
                parts.into_iter().zip(masks).map(given).collect()
            }
            None => {
                let follow = |parts: Result<Parts, Rejection>| {
                    let parts = parts?;
                    let chosen = self.choice(&parts, self.last.centroid)?;
                    self.last.centroid = Some(parts.parts[chosen].centroid);
                    Ok(parts.seen(chosen))
                };
                parts.into_iter().map(follow).collect()
            }
        };
        self.measure(images, seen)
    }

    /// The silhouettes' middle lines, base first.
    fn oriented_all(&mut self, seen: &[Result<Seen, Rejection>]) -> Vec<Result<Oriented, Rejection>> {
        let candidates = in_parallel(seen, |seen| match seen {
            Ok(seen) => self.candidate(seen),
            Err(why) => Err(why.clone()),
        });
        candidates
            .into_iter()
            .zip(seen)
            .map(|(candidate, seen)| {
                let oriented = match (candidate, seen) {
                    (Ok(candidate), Ok(seen)) => self.oriented(candidate, seen),
                    (Err(why), _) => Err(why),
                    (Ok(_), Err(why)) => Err(why.clone()),
                };
                match &oriented {
                    Ok(oriented) => {
                        self.last.line = Some(compared(&oriented.candidate.line.points));
                        self.last.gap = 0;
                    }
                    Err(_) => self.last.gap += 1,
                }
                // Its way is followed on, but not given out while it is not certain whose it is.
                let Ok(seen) = seen else { return oriented };
                let area_px = oriented.as_ref().map(|oriented| oriented.candidate.sizes.area_px);
                let undisturbed = self.undisturbed(seen, area_px.unwrap_or(seen.silhouette.area() as f64));
                oriented.and_then(|oriented| undisturbed.map(|()| oriented))
            })
            .collect()
    }

    fn shape<'a>(&self, oriented: &'a Oriented) -> Shape<'a> {
        let Candidate { line, mask, edge, .. } = &oriented.candidate;
        let base = self.base.map(|base| (base, self.config.base_std_px.get()));
        Shape { line, mask, edge, base_covered: oriented.base_covered, base }
    }

    /// Everything behind the silhouette.
    fn measure(&mut self, images: &[TimedImage], seen: Vec<Result<Seen, Rejection>>) -> Vec<ImageRecord> {
        let oriented = self.oriented_all(&seen);
        let found = in_parallel(&oriented, |oriented| match oriented {
            Ok(oriented) => place(&self.outline, &self.config.gates, &self.plane, &self.shape(oriented)),
            Err(why) => Err(why.clone()),
        });
        images
            .iter()
            .zip(found)
            .zip(oriented.into_iter().zip(seen))
            .map(|((image, found), (oriented, seen))| {
                self.record(image, found, oriented.ok(), seen.ok().map(|seen| seen.silhouette))
            })
            .collect()
    }

    /// What an image shows apart from the empty tank.
    fn parts(&self, image: &GrayImage) -> Result<Parts, Rejection> {
        /// Fewer pixels than this are noise even where a small cut object is looked for.
        const SPECK_PX: usize = 2;
        let contrast = self.background.contrast(image)?;
        let parts = components(&contrast.silhouette(), SPECK_PX);
        Ok(Parts { contrast, parts })
    }

    /// Which part is the mechanism.
    fn choice(&self, parts: &Parts, last: Option<Px>) -> Result<usize, Rejection> {
        let least = self.config.min_area_px.get();
        let diagonal = (parts.contrast.width as f64).hypot(parts.contrast.height as f64);
        choose(&parts.parts, least, self.base, BASE_REACH * diagonal, last)
            .ok_or(Rejection::NothingThere { min_area_px: least })
    }

    /// Fills, thins and follows the silhouette.
    fn candidate(&self, seen: &Seen) -> Result<Candidate, Rejection> {
        let mut mask = seen.silhouette.framed(1);
        let limit_px = (self.config.hole_share.get() * mask.area() as f64) as usize;
        let hole_px = mask.fill_holes(limit_px);
        if hole_px > 0 {
            return Err(Rejection::Closed { hole_px, limit_px });
        }
        let hole_px = mask.grown(CONTACT_PX).fill_holes(0);
        if hole_px > limit_px {
            return Err(Rejection::Contact { gap_px: 2 * CONTACT_PX });
        }
        let medial = longest_path(&thinned(&mask));
        let radius = radii(&mask, &medial);
        let line = Centreline::follow(&seen.contrast, medial, &radius, self.config.smoothing.get())?;
        check_overlap(line.drawn(&mask).overlap(&mask), &self.config.gates)?;
        let edge = edge_points(self.outline.mode, &seen.contrast, &mask, self.background.blocked());
        let sizes = Sizes::of(&line, mask.area());
        let line = line.inset(self.config.end_inset(self.outline.mode, self.base.is_some()));
        Ok(Candidate { line, mask, edge, sizes })
    }

    /// Compares the candidate with what is usual and turns its base end to the front.
    fn oriented(&self, candidate: Candidate, seen: &Seen) -> Result<Oriented, Rejection> {
        if let Some(usual) = &self.usual {
            candidate.sizes.check(usual, &self.config.gates)?;
        }
        let Candidate { line, mask, edge, sizes } = candidate;
        let (start, end) = (line.points[0], line.points[line.points.len() - 1]);
        let backwards = match (self.base, &self.last.line) {
            (Some(base), _) => distance(base, end) < distance(base, start),
            (None, Some(last)) => {
                let here = compared(&line.points);
                let apart = |other: &mut dyn Iterator<Item = &Px>| -> f64 {
                    last.iter().zip(other).map(|(a, b)| distance(*a, *b).powi(2)).sum()
                };
                apart(&mut here.iter().rev()) < apart(&mut here.iter())
            }
            (None, None) => end[1] < start[1],
        };
        let line = if backwards { line.reversed() } else { line };
        let base_covered = self.covered(line.points[0], &seen.contrast);
        // What is held at its base and seen whole keeps its length; links say it by their fit.
        if let (Some(usual), Some(_), Mode::Arc, false) =
            (&self.usual, self.base, self.outline.mode, base_covered)
        {
            sizes.check_length(usual, self.length_scatter_px)?;
        }
        let doubt = self.doubt(seen.cut_object_px, sizes.area_px);
        Ok(Oriented { candidate: Candidate { line, mask, edge, sizes }, base_covered, doubt })
    }

    /// Whether the silhouette ends at `px` only because static mask or border end it there.
    fn covered(&self, px: Px, contrast: &Contrast) -> bool {
        let [x, y] = px;
        let (right, bottom) = ((contrast.width - 1) as f64, (contrast.height - 1) as f64);
        let at_border = x.min(y).min(right - x).min(bottom - y) < COVERED_PX;
        let reach = COVERED_PX as isize + CLEAR_PX;
        at_border
            || self.background.blocked().is_some_and(|mask| {
                (-reach..=reach).any(|dy| {
                    (-reach..=reach).any(|dx| mask.at(x.round() as isize + dx, y.round() as isize + dy))
                })
            })
    }

    /// Refuses images in which another object may be the mechanism, or a part of it, as far as the border lets see:
    /// from where it has come in sight until it has left it. Where `base_px` tells the mechanism, none is refused.
    fn undisturbed(&mut self, seen: &Seen, area_px: f64) -> Result<(), Rejection> {
        let gates = &self.config.gates;
        let share = seen.cut_object_px as f64 / area_px;
        let limit = if self.last.intruder { gates.cut_object } else { gates.intruder };
        self.last.intruder = self.base.is_none() && share >= limit.get() && share > 0.0;
        if self.last.intruder { Err(Rejection::Intruder { object_px: seen.cut_object_px }) } else { Ok(()) }
    }

    /// What in this image may mislead although every gate is passed.
    fn doubt(&self, cut_object_px: usize, area_px: f64) -> Option<String> {
        let gates = &self.config.gates;
        if cut_object_px as f64 >= gates.cut_object.get() * area_px && cut_object_px > 0 {
            return Some(format!(
                "another object of {cut_object_px} px is cut by the picture's border: it may be a part of the mechanism"
            ));
        }
        let lost = self.base.is_none() && self.last.gap > gates.longest_gap && self.last.line.is_some();
        lost.then(|| format!("base and tip may have changed places during {} rejected images", self.last.gap))
    }

    fn record(
        &self,
        image: &TimedImage,
        found: Result<Found, Rejection>,
        oriented: Option<Oriented>,
        silhouette: Option<Mask>,
    ) -> ImageRecord {
        let record = |status, reason, keypoints, mask, centreline| ImageRecord {
            name: image.name.clone(),
            time_s: image.time_s,
            status,
            reason,
            keypoints,
            mask,
            centreline,
        };
        match (found, oriented) {
            (Ok(found), Some(Oriented { candidate, doubt, .. })) => {
                let keypoints = found.points.iter().zip(&found.std_px);
                let keypoints =
                    keypoints.map(|(px, std_px)| Keypoint::seen(*px, *std_px, &self.plane)).collect();
                let status = if doubt.is_some() { Status::Doubtful } else { Status::Ok };
                record(
                    status,
                    doubt.unwrap_or_default(),
                    keypoints,
                    Some(candidate.mask),
                    candidate.line.points,
                )
            }
            (Err(why), _) => record(Status::Rejected, why.to_string(), Vec::new(), silhouette, Vec::new()),
            (Ok(_), None) => unreachable!("only an oriented silhouette has keypoints"),
        }
    }
}

/// `work` on every item, in the items' order.
fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    items.par_iter().map(work).collect()
}

fn readable(image: &TimedImage) -> Result<&GrayImage, Rejection> {
    image.grey.as_ref().map_err(|why| Rejection::Unreadable(why.clone()))
}

fn compared(points: &[Px]) -> Vec<Px> {
    let lengths = arc_lengths(points);
    let total = lengths[lengths.len() - 1];
    (0..COMPARED_POINTS)
        .map(|i| point_at(points, &lengths, total * i as f64 / (COMPARED_POINTS - 1) as f64))
        .collect()
}
