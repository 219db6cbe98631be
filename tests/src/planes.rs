//! How far a calibrated plane is from what is there.

use calibrate::Picture;
use camera::calibration::Plane;
use nalgebra::{Rotation2, Vector2};

use crate::wall::{Place, WallCamera};

/// Root mean square.
pub fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Places all over what the corners cover.
pub fn covered(pictures: &[Picture]) -> Vec<Place> {
    const STEPS: usize = 24;
    let corners = pictures.iter().flat_map(|picture| picture.corners.iter().flatten());
    let all: Vec<Place> = corners.map(|corner| corner.px).collect();
    let end =
        |axis: usize, pick: fn(f64, f64) -> f64| all.iter().map(|px| px[axis]).reduce(pick).expect("corners");
    let [x, y] = [0, 1].map(|axis| (end(axis, f64::min), end(axis, f64::max)));
    let part = |(least, most): (f64, f64), i: usize| least + (most - least) * i as f64 / STEPS as f64;
    (0..(STEPS + 1).pow(2)).map(|i| [part(x, i % (STEPS + 1)), part(y, i / (STEPS + 1))]).collect()
}

/// Distances of what the plane says from what is there, as both stand \[m\].
pub fn errors(plane: &Plane, truth: impl Fn(Place) -> Place, places: &[Place]) -> Vec<f64> {
    let off = |&px: &Place| (Vector2::from(plane.metres(px)) - Vector2::from(truth(px))).norm();
    places.iter().map(off).collect()
}

/// The same, turned and moved as they fit best: what is left is shape.
pub fn shape_errors(plane: &Plane, truth: impl Fn(Place) -> Place, places: &[Place]) -> Vec<f64> {
    let told: Vec<Vector2<f64>> = places.iter().map(|&px| plane.metres(px).into()).collect();
    let there: Vec<Vector2<f64>> = places.iter().map(|&px| truth(px).into()).collect();
    let about_middle = |places: Vec<Vector2<f64>>| -> Vec<Vector2<f64>> {
        let middle = places.iter().sum::<Vector2<f64>>() / places.len() as f64;
        places.into_iter().map(|place| place - middle).collect()
    };
    let (told, there) = (about_middle(told), about_middle(there));
    let pairs = || told.iter().zip(&there);
    let (sine, cosine) =
        pairs().fold((0.0, 0.0), |(sine, cosine), (a, b)| (sine + a.perp(b), cosine + a.dot(b)));
    let turn = Rotation2::new(sine.atan2(cosine));
    pairs().map(|(a, b)| (turn * a - b).norm()).collect()
}

/// The largest.
pub fn most(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(0.0, f64::max)
}

/// The camera's own truth, from where it sees the origin.
pub fn from_origin(camera: &WallCamera, origin_px: Place) -> impl Fn(Place) -> Place {
    let origin = camera.traced(origin_px, 0.0);
    move |px| {
        let [x, z] = camera.traced(px, 0.0);
        [x - origin[0], z - origin[1]]
    }
}
