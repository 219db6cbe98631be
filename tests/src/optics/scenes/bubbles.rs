//! Air bubbles rise before and behind the mechanism.

use crate::optics::actors::Actor;
use crate::optics::setting::Setting;
use crate::optics::texture::Texture;
use crate::optics::vec::{V3, v3};
use crate::optics::world::Material;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    super::usual::wall(s, rng);
    let material = s.material(Material { is_bubble: true, ..Material::matte(V3::ZERO, Texture::Plain) });
    let length_m = s.mechanism.length_m();
    let half_m = s.view_width_m() * 0.5;
    let each = (0..rng.random_range(30..45))
        .map(|_| {
            let r: f64 = rng.random_range(0.0f64..1.0).powi(2) * 0.0030 + 0.0008;
            let start = v3(
                rng.random_range(-half_m..half_m),
                rng.random_range(-0.07..0.07),
                rng.random_range(-1.6..0.6) * length_m,
            );
            (start, r * length_m / 0.16 + 0.0002, rng.random_range(0.16..0.3), rng.random_range(0.0..TAU))
        })
        .collect();
    s.actors.push(Actor::Bubbles { each, material, from_z_m: -1.6 * length_m, to_z_m: 0.6 * length_m });
}
