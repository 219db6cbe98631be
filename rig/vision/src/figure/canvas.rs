//! Pixels as a camera square to the plane of motion would have them: there a mechanism keeps its size wherever it is.

use camera::calibration::{Plane, Px};

/// The plane of motion in pixels of one size; the same as the picture's where the camera is square to it.
#[derive(Debug, Clone)]
pub(crate) struct Canvas {
    plane: Plane,
    /// Size of a canvas pixel \[m\].
    scale_m: f64,
    /// Where the canvas's first pixel lies, `[x, z]` \[m\].
    corner_m: [f64; 2],
    square: bool,
}

/// Two lines `[column, row]` of derivatives by `[column, row]`.
pub(crate) type Jacobian = [[f64; 2]; 2];

impl Canvas {
    /// Of `plane`, with pixels of the size that they have in the picture at `px`.
    pub(crate) fn new(plane: &Plane, px: Px) -> Self {
        /// A camera is square where its canvas is nowhere farther off than that \[px\].
        const SQUARE_PX: f64 = 1e-9;
        let scale_m = plane.metres_per_pixel(px);
        let mut canvas =
            Self { plane: plane.clone(), scale_m, corner_m: plane.metres([0.0, 0.0]), square: false };
        let far = [[0.0, 1000.0], [1000.0, 0.0], [700.0, 900.0]];
        canvas.square = far.iter().all(|&px| {
            let on = canvas.at_px(px);
            (on[0] - px[0]).hypot(on[1] - px[1]) < SQUARE_PX * 1000.0
        });
        canvas
    }

    /// Size of a canvas pixel \[m\].
    pub(crate) fn scale_m(&self) -> f64 {
        self.scale_m
    }

    /// Where on the canvas lies what the picture shows at `px`.
    pub(crate) fn at_px(&self, px: Px) -> Px {
        if self.square {
            return px;
        }
        let [x, z] = self.plane.metres(px);
        [(x - self.corner_m[0]) / self.scale_m, (self.corner_m[1] - z) / self.scale_m]
    }

    /// Where the picture shows the canvas's `at`.
    pub(crate) fn px(&self, at: Px) -> Px {
        if self.square {
            return at;
        }
        self.plane.pixel([self.corner_m[0] + self.scale_m * at[0], self.corner_m[1] - self.scale_m * at[1]])
    }

    /// How the picture's pixels move with the canvas's at `at`.
    pub(crate) fn jacobian(&self, at: Px) -> Jacobian {
        const STEP_PX: f64 = 0.5;
        if self.square {
            return [[1.0, 0.0], [0.0, 1.0]];
        }
        let [x, y] = at;
        let [left, right] = [self.px([x - STEP_PX, y]), self.px([x + STEP_PX, y])];
        let [above, below] = [self.px([x, y - STEP_PX]), self.px([x, y + STEP_PX])];
        [0, 1].map(|k| [right[k] - left[k], below[k] - above[k]])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn square_cameras_have_their_own_pixels_and_tilted_ones_come_back() {
        let square = Canvas::new(&Plane::square(0.0003, [310.0, 80.0]), [320.0, 240.0]);
        assert_eq!(square.at_px([12.0, 400.5]), [12.0, 400.5]);
        let map = Matrix3::new(3e-4, 2e-5, -0.1, 1e-5, -3.1e-4, 0.02, 1e-5, 8e-5, 1.0);
        let tilted = Canvas::new(&Plane::new(map, [320.0, 240.0], 1e-8).unwrap(), [320.0, 240.0]);
        assert!(!tilted.square);
        for px in [[100.0, 90.0], [500.0, 400.0]] {
            let at = tilted.at_px(px);
            let back = tilted.px(at);
            assert!((back[0] - px[0]).hypot(back[1] - px[1]) < 1e-6, "{back:?} {px:?}");
            let moved = tilted.px([at[0] + 0.01, at[1]]);
            let by = tilted.jacobian(at);
            assert!((moved[0] - back[0] - 0.01 * by[0][0]).abs() < 1e-6);
            assert!((moved[1] - back[1] - 0.01 * by[1][0]).abs() < 1e-6);
        }
    }
}
