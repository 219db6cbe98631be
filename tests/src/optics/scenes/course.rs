//! Scenes that change how the mechanism moves, and how the camera samples it in time.

use crate::optics::actors::Actor;
use crate::optics::motion::Motion;
use crate::optics::setting::Setting;
use crate::optics::vec::v3;
use crate::optics::world::BODY;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A long exposure of a fast motion.
pub(crate) fn blur(s: &mut Setting, rng: &mut ChaCha8Rng) {
    s.motion = Motion::drawn(&s.mechanism, 1.6, rng);
    s.exposure_s = 0.009;
    s.instants = 36;
}

/// The last row is exposed 20 ms after the first one.
pub(crate) fn rolling(s: &mut Setting, _: &mut ChaCha8Rng) {
    s.readout_s = 0.020;
}

/// Less than three degrees in all, about a bent pose.
pub(crate) fn still(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let all: f64 = amplitudes(&s.motion);
    s.motion.scale(1.3f64.to_radians() / all);
    bend(s, rng.random_range(-0.5..0.5), rng);
}

/// Moves by less than its own width, to one side.
pub(crate) fn one_sided(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let all: f64 = amplitudes(&s.motion);
    let wanted = 1.6 * s.mechanism.half_width_m() / s.mechanism.length_m() * 1.5;
    s.motion.scale(wanted / all);
    bend(s, wanted, rng);
}

/// A second mechanism of the same sizes a little behind, with its own motion.
pub(crate) fn two(s: &mut Setting, rng: &mut ChaCha8Rng) {
    s.motion.scale(0.65);
    let mut motion = Motion::drawn(&s.mechanism, 1.0, rng);
    motion.scale(0.6);
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    motion.root = v3(
        side * s.view_width_m() * rng.random_range(0.2..0.28),
        0.02,
        rng.random_range(-0.05..0.0) * s.mechanism.length_m(),
    );
    s.actors.push(Actor::Twin { motion, material: BODY });
}

fn amplitudes(m: &Motion) -> f64 {
    m.hinges.iter().flat_map(|h| &h.sines).map(|s| s.amplitude_rad).sum()
}

/// A rest pose bent by this much in all at the root, and by as much again along the links.
fn bend(s: &mut Setting, root_rad: f64, rng: &mut ChaCha8Rng) {
    let n = s.motion.hinges.len() as f64;
    for (i, h) in s.motion.hinges.iter_mut().enumerate() {
        h.rest_rad = if i == 0 { root_rad } else { rng.random_range(0.2..1.0) * root_rad / n };
    }
}
