//! Rods before and behind the mechanism, on a wall of tiles or with algae.

use crate::optics::setting::Setting;
use crate::optics::solids::{Shape, Solid};
use crate::optics::texture::Texture;
use crate::optics::vec::{V3, v3};
use crate::optics::world::{FOREIGN, Material};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    super::usual::wall(s, rng);
    let length_m = s.mechanism.length_m();
    let half_m = s.view_width_m() * 0.45;
    for i in 0..6 {
        let is_before = i < 2;
        let hue = v3(rng.random_range(0.6..1.0), rng.random_range(0.7..1.0), rng.random_range(0.6..1.0));
        let metal = Material {
            gloss: 0.3,
            ..Material::matte(
                hue * rng.random_range(0.05..0.6),
                Texture::Mottled { size_m: 0.005, share: 0.08 },
            )
        };
        let material = s.material(metal);
        let y_m = if is_before {
            rng.random_range(-0.1..-0.04)
        } else {
            rng.random_range(0.03..s.world.tank.back_y_m - 0.01)
        };
        let r = length_m * rng.random_range(0.008..0.022);
        let steep = rng.random_bool(0.7);
        let lean: f64 = rng.random_range(-0.35..0.35);
        let along = if steep { v3(lean, 0.0, 1.0) } else { v3(1.0, 0.0, lean) };
        let middle = v3(rng.random_range(-half_m..half_m), y_m, -length_m * rng.random_range(0.2..0.9));
        let reach = along * 0.6;
        s.world.fixed.push(rod(middle - reach, middle + reach, r, material));
    }
}

fn rod(a: V3, b: V3, r: f64, material: usize) -> Solid {
    Solid::new(Shape::RoundCone { a, b, ra_m: r, rb_m: r, cut: None }, material, FOREIGN)
}
