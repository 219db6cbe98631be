//! A camera that looks into a tank through its flat wall, ray by ray, and a board in the water: pictures whose truth is known, drawn
//! by code that shares none with the calibration.
//!
//! Frame of the wall: x right, y down, z from the camera into the tank; its outer face is z = 0 and the camera's pupil lies on
//! x = y = 0. The plane of motion is parallel to the wall; world x points right, world z up.

use image::GrayImage;
use nalgebra::{Rotation2, Rotation3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::clips::picture::Picture;

/// A place in a picture \[px\] or, in metres, in the plane.
pub type Place = [f64; 2];

/// Refractive indices.
const GLASS_REFRACTIVE_INDEX: f64 = 1.5;
const WATER_REFRACTIVE_INDEX: f64 = 1.333;

/// A pinhole camera before a wall.
#[derive(Debug, Clone, Copy)]
pub struct WallCamera {
    /// Width and height \[px\].
    pub size_px: [u32; 2],
    /// Focal length \[px\].
    pub focal_px: f64,
    /// How its lens alone distorts: straight = seen (1 + k r²), r the seen distance in focal lengths.
    pub lens: f64,
    /// Turn about the upright axis, then about the level one \[rad\].
    pub tilt_rad: [f64; 2],
    /// Pupil to wall \[m\].
    pub air_m: f64,
    /// Thickness of the wall \[m\].
    pub glass_m: f64,
    /// Wall to the plane \[m\].
    pub water_m: f64,
}

impl WallCamera {
    /// One that is square to the wall.
    pub fn square() -> Self {
        Self {
            size_px: [1280, 720],
            focal_px: 1500.0,
            lens: 0.0,
            tilt_rad: [0.0; 2],
            air_m: 0.5,
            glass_m: 0.01,
            water_m: 0.3,
        }
    }

    /// Where in the plane `behind_m` behind its own what is seen at `px` lies: x right, z up, from the foot of the pupil \[m\].
    pub fn traced(&self, px: Place, behind_m: f64) -> Place {
        let [width, height] = self.size_px.map(f64::from);
        let seen = Vector2::new(px[0] - (width - 1.0) / 2.0, px[1] - (height - 1.0) / 2.0) / self.focal_px;
        let straight = seen * (1.0 + self.lens * seen.norm_squared());
        let [about_upright, about_level] = self.tilt_rad;
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), about_upright)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), about_level);
        let air = (turn * Vector3::new(straight.x, straight.y, 1.0)).normalize();
        let mut at = Vector2::zeros();
        for (depth, index) in [
            (self.air_m, 1.0),
            (self.glass_m, GLASS_REFRACTIVE_INDEX),
            (self.water_m + behind_m, WATER_REFRACTIVE_INDEX),
        ] {
            // Snell: along the wall, index times sine stays what it is.
            let along = Vector2::new(air.x, air.y) / index;
            let inward = (1.0 - along.norm_squared()).sqrt();
            at += along / inward * depth;
        }
        [at.x, -at.y]
    }

    /// Where the place of its plane is seen.
    pub fn seen(&self, place: Place) -> Place {
        self.seen_behind(place, 0.0)
    }

    /// Where the place of the plane `behind_m` behind its own is seen, by Newton on [`Self::traced`].
    pub fn seen_behind(&self, place: Place, behind_m: f64) -> Place {
        const STEP_PX: f64 = 1e-3;
        let [width, height] = self.size_px.map(f64::from);
        let mut px = Vector2::new(width / 2.0, height / 2.0);
        for _ in 0..30 {
            let here = Vector2::from(self.traced(px.into(), behind_m));
            let slope = |off: Vector2<f64>| {
                (Vector2::from(self.traced((px + off).into(), behind_m)) - here) / STEP_PX
            };
            let (across, down) = (slope(Vector2::new(STEP_PX, 0.0)), slope(Vector2::new(0.0, STEP_PX)));
            let matrix = nalgebra::Matrix2::from_columns(&[across, down]);
            let step = matrix.lu().solve(&(Vector2::from(place) - here)).expect("a camera that sees");
            px += step;
            if step.norm() < 1e-9 {
                break;
            }
        }
        px.into()
    }
}

/// A printed board in the plane of motion or before or behind it.
pub trait Sheet {
    /// Its paint, 0 to 1, at a place of its plane, as [`WallCamera::traced`] counts \[m\]; `None` beside it.
    fn paint(&self, place: Place) -> Option<f64>;

    /// How much farther from the camera than the plane of motion it lies \[m\].
    fn behind_m(&self) -> f64;

    /// The corners that are looked for \[m\].
    fn corners(&self) -> Vec<Place>;
}

/// A chessboard in the plane of motion.
#[derive(Debug, Clone, Copy)]
pub struct PlacedBoard {
    /// Inner corners along its sides.
    pub corners: [usize; 2],
    /// Side of a square \[m\].
    pub square_m: f64,
    /// Where its middle lies, as [`WallCamera::traced`] counts \[m\].
    pub middle: Place,
    /// How it is turned \[rad\].
    pub turn_rad: f64,
    /// How much farther from the camera it lies \[m\].
    pub behind_m: f64,
}

