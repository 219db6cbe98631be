//! A whole sequence of images through an [`Extractor`]: the one way in, be they filmed just now, recorded, or files.

use std::path::Path;
use std::sync::Arc;

use sim::Model;

use super::config::VisionConfig;
use super::extractor::{Extractor, LEARN_FROM};
use super::mask::Mask;
use super::outline::Outline;
use super::record::{Extraction, ImageRecord};
use super::self_check::SelfCheck;
use super::silhouettes::Silhouettes;
use super::{SequenceError, VisionError, sam2};
use camera::calibration::Plane;
use camera::source::{ImageSource, TimedImage};

/// Images whose intermediate pictures are held at once, where nobody waits for the first ones.
const AT_ONCE: usize = 64;

/// How keypoints are extracted.
#[derive(Debug, Clone)]
pub struct Task<'a> {
    /// The `[vision]` table.
    pub config: &'a VisionConfig,
    /// What it and the model say of the mechanism's shape.
    pub outline: Outline,
    /// From pixels to metres.
    pub plane: Plane,
    /// The folder that paths in the table start from.
    pub folder: &'a Path,
    /// The silhouettes of all images, where they are given and not looked for.
    pub masks: Option<Vec<Option<Mask>>>,
    /// The silhouettes of all images, where they stand for what differs from the empty tank: in what is learned too.
    pub silhouettes: Option<Arc<Silhouettes>>,
    /// Whether the film is drawn again to tell how well its keypoints are found.
    pub self_check: bool,
}

impl<'a> Task<'a> {
    /// Of a `[vision]` table whose paths start at `folder`, and the model of what is seen.
    ///
    /// # Errors
    /// As [`Outline::new`]; and where the camera looks along the plane in which the model moves.
    pub fn new(
        config: &'a VisionConfig,
        model: Option<&Model>,
        plane: Plane,
        folder: &'a Path,
    ) -> Result<Self, VisionError> {
        let view = plane.view();
        if let Some(model) = model.filter(|model| view.misses(model)) {
            let what = format!(
                "is asked to follow the model {} in the {view} plane, but none of its hinges turns there: the calibration's `view` is \
                 the plane that the camera looks at, and the model moves in another one",
                model.name
            );
            return Err(VisionError::Config { what });
        }
        Ok(Self {
            config,
            outline: Outline::new(config, model)?,
            plane,
            folder,
            masks: None,
            silhouettes: None,
            self_check: config.self_check,
        })
    }

    /// An extraction that knows the empty tank from a `sample` of the sequence; the sequence is still to come.
    ///
    /// # Errors
    /// As [`Extractor::learn`]; and where the calibration is of pictures of another size.
    pub fn learn(&mut self, sample: &[TimedImage]) -> Result<Begun, VisionError> {
        if let Some(grey) = sample.iter().find_map(|image| image.grey.as_ref().ok()) {
            self.plane.fits(grey.dimensions().into())?;
        }
        let extractor = Extractor::learn(
            sample,
            self.config,
            &self.outline,
            self.plane.clone(),
            self.folder,
            self.silhouettes.clone(),
        )?;
        let extractor = match self.masks.take() {
            Some(masks) => extractor.with_masks(masks),
            None => extractor,
        };
        Ok(Begun { extractor, records: Vec::new() })
    }

    /// All of `source`; `found` is given some images at a time with what was found in them.
    ///
    /// # Errors
    /// [`SequenceError`]; and what `found` gives.
    pub fn extract<E: From<SequenceError>>(
        mut self,
        source: &(impl ImageSource + ?Sized),
        found: impl FnMut(&[TimedImage], &[ImageRecord]) -> Result<(), E>,
    ) -> Result<Extraction, E> {
        if let (Some(sam2), None, None) = (self.config.sam2(), &self.masks, &self.silhouettes) {
            self.silhouettes = Some(Arc::new(sam2::segment(sam2, self.folder, source)?));
        }
        let sample = source.sample(LEARN_FROM).map_err(SequenceError::from)?;
        let begun = self.learn(&sample).map_err(SequenceError::from)?;
        drop(sample);
        self.finish(begun, source, found)
    }

    /// What was `begun`, with the images of `source` after it; `found` as for [`Self::extract`], of those images.
    ///
    /// # Errors
    /// As [`Self::extract`].
    pub fn finish<E: From<SequenceError>>(
        self,
        mut begun: Begun,
        source: &(impl ImageSource + ?Sized),
        mut found: impl FnMut(&[TimedImage], &[ImageRecord]) -> Result<(), E>,
    ) -> Result<Extraction, E> {
        let mut images = source.images().map_err(SequenceError::from)?;
        while let Some((images, records)) = begun.take(&mut images, AT_ONCE).map_err(SequenceError::from)? {
            found(&images, records)?;
        }
        let Begun { extractor, mut records } = begun;
        let settled = extractor.settle(&mut records);
        let mut extraction = Extraction {
            learned: extractor.learned().to_vec(),
            is_revised: settled || self.self_check,
            ..Extraction::named(records, self.outline.keypoints(), self.plane.clone())
        };
        if self.self_check {
            let sample = source.sample(LEARN_FROM).map_err(SequenceError::from)?;
            self.check(&extractor, &mut extraction, &sample);
        }
        Ok(extraction)
    }

    /// Draws the film in which `extractor` found `extraction`, and of which `sample` is a part, again, and says of the keypoints how far off
    /// they are as that tells.
    fn check(&self, extractor: &Extractor, extraction: &mut Extraction, sample: &[TimedImage]) {
        // Which of a few shapes its ends have is known by now; trying them all again would take most of the time.
        let outline = Outline { end_rounding: extractor.end_rounding(), ..self.outline.clone() };
        let learn = |sample: &[TimedImage]| {
            Extractor::learn(sample, self.config, &outline, self.plane.clone(), self.folder, None)
        };
        let check = SelfCheck::of(extractor, extraction, sample, learn);
        if let Ok(check) = &check {
            check.weigh(extraction);
        }
        extraction.checked = Some(check);
    }
}

/// Some images, and what was found in each of them.
pub type Portion<'a> = (Vec<TimedImage>, &'a [ImageRecord]);

/// An extraction on its way through a sequence.
#[derive(Debug)]
pub struct Begun {
    extractor: Extractor,
    records: Vec<ImageRecord>,
}

impl Begun {
    /// One for each image that was taken.
    pub fn records(&self) -> &[ImageRecord] {
        &self.records
    }

    /// Takes the next of `images`, at most so many, and returns them with what was found in them; none where there are no more.
    ///
    /// # Errors
    /// What `images` give.
    pub fn take<E>(
        &mut self,
        images: &mut impl Iterator<Item = Result<TimedImage, E>>,
        at_most: usize,
    ) -> Result<Option<Portion<'_>>, E> {
        let portion: Vec<TimedImage> = images.take(at_most).collect::<Result<_, E>>()?;
        if portion.is_empty() {
            return Ok(None);
        }
        let before = self.records.len();
        self.records.append(&mut self.extractor.push(&portion));
        Ok(Some((portion, &self.records[before..])))
    }
}
