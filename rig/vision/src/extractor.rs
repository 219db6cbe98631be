//! A sequence of images through all stages.
//!
//! Offline and live are one: an [`Extractor`] learns the background and the usual size from a sample of images
//! (of the whole sequence, or the first still ones), then takes images in order, any number at a time.

mod free;
mod identity;
mod learning;
mod redrawn;
mod tracking;

pub(crate) use identity::MAX_BASE_SIGMAS;
pub use learning::{LEARN_FROM, Learned};
use tracking::{Placed, Track};

use std::collections::VecDeque;
use std::sync::Arc;

use image::GrayImage;
use rayon::prelude::*;

use super::Mask;
use super::arms::Swim;
use super::background::{Background, Contrast};
use super::body::Bodies;
use super::bridges::Bridges;
use super::centreline::Centreline;
use super::component::{choose, components};
use super::config::{Mode, VisionConfig};
use super::continuity::{Continuity, Marks};
use super::exposure::Exposure;
use super::figure::film::Film;
use super::figure::fit::Fitted;
use super::gates::{Sizes, check_overlap};
use super::keypoints::{CLEAR_PX, Shape, edge_points, place};
use super::outline::Outline;
use super::parts::{Parts, Seen};
use super::record::{ImageRecord, Keypoint, Status};
use super::rejection::Rejection;
use super::silhouettes::Silhouettes;
use super::spline::{arc_lengths, distance, point_at};
use super::thin::{longest_path, radii, thinned};
use camera::calibration::Plane;
use camera::calibration::Px;
use camera::source::TimedImage;

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
    bridges: Bridges,
    /// Where nothing of the mechanism's outline can be seen, an edge's width around included.
    hidden: Option<Mask>,
    /// What the images share of a mechanism whose base is known.
    film: Option<Arc<Film>>,
    usual: Option<Sizes>,
    /// Mode `centroid`: what is usual of the body, and its headings.
    bodies: Bodies,
    /// Mode `arms`: where they were last.
    swim: Swim,
    /// Sigma of the usual length \[px\].
    length_scatter_px: f64,
    /// The silhouettes of the images to come, where they are given and not looked for.
    masks: Option<VecDeque<Option<Mask>>>,
    /// Silhouettes of the sequence that stand for what differs from the empty tank.
    silhouettes: Option<Arc<Silhouettes>>,
    last: Last,
}

