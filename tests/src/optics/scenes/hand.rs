//! A hand comes in from a border twice, and covers a part.

use crate::optics::actors::Actor;
use crate::optics::setting::Setting;
use crate::optics::texture::Texture;
use crate::optics::vec::v3;
use crate::optics::world::Material;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let skin = v3(0.62, 0.40, 0.30) * rng.random_range(0.7..1.1);
    let material = s.material(Material {
        gloss: 0.06,
        ..Material::matte(skin, Texture::Mottled { size_m: 0.006, share: 0.06 })
    });
    let length_m = s.mechanism.length_m();
    let lasts_s = s.images as f64 / s.fps;
    let angle_rad = [
        rng.random_range(-0.5..0.3),
        PI + rng.random_range(-0.3..0.5),
        PI * 0.5 + rng.random_range(-0.3..0.3),
    ][rng.random_range(0..3usize)];
    // The fingers reach a little past the middle of the mechanism.
    let reach = v3(rng.random_range(-0.1..0.25) * length_m, 0.0, 0.0).turned(angle_rad);
    let tip = reach + v3(0.0, rng.random_range(-0.06..-0.035), -length_m * rng.random_range(0.4..0.7));
    s.actors.push(Actor::Hand {
        tip,
        angle_rad,
        size: rng.random_range(0.75..0.95),
        visits_s: vec![(lasts_s * 0.12, lasts_s * 0.5), (lasts_s * 0.65, lasts_s * 0.98)],
        material,
    });
}
