//! What the glass adds: reflections of the room, and dirt.

use crate::optics::camera::Camera;
use crate::optics::vec::{V3, hash01, smoothstep, v3};

/// Reflections and specks; by default none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Glass {
    pub(crate) room: Option<Room>,
    /// Column, row and radius [px], and how much light each speck takes.
    pub(crate) specks: Vec<(f64, f64, f64, f64)>,
    /// How much darker the picture's corners are, as a share.
    pub(crate) vignette: f64,
}

/// A room behind the camera with a window and somebody who walks.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// Share of the light that the glass mirrors times the window's brightness.
    pub(crate) window_level: f64,
    pub(crate) window_x_m: f64,
    pub(crate) window_z_m: f64,
    pub(crate) walker_level: f64,
    pub(crate) walker_start_m: f64,
    pub(crate) walker_m_per_s: f64,
}

/// How far behind the camera the room's wall is.
const ROOM_M: f64 = 2.0;

impl Glass {
    /// What is taken and added at a pixel for all images.
    pub(crate) fn still(&self, camera: &Camera, column: usize, row: usize) -> (f64, V3) {
        let (c, r) = (column as f64, row as f64);
        let (mc, mr) = camera.middle_px();
        let mut left = 1.0 - self.vignette * ((c - mc).powi(2) + (r - mr).powi(2)) / (mc * mc + mr * mr);
        for &(x, y, radius_px, share) in &self.specks {
            let d = (c - x).hypot(r - y);
            if d < radius_px * 1.6 {
                left *= 1.0 - share * smoothstep(radius_px * 1.5, radius_px * 0.5, d);
            }
        }
        let Some(room) = &self.room else {
            return (left, V3::ZERO);
        };
        let (x, z) = room_point(camera, c, r);
        let (u, v) = (x - room.window_x_m, z - room.window_z_m);
        let edge = |d: f64, half: f64| smoothstep(half + 0.012, half - 0.012, d.abs());
        let mut window = edge(u, 0.42) * edge(v, 0.34);
        // Cross bars and what is seen outside.
        window *= 1.0 - edge(u, 0.025).max(edge(v + 0.05, 0.025));
        let outside = 0.75 + 0.25 * smoothstep(-0.1, 0.1, v + 0.08 * (u * 9.0).sin());
        let glow = 0.12 * (-(u * u + v * v) * 1.5).exp();
        (left, v3(0.85, 0.95, 1.1) * (room.window_level * (window * outside + glow)))
    }

    /// What moves in the room, at a pixel.
    pub(crate) fn moving(&self, camera: &Camera, column: usize, row: usize, t_s: f64) -> V3 {
        let Some(room) = &self.room else {
            return V3::ZERO;
        };
        let (x, z) = room_point(camera, column as f64, row as f64);
        let (u, v) = (x - room.walker_start_m - room.walker_m_per_s * t_s, z - room.window_z_m + 0.1);
        let bob = 0.012 * (t_s * 11.0).sin();
        let head = smoothstep(0.12, 0.09, u.hypot((v - 0.22 - bob) * 0.85));
        let trunk = smoothstep(0.24, 0.19, u.abs()) * smoothstep(0.12, 0.05, v - bob);
        v3(1.1, 1.0, 0.9) * (room.walker_level * head.max(trunk * 0.75))
    }
}

/// Where a pixel looks, by way of the glass, in the room.
fn room_point(camera: &Camera, column: f64, row: f64) -> (f64, f64) {
    let d = camera.direction_in_air(column, row);
    (camera.centre_x_m + d.x / d.y * ROOM_M, d.z / d.y * ROOM_M)
}

/// Draws dirt on the glass from a key.
pub(crate) fn specks(count: usize, key: u32, width_px: usize, height_px: usize) -> Vec<(f64, f64, f64, f64)> {
    (0..count as u32)
        .map(|i| {
            let h = |k: u32| hash01(key.wrapping_mul(977).wrapping_add(i * 8 + k));
            (h(0) * width_px as f64, h(1) * height_px as f64, 1.2 + 5.0 * h(2) * h(2), 0.08 + 0.3 * h(3))
        })
        .collect()
}
