//! `rig extract`: images to a trajectory.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use serde_json::json;

use super::progress::Bar;
use super::{Failure, Outcome};
use analysis::Progress as _;
use app::exchange::TableOfImages;
use app::look::{self, Overlays};
use app::{Watcher as _, on_threads, read_model, threads};
use config::{ExtractionConfig, paths};
use images::{self, ImageSource as _, TimedImage, Trimmed, Window};
use interchange::wcon::{self, Line, Written};
use record::outputs::{OutputFile, Outputs};
use vision::extractor::Learned;
use vision::{Extraction, ImageRecord, Status, Task, output};

/// Keypoints from images: a folder of pictures, or a video where ffmpeg is installed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of pictures (the numbers in their names are those of the images, or as its frames.csv says), or a video file.
    #[arg(value_name = "FRAMES")]
    pub frames: PathBuf,
    /// Any rig config; only its `[camera]` fps, `[calibration]`, `[vision]` and the model of `[run]` are used.
    #[arg(long, value_name = "TOML")]
    pub config: PathBuf,
    /// The mechanism's MuJoCo model, whose sites P0..Pn say what its shape is where `[vision]` does not; left out: that of `[run]`.
    #[arg(long, value_name = "MODEL.xml")]
    pub model: Option<PathBuf>,
    /// The trajectory to write; each image's status goes to `<out>.frames.csv`.
    #[arg(long, value_name = "CSV")]
    pub out: PathBuf,
    /// Also write whole centrelines: CSV, or WCON by the ending .wcon.
    #[arg(long, value_name = "CSV|WCON")]
    pub centreline: Option<PathBuf>,
    /// Also draw mask, centreline and keypoints over every image: pictures in a folder, or a film by the ending .mp4, .webm or .mkv (needs
    /// ffmpeg), which plays as the images' source does.
    #[arg(long, visible_alias = "overlay", value_name = "FOLDER|FILM")]
    pub overlays: Option<PathBuf>,
    /// Also put refused and doubtful images, by reason, on one picture, where there are any.
    #[arg(long, value_name = "PNG|JPG")]
    pub contact_sheet: Option<PathBuf>,
    /// Also draw the motion that was found again, in the film's own tank, light, sharpness and noise, and read it again: prints how far off
    /// each keypoint is by an image's noise and by what comes back with the pose, and writes the sigmas that this tells.
    #[arg(long)]
    pub self_check: bool,
    /// Leave out what was filmed before this, in seconds of the film's own time.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from_s: Option<f64>,
    /// Leave out what was filmed after this, in seconds of the film's own time.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to_s: Option<f64>,
    /// How much slower than life the film plays; times are divided by it. 240 images/s played at 30 is 8.
    #[arg(long, value_name = "F")]
    pub slow_motion: Option<f64>,
    /// Threads to use [default: all processors]; the result does not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
}

