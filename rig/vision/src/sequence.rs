//! A whole sequence of images through an [`Extractor`]: the one way in, be they filmed just now, recorded, or files.

use std::path::Path;
use std::sync::Arc;

use sim::Model;

use super::config::{Background, Mode, VisionConfig, picture};
use super::extractor::{Extractor, LEARN_FROM, MAX_BASE_SIGMAS};
use super::mask::Mask;
use super::outline::Outline;
use super::pose::{Given, Mechanism, PoseFilm};
use super::record::{Extraction, ImageRecord};
use super::sam2::Segmenter;
use super::self_check::{SelfCheck, SelfCheckError};
use super::silhouettes::Silhouettes;
use super::spline::distance;
use super::{SequenceError, VisionError, sam2, static_mask};
use camera::calibration::{Plane, View};
use camera::source::{ImageSource, TimedImage};

/// Images whose intermediate pictures are held at once, where nobody waits for the first ones.
const AT_ONCE: usize = 64;

/// A film is another one's than the model's where that explains a smaller share of the sample; chosen: what a wrong P0 or length explains by
/// chance was a third.
const LEAST_EXPLAINED_SHARE: f64 = 0.5;

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
    /// What is posed where nothing is segmented.
    pub mechanism: Option<Mechanism>,
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
        let outline = Outline::new(config, model)?;
        let mechanism = match config.segmenter {
            Segmenter::Pose => Some(by_pose(&outline, model, view)?),
            Segmenter::Auto if config.base().is_some() || outline.base_m.is_some() => {
                by_pose(&outline, model, view).ok()
            }
            Segmenter::Auto | Segmenter::Classical | Segmenter::Sam2 => None,
        };
        Ok(Self {
            config,
            mechanism,
            outline,
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
        // silhouettes that are given are to be read
        let mechanism =
            self.mechanism.as_ref().filter(|_| self.masks.is_none() && self.silhouettes.is_none());
        if let Some(mechanism) = mechanism {
            let film = self.learn_film(sample, mechanism)?;
            return Ok(Begun { by: By::Pose(Box::new(film)), records: Vec::new() });
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
        Ok(Begun { by: By::Silhouette(Box::new(extractor)), records: Vec::new() })
    }

    /// A film of `mechanism` as `sample` shows it.
    fn learn_film(&self, sample: &[TimedImage], mechanism: &Mechanism) -> Result<PoseFilm, VisionError> {
        let size = sample.iter().find_map(|image| Some(image.grey.as_ref().ok()?.dimensions()));
        let size = size.ok_or(VisionError::NoImages)?;
        let blocked = match &self.config.static_mask {
            Some(path) => Some(static_mask::read(self.folder, path, size)?),
            None => None,
        };
        let model_base = || self.outline.base_m.map(|base| self.plane.pixel(self.plane.view().seen(base)));
        let base = self.config.base().or_else(model_base).ok_or_else(|| VisionError::Config {
            what: "segmenter = \"pose\" needs `base_px`, where P0 is seen: the model does not hold it".into(),
        })?;
        let distance_m = self.config.camera_distance_m.map(|distance| distance.get());
        let empty = match &self.config.background {
            Background::Picture(path) => {
                let picture = picture("background", self.folder, path, size)?;
                Some(TimedImage::new(path.display().to_string(), 0.0, Ok(picture)))
            }
            _ => None,
        };
        let end_rounding = self.config.end_rounding.map(|rounding| rounding.get());
        let given =
            Given { base, distance_m, end_rounding, blocked: blocked.as_ref(), empty: empty.as_ref() };
        let film = PoseFilm::learn(sample, mechanism.clone(), &self.plane, given)
            .map_err(|why| VisionError::NoBackground { images: sample.len(), what: why.to_string() })?;
        let begins = film.base_px();
        let (apart_px, std_px) = (distance(base, begins), self.config.base_std_px.get());
        if apart_px > MAX_BASE_SIGMAS * std_px {
            return Err(VisionError::BaseElsewhere { base, begins, apart_px, std_px });
        }
        let [explained, images] = film.explained();
        if (explained as f64) < LEAST_EXPLAINED_SHARE * images as f64 {
            return Err(VisionError::NotThisModel {
                base,
                explained,
                images,
                is_empty_given: empty.is_some(),
            });
        }
        Ok(film)
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
        let Begun { by, mut records } = begun;
        let By::Silhouette(extractor) = by else {
            let checked = self.self_check.then_some(Err(SelfCheckError::ByPose));
            let extraction = Extraction::named(records, self.outline.keypoints(), self.plane.clone());
            return Ok(Extraction { checked, ..extraction });
        };
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

/// What `segmenter = "pose"` needs of a model.
fn by_pose(outline: &Outline, model: Option<&Model>, view: View) -> Result<Mechanism, VisionError> {
    let refuse = |what: &str| Err(VisionError::Config { what: format!("segmenter = \"pose\" {what}") });
    let soft = match outline.mode {
        Mode::Links => false,
        Mode::Arc => true,
        Mode::Paper | Mode::Centroid | Mode::Arms => {
            return refuse("is for modes \"links\" and \"arc\": what is held at P0");
        }
    };
    let mechanism = model.and_then(|model| Mechanism::of(model, view, soft));
    match mechanism.filter(|mechanism| mechanism.keypoints_count() == outline.links + 1) {
        Some(mechanism) => Ok(mechanism),
        None => refuse(
            "needs a model that is one row of hinges in the plane that the camera looks at, held at its site P0, with a site for each keypoint",
        ),
    }
}

/// Some images, and what was found in each of them.
pub type Portion<'a> = (Vec<TimedImage>, &'a [ImageRecord]);

/// An extraction on its way through a sequence.
#[derive(Debug)]
pub struct Begun {
    by: By,
    records: Vec<ImageRecord>,
}

/// What images are read by.
#[derive(Debug)]
enum By {
    /// The model's pose that explains them.
    Pose(Box<PoseFilm>),
    /// What stands out from the empty tank.
    Silhouette(Box<Extractor>),
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
        match &mut self.by {
            By::Pose(film) => self.records.extend(portion.iter().map(|image| film.take(image))),
            By::Silhouette(extractor) => self.records.append(&mut extractor.push(&portion)),
        }
        Ok(Some((portion, &self.records[before..])))
    }
}
