//! The camera in air before a flat glass port: lens with one radial term, Snell's law at both faces of the glass, exact.

use crate::optics::vec::{V3, v3};

pub(crate) const N_GLASS: f64 = 1.52;
pub(crate) const N_WATER: f64 = 1.333;

/// A ray in water.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) from: V3,
    pub(crate) along: V3,
}

impl Ray {
    pub(crate) fn at(&self, t: f64) -> V3 {
        self.from + self.along * t
    }
}

/// What is known of the camera and its port.
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    pub(crate) width_px: usize,
    pub(crate) height_px: usize,
    /// Focal length in air.
    pub(crate) focal_px: f64,
    /// Where the camera's centre is beside the world's origin, along x and z.
    pub(crate) centre_x_m: f64,
    pub(crate) centre_z_m: f64,
    pub(crate) air_m: f64,
    pub(crate) glass_m: f64,
    /// From the glass to the plane of motion.
    pub(crate) water_m: f64,
    /// Rotations about z (to the right), x (upward) and the optical axis.
    pub(crate) pan_rad: f64,
    pub(crate) tilt_rad: f64,
    pub(crate) roll_rad: f64,
    /// Undistorted = middle + (seen - middle)(1 + k r^2).
    pub(crate) radial_per_px2: f64,
}

impl Camera {
    /// The picture's middle, where the lens's distortion is centred.
    pub(crate) fn middle_px(&self) -> (f64, f64) {
        ((self.width_px as f64 - 1.0) / 2.0, (self.height_px as f64 - 1.0) / 2.0)
    }

    /// Effective distance from the camera to the plane of motion, for rays near the normal.
    pub(crate) fn effective_distance_m(&self) -> f64 {
        self.air_m + self.glass_m / N_GLASS + self.water_m / N_WATER
    }

    /// Where the glass meets the water.
    pub(crate) fn port_y_m(&self) -> f64 {
        -self.water_m
    }

    /// The direction in air, of unit length, that a point of the picture looks along.
    pub(crate) fn direction_in_air(&self, column: f64, row: f64) -> V3 {
        let (mc, mr) = self.middle_px();
        let (dc, dr) = (column - mc, row - mr);
        let k = 1.0 + self.radial_per_px2 * (dc * dc + dr * dr);
        let (u, w) = (dc * k / self.focal_px, -dr * k / self.focal_px);
        let (s, c) = self.roll_rad.sin_cos();
        let (u, w) = (c * u - s * w, s * u + c * w);
        let (s, c) = self.tilt_rad.sin_cos();
        let d = v3(u, c - s * w, s + c * w);
        let (s, c) = self.pan_rad.sin_cos();
        v3(c * d.x + s * d.y, c * d.y - s * d.x, d.z).unit()
    }

    /// The ray in water that a point of the picture looks along, from the inner face of the glass.
    pub(crate) fn ray(&self, column: f64, row: f64) -> Ray {
        let d = self.direction_in_air(column, row);
        let centre = v3(self.centre_x_m, -self.water_m - self.glass_m - self.air_m, self.centre_z_m);
        let inside = |n: f64| {
            let (x, z) = (d.x / n, d.z / n);
            v3(x, (1.0 - x * x - z * z).sqrt(), z)
        };
        let (g, w) = (inside(N_GLASS), inside(N_WATER));
        let from = centre + d * (self.air_m / d.y) + g * (self.glass_m / g.y);
        Ray { from, along: w }
    }

    /// Where a point of the picture looks at the plane of this y, as (x, z).
    pub(crate) fn on_plane(&self, column: f64, row: f64, y_m: f64) -> (f64, f64) {
        let ray = self.ray(column, row);
        let p = ray.at((y_m - ray.from.y) / ray.along.y);
        (p.x, p.z)
    }

    /// Where a point in the water is seen, column and row, by Newton's method on the exact ray.
    pub(crate) fn project(&self, p: V3) -> (f64, f64) {
        let (mut c, mut r) = self.middle_px();
        for _ in 0..30 {
            let (x, z) = self.on_plane(c, r, p.y);
            let (xc, zc) = self.on_plane(c + 0.5, r, p.y);
            let (xr, zr) = self.on_plane(c, r + 0.5, p.y);
            let (a, b, d, e) = ((xc - x) * 2.0, (xr - x) * 2.0, (zc - z) * 2.0, (zr - z) * 2.0);
            let det = a * e - b * d;
            if det.abs() < 1e-300 {
                break;
            }
            let (gx, gz) = (p.x - x, p.z - z);
            let (dc, dr) = ((e * gx - b * gz) / det, (a * gz - d * gx) / det);
            c += dc.clamp(-2000.0, 2000.0);
            r += dr.clamp(-2000.0, 2000.0);
            if dc.abs() + dr.abs() < 1e-10 {
                break;
            }
        }
        (c, r)
    }

    /// Moves the camera parallel to its port so that the world's origin is seen there.
    pub(crate) fn see_origin_at(&mut self, column: f64, row: f64) {
        (self.centre_x_m, self.centre_z_m) = (0.0, 0.0);
        let (x, z) = self.on_plane(column, row, 0.0);
        (self.centre_x_m, self.centre_z_m) = (-x, -z);
    }

    /// Pixels a metre at this depth, near the axis.
    pub(crate) fn scale_px_per_m(&self, y_m: f64) -> f64 {
        self.focal_px / (self.effective_distance_m() + y_m / N_WATER)
    }
}
