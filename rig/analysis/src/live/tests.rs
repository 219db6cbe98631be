use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::*;
use ::record::folder::file;
use ::record::recording::{Recorder, RecorderOptions};
use ::record::start_stop::{RunKind, Start, Stop};
use camera::{CameraImage, fixtures};
use ground::clock::MonotonicNs;
use images::recording::RecordedImages;
use record::fixtures as record;
use tank::render::{Look, Renderer};
use vision::record::StoredRecord;
use vision::{ImageRecord, SequenceError};

const MS: u64 = 1_000_000;
const SIZE_PX: (u32, u32) = (640, 480);

/// A film of the driven chain swaying, one image of which carries the stamp of the one before.
struct Film {
    config: RigConfig,
    base: PathBuf,
    run: RunFolder,
    images: Vec<Arc<CameraImage>>,
    _runs: tempfile::TempDir,
}

impl Film {
    fn new() -> Self {
        let base = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let config = RigConfig::read(&base.join("chain-driven-pose-1.toml")).unwrap();
        let text = std::fs::read_to_string(base.join(&config.run.model)).unwrap();
        let model = sim::Model::from_mjcf(&text).unwrap();
        let plane = config.calibration.plane(&base).unwrap();
        let renderer = Renderer::new(plane, Look::plain(SIZE_PX.0, SIZE_PX.1));
        let image = |k: u32| {
            let mut state = model.rest_state();
            let turn = [0.5, 0.3, 0.2].map(|amplitude| amplitude * (0.2 * f64::from(k)).sin());
            state.qpos.copy_from_slice(&turn);
            let grey = renderer.draw(&model, &state.qpos);
            let at = MonotonicNs(u64::from(if k == 7 { 6 } else { k }) * 10 * MS + MS);
            let image = fixtures::image(k, at, SIZE_PX);
            Arc::new(CameraImage { damaged: k == 20, data: grey.into_raw(), ..image })
        };
        let runs = tempfile::tempdir().unwrap();
        let start =
            Start { kind: RunKind::Free, clock: record::at(0), ..record::start("20261120T101503Z-ab12cd") };
        let run = RunFolder::create(runs.path(), start).unwrap();
        run.write(file::MODEL_START, text.as_bytes()).unwrap();
        Self { images: (0..60).map(image).collect(), config, base, run, _runs: runs }
    }

    fn live(&self) -> Live {
        let mut live = Live::new(&self.config, &self.base, 3, true, Showing::default());
        live.begins(&self.run);
        live
    }

    /// When the usable images were exposed.
    fn times_s(&self) -> Vec<f64> {
        let usable = (0..).zip(&self.images).filter(|(index, _)| *index != 7);
        usable.map(|(_, image)| image.mid_exposure.seconds_since(MonotonicNs(0))).collect()
    }

    /// The run with all images in its recording, and what the empty tank was learned from.
    fn recorded(&self, learn_from: Range<u64>) -> RunFolder {
        let mut run = self.run.clone();
        let info = fixtures::info(SIZE_PX);
        let path = run.file(file::RECORDING);
        let recorder = Recorder::create(&path, Some(&info), RecorderOptions::default()).unwrap();
        self.images.iter().for_each(|image| recorder.image(Arc::clone(image)).unwrap());
        recorder.finish().unwrap();
        let stop = Stop { images: self.images.len() as u64, learn_from: Some(learn_from), ..record::stop() };
        run.finish(stop, None).unwrap();
        run
    }
}

fn kept(records: &[ImageRecord]) -> Vec<StoredRecord> {
    records.iter().map(StoredRecord::from).collect()
}

#[test]
fn images_looked_at_while_they_come_give_what_the_recording_gives() {
    let film = Film::new();
    let mut live = film.live();
    for (index, image) in film.images.iter().enumerate() {
        live.hear(&Notice::Image(Arc::clone(image)));
        if index == 39 {
            live.hear(&Notice::Learn(5..40));
        }
    }
    let Head { begun, left, early } = live.finish(&film.times_s()).unwrap();
    assert_eq!(begun.records().len() + left.times_s().count(), 59);
    assert!(early.is_none(), "nobody asked for a fit");

    let recorded = RecordedImages::of_run(&film.recorded(5..40));
    let plane = film.config.calibration.plane(&film.base).unwrap();
    let model = model(&film.run).unwrap();
    let task = Task::new(&film.config.vision, Some(&model), plane, &film.base).unwrap();
    let nobody = |_: &[_], _: &[_]| Ok::<(), SequenceError>(());
    let offline = task.clone().extract(&recorded, nobody).unwrap();
    let live = task.finish(begun, &left.of(&recorded), nobody).unwrap();
    assert_eq!(kept(&live.records), kept(&offline.records));
    let seen = live.records.iter().filter(|record| record.keypoints.len() == 4).count();
    assert_eq!(seen, 58, "all but the damaged one");
}

#[test]
fn a_film_too_short_to_learn_from_or_with_other_images_gives_nothing() {
    let film = Film::new();
    let mut live = film.live();
    film.images[..30].iter().for_each(|image| live.hear(&Notice::Image(Arc::clone(image))));
    assert!(live.finish(&film.times_s()[..29]).is_none());

    let mut live = film.live();
    film.images.iter().for_each(|image| live.hear(&Notice::Image(Arc::clone(image))));
    live.hear(&Notice::Learn(0..60));
    assert!(live.finish(&film.times_s()[1..]).is_none(), "an image that the recording lacks");
}

#[test]
fn what_has_been_seen_is_fitted_while_the_rest_is_filmed() {
    let mut film = Film::new();
    film.config.fit.parameters = vec!["damping".into()];
    film.config.fit.max_evaluations = 40;
    let early = |film: &Film| {
        let mut live = film.live();
        film.images.iter().for_each(|image| live.hear(&Notice::Image(Arc::clone(image))));
        live.hear(&Notice::Fit);
        live.hear(&Notice::Learn(5..40));
        let extraction = live.extraction.as_ref().unwrap();
        until(|| extraction.images.waiting() < IMAGES_AT_ONCE);
        live.finish(&film.times_s()).unwrap().early
    };
    let result = |fit: EarlyFit| {
        until(|| fit.is_done());
        fit.result()
    };
    assert!(result(early(&film).unwrap()).is_some());

    film.config.fit.method = Method::Paper;
    assert!(early(&film).is_none(), "another method begins at the model's values");
    film.config.fit.method = Method::Hybrid;
    film.config.fit.parameters = vec!["nonsense".into()];
    let wrong = early(&film).and_then(result);
    assert!(wrong.is_none(), "what is wrong is for the fit of the whole to say");
}

fn until(condition: impl Fn() -> bool) {
    let patience = Instant::now() + Duration::from_secs(60);
    while !condition() && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(5));
    }
}
