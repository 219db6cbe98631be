//! What a calibration of the exact camera would say: a homography and one radial term, fitted to exact projections.

use crate::optics::camera::Camera;
use nalgebra::{SMatrix, SVector};

/// The calibration that is handed out.
#[derive(Clone, Debug)]
pub(crate) struct Calibration {
    /// Undistorted pixel (column, row, 1) to (x, z, 1) in metres, up to a factor.
    pub(crate) metres_from_pixels: [[f64; 3]; 3],
    pub(crate) radial_centre_px: (f64, f64),
    pub(crate) radial_per_px2: f64,
    /// Residuals of the fit: root of the mean square and largest.
    pub(crate) rms_px: f64,
    pub(crate) worst_px: f64,
}

impl Calibration {
    /// Fits to a grid of 204 points that covers the picture but its rim, where nobody gets a chessboard to lie.
    pub(crate) fn of(camera: &Camera) -> Calibration {
        let centre = camera.middle_px();
        let unit_px = camera.focal_px;
        let mut seen = Vec::new();
        for i in 0..17 {
            for j in 0..12 {
                let c = (0.07 + 0.86 * i as f64 / 16.0) * (camera.width_px as f64 - 1.0);
                let r = (0.07 + 0.86 * j as f64 / 11.0) * (camera.height_px as f64 - 1.0);
                let (x, z) = camera.on_plane(c, r, 0.0);
                seen.push(((c - centre.0) / unit_px, (r - centre.1) / unit_px, x, z));
            }
        }
        let d = camera.effective_distance_m();
        let mut p = [d, 0.0, camera.centre_x_m, 0.0, -d, camera.centre_z_m, 0.0, 0.0, 0.0];
        for _ in 0..20 {
            let (mut normal, mut right) = ([[0.0; 9]; 9], [0.0; 9]);
            for s in &seen {
                let (x0, z0) = apply(&p, s.0, s.1);
                let mut jac = [[0.0; 9]; 2];
                for k in 0..9 {
                    let mut q = p;
                    q[k] += 1e-6;
                    let (x1, z1) = apply(&q, s.0, s.1);
                    jac[0][k] = (x1 - x0) / 1e-6;
                    jac[1][k] = (z1 - z0) / 1e-6;
                }
                for (row, residual) in jac.iter().zip([s.2 - x0, s.3 - z0]) {
                    for a in 0..9 {
                        right[a] += row[a] * residual;
                        for b in 0..9 {
                            normal[a][b] += row[a] * row[b];
                        }
                    }
                }
            }
            for (a, step) in solve(normal, right).into_iter().enumerate() {
                p[a] += step;
            }
        }
        let scale = camera.scale_px_per_m(0.0);
        let errors = seen.iter().map(|s| {
            let (x, z) = apply(&p, s.0, s.1);
            (x - s.2).hypot(z - s.3) * scale
        });
        let (mut sum, mut worst_px) = (0.0, 0.0f64);
        for e in errors {
            sum += e * e;
            worst_px = worst_px.max(e);
        }
        // From pixels about the middle in units of the focal length to pixels from the corner.
        let f = 1.0 / unit_px;
        let row = |a: f64, b: f64, c: f64| [a * f, b * f, c - a * f * centre.0 - b * f * centre.1];
        Calibration {
            metres_from_pixels: [row(p[0], p[1], p[2]), row(p[3], p[4], p[5]), row(p[6], p[7], 1.0)],
            radial_centre_px: centre,
            radial_per_px2: p[8] * f * f,
            rms_px: (sum / seen.len() as f64).sqrt(),
            worst_px,
        }
    }

    /// Where a seen pixel lies in the plane of motion, as (x, z).
    #[cfg(test)]
    pub(crate) fn metres(&self, column: f64, row: f64) -> (f64, f64) {
        let (dc, dr) = (column - self.radial_centre_px.0, row - self.radial_centre_px.1);
        let k = 1.0 + self.radial_per_px2 * (dc * dc + dr * dr);
        let (c, r) = (self.radial_centre_px.0 + dc * k, self.radial_centre_px.1 + dr * k);
        let [x, z, w] = self.metres_from_pixels.map(|m| m[0] * c + m[1] * r + m[2]);
        (x / w, z / w)
    }

    /// The file `tank.toml`.
    pub(crate) fn to_toml(&self, camera: &Camera) -> String {
        let rows: Vec<String> = self
            .metres_from_pixels
            .iter()
            .map(|r| format!("    [{:.15e}, {:.15e}, {:.15e}],", r[0], r[1], r[2]))
            .collect();
        format!(
            "# Fitted to 204 exact projections: {:.4} px rms, {:.4} px at worst.\n\
             view = \"x-z\"\npicture_px = [{}, {}]\nmetres_from_pixels = [\n{}\n]\nradial_centre_px = [{:?}, {:?}]\n\
             radial_per_px2 = {:.12e}\n",
            self.rms_px,
            self.worst_px,
            camera.width_px,
            camera.height_px,
            rows.join("\n"),
            self.radial_centre_px.0,
            self.radial_centre_px.1,
            self.radial_per_px2
        )
    }
}

/// The homography and radial term of nine numbers, for a point about the picture's middle in units of the focal length.
fn apply(p: &[f64; 9], u: f64, w: f64) -> (f64, f64) {
    let k = 1.0 + p[8] * (u * u + w * w);
    let (u, w) = (u * k, w * k);
    let n = p[6] * u + p[7] * w + 1.0;
    ((p[0] * u + p[1] * w + p[2]) / n, (p[3] * u + p[4] * w + p[5]) / n)
}

/// Solves nine linear equations.
fn solve(a: [[f64; 9]; 9], b: [f64; 9]) -> [f64; 9] {
    let rows = SMatrix::<f64, 9, 9>::from_fn(|i, j| a[i][j]);
    rows.lu().solve(&SVector::from(b)).map_or([0.0; 9], Into::into)
}
