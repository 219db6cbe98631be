//! All that a ray can meet, and the light that comes back along it.

use crate::optics::camera::{N_WATER, Ray};
use crate::optics::light::Light;
use crate::optics::solids::{Hit, Shape, Solid};
use crate::optics::tank::{Plane, Tank};
use crate::optics::texture::Texture;
use crate::optics::vec::{V3, refracted, v3};

/// Numbers of the materials every film has.
pub(crate) const BODY: usize = 0;
pub(crate) const WALL: usize = 1;
pub(crate) const FLOOR: usize = 2;
pub(crate) const HOLDER: usize = 3;

/// Owners of keypoints are numbered from 0; things that are no part of the mechanism have this one.
pub(crate) const FOREIGN: u16 = 1000;

/// How a surface answers light.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    pub(crate) albedo: V3,
    pub(crate) texture: Texture,
    /// Strength of the highlight.
    pub(crate) gloss: f64,
    /// An air bubble: refracts and reflects, has no colour of its own.
    pub(crate) is_bubble: bool,
}

impl Material {
    pub(crate) fn matte(albedo: V3, texture: Texture) -> Material {
        Material { albedo, texture, gloss: 0.03, is_bubble: false }
    }
}

/// The tank with its light and what stands in it.
#[derive(Clone, Debug)]
pub(crate) struct World {
    pub(crate) tank: Tank,
    pub(crate) light: Light,
    pub(crate) materials: Vec<Material>,
    /// What never moves.
    pub(crate) fixed: Vec<Solid>,
    /// Light that the water scatters towards the camera, and the share lost a metre.
    pub(crate) haze: V3,
    pub(crate) loss_per_m: V3,
}

/// What is needed beside a ray to follow it.
pub(crate) struct Moment<'a> {
    pub(crate) t_s: f64,
    /// What moves, as it is at that time.
    pub(crate) moving: &'a [Solid],
    /// Where on the light's panel the sample lies, in 0..1.
    pub(crate) light_at: (f64, f64),
}

/// What a ray meets first.
pub(crate) enum Met<'a> {
    Solid(Hit, &'a Solid),
    Plane(f64, Plane, V3),
}