/// Carries out `rig extract`.
///
/// # Errors
/// Input: config, folder or pictures are wrong. Data: nothing in the images can be told from the background.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let read = paths::files(&args.config).into_iter().chain([args.frames.clone()]).chain(args.model.clone());
    let mut outputs = Outputs::reading(read);
    let out = TableOfImages::at(&args.out, &mut outputs)?;
    let centreline = args.centreline.as_deref().map(|path| outputs.file(path)).transpose()?;
    let sheet = args.contact_sheet.as_deref().map(|path| outputs.file(path)).transpose()?;
    let slowed = args.slow_motion.unwrap_or(1.0);
    let plan = |path: &Path| Overlays::plan(path, slowed, &mut outputs);
    let mut overlays = args.overlays.as_deref().map(plan).transpose()?;
    let config = ExtractionConfig::read(&args.config).map_err(Failure::input)?;
    let plane = config.plane().map_err(Failure::input)?;
    let named = args.model.clone().or(config.model());
    let model = named.as_deref().map(read_model).transpose()?;
    let window = Window::new(args.from_s, args.to_s, args.slow_motion).map_err(Failure::input)?;
    args.contact_sheet.as_deref().map(look::sheet_format).transpose()?;
    let source = Trimmed::new(images::open(&args.frames, config.fps()).map_err(Failure::input)?, window);

    let mut bar = Bar::new(Arc::default());
    bar.begin("images", source.len_hint().map(|count| count as u64));
    let mut done = 0;
    let mut found = |images: &[TimedImage], records: &[ImageRecord]| {
        if let Some(overlays) = &mut overlays {
            overlays.draw(images, records)?;
        }
        done += images.len() as u64;
        bar.step(done);
        Ok::<(), Failure>(())
    };
    let task = Task::new(&config.vision, model.as_ref(), plane, config.folder()).map_err(Failure::input)?;
    let task = Task { self_check: args.self_check || task.self_check, ..task };
    let threads = threads(args.threads);
    let extraction = on_threads(threads, || task.extract(&source, &mut found));
    bar.clear();
    let extraction = extraction?;
    let checked = extraction.checked.clone().transpose().context("checking the film by drawing it again");
    let checked = checked.map_err(Failure::input)?;
    let images = extraction.records.iter().map(|r| (r.name.as_str(), r.time_s, r.status, r.reason.as_str()));
    out.write(ident::table::trajectory_text(&extraction.trajectory).as_bytes(), images)?;
    if let Some(file) = &centreline {
        write_centreline(file, &args.frames, &extraction).map_err(Failure::input)?;
    }
    overlays.map(Overlays::finish).transpose()?;
    let mut text = checked.as_ref().map(ToString::to_string).unwrap_or_default();
    text.push_str(&summary(&extraction, &args.out));
    if let Some(sheet) = &sheet {
        let path = sheet.path().display();
        text.push_str(&match look::write_sheet(sheet, &source, &extraction)? {
            true => format!("{path}: refused and doubtful images by reason\n"),
            false => format!("{path} is not there: no image was refused or doubtful\n"),
        });
    }
    let mut warnings = source.remarks();
    warnings.extend(config.fps().and_then(|fps| other_rate(&extraction.records, fps)));
    Ok(Outcome { out: Some(args.out.clone()), warnings, text, ..Outcome::default() })
}

/// Largest departure of the images' own rate from the configured one that is not worth a word, as a share; chosen.
const MAX_RATE_DEPARTURE: f64 = 0.05;

/// A warning where images with times of their own come at another rate than `fps` \[images/s\].
fn other_rate(records: &[ImageRecord], fps: f64) -> Option<String> {
    let mut steps_s: Vec<f64> = records.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
    steps_s.sort_by(f64::total_cmp);
    let rate = 1.0 / steps_s.get(steps_s.len() / 2)?;
    ((rate / fps - 1.0).abs() > MAX_RATE_DEPARTURE).then(|| {
        format!(
            "by their own times, which count, the images come {rate:.1} a second, and [camera] fps says {fps}: what plays faster or slower than \
             life needs --slow-motion (below 1 for faster)"
        )
    })
}

/// Writes the centrelines, as CSV or WCON by the ending.
fn write_centreline(out: &OutputFile, frames: &Path, extraction: &Extraction) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    if out.path().extension().is_some_and(|ending| ending.eq_ignore_ascii_case("wcon")) {
        let id = frames.file_name().unwrap_or_default().to_string_lossy();
        serde_json::to_writer(&mut bytes, &wcon::document(&centrelines(extraction, &id)))?;
    } else {
        output::write_centreline_csv(extraction, &mut bytes)?;
    }
    Ok(out.write(&bytes)?)
}

/// The centrelines as a document to write; an image's reason stands in our own block.
fn centrelines<'a>(extraction: &Extraction, id: &'a str) -> Written<'a> {
    let line = |record: &ImageRecord| {
        let points = match output::centreline(extraction, record) {
            Some(points) => points.into_iter().map(Some).collect(),
            None => vec![None; output::CENTRELINE_POINTS],
        };
        Line { time_s: record.time_s, points }
    };
    let image = |r: &ImageRecord| json!({ "file": r.name, "status": r.status, "reason": r.reason });
    Written {
        id,
        lines: extraction.records.iter().map(line).collect(),
        keypoints: None,
        images: Some(extraction.records.iter().map(image).collect()),
    }
}

/// How many images went through, and the reasons of the others by how often they came.
fn summary(extraction: &Extraction, out: &Path) -> String {
    let [ok, doubtful, rejected] =
        [Status::Ok, Status::Doubtful, Status::Rejected].map(|status| extraction.count(status));
    let total = extraction.records.len();
    let told: String = extraction
        .learned
        .iter()
        .map(|Learned { key, value, std }| {
            format!("{key} = {value:.5} ± {std:.5}, from the images: nobody says it\n")
        })
        .collect();
    told + &format!(
        "{}: {total} images, {ok} ok, {doubtful} doubtful, {rejected} rejected; reasons in {}.frames.csv\n",
        out.display(),
        out.display()
    )
}