/// What an image takes from the ones before it.
#[derive(Debug, Default)]
struct Last {
    continuity: Continuity,
    centroid: Option<Px>,
    line: Option<Vec<Px>>,
    gap: usize,
    track: Track,
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
        let sound: Vec<(Result<&GrayImage, Rejection>, f64)> =
            own.zip(images).map(|(own, image)| (own.and_then(|()| readable(image)), image.time_s)).collect();
        let parts = in_parallel(&sound, |(image, time_s)| {
            let image = image.as_ref().map_err(Clone::clone)?;
            self.exposure.as_ref().map_or(Ok(()), |usual| Exposure::of(image).check(usual))?;
            self.parts(image, *time_s)
        });
        let seen: Vec<(Option<Contrast>, Result<Seen, Rejection>)> = match self.masks.as_mut() {
            Some(masks) => {
                let masks: Vec<Option<Mask>> = parts.iter().map(|_| masks.pop_front().flatten()).collect();
                let given = |(parts, mask): (Result<Parts, Rejection>, Option<Mask>)| match (parts, mask) {
                    (Err(why), _) => (None, Err(why)),
                    (Ok(parts), Some(mask)) => shown(parts.with(&mask)),
                    (Ok(parts), None) => {
                        let why = self.choice(&parts, None).err().unwrap_or(Rejection::NoMask);
                        (Some(parts.contrast), Err(why))
                    }
                };
                parts.into_iter().zip(masks).map(given).collect()
            }
            None => {
                let follow = |parts: Result<Parts, Rejection>| match parts {
                    Err(why) => (None, Err(why)),
                    Ok(parts) => match self.choice(&parts, self.last.centroid) {
                        Err(why) => (Some(parts.contrast), Err(why)),
                        Ok(chosen) => {
                            self.last.centroid = Some(parts.parts[chosen].centroid);
                            let (contrast, seen) = parts.seen(chosen);
                            (Some(contrast), Ok(seen))
                        }
                    },
                };
                parts.into_iter().map(follow).collect()
            }
        };
        let (contrasts, seen): (Vec<_>, Vec<_>) = seen.into_iter().unzip();
        self.measure(images, &contrasts, seen)
    }

    /// The silhouettes' middle lines, base first.
    fn oriented_all(
        &mut self,
        contrasts: &[Option<Contrast>],
        seen: &[Result<Seen, Rejection>],
    ) -> Vec<Result<Oriented, Rejection>> {
        let jobs: Vec<_> = contrasts.iter().zip(seen).collect();
        let candidates = in_parallel(&jobs, |job| match job {
            (Some(contrast), Ok(seen)) => self.candidate(contrast, seen),
            (_, Err(why)) => Err(why.clone()),
            (None, Ok(_)) => unreachable!("a silhouette is seen in a contrast"),
        });
        candidates
            .into_iter()
            .zip(jobs)
            .map(|(candidate, job)| {
                let (Some(contrast), Ok(seen)) = job else { return candidate.and(Err(Rejection::NoMask)) };
                let oriented = candidate.and_then(|candidate| self.oriented(candidate, contrast, seen));
                match &oriented {
                    Ok(oriented) => {
                        self.last.line = Some(compared(&oriented.candidate.line.points));
                        self.last.gap = 0;
                    }
                    Err(_) => self.last.gap += 1,
                }
                // Its way is followed on, but not given out while it is not certain whose it is.
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

    /// The keypoints where a silhouette tells them.
    fn by_silhouette(&self, oriented: &Oriented) -> Result<Placed, Rejection> {
        let found = place(&self.outline, &self.config.gates, &self.plane, &self.shape(oriented))?;
        let line = oriented.candidate.line.points.clone();
        Ok(Placed { found, line, doubt: oriented.doubt.clone() })
    }

    /// Everything behind the silhouette.
    fn measure(
        &mut self,
        images: &[TimedImage],
        contrasts: &[Option<Contrast>],
        seen: Vec<Result<Seen, Rejection>>,
    ) -> Vec<ImageRecord> {
        match self.outline.mode {
            Mode::Centroid => return self.bodies_in(images, contrasts, seen),
            Mode::Arms => return self.arms_in(images, contrasts, seen),
            Mode::Links | Mode::Arc | Mode::Paper => {}
        }
        let oriented = self.oriented_all(contrasts, &seen);
        let placed: Vec<Result<Placed, Rejection>> = match self.film.clone() {
            Some(film) => {
                let found = self.tracked(&film, images, contrasts, &oriented);
                // Where the outline is not found, the silhouette alone may still tell.
                let alone = |(found, oriented): (Result<Fitted, Rejection>, &Result<Oriented, Rejection>)| {
                    found.map(|found| Placed::by_outline(&film, &found)).or_else(|why| {
                        let placed = self.by_silhouette(oriented.as_ref().map_err(|_| why.clone())?)?;
                        Ok(Placed { doubt: Some(format!("by its silhouette alone: {why}")), ..placed })
                    })
                };
                found.into_iter().zip(&oriented).map(alone).collect()
            }
            None => in_parallel(&oriented, |oriented| {
                self.by_silhouette(oriented.as_ref().map_err(Clone::clone)?)
            }),
        };
        let masks = seen.into_iter().map(|seen| seen.ok().map(|seen| seen.silhouette));
        let masks = masks.zip(oriented).map(|(silhouette, oriented)| match oriented {
            Ok(oriented) => Some(oriented.candidate.mask),
            Err(_) => silhouette,
        });
        images
            .iter()
            .zip(placed)
            .zip(masks)
            .map(|((image, placed), mask)| self.record(image, placed, mask))
            .collect()
    }

    /// What an image, taken at `time_s`, shows apart from the empty tank.
    fn parts(&self, image: &GrayImage, time_s: f64) -> Result<Parts, Rejection> {
        /// Fewer pixels than this are noise even where a small cut object is looked for.
        const SPECK_PX: usize = 2;
        let mut contrast = self.background.contrast(image)?;
        let mut silhouette = match &self.silhouettes {
            Some(given) => given.seen(time_s, &mut contrast, self.background.blocked()),
            None => contrast.silhouette(),
        };
        if let Some(still) = self.background.still() {
            silhouette = silhouette.without(still);
            self.bridges.join(&mut silhouette);
        }
        let parts = components(&silhouette, SPECK_PX);
        Ok(Parts { contrast, parts })
    }

    /// Which part is the mechanism.
    fn choice(&self, parts: &Parts, last: Option<Px>) -> Result<usize, Rejection> {
        if let Some(chosen) = self.bodies.choice(&parts.parts, &self.config.gates, last) {
            return Ok(chosen);
        }
        let least = self.config.min_area_px.get();
        let diagonal = (parts.contrast.width as f64).hypot(parts.contrast.height as f64);
        choose(&parts.parts, least, self.base, BASE_REACH * diagonal, last).ok_or(match self.silhouettes {
            Some(_) => Rejection::NotSegmented,
            None => Rejection::NothingThere { min_area_px: least },
        })
    }

    /// Fills, thins and follows the silhouette.
    fn candidate(&self, contrast: &Contrast, seen: &Seen) -> Result<Candidate, Rejection> {
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
        let line = Centreline::follow(contrast, medial, &radius, self.config.smoothing.get())?;
        let (drawn, told) = (self.told(line.drawn(&mask)), self.told(mask.clone()));
        check_overlap(drawn.overlap(&told), &self.config.gates)?;
        let edge = edge_points(self.outline.mode, contrast, &mask, self.background.blocked());
        let sizes = Sizes::of(&line, mask.area());
        let line = line.inset(self.config.end_inset(self.outline.mode, self.base.is_some()));
        Ok(Candidate { line, mask, edge, sizes })
    }

    /// What of `mask` can be told from things that are still.
    fn told(&self, mask: Mask) -> Mask {
        match self.background.still() {
            Some(still) => mask.without(still),
            None => mask,
        }
    }

    /// Compares the candidate with what is usual and turns its base end to the front.
    fn oriented(
        &self,
        candidate: Candidate,
        contrast: &Contrast,
        seen: &Seen,
    ) -> Result<Oriented, Rejection> {
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
        let base_covered = self.covered(line.points[0], contrast);
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
            || [self.background.blocked(), self.background.still()].into_iter().flatten().any(|mask| {
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
        placed: Result<Placed, Rejection>,
        mask: Option<Mask>,
    ) -> ImageRecord {
        let (status, reason, keypoints, centreline) = match placed {
            Ok(Placed { found, line, doubt }) => {
                let keypoints = found.points.iter().zip(&found.sigmas);
                let keypoints =
                    keypoints.map(|(px, sigma)| Keypoint::seen(*px, *sigma, &self.plane)).collect();
                let status = if doubt.is_some() { Status::Doubtful } else { Status::Ok };
                (status, doubt.unwrap_or_default(), keypoints, line)
            }
            Err(why) => (Status::Rejected, why.to_string(), Vec::new(), Vec::new()),
        };
        let (name, time_s) = (image.name.clone(), image.time_s);
        ImageRecord { name, time_s, status, reason, keypoints, mask, centreline }
    }
}

fn shown(
    (contrast, seen): (Contrast, Result<Seen, Rejection>),
) -> (Option<Contrast>, Result<Seen, Rejection>) {
    (Some(contrast), seen)
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
