//! How well a film with known keypoints is read.

use std::error::Error;
use std::fmt;
use std::path::Path;
use std::time::Instant;

use camera::calibration::Calibration;
use camera::decode::picture_file;
use camera::source::TimedImage;
use serde::Deserialize;
use vision::{Extraction, SequenceError, Status, Task, VisionConfig};

/// A point this far off is wrong \[px\].
pub const WRONG_PX: f64 = 3.0;

/// How well a film was read.
#[derive(Debug, Clone, Default)]
pub struct Score {
    /// Number of images.
    pub images: usize,
    /// Images with status `ok`.
    pub answered: usize,
    /// Of those, with a keypoint more than [`WRONG_PX`] off.
    pub wrong: usize,
    /// Root mean square error of each keypoint over the images answered \[px\].
    pub rms_px: Vec<f64>,
    /// The largest \[px\].
    pub worst_px: Vec<f64>,
    /// Root mean square of error over sigma by keypoint, an axis at a time.
    pub normalised: Vec<f64>,
    /// Time to learn \[s\], and images a second after that.
    pub learned_s: f64,
    /// See [`Self::learned_s`].
    pub images_per_s: f64,
}

#[derive(Deserialize)]
struct Config {
    vision: VisionConfig,
    calibration: Calibration,
    camera: CameraTable,
}

#[derive(Deserialize)]
struct CameraTable {
    fps: f64,
}

/// Reads every `stride`-th image of the film in `folder` as its extract.toml says, on the caller's pool of threads, and judges what comes
/// out by its truth.csv.
///
/// # Errors
/// What cannot be read, or the extraction's refusal.
pub fn score(folder: &Path, stride: usize) -> Result<Score, Box<dyn Error + Send + Sync>> {
    let config: Config = toml::from_str(&std::fs::read_to_string(folder.join("extract.toml"))?)?;
    let model = sim::Model::from_mjcf(&std::fs::read_to_string(folder.join("model.xml"))?)?;
    let plane = config.calibration.plane(folder)?;
    let frames = std::fs::read_dir(folder.join("frames"))?;
    let mut paths: Vec<_> = frames.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    paths.sort();
    let mut images = Vec::new();
    for (i, path) in paths.iter().enumerate().step_by(stride) {
        let picture = picture_file(&std::fs::read(path)?).map_err(|error| error.to_string());
        images.push(TimedImage::new(i.to_string(), i as f64 / config.camera.fps, picture));
    }
    let task = Task::new(&config.vision, Some(&model), plane, folder)?;
    let begun = Instant::now();
    let mut first = None;
    let extraction = task.extract(images.as_slice(), |images, _| {
        first.get_or_insert((Instant::now(), images.len()));
        Ok::<(), SequenceError>(())
    })?;
    let (learned_s, images_per_s) = first.map_or((f64::NAN, f64::NAN), |(at, count)| {
        let after = (images.len() - count) as f64;
        (at.duration_since(begun).as_secs_f64(), after / at.elapsed().as_secs_f64())
    });
    Ok(Score { learned_s, images_per_s, ..judged(folder, stride, &extraction)? })
}

fn judged(
    folder: &Path,
    stride: usize,
    extraction: &Extraction,
) -> Result<Score, Box<dyn Error + Send + Sync>> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(folder.join("truth.csv"))?;
    let header = reader.headers()?.clone();
    let column = |name: String| {
        header.iter().position(|one| one == name).ok_or_else(|| format!("truth.csv has no column {name}"))
    };
    let columns: Vec<[usize; 2]> = extraction
        .names
        .iter()
        .map(|name| Ok([column(format!("{name}_x_px"))?, column(format!("{name}_y_px"))?]))
        .collect::<Result<_, String>>()?;
    let rows: Vec<csv::StringRecord> = reader.records().step_by(stride).collect::<Result<_, _>>()?;
    let count = columns.len();
    let mut score = Score {
        images: rows.len(),
        rms_px: vec![0.0; count],
        worst_px: vec![0.0; count],
        normalised: vec![0.0; count],
        ..Score::default()
    };
    for (record, row) in
        extraction.records.iter().zip(&rows).filter(|(record, _)| record.status == Status::Ok)
    {
        let mut most_px = 0.0_f64;
        for (i, ([x, y], found)) in columns.iter().zip(&record.keypoints).enumerate() {
            let truth: [f64; 2] = [row[*x].parse()?, row[*y].parse()?];
            let off_px = (found.px[0] - truth[0]).hypot(found.px[1] - truth[1]);
            most_px = most_px.max(off_px);
            score.rms_px[i] += off_px * off_px;
            score.normalised[i] += 0.5 * (off_px / found.std_px).powi(2);
            score.worst_px[i] = score.worst_px[i].max(off_px);
        }
        score.answered += 1;
        score.wrong += usize::from(most_px > WRONG_PX);
    }
    let mean = |sum: &mut f64| *sum = (*sum / score.answered.max(1) as f64).sqrt();
    score.rms_px.iter_mut().for_each(mean);
    score.normalised.iter_mut().for_each(mean);
    Ok(score)
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list =
            |values: &[f64]| values.iter().map(|value| format!("{value:.2}")).collect::<Vec<_>>().join(" ");
        write!(
            f,
            "{} of {} answered, {} of them wrong; rms {} px, worst {} px, error over sigma {}; learned in {:.1} s, {:.0} images/s",
            self.answered,
            self.images,
            self.wrong,
            list(&self.rms_px),
            list(&self.worst_px),
            list(&self.normalised),
            self.learned_s,
            self.images_per_s,
        )
    }
}
