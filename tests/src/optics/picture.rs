//! A picture of linear light.

use crate::optics::vec::V3;

/// Linear RGB, row by row from the top.
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    pub(crate) width_px: usize,
    pub(crate) height_px: usize,
    pub(crate) light: Vec<[f32; 3]>,
}

/// A colour as three floats.
pub(crate) fn floats(c: V3) -> [f32; 3] {
    [c.x as f32, c.y as f32, c.z as f32]
}

impl Picture {
    pub(crate) fn black(width_px: usize, height_px: usize) -> Picture {
        Picture { width_px, height_px, light: vec![[0.0; 3]; width_px * height_px] }
    }

    /// Blurred by a Gaussian; beyond its borders the picture goes on as at them.
    pub(crate) fn blurred(&self, sigma_px: f64) -> Picture {
        let reach = (sigma_px * 4.0).ceil() as i64;
        let mut kernel: Vec<f32> =
            (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp() as f32).collect();
        let sum: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|k| *k /= sum);
        let (w, h) = (self.width_px as i64, self.height_px as i64);
        let pass = |from: &[[f32; 3]], right: i64, down: i64| {
            let mut to = vec![[0f32; 3]; from.len()];
            for r in 0..h {
                for c in 0..w {
                    let mut sum = [0f32; 3];
                    for (i, k) in kernel.iter().enumerate() {
                        let o = i as i64 - reach;
                        let at =
                            ((r + o * down).clamp(0, h - 1) * w + (c + o * right).clamp(0, w - 1)) as usize;
                        for (s, v) in sum.iter_mut().zip(from[at]) {
                            *s += k * v;
                        }
                    }
                    to[(r * w + c) as usize] = sum;
                }
            }
            to
        };
        let across = pass(&self.light, 1, 0);
        Picture { width_px: self.width_px, height_px: self.height_px, light: pass(&across, 0, 1) }
    }
}