impl PlacedBoard {
    /// In squares from its middle.
    fn squares(&self, place: Place) -> Vector2<f64> {
        Rotation2::new(-self.turn_rad) * (Vector2::from(place) - Vector2::from(self.middle)) / self.square_m
    }
}

impl Sheet for PlacedBoard {
    fn corners(&self) -> Vec<Place> {
        let [columns, rows] = self.corners;
        let half = Vector2::new(columns as f64 - 1.0, rows as f64 - 1.0) / 2.0;
        let place = |i: usize| {
            let squares = Vector2::new((i % columns) as f64, (i / columns) as f64) - half;
            (Rotation2::new(self.turn_rad) * squares * self.square_m + Vector2::from(self.middle)).into()
        };
        (0..columns * rows).map(place).collect()
    }

    fn behind_m(&self) -> f64 {
        self.behind_m
    }

    /// A white margin of half a square surrounds the squares.
    fn paint(&self, place: Place) -> Option<f64> {
        let [columns, rows] = self.corners.map(|count| count as f64);
        let at = self.squares(place) + Vector2::new(columns + 1.0, rows + 1.0) / 2.0;
        let within = |margin: f64| {
            at.x > -margin && at.y > -margin && at.x < columns + 1.0 + margin && at.y < rows + 1.0 + margin
        };
        let dark = (at.x.floor() + at.y.floor()).rem_euclid(2.0) == 0.0;
        within(0.5).then(|| if within(0.0) && dark { 0.1 } else { 1.0 })
    }
}

/// What a picture suffers from.
#[derive(Debug, Clone, Copy)]
pub struct Trouble {
    /// Blur of the lens, 1 sigma \[px\].
    pub blur_px: f64,
    /// Noise, 1 sigma \[grey levels\].
    pub noise: f64,
    /// How much less light there is on one side than on the other, as a share.
    pub uneven: f64,
    /// Light on white paper \[grey levels\].
    pub white: f64,
    /// A finger: its middle and radius \[px\].
    pub finger: Option<(Place, f64)>,
}

impl Trouble {
    /// What is usual.
    pub fn usual() -> Self {
        Self { blur_px: 0.8, noise: 6.0, uneven: 0.5, white: 200.0, finger: None }
    }
}

/// Samples of a pixel that an edge crosses.
const SAMPLES: usize = 36;
/// The golden section: steps of it fill a side evenly, whichever way an edge runs.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// What is behind the board, as paint.
const TANK: f64 = 0.35;

/// The picture that `camera` takes of `board`, of random numbers from `seed`.
pub fn picture(camera: &WallCamera, board: Option<&dyn Sheet>, trouble: &Trouble, seed: u64) -> GrayImage {
    let [width, height] = camera.size_px.map(|side| side as usize);
    let paint = |px: Place| {
        if let Some((middle, radius)) = trouble.finger
            && (px[0] - middle[0]).hypot(px[1] - middle[1]) < radius
        {
            return 0.7;
        }
        board.and_then(|board| board.paint(camera.traced(px, board.behind_m()))).unwrap_or(TANK)
    };
    let light = |[column, row]: Place| {
        let corners = [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]];
        let [first, others @ ..] = corners.map(|[x, y]| paint([column + x, row + y]));
        if others.iter().all(|&other| other == first) {
            return trouble.white * first;
        }
        let off = |i: usize| (i as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let across = |i: usize| ((i as f64 + 0.5) * GOLDEN).fract() - 0.5;
        let all = (0..SAMPLES).map(|i| paint([column + off(i), row + across(i)]));
        trouble.white * all.sum::<f64>() / SAMPLES as f64
    };
    let mut picture = Picture::of(width, height, light);
    let far = (width as f64).hypot(height as f64);
    picture.shine(|[column, row]| {
        let middle = (column - 0.3 * width as f64).hypot(row - 0.4 * height as f64) / far;
        (1.0 - trouble.uneven * column / width as f64) * (1.0 - 0.3 * middle * middle)
    });
    picture.blur(trouble.blur_px);
    picture.expose(trouble.noise, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// Ten places of a board's middle, spread over what `camera` sees, and how it is turned there \[rad\].
pub fn ten_places(camera: &WallCamera) -> Vec<(Place, f64)> {
    let [width, height] = camera.size_px.map(f64::from);
    let shares = [
        [0.5, 0.5, 0.0],
        [0.3, 0.35, 0.1],
        [0.7, 0.35, -0.2],
        [0.3, 0.65, 1.5],
        [0.7, 0.65, 0.3],
        [0.5, 0.35, 3.0],
        [0.5, 0.65, -0.1],
        [0.28, 0.5, 1.2],
        [0.72, 0.5, -1.6],
        [0.45, 0.55, 0.7],
    ];
    let middle =
        |[column, row, turn_rad]: [f64; 3]| (camera.traced([column * width, row * height], 0.0), turn_rad);
    shares.map(middle).into()
}

/// A chessboard at these ten places.
pub fn spread(camera: &WallCamera, corners: [usize; 2], square_m: f64) -> Vec<PlacedBoard> {
    let board = |(middle, turn_rad)| PlacedBoard { corners, square_m, middle, turn_rad, behind_m: 0.0 };
    ten_places(camera).into_iter().map(board).collect()
}
