//! A film of one level of difficulty.

use std::f64::consts::TAU;

use camera::calibration::Plane;
use ground::strict::Finite;
use image::GrayImage;
use images::TimedImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use vision::{Ahead, VisionConfig};

use super::body::{Body, KINDS};
use super::mechanism::Mechanism;
use super::octopus::{self, Swimming};
use super::picture::{Picture, between};
use super::shape::{Px, Shape};
use super::subject::Subject;

/// How hard the pictures are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Even light, little noise.
    Clean,
    /// Uneven light, dirt, noise, a motor in front of the root.
    Usual,
    /// One of: a bar across the picture, little contrast, bubbles, caustics, flicker.
    Hard,
    /// As clean, but some images are black, torn, repeated or saturated, and something swims past.
    Broken,
}

impl Level {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 4] =
        [("clean", Self::Clean), ("usual", Self::Usual), ("hard", Self::Hard), ("broken", Self::Broken)];
}

/// What an image really shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// P0..Pn \[px\].
    pub points: Vec<Px>,
    /// What is wrong with the image itself, if anything, or covers what it shows.
    pub trouble: Option<&'static str>,
}

/// A film with its truth.
#[derive(Debug)]
pub struct Clip {
    /// Level, mechanism and seed, and what makes it hard.
    pub name: String,
    /// Its images.
    pub images: Vec<TimedImage>,
    /// What each shows.
    pub truth: Vec<Truth>,
    /// What its maker would say of it.
    pub config: VisionConfig,
    /// Pixels to metres.
    pub plane: Plane,
    /// The model of what is filmed, where its maker has one.
    pub model: Option<sim::Model>,
}

/// Images a second.
const FPS: f64 = 50.0;
/// What makes a film hard.
const HARD_CONDITIONS: [&str; 5] = ["bar", "low contrast", "bubbles", "caustics", "flicker"];
/// How well somebody who clicks on P0 meets it \[px\].
const BASE_CLICK_ERROR_PX: f64 = 3.0;

/// All that is drawn once for a film.
struct Tank {
    level: f64,
    slope: [f64; 2],
    vignette: f64,
    specks: Vec<Shape>,
    motor: Vec<Shape>,
    hardship: Option<&'static str>,
    bar: Shape,
    bubbles: Vec<[f64; 4]>,
    contrast: f64,
    blur: f64,
    noise: f64,
    /// Whether something swims past.
    swims: bool,
    /// Width and height of the picture \[px\].
    size: [f64; 2],
}

/// The film of `seconds` \[s\] at `level` that `seed` draws; odd seeds are arms, each third chain is of odd sizes; `large`: 1280 by 720.
pub fn clip(level: Level, seed: u64, seconds: f64, large: bool) -> Clip {
    let random = &mut ChaCha8Rng::seed_from_u64(seed.wrapping_mul(7919) + level as u64);
    let (width, height) = if large { (1280, 720) } else { (640, 480) };
    let arm = seed % 2 == 1;
    let scale = match (arm, large) {
        (false, false) => 0.00025,
        (false, true) => 0.00015,
        (true, false) => 0.0005,
        (true, true) => 0.00032,
    };
    let mechanism = if arm { Mechanism::arm(scale) } else { Mechanism::chain(random, scale, seed % 6 == 4) };
    let motion = mechanism.motion(random);
    let base =
        [width as f64 / 2.0 + between(random, -8.0, 8.0), 0.13 * height as f64 + between(random, -3.0, 3.0)];
    let count = (seconds * FPS).round() as usize;
    let scenes = (0..count).map(|i| mechanism.at(&motion, base, i as f64 / FPS)).collect();
    let subject = Subject::Held(&mechanism);
    Film { level, seed, size: [width, height], base, fps: FPS, subject, scale }.shot(scenes, random)
}