impl World {
    /// The nearest of some solids.
    pub(crate) fn nearest<'a>(
        solids: impl Iterator<Item = &'a Solid>,
        ray: &Ray,
    ) -> Option<(Hit, &'a Solid)> {
        let mut best: Option<(Hit, &Solid)> = None;
        for s in solids {
            if let Some(h) = s.hit(ray)
                && best.is_none_or(|(b, _)| h.t < b.t)
            {
                best = Some((h, s));
            }
        }
        best
    }

    /// What a ray meets first among all.
    pub(crate) fn meet<'a>(&'a self, ray: &Ray, m: &Moment<'a>) -> Met<'a> {
        let (t, plane, n) = self.tank.hit(ray, m.t_s);
        match World::nearest(m.moving.iter().chain(&self.fixed), ray) {
            Some((h, s)) if h.t < t => Met::Solid(h, s),
            _ => Met::Plane(t, plane, n),
        }
    }

    /// The light that comes back along a ray.
    pub(crate) fn trace(&self, ray: &Ray, m: &Moment, depth: u32) -> V3 {
        match self.meet(ray, m) {
            Met::Solid(h, s) => self.of_solid(ray, h, s, m, depth),
            Met::Plane(t, plane, n) => {
                if plane == Plane::Surface {
                    return self.of_surface(ray, t, n, m, depth);
                }
                let (still, direct) = self.of_plane(ray, t, plane, n, m);
                still + direct
            }
        }
    }

    /// What water does to light on its way: what is left of it, and what comes in.
    fn through_water(&self, light: V3, t: f64) -> V3 {
        let left = self.loss_per_m.map(|l| (-l * t).exp());
        light.times(left) + self.haze.times(V3::all(1.0) - left)
    }

    /// Light of a solid that a ray meets.
    pub(crate) fn of_solid(&self, ray: &Ray, h: Hit, s: &Solid, m: &Moment, depth: u32) -> V3 {
        let p = ray.at(h.t);
        let mat = &self.materials[s.material];
        if mat.is_bubble {
            return self.of_bubble(ray, (p, s), h, m, depth);
        }
        let albedo = mat.albedo.times(mat.texture.at(s.texture_at(p)));
        let from = self.light.sample(m.light_at.0, m.light_at.1);
        let mut out = albedo.times(self.light.indirect(h.normal));
        let direct = self.light.direct(from, p, h.normal);
        if direct.x > 0.0 && self.sees(p, from, m.moving.iter().chain(&self.fixed)) {
            let direct = direct * self.light.modulation(p, m.t_s);
            out += albedo.times(direct);
            let half = ((from - p).unit() - ray.along).unit();
            out += direct * (mat.gloss * 2.0 * half.dot(h.normal).max(0.0).powi(40));
        }
        self.through_water(out, h.t)
    }

    /// Whether nothing stands between a point and the light.
    pub(crate) fn sees<'a>(&self, p: V3, from: V3, mut solids: impl Iterator<Item = &'a Solid>) -> bool {
        let to = from - p;
        let far = to.norm();
        let ray = Ray { from: p, along: to * (1.0 / far) };
        !solids.any(|s| !self.materials[s.material].is_bubble && s.hit(&ray).is_some_and(|h| h.t < far))
    }

    /// Light of a wall: what comes from all round, and what the panel sends past the fixed solids and `m.moving`.
    pub(crate) fn of_plane(&self, ray: &Ray, t: f64, plane: Plane, n: V3, m: &Moment) -> (V3, V3) {
        let p = ray.at(t);
        let (material, uv) = match plane {
            Plane::Floor => (FLOOR, (p.x, p.y, 0.0)),
            Plane::Side => (WALL, (p.y, p.z, 0.0)),
            _ => (WALL, (p.x, p.z, 0.0)),
        };
        let mat = &self.materials[material];
        let albedo = mat.albedo.times(mat.texture.at(uv));
        let from = self.light.sample(m.light_at.0, m.light_at.1);
        // Corners are darker: less of what is round sees them.
        let corner = match plane {
            Plane::Back => 1.0 - 0.35 * (-(p.z - self.tank.floor_z_m).max(0.0) / 0.025).exp(),
            Plane::Floor => 1.0 - 0.35 * (-(self.tank.back_y_m - p.y).max(0.0) / 0.025).exp(),
            _ => 1.0,
        };
        let still = albedo.times(self.light.indirect(n)) * corner;
        let mut direct = V3::ZERO;
        let d = self.light.direct(from, p, n);
        if d.x > 0.0 && self.sees(p, from, m.moving.iter().chain(&self.fixed)) {
            direct = albedo.times(d) * self.light.modulation(p, m.t_s);
        }
        let left = self.loss_per_m.map(|l| (-l * t).exp());
        (still.times(left) + self.haze.times(V3::all(1.0) - left), direct.times(left))
    }

    /// The surface from below: a mirror at shallow angles, else the bright sky above.
    fn of_surface(&self, ray: &Ray, t: f64, n: V3, m: &Moment, depth: u32) -> V3 {
        let p = ray.at(t);
        let sky = self.light.ambient * 1.3;
        if depth == 0 || ray.along.dot(n) > 0.0 {
            return self.through_water(sky * 0.5, t);
        }
        let mut along = ray.along.mirrored(n);
        along.z = along.z.min(-1e-4);
        let mirrored = self.trace(&Ray { from: p, along: along.unit() }, m, depth - 1);
        let out = match refracted(ray.along, n, N_WATER) {
            None => mirrored * 0.97,
            Some(d) => {
                let f = reflectance(-ray.along.dot(n), d.dot(-n).abs(), N_WATER);
                mirrored * f + sky * (1.0 - f)
            }
        };
        self.through_water(out, t)
    }

    /// A bubble: its rim mirrors all, its middle lets most through.
    fn of_bubble(&self, ray: &Ray, (p, s): (V3, &Solid), h: Hit, m: &Moment, depth: u32) -> V3 {
        if depth == 0 {
            return self.light.indirect(h.normal) * 0.5;
        }
        let back = Ray { from: p, along: ray.along.mirrored(h.normal) };
        let mut mirrored = self.trace(&back, m, depth - 1);
        if back.along.z > 0.75 {
            mirrored += self.light.colour * 1.5;
        }
        let Some(d) = refracted(ray.along, h.normal, N_WATER) else {
            return mirrored;
        };
        let f = reflectance(-ray.along.dot(h.normal), -d.dot(h.normal), N_WATER);
        let Shape::Ellipsoid { centre, half_m, .. } = &s.shape else {
            return mirrored;
        };
        let exit = p + d * (2.0 * (*centre - p).dot(d).max(0.0));
        let inner = (*centre - exit) * (1.0 / half_m.x);
        let out = refracted(d, inner, 1.0 / N_WATER).unwrap_or(d);
        mirrored * f
            + self.trace(&Ray { from: exit - inner * 1e-7, along: out.unit() }, m, depth - 1) * (1.0 - f)
    }

    /// Irradiance of a surface, mean over the panel, nothing in between.
    pub(crate) fn irradiance(&self, p: V3, n: V3) -> V3 {
        let mut e = self.light.indirect(n);
        for i in 0..64 {
            let (u, v) = ((i % 8) as f64 / 8.0 + 0.0625, (i / 8) as f64 / 8.0 + 0.0625);
            e += self.light.direct(self.light.sample(u, v), p, n) * (1.0 / 64.0);
        }
        e
    }
}

/// Fresnel's reflectance for unpolarized light, of the cosines on both sides; `ratio` = n_from / n_to.
fn reflectance(cos_in: f64, cos_out: f64, ratio: f64) -> f64 {
    let s = (ratio * cos_in - cos_out) / (ratio * cos_in + cos_out);
    let p = (ratio * cos_out - cos_in) / (ratio * cos_out + cos_in);
    0.5 * (s * s + p * p)
}

/// The direction straight towards the camera.
pub(crate) const TOWARDS_CAMERA: V3 = v3(0.0, -1.0, 0.0);
