//! A fish passes behind the mechanism, and then before it.

use crate::optics::actors::Actor;
use crate::optics::setting::Setting;
use crate::optics::texture::Texture;
use crate::optics::vec::v3;
use crate::optics::world::Material;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    super::usual::wall(s, rng);
    let hues = [v3(0.42, 0.45, 0.46), v3(0.75, 0.36, 0.12), v3(0.25, 0.3, 0.26)];
    let hue = hues[rng.random_range(0..3usize)];
    let material =
        s.material(Material { gloss: 0.15, ..Material::matte(hue, Texture::Scales { size_m: 0.0012 }) });
    let fin = s.material(Material::matte(hue * 0.6, Texture::Plain));
    let length_m = s.mechanism.length_m();
    let half_length_m = length_m * rng.random_range(0.14..0.22);
    let lasts_s = s.images as f64 / s.fps * 0.4;
    let half_way_m = s.view_width_m() * 0.6 + half_length_m * 2.5;
    let speed = 2.0 * half_way_m / lasts_s;
    let start = |side: f64, y_m: f64, z: f64| v3(-side * half_way_m, y_m, -z * length_m);
    let passages = vec![
        (lasts_s * 0.15, start(1.0, rng.random_range(0.035..0.07), rng.random_range(0.35..0.65)), speed),
        (lasts_s * 1.35, start(-1.0, rng.random_range(-0.07..-0.045), rng.random_range(0.3..0.75)), -speed),
    ];
    s.actors.push(Actor::Fish { passages, lasts_s, half_length_m, material, fin });
}