/// The film of a rigid body that nothing holds, of the kind `seed` modulo their number; as [`clip`].
pub fn body_clip(level: Level, seed: u64, seconds: f64, large: bool) -> Clip {
    /// Where P1 is put ahead of P0 \[px\].
    const AHEAD_PX: f64 = 30.0;
    let random = &mut ChaCha8Rng::seed_from_u64(seed.wrapping_mul(104_729) + level as u64);
    let (width, height) = if large { (1280, 720) } else { (640, 480) };
    let body = Body::of(KINDS[seed as usize % KINDS.len()], large);
    let course = body.course([width as f64, height as f64], random);
    let count = (seconds * FPS).round() as usize;
    let scenes: Vec<(Vec<Shape>, Vec<Px>)> =
        (0..count).map(|i| body.at(&course, i as f64 / FPS, AHEAD_PX)).collect();
    // Where both ends look alike, somebody has to say which is ahead.
    let ahead = match scenes.first().map(|(_, points)| points.as_slice()) {
        Some([centre, point]) if body.kind == "ellipse" => {
            if point[0] > centre[0] {
                Ahead::Right
            } else {
                Ahead::Left
            }
        }
        _ => Ahead::Blunt,
    };
    let (subject, base) = (Subject::Free(&body, AHEAD_PX, ahead), [width as f64 / 2.0, height as f64 / 2.0]);
    Film { level, seed, size: [width, height], base, fps: FPS, subject, scale: 0.0005 }.shot(scenes, random)
}

/// The film of the shipped octopus: every third seed as it is simulated, the next turning, the next with each arm by itself; as [`clip`].
pub fn octopus_clip(level: Level, seed: u64, seconds: f64, large: bool) -> Clip {
    let random = &mut ChaCha8Rng::seed_from_u64(seed.wrapping_mul(15_485_863) + level as u64);
    let (size, scale) = if large { ([1280, 720], 0.0004) } else { ([640, 480], 0.0007) };
    let swimming = [Swimming::Stroke, Swimming::Course, Swimming::Apart][seed as usize % 3];
    let model = octopus::model();
    let base = [size[0] as f64 / 2.0, 0.36 * size[1] as f64];
    let times_s: Vec<f64> = (0..(seconds * FPS).round() as usize).map(|i| i as f64 / FPS).collect();
    let poses = octopus::motion(&model, swimming, &times_s, random);
    let scenes = poses.iter().map(|qpos| octopus::seen(&model, qpos, base, scale)).collect();
    let subject = Subject::Octopus(swimming);
    let clip = Film { level, seed, size, base, fps: FPS, subject, scale }.shot(scenes, random);
    Clip { model: Some(model), ..clip }
}

/// A film of 640 by 480 at `level` of a chain whose motion is prescribed: `points` are P0..Pn \[px\], one row an image, `fps` a second;
/// `scale` \[m/px\]. The world origin is at P0 of the first image.
pub fn prescribed_clip(
    level: Level,
    seed: u64,
    mechanism: &Mechanism,
    scale: f64,
    points: Vec<Vec<Px>>,
    fps: f64,
) -> Clip {
    let random = &mut ChaCha8Rng::seed_from_u64(seed);
    let base = points[0][0];
    let scenes = points.into_iter().map(|points| (mechanism.through(&points), points)).collect();
    let subject = Subject::Held(mechanism);
    Film { level, seed, size: [640, 480], base, fps, subject, scale }.shot(scenes, random)
}

/// What is filmed and how.
struct Film<'a> {
    level: Level,
    seed: u64,
    size: [usize; 2],
    base: Px,
    fps: f64,
    subject: Subject<'a>,
    scale: f64,
}

