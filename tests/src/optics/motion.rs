//! Motions: drawn sums of sines whose phase travels along the links.

use crate::optics::mechanism::{Kind, Mechanism, Pose};
use crate::optics::vec::{V3, v3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// One sine of one hinge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sine {
    pub(crate) amplitude_rad: f64,
    pub(crate) rate_hz: f64,
    pub(crate) phase_rad: f64,
}

/// The course of a hinge: a rest angle and sines about it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Course {
    pub(crate) rest_rad: f64,
    pub(crate) sines: Vec<Sine>,
}

/// The course of a whole mechanism.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    pub(crate) root: V3,
    pub(crate) hinges: Vec<Course>,
    /// How far a free body swims: half the way along x and z, its rate, and half its turn.
    pub(crate) swim_m: (f64, f64),
    pub(crate) swim_hz: f64,
    pub(crate) swim_turn_rad: f64,
}

impl Course {
    fn at(&self, t_s: f64) -> f64 {
        self.rest_rad
            + self
                .sines
                .iter()
                .map(|s| s.amplitude_rad * (TAU * s.rate_hz * t_s + s.phase_rad).sin())
                .sum::<f64>()
    }
}

impl Motion {
    /// Draws a motion; `faster` multiplies all rates.
    pub(crate) fn drawn(m: &Mechanism, faster: f64, rng: &mut ChaCha8Rng) -> Motion {
        let n = m.links.len();
        let count = rng.random_range(2..=3);
        let waves: Vec<(f64, f64, f64, f64)> = (0..count)
            .map(|_| {
                let share = rng.random_range(0.4..1.0);
                let rate_hz = rng.random_range(0.4..1.5) * faster;
                (share, rate_hz, rng.random_range(0.0..TAU), rng.random_range(0.4..1.4))
            })
            .collect();
        let sum: f64 = waves.iter().map(|w| w.0).sum();
        let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let root_rad: f64 = rng.random_range(0.35..0.7);
        let bend_rad: f64 = rng.random_range(1.0..1.9);
        let hinge_rad: f64 = rng.random_range(0.45..0.9);
        let course = |i: usize| {
            let (most_rad, lag) = match (m.kind, i) {
                (_, 0) => (root_rad, 0.0),
                (Kind::Chain, i) => (hinge_rad, i as f64),
                // Bending more towards the thin end, in all no more than was drawn.
                (_, i) => (bend_rad / 7.0 * (0.8 + 0.05 * i as f64), i as f64 * 0.25),
            };
            let sines = waves
                .iter()
                .map(|&(share, rate_hz, phase, delay)| Sine {
                    amplitude_rad: most_rad * share / sum,
                    rate_hz,
                    phase_rad: phase - delay * lag * side,
                })
                .collect();
            Course { rest_rad: 0.0, sines }
        };
        let mut motion = Motion {
            root: V3::ZERO,
            hinges: (0..n).map(course).collect(),
            swim_m: (0.0, 0.0),
            swim_hz: 0.0,
            swim_turn_rad: 0.0,
        };
        if m.kind == Kind::Octopus {
            motion.swim_m = (rng.random_range(0.002..0.02), rng.random_range(0.005..0.02));
            motion.swim_hz = rng.random_range(0.3..0.7);
            motion.swim_turn_rad = rng.random_range(0.05..0.3);
            motion.scale(0.5);
            let one = motion.hinges.clone();
            motion.hinges = (0..8).flat_map(|_| one.clone()).collect();
        }
        motion
    }

    /// Multiplies every amplitude.
    pub(crate) fn scale(&mut self, by: f64) {
        for s in self.hinges.iter_mut().flat_map(|h| h.sines.iter_mut()) {
            s.amplitude_rad *= by;
        }
    }

    /// The pose at a time.
    pub(crate) fn at(&self, t_s: f64) -> Pose {
        let s = (TAU * self.swim_hz * t_s).sin();
        let c = (TAU * self.swim_hz * 1.3 * t_s + 0.7).sin();
        Pose {
            root: self.root + v3(self.swim_m.0 * c, 0.0, self.swim_m.1 * s),
            turn_rad: self.swim_turn_rad * (TAU * self.swim_hz * 0.6 * t_s).sin(),
            angles_rad: self.hinges.iter().map(|h| h.at(t_s)).collect(),
        }
    }
}
