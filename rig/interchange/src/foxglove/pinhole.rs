//! A plane's calibration as the pinhole camera that Foxglove's schemas are made for.
//!
//! A calibration describes the image of one plane of the tank. It determines the focal length of a tilted camera; for one that is square
//! to the plane a usual lens is assumed. Points in the plane are exact in both cases; the scale of what lies behind it is a guess.

use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::{CAMERA, time, transform};
use camera::calibration::Plane;

/// Focal length of a usual lens, in widths of the picture. Guessed.
const DEFAULT_FOCAL_LENGTH_WIDTHS: f64 = 1.5;
/// Focal lengths that are accepted from a calibration, in widths of the picture. Chosen.
const PLAUSIBLE_FOCAL_LENGTHS_WIDTHS: std::ops::Range<f64> = 0.4..8.0;

/// A camera without skew whose axis goes through the middle of the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Pinhole {
    size_px: [u32; 2],
    focal_px: f64,
    /// `tank_from_camera`.
    rotation: Matrix3<f64>,
    /// Its position in the tank \[m\].
    place_m: Vector3<f64>,
    /// First coefficient of OpenCV's radial distortion, to first order.
    radial: f64,
}

impl Pinhole {
    /// The camera that sees the plane of motion as `plane` says in pictures of this width and height; none where the plane is seen edge on.
    ///
    /// # Source
    /// Z. Zhang, A Flexible New Technique for Camera Calibration, IEEE Trans. Pattern Anal. Mach. Intell. 22 (2000), section 2.
    pub fn of(plane: &Plane, size_px: [u32; 2]) -> Option<Self> {
        let width = f64::from(size_px[0]);
        let middle = size_px.map(|px| (f64::from(px) - 1.0) / 2.0);
        let centred = Matrix3::new(1.0, 0.0, -middle[0], 0.0, 1.0, -middle[1], 0.0, 0.0, 1.0);
        let pixels_from_plane = centred * plane.metres_from_pixels().try_inverse()?;
        let (right, up) = (pixels_from_plane.column(0), pixels_from_plane.column(1));
        // with w = 1/f2: (x1 x2 + y1 y2) w + z1 z2 = 0 and (|xy1|2 - |xy2|2) w + z1^2 - z2^2 = 0
        let flat = [
            right[0] * up[0] + right[1] * up[1],
            right[0].powi(2) + right[1].powi(2) - up[0].powi(2) - up[1].powi(2),
        ];
        let deep = [right[2] * up[2], right[2].powi(2) - up[2].powi(2)];
        let inverse_square =
            -(flat[0] * deep[0] + flat[1] * deep[1]) / (flat[0] * flat[0] + flat[1] * flat[1]);
        let focal_px = Some(inverse_square.sqrt().recip())
            .filter(|focal| PLAUSIBLE_FOCAL_LENGTHS_WIDTHS.contains(&(focal / width)))
            .unwrap_or(DEFAULT_FOCAL_LENGTH_WIDTHS * width);
        let rays =
            Matrix3::from_diagonal(&Vector3::new(1.0 / focal_px, 1.0 / focal_px, 1.0)) * pixels_from_plane;
        let scale = (rays.column(0).norm() + rays.column(1).norm()) / 2.0 * rays[(2, 2)].signum();
        if !scale.is_normal() {
            return None;
        }
        let (right, up, origin) =
            (rays.column(0) / scale, rays.column(1) / scale, rays.column(2).into_owned() / scale);
        // the nearest rotation to what need not quite be one
        let found = Matrix3::from_columns(&[right, up, right.cross(&up)]).svd(true, true);
        let camera_from_plane = found.u? * found.v_t?;
        let axes = plane.view().seen_axes().map(|(axis, _)| Vector3::ith(axis, 1.0));
        let tank_from_plane = Matrix3::from_columns(&[axes[0], axes[1], axes[0].cross(&axes[1])]);
        let rotation = tank_from_plane * camera_from_plane.transpose();
        Some(Self {
            size_px,
            focal_px,
            rotation,
            place_m: -(rotation * origin),
            radial: -plane.radial_per_px2() * focal_px * focal_px,
        })
    }

