//! How well keypoints are found in pictures like a film's own, whose truth is known: the motion that was found is drawn again, in the
//! film's tank, light, sharpness and noise, and read again.
//!
//! What another noise changes is an image's own. What stays is the pose's: how its edges lie on the pixels, and what a sample
//! could not tell of the mechanism's shape. Several films, each of all poses moved by a share of a pixel and each with an
//! extractor that learns from it alone, show how large that is.

mod scene;

use image::GrayImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardUniform};
use rayon::prelude::*;

use super::extractor::{Extractor, LEARN_FROM};
use super::keypoints::Sigma;
use super::record::{Extraction, ImageRecord, Keypoint, Status};
use camera::calibration::Px;
use camera::source::TimedImage;
use ground::error_chain::with_causes;
use scene::Scene;

/// What drawing and reading a film again tells.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfCheck {
    /// Images drawn.
    pub images: usize,
    /// Of these, images that were refused or read wrongly.
    pub lost: usize,
    /// Each keypoint's errors, in the order of the records.
    pub keypoints: Vec<Checked>,
}

/// A keypoint's errors, root mean squares per axis \[px\].
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// Its name.
    pub name: String,
    /// What is an image's own.
    pub white_px: f64,
    /// What comes back with the pose.
    pub pose_px: f64,
    /// What the extraction says of the film itself.
    pub said: Sigma,
}

/// Why a film cannot be checked by itself.
#[derive(Debug, Clone, thiserror::Error)]
pub enum SelfCheckError {
    /// Nothing to draw.
    #[error(
        "cannot be drawn again: its mechanism's outline is not known, only its silhouette; a self-check needs mode \"links\" or \"arc\" and \
         P0 held (`base_px`, or a model whose first body is fixed)"
    )]
    NoOutline,
    /// Nothing was segmented.
    #[error("is not drawn again: with segmenter = \"pose\" sigmas come from its own residuals")]
    ByPose,
    /// Too little was found in the film.
    #[error(
        "cannot be checked: only {found} images were found without a doubt, at least {wanted} are needed"
    )]
    TooFew {
        /// Images found.
        found: usize,
        /// Least number.
        wanted: usize,
    },
    /// The pictures drawn again say nothing.
    #[error("drawn again could not be read: {0}")]
    Unread(String),
}

/// Poses drawn, at most: spread over the film.
const MOST_POSES: usize = 96;
const LEAST_POSES: usize = 8;
/// Films drawn, each moved by another share of a pixel.
const FILMS: u64 = 4;
/// Farther off than this an image was read wrongly \[px\].
const WRONG_PX: f64 = 3.0;

/// Errors of each image and keypoint, `[column, row]` \[px\]; none where it was not read.
type Errors = Vec<Option<Vec<Px>>>;

impl SelfCheck {
    /// Of the film in which `extractor` found `extraction`. `sample`: images of it, as for [`Extractor::learn`]; `learn` gives an extractor
    /// that knows nothing but the sample of pictures that it is given.
    ///
    /// # Errors
    /// [`SelfCheckError`].
    pub fn of<E: std::error::Error>(
        extractor: &Extractor,
        extraction: &Extraction,
        sample: &[TimedImage],
        learn: impl Fn(&[TimedImage]) -> Result<Extractor, E>,
    ) -> Result<Self, SelfCheckError> {
        let sure: Vec<&ImageRecord> =
            extraction.records.iter().filter(|record| record.status == Status::Ok).collect();
        if sure.len() < LEAST_POSES {
            return Err(SelfCheckError::TooFew { found: sure.len(), wanted: LEAST_POSES });
        }
        let scene = scene_of(extractor, sample, &extraction.records).ok_or(SelfCheckError::NoOutline)?;
        let stride = sure.len().div_ceil(MOST_POSES);
        let poses: Vec<&ImageRecord> = sure.iter().step_by(stride).copied().collect();
        let drawn: Vec<(Vec<Vec<Px>>, Vec<Px>)> =
            poses.iter().filter_map(|record| extractor.drawn(&record.centreline)).collect();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let mut films: Vec<(Errors, Option<Errors>)> = Vec::new();
        for film in 0..FILMS {
            let by: Px = std::array::from_fn(|_| StandardUniform.sample(&mut random));
            let moved = |p: &Px| [p[0] + by[0], p[1] + by[1]];
            let shot = |take: u64| -> Vec<TimedImage> {
                let image = |(i, (polygons, _)): (usize, &(Vec<Vec<Px>>, Vec<Px>))| {
                    let polygons: Vec<Vec<Px>> =
                        polygons.iter().map(|polygon| polygon.iter().map(moved).collect()).collect();
                    let seed = ((take * FILMS + film) << 32) + i as u64;
                    let grey: GrayImage = scene.draw(&polygons, seed);
                    TimedImage { name: i.to_string(), time_s: poses[i].time_s, chroma: None, grey: Ok(grey) }
                };
                drawn.par_iter().enumerate().map(image).collect()
            };
            let first = shot(0);
            let sample: Vec<TimedImage> =
                first.iter().step_by(first.len().div_ceil(LEARN_FROM)).cloned().collect();
            let mut learned = learn(&sample).map_err(|why| SelfCheckError::Unread(with_causes(&why)))?;
            drop(sample);
            let mut read = |images: Vec<TimedImage>| -> Errors {
                let records = learned.push(&images);
                let truth = drawn.iter().map(|(_, points)| points.iter().map(moved).collect::<Vec<Px>>());
                records.iter().zip(truth).map(|(record, truth)| errors(record, &truth)).collect()
            };
            let own = read(first);
            // Another noise once is enough: every image tells.
            let again = (film == 0).then(|| read(shot(1)));
            films.push((own, again));
        }
        Ok(Self::told(&films, &extraction.names, &sure))
    }

