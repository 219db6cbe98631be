//! The water's surface at the top, which mirrors wall and mechanism.

use crate::optics::setting::Setting;
use crate::optics::tank::Surface;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    super::usual::wall(s, rng);
    s.root_share = 0.3;
    s.length_share = s.length_share.min(0.58);
    let waves = (0..5)
        .map(|_| {
            let length_m: f64 = rng.random_range(0.012..0.07);
            // Ripples of water: gravity and surface tension.
            let k = TAU / length_m;
            let rate_hz = (9.81 * k + 7.3e-5 * k.powi(3)).sqrt() / TAU;
            let slope = rng.random_range(0.01..0.035);
            (rng.random_range(0.0..2.0 * PI), length_m, slope / k, rate_hz, rng.random_range(0.0..TAU))
        })
        .collect();
    s.world.tank.surface = Some(Surface { z_m: s.mechanism.length_m() * rng.random_range(0.12..0.2), waves });
    s.world.haze = crate::optics::vec::v3(0.05, 0.07, 0.075);
}