impl Film<'_> {
    /// The film of some scenes, an outline and its P0..Pn each.
    fn shot(&self, scenes: Vec<(Vec<Shape>, Vec<Px>)>, random: &mut ChaCha8Rng) -> Clip {
        let Self { level, seed, size: [width, height], base, fps, subject, scale } = *self;
        let tank = Tank::drawn(level, seed, [width as f64, height as f64], base, subject.held(), random);
        let mut images: Vec<GrayImage> = Vec::with_capacity(scenes.len());
        let mut truth = Vec::with_capacity(scenes.len());
        for (i, (shapes, points)) in scenes.into_iter().enumerate() {
            let time_s = i as f64 / fps;
            let trouble = if level == Level::Broken { trouble(i) } else { None };
            let grey = match trouble {
                Some("repeated") => images[i - 1].clone(),
                Some("torn") => {
                    let now = tank.picture(&shapes, width, height, (i, time_s), random);
                    let cut = height as u32 / 2;
                    GrayImage::from_fn(width as u32, height as u32, |x, y| {
                        *if y < cut { &images[i - 1] } else { &now }.get_pixel(x, y)
                    })
                }
                Some("black") => Picture::of(width, height, |_| 3.0).expose(1.5, random),
                Some("saturated") => Picture::of(width, height, |_| 400.0).expose(2.0, random),
                _ => tank.picture(&shapes, width, height, (i, time_s), random),
            };
            images.push(grey);
            let covered = tank.things(i).iter().any(|thing| subject.meets(&points, thing));
            // Nothing that swims past hides what hangs; what is free meets it or does not.
            let trouble = trouble.filter(|what| *what != "swimmer" || subject.held().is_some());
            truth.push(Truth { points, trouble: trouble.or(covered.then_some("covered")) });
        }
        let timed = |(i, grey): (usize, GrayImage)| TimedImage {
            name: format!("{i:05}"),
            time_s: i as f64 / fps,
            chroma: None,
            grey: Ok(grey),
        };
        let click =
            base.map(|place| Finite::new(place + between(random, -BASE_CLICK_ERROR_PX, BASE_CLICK_ERROR_PX)));
        let kind = subject.kind();
        let name = Level::ALL.iter().find(|(_, one)| *one == level).map_or("", |(name, _)| name);
        let hardship = tank.hardship.map_or(String::new(), |what| format!(" ({what})"));
        Clip {
            name: format!("{name} {kind} {seed}{hardship}"),
            images: images.into_iter().enumerate().map(timed).collect(),
            truth,
            config: subject.config(scale, click),
            plane: Plane::square(scale, base),
            model: None,
        }
    }
}

/// What is wrong with image `i` of a broken film: something every 13 images; the body swims by from the 30th on.
fn trouble(i: usize) -> Option<&'static str> {
    match i {
        0..8 => None,
        30..50 => Some("swimmer"),
        _ if !i.is_multiple_of(13) => None,
        _ => Some(["black", "torn", "repeated", "saturated"][i / 13 % 4]),
    }
}

impl Tank {
    fn drawn(
        level: Level,
        seed: u64,
        [width, height]: [f64; 2],
        base: Px,
        held: Option<f64>,
        random: &mut ChaCha8Rng,
    ) -> Self {
        let usual = level == Level::Usual;
        let hardship =
            (level == Level::Hard).then(|| HARD_CONDITIONS[(seed / 2) as usize % HARD_CONDITIONS.len()]);
        let strength = if usual { 1.0 } else { 0.1 };
        let speck = |random: &mut ChaCha8Rng| Shape::Disc {
            centre: [between(random, 0.0, width), between(random, 0.0, height)],
            radius: between(random, 0.8, 2.5),
        };
        let half = held.unwrap_or_default();
        // The motor hides P0 and what is above it.
        let bracket = |from: f64, to: f64, half: f64| Shape::Bar {
            ends: [[base[0], from], [base[0], to]],
            past: [0.0; 2],
            half,
            round: 0.0,
        };
        let motor = vec![
            bracket(-20.0, base[1] + 0.4 * half, 1.9 * half),
            bracket(-20.0, base[1] - half, 4.0 * half),
        ];
        let across = between(random, 0.45, 0.7) * height;
        Self {
            level: between(random, 150.0, 190.0),
            slope: [0, 1].map(|_| strength * between(random, -0.25, 0.25)),
            vignette: strength * between(random, 0.1, 0.3),
            specks: if usual { (0..25).map(|_| speck(random)).collect() } else { Vec::new() },
            motor: if usual && held.is_some() { motor } else { Vec::new() },
            hardship,
            bar: Shape::Bar {
                ends: [[-20.0, across], [width + 20.0, across + between(random, -40.0, 40.0)]],
                past: [0.0; 2],
                half: 0.011 * width,
                round: 0.0,
            },
            bubbles: (0..12)
                .map(|_| {
                    let [column, row] = [between(random, 0.0, width), between(random, 0.0, height)];
                    [column, row, between(random, 4.0, 12.0), between(random, 60.0, 160.0)]
                })
                .collect(),
            contrast: if hardship == Some("low contrast") { 0.25 } else { between(random, 0.6, 0.75) },
            blur: if usual { 0.8 } else { 0.6 },
            noise: if usual { between(random, 4.0, 6.0) } else { 2.0 },
            swims: level == Level::Broken,
            size: [width, height],
        }
    }

