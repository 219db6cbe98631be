//! What a tank usually looks like: a wall of tiles or with algae, a holder before the root, dirt on the glass.

use crate::optics::glass::specks;
use crate::optics::mechanism::Kind;
use crate::optics::setting::Setting;
use crate::optics::solids::{Shape, Solid};
use crate::optics::texture::Texture;
use crate::optics::vec::v3;
use crate::optics::world::{FLOOR, FOREIGN, HOLDER, WALL};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(crate) fn change(s: &mut Setting, rng: &mut ChaCha8Rng) {
    wall(s, rng);
    if s.mechanism.kind != Kind::Octopus {
        holder(s, rng);
    }
    s.glass.specks = specks(
        rng.random_range(10..22),
        rng.random_range(0..1_000_000),
        s.camera.width_px,
        s.camera.height_px,
    );
    s.glass.vignette = rng.random_range(0.15..0.35);
    // The light stands aside, so that the picture is brighter on one side.
    s.world.light.middle.x += if rng.random_bool(0.5) { 0.15 } else { -0.15 };
    s.world.haze = v3(0.05, 0.07, 0.075);
}

/// A textured wall; what is dark stays dark on the whole.
pub(crate) fn wall(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let texture = if rng.random_bool(0.5) {
        Texture::Tiles {
            size_m: rng.random_range(0.018..0.03),
            joint_m: rng.random_range(0.001..0.002),
            joint_level: if s.wall_level > 0.4 {
                rng.random_range(0.5..0.75)
            } else {
                rng.random_range(1.2..1.6)
            },
            spread: rng.random_range(0.04..0.1),
            shift_m: (rng.random_range(0.0..0.02), rng.random_range(0.0..0.02)),
        }
    } else {
        Texture::Algae { size_m: rng.random_range(0.02..0.05), cover: rng.random_range(0.2..0.5) }
    };
    s.world.materials[WALL].texture = texture;
    s.world.materials[FLOOR].texture = Texture::Algae { size_m: 0.01, cover: 0.3 };
    // In every other film the floor comes into view below.
    if rng.random_bool(0.5) {
        s.world.tank.floor_z_m = -s.mechanism.length_m() * rng.random_range(1.25..1.4) - 0.01;
    }
}

/// A motor before the root, which covers it, on a rod that comes from above.
pub(crate) fn holder(s: &mut Setting, rng: &mut ChaCha8Rng) {
    let px_m = s.mechanism.length_m() / (s.length_share * s.camera.height_px as f64);
    let below_m = rng.random_range(8.0..15.0) * px_m;
    let (half_x, height) =
        (s.mechanism.half_width_m() + rng.random_range(0.004..0.010), rng.random_range(0.018..0.03));
    let front = s.mechanism.links[0].half_m[1] + 0.003;
    let (thick, shift) = (rng.random_range(0.006..0.012), rng.random_range(-0.003..0.003));
    let centre = v3(shift, -front - thick, height * 0.5 - below_m);
    let motor = Shape::Box {
        centre,
        half_m: v3(half_x, thick, height * 0.5),
        turn_rad: rng.random_range(-0.02..0.02),
    };
    let top = centre + v3(0.0, 0.0, height * 0.4);
    let rod = Shape::RoundCone { a: top, b: top + v3(0.004, 0.0, 0.2), ra_m: 0.004, rb_m: 0.004, cut: None };
    s.world.fixed.push(Solid::new(motor, HOLDER, FOREIGN));
    s.world.fixed.push(Solid::new(rod, HOLDER, FOREIGN));
}
