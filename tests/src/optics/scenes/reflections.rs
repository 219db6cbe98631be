//! The glass mirrors a window of the room faintly, and somebody who walks by.

use crate::optics::glass::{Room, specks};
use crate::optics::setting::Setting;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let window_level = rng.random_range(0.013..0.026) * if s.wall_level > 0.4 { 2.2 } else { 1.0 };
    s.glass.room = Some(Room {
        window_level,
        window_x_m: rng.random_range(-0.4..0.4),
        window_z_m: rng.random_range(-0.1..0.2),
        walker_level: window_level * rng.random_range(0.35..0.6),
        walker_start_m: -0.9,
        walker_m_per_s: 1.8 / (s.images as f64 / s.fps),
    });
    s.glass.specks = specks(8, rng.random_range(0..1_000_000), s.camera.width_px, s.camera.height_px);
}
