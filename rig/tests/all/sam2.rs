//! SAM 2 through ONNX Runtime, on graphs without weights: see `data/sam2/README.md`.
//!
//! The runtime's library is looked for as `rig` itself does, in `ORT_DYLIB_PATH` and where the system has libraries. Where there is none,
//! what needs it is skipped, which is said.

use std::path::{Path, PathBuf};

use camera::calibration::{Plane, Px};
use ground::error_chain::with_causes;
use ground::strict::{Finite, Positive};
use images::TimedImage;
use tank::render::{Look, Renderer};
use vision::sam2::{Click, Crop, Mismatch, Sam2Config, Sam2Error, Segmenter};
use vision::{Extraction, Mode, SequenceError, Status, Task, VisionConfig, VisionError};

const SIDE_PX: u32 = 320;
const BASE: Px = [160.0, 60.0];
const LENGTH_PX: f64 = 180.0;
const HALF_WIDTH_PX: f64 = 13.0;
const IMAGES: usize = 13;
/// The image that is clicked in: the film goes on both ways.
const CLICKED: usize = 5;
/// Keypoints lie on the same edges, whoever found the silhouette; what is left is where the search for them began.
const SAME_PX: f64 = 0.05;

fn data(export: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2").join(export)
}

fn angle(image: usize) -> f64 {
    0.9 * (image as f64 / (IMAGES - 1) as f64 - 0.5)
}

/// So far along the bar and so far beside its middle.
fn on_bar(image: usize, along: f64, beside: f64) -> Px {
    let (sin, cos) = angle(image).sin_cos();
    [BASE[0] + along * sin + beside * cos, BASE[1] + along * cos - beside * sin]
}

/// A bar that swings about its upper end.
fn film() -> Vec<TimedImage> {
    let renderer = Renderer::new(Plane::square(0.001, BASE), Look::plain(SIDE_PX, SIDE_PX));
    let picture = |image: usize| {
        let corners = [
            (0.0, HALF_WIDTH_PX),
            (LENGTH_PX, HALF_WIDTH_PX),
            (LENGTH_PX, -HALF_WIDTH_PX),
            (0.0, -HALF_WIDTH_PX),
        ];
        renderer.draw_polygons(&[corners.map(|(along, beside)| on_bar(image, along, beside)).to_vec()])
    };
    let timed = |image: usize| TimedImage {
        name: format!("{image}.png"),
        time_s: image as f64 / 30.0,
        chroma: None,
        grey: Ok(picture(image)),
    };
    (0..IMAGES).map(timed).collect()
}

fn click([x, y]: Px) -> Click {
    Click { x_px: Finite::new(x).unwrap(), y_px: Finite::new(y).unwrap(), positive: true }
}

fn config(weights: &Path, click_px: Px) -> VisionConfig {
    VisionConfig {
        base_px: Some(BASE.map(|at| Finite::new(at).unwrap())),
        segmenter: Segmenter::Sam2,
        sam2: Some(Sam2Config {
            weights: weights.into(),
            library: None,
            start_image: CLICKED,
            clicks: vec![click(click_px)],
            crop_px: Some(Crop { left: 20, top: 20, width: 280, height: 256 }),
            // Their cells are four times those of real ones.
            edge_px: Positive::new(6.0),
            threads: None,
        }),
        ..VisionConfig::new(1, Mode::Links)
    }
}

fn extract(config: &VisionConfig, film: &[TimedImage]) -> Result<Extraction, SequenceError> {
    let task = Task::new(config, None, Plane::square(0.001, BASE), Path::new(""))?;
    task.extract(film, |_, _| Ok(()))
}

/// Why nothing comes of no images.
fn told(config: &VisionConfig) -> String {
    with_causes(&extract(config, &[]).unwrap_err())
}

/// What SAM 2 gives; `None`, which is said, where this machine has no runtime.
fn with_runtime<T>(given: Result<T, SequenceError>) -> Option<Result<T, SequenceError>> {
    match given {
        Err(SequenceError::Vision(VisionError::Sam2(error @ Sam2Error::Library { .. })))
            if std::env::var_os("ORT_DYLIB_PATH").is_none() =>
        {
            eprintln!("skipped: {error}");
            None
        }
        given => Some(given),
    }
}