    /// What swims past in image `i`.
    fn swimmer(&self, i: usize) -> Option<Shape> {
        let [w, h] = self.size;
        (self.swims && trouble(i) == Some("swimmer")).then(|| {
            let along = (i as f64 - 30.0) / 20.0;
            let centre = [w * (1.1 - 1.2 * along), h * (0.55 + 0.03 * (9.0 * along).sin())];
            Shape::Bar {
                ends: [[centre[0] - 28.0, centre[1]], [centre[0] + 28.0, centre[1] + 6.0]],
                past: [8.0; 2],
                half: 11.0,
                round: 11.0,
            }
        })
    }

    /// What can cover something in image `i`, or merge with it.
    fn things(&self, i: usize) -> Vec<Shape> {
        let bar = (self.hardship == Some("bar")).then(|| self.bar.clone());
        bar.into_iter().chain(self.swimmer(i)).collect()
    }

    fn picture(
        &self,
        shapes: &[Shape],
        width: usize,
        height: usize,
        (i, time_s): (usize, f64),
        random: &mut ChaCha8Rng,
    ) -> GrayImage {
        let (w, h) = (width as f64, height as f64);
        let light = |[x, y]: Px| {
            let (u, v) = (x / w - 0.5, y / h - 0.5);
            self.level * (1.0 + self.slope[0] * u + self.slope[1] * v - self.vignette * 2.0 * (u * u + v * v))
        };
        let mut picture = Picture::of(width, height, light);
        picture.draw(&self.specks, |_, light| 0.5 * light);
        if self.hardship == Some("bar") {
            picture.draw(std::slice::from_ref(&self.bar), |_, light| 0.35 * light);
        }
        picture.draw(shapes, |p, _| (1.0 - self.contrast) * light(p));
        picture.draw(&self.motor, |p, _| 0.3 * light(p));
        match self.hardship {
            Some("bubbles") => {
                for [column, row, radius, speed] in &self.bubbles {
                    let centre = [*column, (row - speed * time_s).rem_euclid(h)];
                    let ring = |radius: f64, half: f64| Shape::Ring { centre, radius, half };
                    picture.draw(&[ring(*radius, 1.2)], |_, light| 0.6 * light);
                    picture.draw(&[ring(radius - 2.5, 1.0)], |_, light| (1.25 * light).min(250.0));
                }
            }
            Some("caustics") => {
                let wave = |[x, y]: Px, k: f64, turn: f64, f: f64| {
                    (TAU * ((x * turn.cos() + y * turn.sin()) / k + f * time_s)).sin()
                };
                picture.shine(|p| {
                    let sum = wave(p, 71.0, 0.4, 0.9) + wave(p, 53.0, 1.9, -1.1) + wave(p, 97.0, 2.7, 0.6);
                    1.0 + 0.05 * (sum / 1.5).powi(3)
                });
            }
            Some("flicker") => picture.shine(|_| 1.0 + 0.05 * (TAU * 7.0 * time_s).sin()),
            _ => {}
        }
        if let Some(body) = self.swimmer(i) {
            picture.draw(&[body], |p, _| 0.4 * light(p));
        }
        picture.blur(self.blur);
        picture.expose(self.noise, random)
    }
}
