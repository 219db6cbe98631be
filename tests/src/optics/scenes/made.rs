//! Scenes that change how the mechanism is made.

use crate::optics::mechanism::{Kind, Made};
use crate::optics::setting::Setting;
use crate::optics::vec::v3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A flat ribbon 24 mm deep, with its flank lit from a side.
pub(crate) fn ribbon(s: &mut Setting, rng: &mut ChaCha8Rng) {
    if s.mechanism.kind == Kind::Arm {
        s.mechanism.made = Made::Ribbon { half_depth_m: 0.012 };
    }
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let l = &mut s.world.light;
    l.middle =
        v3(side * rng.random_range(0.2..0.35), rng.random_range(-0.15..-0.03), rng.random_range(0.1..0.25));
    l.colour = l.colour * 1.6;
    // Only a bright mechanism shows its flank.
    s.wall_level = rng.random_range(0.12..0.22);
    s.body_level = rng.random_range(0.45..0.6);
    s.body_hue = v3(1.0, 0.8, 0.6);
}

/// The links in two layers, one behind the other.
pub(crate) fn layers(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let apart_m = rng.random_range(0.004..0.008);
    let first = if rng.random_bool(0.5) { 0.5 } else { -0.5 };
    for (i, link) in s.mechanism.links.iter_mut().enumerate() {
        link.layer_m = if i % 2 == 0 { first } else { -first } * apart_m;
        link.half_m[1] = link.half_m[1].min(0.49 * apart_m);
    }
}
