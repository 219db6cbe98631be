//! The renderer: what stands still is shaded once a film, what moves and its shadow are traced image by image.

use crate::optics::picture::{Picture, floats};
use crate::optics::setting::Setting;
use crate::optics::solids::Solid;
use crate::optics::tank::Plane;
use crate::optics::tiles::{Lists, TILE_PX};
use crate::optics::vec::{V3, scramble, v3};
use crate::optics::world::{Met, Moment, World};
use rayon::prelude::*;

/// How often mirrored and refracted rays are followed.
const DEPTH: u32 = 3;
/// Samples of the light's panel for a shadow on a wall.
const SHADOW_SAMPLES: usize = 20;

/// What is known of a pixel as long as nothing moves there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Still {
    /// Light that shadows and caustics leave alone, and the panel's.
    pub(crate) light: [f32; 3],
    pub(crate) direct: [f32; 3],
    /// Where the pixel's middle sees a wall, and whether it faces the light there at all.
    pub(crate) at: V3,
    /// Fixed solids are seen here.
    pub(crate) is_solid: bool,
    /// The water's surface is seen here.
    pub(crate) is_surface: bool,
    /// What the glass leaves and adds.
    pub(crate) glass_left: f32,
    pub(crate) glass_light: [f32; 3],
}

/// Renders the images of one setting.
pub(crate) struct Renderer<'a> {
    setting: &'a Setting,
    still: Vec<Still>,
    side: usize,
}