    fn told(films: &[(Errors, Option<Errors>)], names: &[String], sure: &[&ImageRecord]) -> Self {
        let all = || films.iter().flat_map(|(own, again)| std::iter::once(own).chain(again)).flatten();
        let keypoint = |(i, name): (usize, &String)| {
            let mut white = Mean::default();
            for (own, again) in films.iter().filter_map(|(own, again)| Some((own, again.as_ref()?))) {
                for (a, b) in
                    own.iter().zip(again).filter_map(|(a, b)| Some((a.as_ref()?[i], b.as_ref()?[i])))
                {
                    (0..2).for_each(|axis| white.take((a[axis] - b[axis]).powi(2) / 2.0));
                }
            }
            let mut whole = Mean::default();
            all().flatten().flat_map(|errors| errors[i]).for_each(|off| whole.take(off * off));
            // What is left of the whole is no less than what so few images can tell from nothing.
            let least = white.mean() / (white.count / 2.0).sqrt().max(1.0);
            let said = |of: fn(&Keypoint) -> f64| {
                let mut mean = Mean::default();
                let known = sure.iter().filter_map(|record| record.keypoints.get(i)).map(of);
                known.filter(|std| std.is_finite()).for_each(|std| mean.take(std * std));
                mean.mean().sqrt()
            };
            Checked {
                name: name.clone(),
                white_px: white.mean().sqrt(),
                pose_px: (whole.mean() - white.mean()).max(least).sqrt(),
                said: Sigma { whole_px: said(|k| k.std_px), pose_px: said(|k| k.pose_std_px) },
            }
        };
        Self {
            images: all().count(),
            lost: all().filter(|errors| errors.is_none()).count(),
            keypoints: names.iter().enumerate().map(keypoint).collect(),
        }
    }

    /// Says of each keypoint in `extraction` how far off it is, as the check found it on the whole; images in which less of the mechanism
    /// is seen stay as much less sure as they were.
    pub fn weigh(&self, extraction: &mut Extraction) {
        for record in &mut extraction.records {
            for (keypoint, checked) in record.keypoints.iter_mut().zip(&self.keypoints) {
                let said = keypoint.sigma();
                let pose_px = weighed(said.pose_px, checked.pose_px, checked.said.pose_px);
                let white_px = weighed(said.white_px(), checked.white_px, checked.said.white_px());
                let sigma = Sigma { whole_px: white_px.hypot(pose_px), pose_px };
                *keypoint = Keypoint::seen(keypoint.px, sigma, &extraction.plane);
            }
        }
        extraction.renew_trajectory();
    }
}

/// `std` of one image, in proportion, where all together were said to have `said` and have `measured`; what was hardly said at all is the
/// same in every image.
fn weighed(std: f64, measured: f64, said: f64) -> f64 {
    /// More than that is no proportion.
    const MOST: f64 = 3.0;
    let by = if said > 0.0 { (measured / said).min(MOST) } else { 0.0 };
    let rest = (measured * measured - (said * by).powi(2)).max(0.0);
    (std * by).hypot(rest.sqrt())
}

impl std::fmt::Display for SelfCheck {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "drawn again and read again: {} images, {} of them lost", self.images, self.lost)?;
        writeln!(f, "1 sigma [px]      an image's own  with the pose  (said without this check)")?;
        for Checked { name, white_px, pose_px, said } in &self.keypoints {
            let (own, pose) = (said.white_px(), said.pose_px);
            writeln!(f, "  {name:15} {white_px:14.4} {pose_px:14.4}  ({own:.4}, {pose:.4})")?;
        }
        Ok(())
    }
}

/// What the film shows beside its mechanism.
fn scene_of(extractor: &Extractor, sample: &[TimedImage], records: &[ImageRecord]) -> Option<Scene> {
    let read: Vec<(&GrayImage, f64)> =
        sample.iter().filter_map(|image| Some((image.grey.as_ref().ok()?, image.time_s))).collect();
    let images: Vec<&GrayImage> = read.iter().map(|(grey, _)| *grey).collect();
    let contrasts: Vec<_> = read
        .par_iter()
        .filter_map(|(grey, time_s)| Some((extractor.background().contrast(grey).ok()?, *time_s)))
        .collect();
    let slopes = contrasts.iter().flat_map(|(contrast, time_s)| {
        let record = records.iter().find(|record| record.time_s == *time_s);
        record.map_or(Vec::new(), |record| extractor.edge_slopes(contrast, &record.centreline))
    });
    let slopes = slopes.collect();
    Scene::of(
        extractor.background(),
        &images,
        &contrasts.iter().map(|(one, _)| one).collect::<Vec<_>>(),
        slopes,
    )
}

/// How far off a record's keypoints are; none where it is refused, doubtful or wrong.
fn errors(record: &ImageRecord, truth: &[Px]) -> Option<Vec<Px>> {
    let off = |(keypoint, truth): (&Keypoint, &Px)| [0, 1].map(|axis| keypoint.px[axis] - truth[axis]);
    let errors: Vec<Px> = record.keypoints.iter().zip(truth).map(off).collect();
    let right = errors.iter().all(|[x, y]| x.hypot(*y) < WRONG_PX);
    (record.status == Status::Ok && right).then_some(errors)
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn take(&mut self, value: f64) {
        self.sum += value;
        self.count += 1.0;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }
}
