//! Everything that is drawn about one film.

use crate::optics::actors::Actor;
use crate::optics::calibrate::Calibration;
use crate::optics::camera::{Camera, N_WATER};
use crate::optics::glass::Glass;
use crate::optics::light::Light;
use crate::optics::mechanism::{Keypoint, Kind, Mechanism};
use crate::optics::motion::Motion;
use crate::optics::sensor::Sensor;
use crate::optics::solids::Solid;
use crate::optics::tank::Tank;
use crate::optics::texture::Texture;
use crate::optics::vec::{V3, v3};
use crate::optics::world::{BODY, Material, TOWARDS_CAMERA, World};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A film before it is rendered.
#[derive(Clone, Debug)]
pub(crate) struct Setting {
    pub(crate) seed: u64,
    pub(crate) images: usize,
    pub(crate) fps: f64,
    pub(crate) exposure_s: f64,
    /// Instants within an exposure.
    pub(crate) instants: usize,
    /// From the first row's exposure to the last one's.
    pub(crate) readout_s: f64,
    pub(crate) mechanism: Mechanism,
    pub(crate) motion: Motion,
    pub(crate) world: World,
    pub(crate) camera: Camera,
    pub(crate) actors: Vec<Actor>,
    pub(crate) glass: Glass,
    pub(crate) sensor: Sensor,
    /// Colours of wall and mechanism, up to a factor, and how bright they come out, as shares of full scale in the picture.
    pub(crate) wall_hue: V3,
    pub(crate) body_hue: V3,
    pub(crate) wall_level: f64,
    pub(crate) body_level: f64,
    /// Length of the mechanism as a share of the picture's height, and where P0 is from the top.
    pub(crate) length_share: f64,
    pub(crate) root_share: f64,
    /// Troubles that are there in all images.
    pub(crate) troubles: Vec<&'static str>,
}

impl Setting {
    /// Draws what all scenes have; the scene changes it afterwards.
    pub(crate) fn drawn(
        kind: Kind,
        seed: u64,
        images: usize,
        size_px: (usize, usize),
        rng: &mut ChaCha8Rng,
    ) -> Setting {
        let mechanism = Mechanism::drawn(kind, seed, rng);
        let motion = Motion::drawn(&mechanism, 1.0, rng);
        let water_m =
            if kind == Kind::Chain { rng.random_range(0.3..0.6) } else { rng.random_range(0.5..0.6) };
        let angle = 3f64.to_radians();
        let camera = Camera {
            width_px: size_px.0,
            height_px: size_px.1,
            focal_px: 1000.0,
            centre_x_m: 0.0,
            centre_z_m: 0.0,
            air_m: rng.random_range(0.03..0.08),
            glass_m: 0.006,
            water_m,
            pan_rad: rng.random_range(-0.7..0.7) * angle,
            tilt_rad: rng.random_range(-0.7..0.7) * angle,
            roll_rad: rng.random_range(-0.01..0.01),
            radial_per_px2: rng.random_range(-0.015..0.015) / (size_px.0 as f64 * 0.6).powi(2),
        };
        let warm = rng.random_range(-0.06..0.06);
        let strength = rng.random_range(0.8..1.2);
        let light = Light {
            middle: v3(
                rng.random_range(-0.15..0.15),
                rng.random_range(-0.4..-0.12),
                rng.random_range(0.2..0.4),
            ),
            half_m: (rng.random_range(0.03..0.12), rng.random_range(0.03..0.10)),
            colour: v3(1.0 + warm, 1.0, 0.95 - warm) * (0.16 * strength),
            ambient: v3(0.85, 0.98, 1.05) * 0.32,
            fill: V3::all(0.22),
            caustics: None,
            passing_shadow: None,
        };
        let bright_wall = rng.random_bool(0.5);
        let wall_hues = [v3(0.95, 1.0, 1.0), v3(0.75, 0.95, 1.1), v3(1.0, 0.98, 0.9), v3(0.8, 1.0, 0.95)];
        let bright_bodies =
            [v3(1.0, 0.95, 0.88), v3(1.0, 0.55, 0.2), v3(1.0, 0.85, 0.25), v3(0.95, 0.97, 1.0)];
        let dark_bodies = [v3(1.0, 1.0, 1.05), v3(0.4, 0.5, 1.0), v3(1.0, 0.25, 0.2), v3(0.35, 0.8, 0.5)];
        let pick = rng.random_range(0..4usize);
        let (wall_level, body_level, body_hue) = if bright_wall {
            (rng.random_range(0.62..0.8), rng.random_range(0.16..0.28), dark_bodies[pick])
        } else {
            (rng.random_range(0.14..0.28), rng.random_range(0.6..0.78), bright_bodies[pick])
        };
        let wall_hue = wall_hues[rng.random_range(0..4usize)];
        let plain = Material::matte(V3::all(0.5), Texture::Mottled { size_m: 0.02, share: 0.015 });
        let body = Material {
            albedo: V3::all(0.5),
            texture: Texture::Mottled { size_m: 0.003, share: 0.04 },
            gloss: rng.random_range(0.02..0.12),
            is_bubble: false,
        };
        let holder = Material {
            albedo: V3::all(rng.random_range(0.03..0.3)),
            texture: Texture::Mottled { size_m: 0.004, share: 0.05 },
            gloss: 0.1,
            is_bubble: false,
        };
        let haze = V3::all(0.0);
        Setting {
            seed,
            images,
            fps: 50.0,
            exposure_s: 0.001,
            instants: 1,
            readout_s: 0.0,
            mechanism,
            motion,
            world: World {
                tank: Tank {
                    back_y_m: rng.random_range(0.1..0.3),
                    floor_z_m: -0.5,
                    half_width_m: 0.6,
                    surface: None,
                },
                light,
                materials: vec![body, plain.clone(), plain, holder],
                fixed: Vec::new(),
                haze,
                loss_per_m: v3(0.35, 0.1, 0.07),
            },
            camera,
            actors: Vec::new(),
            glass: Glass { vignette: rng.random_range(0.03..0.15), ..Glass::default() },
            sensor: Sensor::drawn(rng),
            wall_hue,
            body_hue,
            wall_level,
            body_level,
            length_share: rng.random_range(0.55..0.68),
            root_share: rng.random_range(0.13..0.2),
            troubles: Vec::new(),
        }
    }

