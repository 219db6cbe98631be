//! Messages in Foxglove's well-known schemas, as JSON: pure functions from what a run holds.
//!
//! Frames: `tank` is the world; `camera` is optical, x to the right in the picture, y down, z away; `simulated/<body>` are the model's
//! bodies. Times are wall-clock nanoseconds since 1970.
//!
//! # Source
//! Fields and types: <https://docs.foxglove.dev/docs/visualization/message-schemas/introduction>.

pub mod pinhole;
pub mod scene;
pub mod schemas;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use serde_json::{Value, json};
use sim::Poses;

use camera::calibration::Px;

/// The world.
pub const TANK: &str = "tank";
/// The camera's optical frame.
pub const CAMERA: &str = "camera";

/// Red, green, blue, opacity, 0 to 1.
pub type Colour = [f64; 4];
/// What was measured, and
pub const MEASURED: Colour = [0.12, 0.37, 0.75, 1.0];
/// what was simulated: the report's colours.
pub const SIMULATED: Colour = [0.82, 0.21, 0.17, 0.8];
/// A silhouette's middle line.
const CENTRELINE: Colour = [1.0, 0.82, 0.12, 1.0];
const NONE: Colour = [0.0; 4];

/// A time.
pub fn time(at_ns: u64) -> Value {
    json!({ "sec": at_ns / 1_000_000_000, "nsec": at_ns % 1_000_000_000 })
}

fn colour([r, g, b, a]: Colour) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": a })
}

fn xyz([x, y, z]: [f64; 3]) -> Value {
    json!({ "x": x, "y": y, "z": z })
}

/// A rotation matrix, row by row.
fn quaternion(rows: &[[f64; 3]; 3]) -> Value {
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_fn(|i, j| rows[i][j]));
    let turn = UnitQuaternion::from_rotation_matrix(&rotation);
    json!({ "x": turn.i, "y": turn.j, "z": turn.k, "w": turn.w })
}

/// `foxglove.CompressedImage`: the bytes of a picture file of `format`, `jpeg` or `png`.
pub fn compressed_image(at_ns: u64, format: &str, bytes: &[u8]) -> Value {
    json!({ "timestamp": time(at_ns), "frame_id": CAMERA, "format": format, "data": STANDARD.encode(bytes) })
}

/// What is drawn over a picture.
#[derive(Debug, Clone, Copy)]
pub struct Annotated<'a> {
    /// Visible keypoints \[px\].
    pub keypoints: &'a [(&'a str, Px)],
    /// The centreline \[px\].
    pub centreline: &'a [Px],
    /// Where the simulation has the keypoints \[px\].
    pub simulated: &'a [Px],
    /// Why the image was refused or doubted; empty when it was not.
    pub reason: &'a str,
}

/// `foxglove.ImageAnnotations`.
pub fn annotations(at_ns: u64, drawn: &Annotated<'_>) -> Value {
    let at = |px: Px| json!({ "x": px[0], "y": px[1] });
    let circle = |px: Px, diameter: f64, fill: Colour, outline: Colour| {
        json!({
            "timestamp": time(at_ns), "position": at(px), "diameter": diameter, "thickness": 1.0,
            "fill_color": colour(fill), "outline_color": colour(outline),
        })
    };
    let text = |px: Px, text: &str| {
        json!({
            "timestamp": time(at_ns), "position": at(px), "text": text, "font_size": 14.0,
            "text_color": colour([1.0; 4]), "background_color": colour([0.0, 0.0, 0.0, 0.5]),
        })
    };
    const LINE_STRIP: u8 = 3;
    let line = json!({
        "timestamp": time(at_ns), "type": LINE_STRIP, "thickness": 2.0,
        "points": drawn.centreline.iter().map(|&px| at(px)).collect::<Vec<_>>(),
        "outline_color": colour(CENTRELINE), "outline_colors": [], "fill_color": colour(NONE),
    });
    let measured = drawn.keypoints.iter().map(|&(_, px)| circle(px, 7.0, MEASURED, [1.0; 4]));
    let simulated = drawn.simulated.iter().map(|&px| circle(px, 11.0, NONE, SIMULATED));
    let mut texts: Vec<Value> =
        drawn.keypoints.iter().map(|&(name, [x, y])| text([x + 8.0, y - 8.0], name)).collect();
    if !drawn.reason.is_empty() {
        texts.push(text([8.0, 20.0], drawn.reason));
    }
    let lines = if drawn.centreline.is_empty() { vec![] } else { vec![line] };
    json!({ "circles": measured.chain(simulated).collect::<Vec<_>>(), "points": lines, "texts": texts })
}

/// How bad a `foxglove.Log` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// As it should be.
    Info = 2,
    /// Less than well.
    Warning = 3,
    /// Something ended.
    Error = 4,
}

/// `foxglove.Log`: `message` of `name`.
pub fn log(at_ns: u64, level: Level, name: &str, message: &str) -> Value {
    json!({
        "timestamp": time(at_ns), "level": level as u8, "name": name, "message": message, "file": "", "line": 0,
    })
}

/// The frame of a body of the simulation; that of the world's is the tank.
pub fn frame_of(body: usize, name: &str) -> String {
    if body == 0 { TANK.into() } else { format!("simulated/{name}") }
}

/// One `foxglove.FrameTransform`: where `child` stands in the tank.
pub fn transform(at_ns: u64, child: &str, place_m: [f64; 3], rotation: &[[f64; 3]; 3]) -> Value {
    json!({
        "timestamp": time(at_ns), "parent_frame_id": TANK, "child_frame_id": child,
        "translation": xyz(place_m), "rotation": quaternion(rotation),
    })
}

/// `foxglove.FrameTransforms`: where the bodies called `names` stand.
pub fn transforms(at_ns: u64, names: &[&str], poses: &Poses) -> Value {
    // the world's own frame is the tank
    let bodies = names.iter().enumerate().skip(1);
    let one = |(body, name): (usize, &&str)| {
        transform(at_ns, &frame_of(body, name), poses.body_pos[body].0, &poses.body_rot[body].0)
    };
    json!({ "transforms": bodies.map(one).collect::<Vec<_>>() })
}
