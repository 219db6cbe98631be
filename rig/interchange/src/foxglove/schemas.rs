//! The schemas' texts: JSON Schema, as Foxglove reads it.

use serde_json::{Map, Value, json};

/// A message type: its name, and how its text is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// As Foxglove knows it.
    pub name: &'static str,
    /// The JSON Schema.
    pub text: Value,
}

fn number() -> Value {
    json!({ "type": "number" })
}

fn integer() -> Value {
    json!({ "type": "integer" })
}

fn string() -> Value {
    json!({ "type": "string" })
}

fn bytes() -> Value {
    json!({ "type": "string", "contentEncoding": "base64" })
}

fn array(items: &Value) -> Value {
    json!({ "type": "array", "items": items })
}

fn object<const N: usize>(title: &str, properties: [(&str, Value); N]) -> Value {
    let required: Vec<&str> = properties.iter().map(|(name, _)| *name).collect();
    let properties: Map<String, Value> =
        properties.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    json!({ "title": title, "type": "object", "properties": properties, "required": required })
}

fn numbers<const N: usize>(title: &str, names: [&str; N]) -> Value {
    object(title, names.map(|name| (name, number())))
}

/// Foxglove knows the two by their titles.
fn moment(title: &str) -> Value {
    object(title, [("sec", integer()), ("nsec", integer())])
}

fn time() -> Value {
    moment("time")
}

fn colour() -> Value {
    numbers("foxglove.Color", ["r", "g", "b", "a"])
}

fn vector() -> Value {
    numbers("foxglove.Vector3", ["x", "y", "z"])
}

fn quaternion() -> Value {
    numbers("foxglove.Quaternion", ["x", "y", "z", "w"])
}

fn pose() -> Value {
    object("foxglove.Pose", [("position", vector()), ("orientation", quaternion())])
}

/// `foxglove.CompressedImage`.
pub fn compressed_image() -> Schema {
    let name = "foxglove.CompressedImage";
    let fields = [("timestamp", time()), ("frame_id", string()), ("data", bytes()), ("format", string())];
    Schema { name, text: object(name, fields) }
}

/// `foxglove.CameraCalibration`.
pub fn camera_calibration() -> Schema {
    let name = "foxglove.CameraCalibration";
    let matrix = || array(&number());
    let fields = [
        ("timestamp", time()),
        ("frame_id", string()),
        ("width", integer()),
        ("height", integer()),
        ("distortion_model", string()),
        ("D", matrix()),
        ("K", matrix()),
        ("R", matrix()),
        ("P", matrix()),
    ];
    Schema { name, text: object(name, fields) }
}

/// `foxglove.ImageAnnotations`.
pub fn image_annotations() -> Schema {
    let name = "foxglove.ImageAnnotations";
    let point = || numbers("foxglove.Point2", ["x", "y"]);
    let circle = object(
        "foxglove.CircleAnnotation",
        [
            ("timestamp", time()),
            ("position", point()),
            ("diameter", number()),
            ("thickness", number()),
            ("fill_color", colour()),
            ("outline_color", colour()),
        ],
    );
    let points = object(
        "foxglove.PointsAnnotation",
        [
            ("timestamp", time()),
            ("type", integer()),
            ("points", array(&point())),
            ("outline_color", colour()),
            ("outline_colors", array(&colour())),
            ("fill_color", colour()),
            ("thickness", number()),
        ],
    );
    let text = object(
        "foxglove.TextAnnotation",
        [
            ("timestamp", time()),
            ("position", point()),
            ("text", string()),
            ("font_size", number()),
            ("text_color", colour()),
            ("background_color", colour()),
        ],
    );
    let fields = [("circles", array(&circle)), ("points", array(&points)), ("texts", array(&text))];
    Schema { name, text: object(name, fields) }
}

/// `foxglove.FrameTransforms`.
pub fn frame_transforms() -> Schema {
    let name = "foxglove.FrameTransforms";
    let one = object(
        "foxglove.FrameTransform",
        [
            ("timestamp", time()),
            ("parent_frame_id", string()),
            ("child_frame_id", string()),
            ("translation", vector()),
            ("rotation", quaternion()),
        ],
    );
    Schema { name, text: object(name, [("transforms", array(&one))]) }
}

/// `foxglove.SceneUpdate`, of the shapes that are used here.
pub fn scene_update() -> Schema {
    let name = "foxglove.SceneUpdate";
    let shape = |title: &str| object(title, [("pose", pose()), ("size", vector()), ("color", colour())]);
    let cylinder = object(
        "foxglove.CylinderPrimitive",
        [
            ("pose", pose()),
            ("size", vector()),
            ("bottom_scale", number()),
            ("top_scale", number()),
            ("color", colour()),
        ],
    );
    let pair = object("foxglove.KeyValuePair", [("key", string()), ("value", string())]);
    let unused = || array(&json!({ "type": "object" }));
    let entity = object(
        "foxglove.SceneEntity",
        [
            ("timestamp", time()),
            ("frame_id", string()),
            ("id", string()),
            ("lifetime", moment("duration")),
            ("frame_locked", json!({ "type": "boolean" })),
            ("metadata", array(&pair)),
            ("arrows", unused()),
            ("cubes", array(&shape("foxglove.CubePrimitive"))),
            ("spheres", array(&shape("foxglove.SpherePrimitive"))),
            ("cylinders", array(&cylinder)),
            ("lines", unused()),
            ("triangles", unused()),
            ("texts", unused()),
            ("models", unused()),
        ],
    );
    let deletion = object(
        "foxglove.SceneEntityDeletion",
        [("timestamp", time()), ("type", integer()), ("id", string())],
    );
    let fields = [("deletions", array(&deletion)), ("entities", array(&entity))];
    Schema { name, text: object(name, fields) }
}

/// `foxglove.Log`.
pub fn log() -> Schema {
    let name = "foxglove.Log";
    let fields = [
        ("timestamp", time()),
        ("level", integer()),
        ("message", string()),
        ("name", string()),
        ("file", string()),
        ("line", integer()),
    ];
    Schema { name, text: object(name, fields) }
}

/// A schema of our own, called `name`: numbers to be plotted, any of which may be missing.
pub fn plotted(name: &'static str, fields: impl IntoIterator<Item = String>) -> Schema {
    let properties: Map<String, Value> = fields.into_iter().map(|field| (field, number())).collect();
    Schema { name, text: json!({ "title": name, "type": "object", "properties": properties }) }
}
