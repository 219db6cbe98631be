//! A body that nothing holds, through the images of a film.

use super::tracking::Placed;
use super::{Extractor, Last, Learned, in_parallel};
use crate::VisionError;
use crate::arms::{Swim, Swimming};
use crate::background::Contrast;
use crate::body::{Body, Usual};
use crate::parts::Seen;
use crate::record::ImageRecord;
use crate::rejection::Rejection;
use camera::source::TimedImage;

impl Extractor {
    /// The same with what is usual of a body in a sample.
    pub(super) fn usual_body(
        mut self,
        contrasts: &[Option<Contrast>],
        seen: &[Result<Seen, Rejection>],
    ) -> Result<Self, VisionError> {
        let found = self.each_body(contrasts, seen);
        let bodies: Vec<&Body> = found.iter().flatten().collect();
        let Some(usual) = Usual::of(&bodies) else {
            let why = found.iter().find_map(|found| found.as_ref().err());
            let what = why.map_or_else(String::new, Rejection::to_string);
            return Err(VisionError::NoBackground { images: found.len(), what });
        };
        if self.outline.heading_m.is_none() {
            let scale = bodies.iter().map(|body| self.plane.metres_per_pixel(body.moments.centroid));
            let value = usual.half_length_px * scale.sum::<f64>() / bodies.len() as f64;
            self.outline.heading_m = Some(value);
            // It is wherever it is put.
            self.learned.push(Learned { key: "heading_m", value, std: 0.0 });
        }
        self.bodies.learn(usual);
        self.last = Last::default();
        Ok(self)
    }

    fn each_body(
        &self,
        contrasts: &[Option<Contrast>],
        seen: &[Result<Seen, Rejection>],
    ) -> Vec<Result<Body, Rejection>> {
        let blocked = [self.background.blocked(), self.background.still()];
        let blocked: Vec<_> = blocked.into_iter().flatten().collect();
        let judged = (self.config.hole_share.get(), &self.config.gates);
        let jobs: Vec<_> = contrasts.iter().zip(seen).collect();
        in_parallel(&jobs, |(contrast, seen)| match (contrast, seen) {
            (Some(contrast), Ok(seen)) => self.bodies.seen(contrast, &seen.silhouette, &blocked, judged),
            (_, Err(why)) => Err(why.clone()),
            (None, Ok(_)) => Err(Rejection::NoMask),
        })
    }

    /// Everything behind the silhouette of a body.
    pub(super) fn bodies_in(
        &mut self,
        images: &[TimedImage],
        contrasts: &[Option<Contrast>],
        seen: Vec<Result<Seen, Rejection>>,
    ) -> Vec<ImageRecord> {
        let found = self.each_body(contrasts, &seen);
        let heading_m = self.outline.heading_m.unwrap_or_default();
        let all = images.iter().zip(found).zip(seen);
        let records = all.map(|((image, found), seen)| {
            let body = found.as_ref().ok();
            let headed = self.bodies.headed(image.time_s, body, self.config.ahead, (heading_m, &self.plane));
            let mask = match (body, seen) {
                (Some(body), _) => Some(body.mask.clone()),
                (None, seen) => seen.ok().map(|seen| seen.silhouette),
            };
            let placed = match (headed, found) {
                (Some(headed), _) => {
                    Ok(Placed { found: headed.found, line: headed.line, doubt: headed.doubt })
                }
                (None, found) => Err(found.err().unwrap_or(Rejection::NoMask)),
            };
            self.record(image, placed, mask)
        });
        records.collect()
    }

    /// The same where a sample shows the body of a swimmer with arms.
    pub(super) fn usual_arms(
        mut self,
        contrasts: &[Option<Contrast>],
        seen: &[Result<Seen, Rejection>],
    ) -> Result<Self, VisionError> {
        // One that shows it is enough.
        let mut why = None;
        let shown = contrasts.iter().zip(seen).any(|(contrast, seen)| {
            let found = self.arms_of(&mut Swim::default(), contrast.as_ref(), seen);
            why = found.err();
            why.is_none()
        });
        if !shown {
            let what = why.map_or_else(String::new, |why| why.to_string());
            return Err(VisionError::NoBackground { images: seen.len(), what });
        }
        self.last = Last::default();
        Ok(self)
    }

    fn arms_of(
        &self,
        swim: &mut Swim,
        contrast: Option<&Contrast>,
        seen: &Result<Seen, Rejection>,
    ) -> Result<Swimming, Rejection> {
        match (contrast, seen, &self.outline.swimmer) {
            (Some(contrast), Ok(seen), Some(swimmer)) => {
                swim.take(&self.view(contrast), &seen.silhouette, swimmer, &self.plane)
            }
            (_, Err(why), _) => Err(why.clone()),
            _ => Err(Rejection::NoMask),
        }
    }

    /// Everything behind the silhouette of a swimmer with arms.
    pub(super) fn arms_in(
        &mut self,
        images: &[TimedImage],
        contrasts: &[Option<Contrast>],
        seen: Vec<Result<Seen, Rejection>>,
    ) -> Vec<ImageRecord> {
        let mut swim = std::mem::take(&mut self.swim);
        let all = images.iter().zip(contrasts).zip(seen);
        let records = all.map(|((image, contrast), seen)| {
            let placed = self.arms_of(&mut swim, contrast.as_ref(), &seen);
            let placed = placed.map(|Swimming { found, line, doubt }| Placed { found, line, doubt });
            self.record(image, placed, seen.ok().map(|seen| seen.silhouette))
        });
        let records = records.collect();
        self.swim = swim;
        records
    }

    /// Says of all images that were taken, whose records are `records`, what only all together tell: which end of a free body is ahead.
    /// Whether that changed anything.
    pub fn settle(&self, records: &mut [ImageRecord]) -> bool {
        self.bodies.settle(records, self.config.ahead, &self.plane)
    }
}