    /// Adds a material and gives its number.
    pub(crate) fn material(&mut self, m: Material) -> usize {
        self.world.materials.push(m);
        self.world.materials.len() - 1
    }

    /// The width of the plane of motion that will be in view, about.
    pub(crate) fn view_width_m(&self) -> f64 {
        let share = self.camera.width_px as f64 / self.camera.height_px as f64;
        self.mechanism.length_m() / self.length_share * share
    }

    /// Chooses the focal length and the camera's place so that all keypoints are seen in all images.
    pub(crate) fn aim(&mut self, rng: &mut ChaCha8Rng) {
        let (w, h) = (self.camera.width_px as f64, self.camera.height_px as f64);
        let octopus = self.mechanism.kind == Kind::Octopus;
        let length_m = if octopus { 0.26 } else { self.mechanism.length_m() };
        let mut px_per_m = self.length_share * h / length_m;
        let (mut column, row) =
            (w * rng.random_range(0.47..0.53), if octopus { h * 0.38 } else { h * self.root_share });
        for _ in 0..60 {
            self.camera.focal_px = px_per_m * self.camera.effective_distance_m();
            self.camera.see_origin_at(column, row);
            let (mut low, mut high) = ((f64::MAX, f64::MAX), (f64::MIN, f64::MIN));
            for i in 0..self.images {
                for k in self.keypoints(i as f64 / self.fps) {
                    let (c, r) = self.camera.project(k.at);
                    low = (low.0.min(c), low.1.min(r));
                    high = (high.0.max(c), high.1.max(r));
                }
            }
            let margin = 16.0 + self.mechanism.half_width_m() * px_per_m;
            if low.0 > margin && low.1 > 8.0 && high.0 < w - margin && high.1 < h - margin {
                break;
            }
            column += ((w - low.0 - high.0) * 0.5).clamp(-20.0, 20.0);
            px_per_m *= 0.97;
        }
    }

    /// What remains to be done once the scene has changed what it wants.
    pub(crate) fn finish(&mut self, rng: &mut ChaCha8Rng) {
        self.aim(rng);
        // A flat port's distortion is centred on its normal: a tilt that one radial term cannot follow is made smaller.
        for _ in 0..12 {
            if Calibration::of(&self.camera).rms_px < 0.09 {
                break;
            }
            self.camera.pan_rad *= 0.8;
            self.camera.tilt_rad *= 0.8;
            self.aim(rng);
        }
        self.expose();
    }

    /// Sets the albedos of wall and mechanism so that they come out as bright as they should.
    pub(crate) fn expose(&mut self) {
        let middle = v3(0.0, 0.0, -self.mechanism.length_m() * 0.5);
        let d = self.world.tank.back_y_m;
        let port = self.camera.water_m;
        let behind = v3(self.camera.centre_x_m, d, middle.z * (1.0 + d / (port + 0.05 * N_WATER)));
        let albedo = |s: &Setting, at: V3, hue: V3, level: f64, t: f64| {
            let e = s.world.irradiance(at, TOWARDS_CAMERA).times(s.world.loss_per_m.map(|l| (-l * t).exp()));
            let seen = hue.times(e);
            let luma = |c: V3| {
                0.299 * c.x.powf(1.0 / 2.2) + 0.587 * c.y.powf(1.0 / 2.2) + 0.114 * c.z.powf(1.0 / 2.2)
            };
            hue * (level / luma(seen)).powf(2.2)
        };
        let body = albedo(self, middle, self.body_hue, self.body_level, port);
        let wall = albedo(self, behind, self.wall_hue, self.wall_level, port + d);
        self.world.materials[BODY].albedo = body;
        self.world.materials[crate::optics::world::WALL].albedo = wall;
        self.world.materials[crate::optics::world::FLOOR].albedo = wall.times(v3(0.9, 0.88, 0.8));
    }

    /// All that moves, at a time: always the same solids in the same order, the mechanism's first.
    pub(crate) fn moving(&self, t_s: f64, with_mechanism: bool) -> Vec<Solid> {
        let mut all = Vec::new();
        if with_mechanism {
            all = self.mechanism.solids(&self.motion.at(t_s), BODY, 0);
            for a in &self.actors {
                a.solids(t_s, &self.mechanism, &mut all);
            }
        }
        all
    }

    pub(crate) fn keypoints(&self, t_s: f64) -> Vec<Keypoint> {
        self.mechanism.keypoints(&self.motion.at(t_s))
    }

    /// When the middle of the exposure is for a row of an image, where row 0 is exposed at the image's own time.
    pub(crate) fn row_time_s(&self, image: usize, row: f64) -> f64 {
        image as f64 / self.fps + self.readout_s * row / (self.camera.height_px as f64 - 1.0)
    }
}
