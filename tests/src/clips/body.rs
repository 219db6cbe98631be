//! Rigid bodies that nothing holds, and how they move.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;

use super::picture::between;
use super::shape::{Px, Shape};

/// A rigid body; its centroid lies at (0, 0) and its long axis along the columns, the blunt end ahead.
#[derive(Debug, Clone)]
pub struct Body {
    /// What it looks like.
    pub kind: &'static str,
    /// Its outline \[px\].
    pub shapes: Vec<Shape>,
    /// Farthest place of it from its centroid \[px\].
    pub reach: f64,
}

/// How it moves: sums of sines for column, row and turn, amplitude, frequency \[Hz\], phase; and a steady turn \[rad/s\].
#[derive(Debug, Clone)]
pub struct Course {
    sines: [[[f64; 3]; 2]; 3],
    turning: f64,
    from: Px,
}

/// What swims, one after the other.
pub const KINDS: [&str; 5] = ["fish", "ellipse", "egg", "bracket", "disc"];

impl Body {
    /// The body of a kind, about 60 px long; `large` by half more.
    pub fn of(kind: &'static str, large: bool) -> Self {
        let s = if large { 1.5 } else { 1.0 };
        let egg = |x0: f64, r0: f64, x1: f64, r1: f64| Shape::Egg {
            ends: [[s * x0, 0.0], [s * x1, 0.0]],
            radii: [s * r0, s * r1],
        };
        let shapes = match kind {
            "fish" => vec![
                egg(12.0, 11.0, -28.0, 2.5),
                Shape::Egg { ends: [[s * -30.0, s * -8.0], [s * -30.0, s * 8.0]], radii: [s * 3.0; 2] },
            ],
            "ellipse" => vec![Shape::Ellipse { centre: [0.0; 2], axes: [s * 30.0, s * 12.0], turn: 0.0 }],
            "egg" => vec![egg(12.0, 16.0, -22.0, 8.0)],
            "bracket" => vec![
                Shape::Bar {
                    ends: [[s * -30.0, 0.0], [s * 30.0, 0.0]],
                    past: [0.0; 2],
                    half: s * 7.0,
                    round: 1.0,
                },
                Shape::Bar {
                    ends: [[s * 22.0, 0.0], [s * 22.0, s * 24.0]],
                    past: [0.0; 2],
                    half: s * 8.0,
                    round: 1.0,
                },
            ],
            _ => vec![Shape::Disc { centre: [0.0; 2], radius: s * 20.0 }],
        };
        Self::centred(kind, shapes)
    }

    /// Puts the centroid to (0, 0) and the blunt end ahead, by sums over a fine grid.
    fn centred(kind: &'static str, shapes: Vec<Shape>) -> Self {
        const STEP: f64 = 0.1;
        const SIDE: usize = 1200;
        let at = |i: usize| (i as f64 + 0.5) * STEP - SIDE as f64 * STEP / 2.0;
        let inside: Vec<Px> = (0..SIDE * SIDE)
            .map(|i| [at(i % SIDE), at(i / SIDE)])
            .filter(|p| shapes.iter().any(|shape| shape.distance(*p) < 0.0))
            .collect();
        let mean = |of: &dyn Fn(Px) -> f64| inside.iter().map(|p| of(*p)).sum::<f64>() / inside.len() as f64;
        let centre = [mean(&|p| p[0]), mean(&|p| p[1])];
        let off = |p: Px| [p[0] - centre[0], p[1] - centre[1]];
        let square = |a: usize, b: usize| mean(&|p| off(p)[a] * off(p)[b]);
        let mut angle = f64::atan2(2.0 * square(0, 1), square(0, 0) - square(1, 1)) / 2.0;
        let third = mean(&|p| (angle.cos() * off(p)[0] + angle.sin() * off(p)[1]).powi(3));
        if third > 1.0 {
            angle += std::f64::consts::PI;
        }
        let reach = inside.iter().map(|p| off(*p)[0].hypot(off(*p)[1])).fold(0.0, f64::max);
        let back = |shape: &Shape| shape.placed([-centre[0], -centre[1]], 0.0).placed([0.0; 2], -angle);
        Self { kind, shapes: shapes.iter().map(back).collect(), reach }
    }

    /// Whether a heading can be told.
    pub fn heads(&self) -> bool {
        self.kind != "disc"
    }

    /// A course through a picture of that size, so that it stays in sight.
    pub fn course(&self, [width, height]: Px, random: &mut ChaCha8Rng) -> Course {
        let mut sines = |room: f64, slowest: f64| {
            [0.7, 0.3].map(|share| {
                let speed = between(random, slowest, 3.0 * slowest);
                [share * room, speed, between(random, 0.0, TAU)]
            })
        };
        let room = |size: f64| size / 2.0 - 1.3 * self.reach - 4.0;
        let sines = [sines(room(width), 0.25), sines(room(height), 0.25), sines(1.2, 0.4)];
        Course { sines, turning: between(random, -4.0, 4.0), from: [width / 2.0, height / 2.0] }
    }

    /// Outline, and P0 and a P1 so far `ahead` \[px\], at `time_s`.
    pub fn at(&self, course: &Course, time_s: f64, ahead: f64) -> (Vec<Shape>, Vec<Px>) {
        let sum = |which: usize| -> f64 {
            course.sines[which].iter().map(|[a, f, p]| a * (TAU * f * time_s + p).sin()).sum()
        };
        let centre = [course.from[0] + sum(0), course.from[1] + sum(1)];
        let angle = sum(2) + course.turning * time_s;
        let mut points = vec![centre];
        if self.heads() {
            points.push([centre[0] + ahead * angle.cos(), centre[1] + ahead * angle.sin()]);
        }
        (self.shapes.iter().map(|shape| shape.placed(centre, angle)).collect(), points)
    }
}
