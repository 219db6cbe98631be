//! What the extraction made of a film.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use vision::{Extraction, SequenceError, Status, Task};

use super::clip::Clip;

/// A point this far off is wrong \[px\].
pub const WRONG_PX: f64 = 3.0;

/// How well a film was read.
#[derive(Debug, Clone, Serialize)]
pub struct Score {
    /// The film.
    pub name: String,
    /// Root mean square error of each keypoint over the images answered \[px\]; wrong ones count as well.
    pub rms_px: Vec<f64>,
    /// Share of the sound images with status `ok`.
    pub answered: f64,
    /// Images with status `ok` and a keypoint more than [`WRONG_PX`] off.
    pub wrong_unflagged: usize,
    /// Images.
    pub images: usize,
    /// Root mean square of error over sigma, an axis at a time.
    pub normalised: f64,
    /// Decoded images a second on one thread, learning apart.
    pub images_per_s: f64,
    /// What the film was refused with, if it was.
    pub refused: Option<String>,
}

/// [`read`] without the extraction.
pub fn score(clip: &Clip) -> Score {
    read(clip, false).0
}

/// Reads `clip` on the caller's pool of threads, as `rig extract` (with `--self-check` or without) does, and judges what comes out; with
/// the extraction, unless it is refused.
pub fn read(clip: &Clip, self_check: bool) -> (Score, Option<Extraction>) {
    let mut first = None;
    let found = Task::new(&clip.config, clip.model.as_ref(), clip.plane.clone(), Path::new(""))
        .map_err(SequenceError::from);
    let found = found.and_then(|task| {
        let task = Task { self_check, ..task };
        task.extract(clip.images.as_slice(), |images, _| {
            first.get_or_insert((Instant::now(), images.len()));
            Ok::<(), SequenceError>(())
        })
    });
    let took = first.map_or(f64::NAN, |(since, portion)| {
        (clip.images.len() - portion) as f64 / since.elapsed().as_secs_f64()
    });
    match found {
        Ok(extraction) => (Score { images_per_s: took, ..judged(clip, &extraction) }, Some(extraction)),
        Err(error) => {
            let refused = Some(ground::error_chain::with_causes(&error));
            (Score { refused, ..judged_nothing(clip) }, None)
        }
    }
}

fn judged_nothing(clip: &Clip) -> Score {
    Score {
        name: clip.name.clone(),
        rms_px: Vec::new(),
        answered: 0.0,
        wrong_unflagged: 0,
        images: clip.images.len(),
        normalised: f64::NAN,
        images_per_s: f64::NAN,
        refused: None,
    }
}

/// Compares an extraction with the truth.
pub fn judged(clip: &Clip, extraction: &Extraction) -> Score {
    let mut squares = vec![0.0; clip.truth[0].points.len()];
    let (mut answers, mut sound, mut sound_answers, mut wrong) = (0, 0, 0, 0);
    let (mut normalised, mut numbers) = (0.0, 0);
    for (record, truth) in extraction.records.iter().zip(&clip.truth) {
        let measurable = truth.trouble.is_none();
        sound += usize::from(measurable);
        if record.status != Status::Ok {
            continue;
        }
        answers += 1;
        sound_answers += usize::from(measurable);
        let mut worst: f64 = 0.0;
        let points = record.keypoints.iter().zip(&truth.points).zip(&mut squares);
        for ((keypoint, point), sum) in points.filter(|((keypoint, _), _)| keypoint.std_px.is_finite()) {
            let off = [0, 1].map(|axis| keypoint.px[axis] - point[axis]);
            let square = off[0] * off[0] + off[1] * off[1];
            *sum += square;
            worst = worst.max(square.sqrt());
            normalised += square / (keypoint.std_px * keypoint.std_px);
            numbers += 2;
        }
        wrong += usize::from(worst > WRONG_PX);
    }
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    Score {
        rms_px: squares.iter().map(|sum| (sum / f64::from(answers.max(1))).sqrt()).collect(),
        answered: share(sound_answers, sound),
        wrong_unflagged: wrong,
        normalised: (normalised / f64::from(numbers.max(1))).sqrt(),
        ..judged_nothing(clip)
    }
}