#[test]
fn all_exports_follow_a_click_through_the_film_both_ways() {
    let film = film();
    let classical = VisionConfig { segmenter: Segmenter::Classical, ..config(&data("video"), [0.0; 2]) };
    let expected = extract(&classical, &film).unwrap();
    assert_eq!(expected.count(Status::Ok), IMAGES);
    for export in ["video", "video-objptr", "image"] {
        let config = config(&data(export), on_bar(CLICKED, 90.0, 0.0));
        let Some(found) = with_runtime(extract(&config, &film)) else { return };
        let found = found.unwrap();
        for (image, (record, other)) in found.records.iter().zip(&expected.records).enumerate() {
            assert_eq!(record.status, Status::Ok, "{export} {}: {}", record.name, record.reason);
            for (i, (a, b)) in record.keypoints.iter().zip(&other.keypoints).enumerate() {
                let off = (a.px[0] - b.px[0]).hypot(a.px[1] - b.px[1]);
                assert!(off < SAME_PX, "{export} {} P{i}: {off} px apart", record.name);
            }
            let tip = on_bar(image, LENGTH_PX, 0.0);
            let off = (record.keypoints[1].px[0] - tip[0]).hypot(record.keypoints[1].px[1] - tip[1]);
            assert!(off < 0.3, "{export} {}: the tip is {off} px from where it is", record.name);
        }
    }
}

#[test]
fn a_click_beside_the_mechanism_and_graphs_of_another_export_are_refused() {
    let film = film();
    let error = |config: &VisionConfig| match extract(config, &film) {
        Err(SequenceError::Vision(VisionError::Sam2(error))) => Err(error),
        other => Ok(other.map(|_| ())),
    };
    let background = error(&config(&data("video"), [40.0, 250.0]));
    if matches!(background, Err(Sam2Error::Library { .. })) && std::env::var_os("ORT_DYLIB_PATH").is_none() {
        eprintln!("skipped: no ONNX Runtime");
        return;
    }
    assert!(matches!(background, Err(Sam2Error::Background { start_image: CLICKED, .. })), "{background:?}");
    let outside = error(&config(&data("video"), [400.0, 100.0]));
    assert!(matches!(outside, Err(Sam2Error::Outside { .. })), "{outside:?}");

    let folder = tempfile::tempdir().unwrap();
    let put = |from: &str, to: &str| {
        std::fs::copy(data("video").join(from), folder.path().join(to)).unwrap();
    };
    for name in ["image_encoder.onnx", "image_decoder.onnx", "memory_attention.onnx"] {
        put(name, name);
    }
    put("image_decoder.onnx", "memory_encoder.onnx");
    let mixed = error(&config(folder.path(), on_bar(CLICKED, 90.0, 0.0)));
    assert!(
        matches!(&mixed, Err(Sam2Error::Signature { path, mismatch: Mismatch::Missing { names, .. } })
            if path.ends_with("memory_encoder.onnx") && names == &["mask_for_mem"]),
        "{mixed:?}"
    );
    std::fs::write(folder.path().join("memory_encoder.onnx"), "no graph").unwrap();
    let none = error(&config(folder.path(), on_bar(CLICKED, 90.0, 0.0)));
    assert!(matches!(&none, Err(Sam2Error::Graph { .. })), "{none:?}");
}

#[test]
fn weights_that_are_missing_are_told_before_any_image_is_read() {
    let config = config(Path::new("no-such-folder"), [160.0, 100.0]);
    let told = told(&config);
    for part in ["no-such-folder", "samexporter", "memory_attention.onnx"] {
        assert!(told.contains(part), "{told}");
    }
}

#[test]
fn sam2_without_its_table_or_without_a_click_is_refused() {
    let whole = config(&data("video"), [0.0; 2]);
    let without = VisionConfig { sam2: None, ..whole.clone() };
    assert!(told(&without).contains("[vision.sam2]"), "{}", told(&without));
    let mut beside = whole;
    beside.sam2.as_mut().unwrap().clicks[0].positive = false;
    assert!(told(&beside).contains("clicks"), "{}", told(&beside));
}