    /// Where a place in the tank is seen, without radial distortion \[px\].
    pub fn pixel(&self, place_m: [f64; 3]) -> [f64; 2] {
        let ray = self.rotation.transpose() * (Vector3::from(place_m) - self.place_m);
        let middle = self.size_px.map(|px| (f64::from(px) - 1.0) / 2.0);
        [0, 1].map(|i| middle[i] + self.focal_px * ray[i] / ray[2])
    }

    /// `foxglove.CameraCalibration`.
    pub fn calibration(&self, at_ns: u64) -> Value {
        let [x, y] = self.size_px.map(|px| (f64::from(px) - 1.0) / 2.0);
        let f = self.focal_px;
        let distortion = if self.radial == 0.0 { vec![] } else { vec![self.radial, 0.0, 0.0, 0.0, 0.0] };
        json!({
            "timestamp": time(at_ns), "frame_id": CAMERA, "width": self.size_px[0], "height": self.size_px[1],
            "distortion_model": if distortion.is_empty() { "" } else { "plumb_bob" },
            "D": distortion,
            "K": [f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0],
            "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "P": [f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0],
        })
    }

    /// One `foxglove.FrameTransform`: where the camera stands.
    pub fn transform(&self, at_ns: u64) -> Value {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| self.rotation[(i, j)]));
        transform(at_ns, CAMERA, self.place_m.into(), &rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camera::calibration::View;

    const SIZE_PX: [u32; 2] = [640, 480];

    /// What lies in the plane is seen where the plane's own calibration has it.
    fn agrees(plane: &Plane, within_px: f64) -> Pinhole {
        let camera = Pinhole::of(plane, SIZE_PX).unwrap();
        for px in [[20.0, 30.0], [600.0, 400.0], [320.0, 240.0]] {
            let [right, up] = plane.metres(px);
            let mut world = plane.view().world([right, up]);
            world[plane.view().depth_axis()] = 0.0;
            let got = camera.pixel(world);
            assert!((got[0] - px[0]).hypot(got[1] - px[1]) < within_px, "{px:?} {got:?}");
        }
        camera
    }

    #[test]
    fn camera_square_to_the_plane_stands_before_it_and_sees_what_the_plane_says() {
        let camera = agrees(&Plane::square(2.5e-4, [320.0, 60.0]), 1e-9);
        let place = camera.place_m;
        assert!(place.y < -0.1 && place.x.abs() < 1e-3, "before the plane is -y: {place}");
        let above = agrees(&Plane::square(2.5e-4, [320.0, 60.0]).viewed(View::Xy), 1e-9);
        assert!(above.place_m.z > 0.1, "{}", above.place_m);
    }

    #[test]
    fn tilted_cameras_focal_length_and_place_are_found() {
        let (focal_px, turn) = (900.0, nalgebra::Rotation3::from_euler_angles(0.25, -0.2, 0.05));
        // x right, y down, z away; the plane's up is -y
        let upright = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let camera_from_plane = turn.matrix() * upright;
        let origin = Vector3::new(0.01, -0.02, 0.4);
        let lens = Matrix3::new(focal_px, 0.0, 319.5, 0.0, focal_px, 239.5, 0.0, 0.0, 1.0);
        let seen = lens
            * Matrix3::from_columns(&[
                camera_from_plane.column(0).into(),
                camera_from_plane.column(1).into(),
                origin,
            ]);
        let plane = Plane::new(seen.try_inverse().unwrap(), [0.0, 0.0], 0.0).unwrap();
        let camera = agrees(&plane, 1e-6);
        assert!((camera.focal_px - focal_px).abs() < 1e-6, "{}", camera.focal_px);
        // a keypoint that is not in the plane
        let seen = camera_from_plane * Vector3::new(0.03, 0.02, 0.05) + origin;
        let got = camera.pixel([0.03, -0.05, 0.02]);
        assert!((got[0] - (319.5 + focal_px * seen.x / seen.z)).abs() < 1e-6, "{got:?}");
    }
}
