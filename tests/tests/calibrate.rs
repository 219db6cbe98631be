//! `rig calibrate camera` on pictures of a ray-traced tank.

use nalgebra::{Rotation2, Vector2};
use rig::calibrate::world::Upright;
use rig::calibrate::{Board, Calibrated, Picture, Setup, calibrate, detect};
use rig::calibration::Plane;
use system_tests::wall::{Place, PlacedBoard, Trouble, WallCamera, picture, spread};

const CORNERS: [usize; 2] = [9, 6];
const SQUARE_M: f64 = 0.02;

fn board() -> Board {
    format!("chessboard:{}x{}:{SQUARE_M}", CORNERS[0], CORNERS[1]).parse().expect("a board")
}

fn setup() -> Setup {
    Setup { board: board(), origin_px: [640.0, 80.0], upright: Upright::Rows, offset: None, most_rms_m: 3e-4 }
}

/// What is found in pictures of boards at these places.
fn pictures(camera: &WallCamera, boards: &[PlacedBoard], trouble: &Trouble) -> Vec<Picture> {
    let look = |(i, placed): (usize, &PlacedBoard)| {
        let picture = picture(camera, Some(placed), trouble, i as u64);
        let corners = detect(&picture, &board()).map_err(|error| error.to_string());
        Picture { name: format!("{i}.png"), size_px: Some(camera.size_px), corners }
    };
    boards.iter().enumerate().map(look).collect()
}

/// Errors of the corners found in a picture, and how many of the board's are not \[px\].
fn detection(camera: &WallCamera, placed: &PlacedBoard, found: &Picture) -> (Vec<f64>, usize) {
    let truth: Vec<Place> = placed.inner_corners().into_iter().map(|corner| camera.seen(corner)).collect();
    let corners = found.corners.as_ref().unwrap_or_else(|why| panic!("{}: {why}", found.name));
    let errors: Vec<f64> = corners
        .iter()
        .map(|corner| {
            let off = |true_px: &Place| (corner.px[0] - true_px[0]).hypot(corner.px[1] - true_px[1]);
            truth.iter().map(off).fold(f64::INFINITY, f64::min)
        })
        .collect();
    (errors, truth.len() - corners.len())
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Places all over what the corners cover.
fn covered(pictures: &[Picture]) -> Vec<Place> {
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
fn errors(plane: &Plane, truth: impl Fn(Place) -> Place, places: &[Place]) -> Vec<f64> {
    let off = |&px: &Place| (Vector2::from(plane.metres(px)) - Vector2::from(truth(px))).norm();
    places.iter().map(off).collect()
}

/// The same, turned and moved as they fit best: what is left is shape.
fn shape_errors(plane: &Plane, truth: impl Fn(Place) -> Place, places: &[Place]) -> Vec<f64> {
    let pairs: Vec<(Vector2<f64>, Vector2<f64>)> =
        places.iter().map(|&px| (plane.metres(px).into(), truth(px).into())).collect();
    let mean = |pick: fn(&(Vector2<f64>, Vector2<f64>)) -> Vector2<f64>| {
        pairs.iter().map(pick).sum::<Vector2<f64>>() / pairs.len() as f64
    };
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let (sine, cosine) = pairs.iter().fold((0.0, 0.0), |(sine, cosine), (a, b)| {
        (sine + (a - from).perp(&(b - to)), cosine + (a - from).dot(&(b - to)))
    });
    let turn = Rotation2::new(sine.atan2(cosine));
    pairs.iter().map(|(a, b)| (turn * (a - from) - (b - to)).norm()).collect()
}

fn most(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(0.0, f64::max)
}

/// The camera's own truth, from where it sees the origin.
fn from_origin(camera: &WallCamera, origin_px: Place) -> impl Fn(Place) -> Place {
    let origin = camera.traced(origin_px, 0.0);
    move |px| {
        let [x, z] = camera.traced(px, 0.0);
        [x - origin[0], z - origin[1]]
    }
}

fn calibrated(pictures: &[Picture], setup: &Setup) -> Calibrated {
    calibrate(pictures, setup).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn camera_square_to_the_wall_is_calibrated_to_a_twentieth_of_a_millimetre() {
    let camera = WallCamera::square();
    let boards = spread(&camera, CORNERS, SQUARE_M);
    let found = pictures(&camera, &boards, &Trouble::usual());
    let mut all = Vec::new();
    for (placed, found) in boards.iter().zip(&found) {
        let (errors, missing) = detection(&camera, placed, found);
        eprintln!(
            "{}: rms {:.3} px, worst {:.3} px, {missing} missing",
            found.name,
            rms(&errors),
            most(&errors)
        );
        assert_eq!(missing, 0, "{}", found.name);
        all.extend(errors);
    }
    eprintln!("corners: rms {:.3} px, worst {:.3} px", rms(&all), most(&all));
    assert!(rms(&all) < 0.1);
    let setup = setup();
    let calibrated = calibrated(&found, &setup);
    let errors = errors(&calibrated.plane, from_origin(&camera, setup.origin_px), &covered(&found));
    eprintln!("plane: rms {:.4} mm, worst {:.4} mm", rms(&errors) * 1e3, most(&errors) * 1e3);
    eprintln!("{}", rig::calibrate::report::text(&calibrated));
    assert!(most(&errors) < 5e-5, "{}", most(&errors));
}