impl<'a> Renderer<'a> {
    /// Shades what stands still.
    pub(crate) fn new(setting: &'a Setting) -> Renderer<'a> {
        let camera = &setting.camera;
        let least = (setting.instants as f64).sqrt().ceil() as usize;
        let side = least.max(if camera.height_px > 600 { 3 } else { 4 });
        let mut world = setting.world.clone();
        world.light.caustics = None;
        world.light.passing_shadow = None;
        let (w, h) = (camera.width_px, camera.height_px);
        let still = (0..w * h).into_par_iter().map(|i| still_pixel(setting, &world, i % w, i / w)).collect();
        Renderer { setting, still, side }
    }

    /// The light of an image, before lens and sensor.
    pub(crate) fn image(&self, image: usize, with_mechanism: bool) -> Picture {
        self.image_of_pass(image, with_mechanism, 0)
    }

    /// The same; another pass takes other samples.
    pub(crate) fn image_of_pass(&self, image: usize, with_mechanism: bool, pass: u32) -> Picture {
        let (w, h) = (self.setting.camera.width_px, self.setting.camera.height_px);
        let mut picture = Picture::black(w, h);
        let shared = (self.setting.readout_s == 0.0).then(|| self.states(image, 0.0, with_mechanism));
        picture.light.par_chunks_mut(w * TILE_PX).enumerate().for_each(|(band, out)| {
            let rows = band * TILE_PX..(band * TILE_PX + TILE_PX).min(h);
            let own: Vec<_> = match &shared {
                Some(_) => Vec::new(),
                None => rows.clone().map(|r| self.states(image, r as f64, with_mechanism)).collect(),
            };
            let all: Vec<&[(f64, Vec<Solid>)]> = match &shared {
                Some(s) => vec![s],
                None => own.iter().map(|s| s.as_slice()).collect(),
            };
            let lists = Lists::of(self.setting, &self.still, rows.clone(), &all);
            for row in rows.clone() {
                let states = if shared.is_some() { all[0] } else { all[row - rows.start] };
                for column in 0..w {
                    let light = self.pixel(image as u32 + pass * 100_003, (column, row), states, &lists);
                    out[(row - rows.start) * w + column] = floats(light);
                }
            }
        });
        picture
    }

    /// What moves, at the instants of a row's exposure.
    fn states(&self, image: usize, row: f64, with_mechanism: bool) -> Vec<(f64, Vec<Solid>)> {
        let s = self.setting;
        (0..s.instants)
            .map(|i| {
                let t_s =
                    s.row_time_s(image, row) + s.exposure_s * ((i as f64 + 0.5) / s.instants as f64 - 0.5);
                (t_s, s.moving(t_s, with_mechanism))
            })
            .collect()
    }

    fn pixel(
        &self,
        samples: u32,
        (column, row): (usize, usize),
        states: &[(f64, Vec<Solid>)],
        lists: &Lists,
    ) -> V3 {
        let s = self.setting;
        let world = &s.world;
        let still = &self.still[row * s.camera.width_px + column];
        let (seen, shading) = lists.at(column);
        let middle_s = states[states.len() / 2].0;
        let lively = world.light.caustics.is_some() || world.light.passing_shadow.is_some();
        let retrace = still.is_surface || (still.is_solid && (lively || !seen.is_empty()));
        let key = scramble((row * s.camera.width_px + column) as u32 ^ scramble(samples + 77));
        let mut background = V3::ZERO;
        if !retrace {
            let mut share = if lively { world.light.modulation(still.at, middle_s) } else { 1.0 };
            if !shading.is_empty() {
                share *= self.lit_share(still.at, states, shading, key);
            }
            background = colour(still.light) + colour(still.direct) * share;
        }
        let mut light = background;
        if retrace || !seen.is_empty() {
            // Waves are smooth: where nothing else moves fewer samples do.
            let n = if still.is_surface && !still.is_solid && seen.is_empty() && states.len() == 1 {
                2
            } else {
                self.side
            };
            let count = n * n;
            light = V3::ZERO;
            for i in 0..count {
                let (jc, jr) = (unit(key, 2 * i as u32), unit(key, 2 * i as u32 + 1));
                let c = column as f64 - 0.5 + ((i % n) as f64 + jc) / n as f64;
                let r = row as f64 - 0.5 + ((i / n) as f64 + jr) / n as f64;
                let (t_s, moving) = &states[(i + key as usize) % states.len()];
                let ray = s.camera.ray(c, r);
                let m = Moment { t_s: *t_s, moving, light_at: panel(key, i) };
                light += if retrace {
                    world.trace(&ray, &m, DEPTH)
                } else {
                    match World::nearest(seen.iter().map(|&k| &moving[k as usize]), &ray) {
                        Some((h, solid)) => world.of_solid(&ray, h, solid, &m, DEPTH),
                        None => background,
                    }
                };
            }
            light = light * (1.0 / count as f64);
        }
        let light = light * still.glass_left as f64 + colour(still.glass_light);
        light + s.glass.moving(&s.camera, column, row, middle_s)
    }

    /// How much of the panel a point of a wall sees past what moves.
    fn lit_share(&self, p: V3, states: &[(f64, Vec<Solid>)], shading: &[u16], key: u32) -> f64 {
        let world = &self.setting.world;
        let mut lit = 0;
        for i in 0..SHADOW_SAMPLES {
            let (u, v) = panel(key, i);
            let moving = &states[(i + key as usize) % states.len()].1;
            lit += world.sees(p, world.light.sample(u, v), shading.iter().map(|&k| &moving[k as usize]))
                as usize;
        }
        lit as f64 / SHADOW_SAMPLES as f64
    }
}

fn still_pixel(setting: &Setting, world: &World, column: usize, row: usize) -> Still {
    let camera = &setting.camera;
    let n = if camera.height_px > 600 { 3 } else { 4 };
    let key = scramble((row * camera.width_px + column) as u32 ^ 0x5bd1_e995);
    let (glass_left, glass_light) = setting.glass.still(camera, column, row);
    let mut still = Still {
        light: [0.0; 3],
        direct: [0.0; 3],
        at: V3::ZERO,
        is_solid: false,
        is_surface: false,
        glass_left: glass_left as f32,
        glass_light: floats(glass_light),
    };
    let (t, ..) = world.tank.hit(&camera.ray(column as f64, row as f64), 0.0);
    still.at = camera.ray(column as f64, row as f64).at(t);
    let (mut light, mut direct) = (V3::ZERO, V3::ZERO);
    let count = n * n;
    for i in 0..count {
        let (jc, jr) = (unit(key, 2 * i as u32), unit(key, 2 * i as u32 + 1));
        let c = column as f64 - 0.5 + ((i % n) as f64 + jc) / n as f64;
        let r = row as f64 - 0.5 + ((i / n) as f64 + jr) / n as f64;
        let ray = camera.ray(c, r);
        // Twice as many samples of the light as of the pixel.
        for half in 0..2 {
            let m = Moment { t_s: 0.0, moving: &[], light_at: panel(key, 2 * i + half) };
            match world.meet(&ray, &m) {
                Met::Solid(h, s) => {
                    still.is_solid = true;
                    light += world.of_solid(&ray, h, s, &m, DEPTH);
                }
                Met::Plane(_, Plane::Surface, _) => still.is_surface = true,
                Met::Plane(t, plane, normal) => {
                    let (l, d) = world.of_plane(&ray, t, plane, normal, &m);
                    light += l;
                    direct += d;
                }
            }
        }
    }
    let each = 0.5 / count as f64;
    still.light = floats(light * each);
    still.direct = floats(direct * each);
    still
}

/// A point of the panel in 0..1 for a pixel's key and the number of a sample, well spread over its samples.
fn panel(key: u32, i: usize) -> (f64, f64) {
    let at = |salt: u32, step: f64| (unit(key, salt) + i as f64 * step).fract();
    (at(1001, 0.754_877_666_246_693), at(1002, 0.569_840_290_998_053))
}

fn unit(key: u32, i: u32) -> f64 {
    crate::optics::vec::hash01(key.wrapping_add(i.wrapping_mul(0x9E37_79B9)))
}

fn colour(f: [f32; 3]) -> V3 {
    v3(f[0] as f64, f[1] as f64, f[2] as f64)
}
