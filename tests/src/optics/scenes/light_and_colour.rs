//! Scenes that change light, colours and levels.

use crate::optics::light::{Caustics, PassingShadow};
use crate::optics::setting::Setting;
use crate::optics::vec::{V3, v3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A quarter of the usual contrast, and nearly the wall's colour.
pub(crate) fn low_contrast(s: &mut Setting, rng: &mut ChaCha8Rng) {
    s.wall_level = rng.random_range(0.38..0.6);
    s.body_level = s.wall_level + if rng.random_bool(0.5) { 0.14 } else { -0.14 };
    s.body_hue =
        s.wall_hue.times(v3(1.0 + rng.random_range(-0.08..0.08), 1.0, 1.0 + rng.random_range(-0.08..0.08)));
    super::usual::wall(s, rng);
}

/// As bright as the wall, of another hue.
pub(crate) fn equal_luma(s: &mut Setting, rng: &mut ChaCha8Rng) {
    s.wall_level = rng.random_range(0.42..0.58);
    s.body_level = s.wall_level;
    let pairs = [
        (v3(0.75, 0.95, 1.15), v3(1.0, 0.5, 0.28)),
        (v3(0.7, 1.0, 0.85), v3(1.0, 0.45, 0.55)),
        (v3(1.0, 0.95, 0.85), v3(0.35, 0.6, 1.2)),
    ];
    (s.wall_hue, s.body_hue) = pairs[rng.random_range(0..3usize)];
    // Even light, so that it holds all over the picture.
    s.world.light.colour = s.world.light.colour * 0.5;
    s.world.light.ambient = s.world.light.ambient * 1.6;
}

/// A bright mechanism before a dark wall, lit steeply from above: its upper edges shine.
pub(crate) fn lit_rim(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let l = &mut s.world.light;
    l.middle = v3(rng.random_range(-0.08..0.08), rng.random_range(-0.10..-0.04), rng.random_range(0.14..0.2));
    l.colour = l.colour * 1.6;
    l.ambient = l.ambient * 0.3;
    l.fill = l.fill * 0.35;
    s.wall_level = rng.random_range(0.07..0.12);
    s.body_level = rng.random_range(0.42..0.5);
    s.body_hue = v3(1.0, 0.96, 0.9);
}

/// Exposure drifts by 15 %.
pub(crate) fn drift(s: &mut Setting, rng: &mut ChaCha8Rng) {
    s.sensor.exposure_drift = 0.15;
    s.sensor.white_drift = 0.03;
    s.sensor.drift_hz = rng.random_range(0.25..0.6);
}

/// A net of light on everything, and a shadow that passes.
pub(crate) fn caustics(s: &mut Setting, rng: &mut ChaCha8Rng) {
    super::usual::wall(s, rng);
    let l = &mut s.world.light;
    l.colour = l.colour * 2.5;
    l.ambient = l.ambient * 0.5;
    l.fill = V3::all(0.12);
    l.caustics = Some(Caustics {
        size_m: rng.random_range(0.025..0.045),
        strength: rng.random_range(0.7..1.0),
        speed_hz: rng.random_range(1.0..2.0),
    });
    let lasts_s = s.images as f64 / s.fps;
    l.passing_shadow = Some(PassingShadow {
        from_s: lasts_s * 0.35,
        speed_m_per_s: 0.5 * s.mechanism.length_m() / 0.16 * 2.4 / lasts_s,
        half_width_m: rng.random_range(0.02..0.04),
        depth: rng.random_range(0.5..0.75),
        start_x_m: -s.mechanism.length_m() * 1.5,
    });
}
