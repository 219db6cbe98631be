//! The `[calibration]` table: from pixels to metres in the plane of motion.

mod view;

use std::path::{Path, PathBuf};

use ground::strict::{self, Finite, NonNegative, Positive, StrictError};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

pub use view::View;

/// A place in a picture, `[column, row]` \[px\]; the centre of the top left pixel is `[0, 0]`.
pub type Px = [f64; 2];

/// How the picture shows the plane of motion: scale and origin, or the file of a camera calibration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Scale \[m/px\] of a camera square to the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metres_per_pixel: Option<Positive>,
    /// Where the world origin is seen \[px\]; picture rows grow downward, z (or y, from above) grows upward.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin_px: Option<[Finite; 2]>,
    /// Which plane the camera looks at; a file says it itself. Default x-z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<View>,
    /// Instead of both: path of a [`CalibrationFile`], relative to the config.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
}

/// The calibration file, as `rig calibrate camera` writes it. The first three keys are needed; the others document its origin and its
/// quality.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// Row by row, shape (3, 3): undistorted pixel `[column, row, 1]` to `[x, z, 1]` (from above `[x, y, 1]`) \[m\], up to a factor.
    pub metres_from_pixels: [[Finite; 3]; 3],
    /// Centre of the radial distortion \[px\].
    pub radial_centre_px: [Finite; 2],
    /// Radial term k \[1/px²\]: undistorted = centre + (seen - centre) (1 + k r²), r the seen distance.
    pub radial_per_px2: Finite,
    /// Which plane the camera looks at. Default x-z.
    #[serde(default)]
    pub view: View,
    /// When it was made, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Which camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// The board, as `--board` named it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<String>,
    /// Pictures that it was made from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<u32>,
    /// Width and height of those pictures \[px\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture_px: Option<[u32; 2]>,
    /// Root mean square distance of the board's corners from where the board has them \[mm\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_mm: Option<NonNegative>,
    /// The largest such distance \[mm\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_mm: Option<NonNegative>,
    /// How much farther from the camera than the board the plane lies, corrected for by the refraction at the wall \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane_offset_m: Option<Finite>,
}

/// Why a calibration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// Neither or both of the two ways were given.
    #[error("[calibration] needs either metres_per_pixel and origin_px, or file")]
    Incomplete,
    /// Table and file contradict each other.
    #[error("[calibration] says view = \"{table}\", the calibration {} says \"{file}\": leave `view` out of the table", path.display())]
    View {
        /// `view` in the table.
        table: View,
        /// `view` in the file.
        file: View,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read as a calibration.
    #[error("reading the calibration")]
    File(#[from] StrictError),
    /// The file is a camera's own calibration, as other programs make them in air.
    #[error("{} holds a camera matrix: a pinhole camera calibrated in air is 8 to 15 % wrong under water, where the wall refracts. Put the \
             chessboard into the water, in the mechanism's plane, take pictures, and let rig calibrate camera make the file", path.display())]
    InAir {
        /// The file.
        path: PathBuf,
    },
    /// Pictures of another size than those of the calibration.
    #[error("the calibration was made from pictures of {}x{} px, these have {}x{} px: film at that size, or calibrate again", wanted[0], wanted[1], got[0], got[1])]
    Size {
        /// Width and height in the calibration \[px\].
        wanted: [u32; 2],
        /// Width and height of the pictures \[px\].
        got: [u32; 2],
    },
    /// The file's homography maps the picture to a line or a point.
    #[error("calibration {}: metres_from_pixels cannot be inverted; calibrate again", path.display())]
    Singular {
        /// The file.
        path: PathBuf,
    },
}

/// The plane of motion as the camera sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    metres_from_pixels: Matrix3<f64>,
    pixels_from_metres: Matrix3<f64>,
    centre_px: Vector2<f64>,
    radial_per_px2: f64,
    /// Width and height of the pictures that it is of, where that is known \[px\].
    picture_px: Option<[u32; 2]>,
    view: View,
}

impl Calibration {
    /// A camera square to the plane: `metres_per_pixel` \[m/px\], world origin seen at `origin_px`.
    pub fn square(metres_per_pixel: Positive, origin_px: [Finite; 2]) -> Self {
        Self { metres_per_pixel: Some(metres_per_pixel), origin_px: Some(origin_px), ..Self::default() }
    }

    /// The plane it describes; a relative `file` starts at `folder`.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn plane(&self, folder: &Path) -> Result<Plane, CalibrationError> {
        match (&self.metres_per_pixel, &self.origin_px, &self.file) {
            (Some(scale), Some([column, row]), None) => {
                let plane = Plane::square(scale.get(), [column.get(), row.get()]);
                Ok(plane.viewed(self.view.unwrap_or_default()))
            }
            (None, None, Some(file)) => {
                let path = folder.join(file);
                let content = CalibrationFile::read(&path)?;
                if let Some(table) = self.view.filter(|view| *view != content.view) {
                    return Err(CalibrationError::View { table, file: content.view, path });
                }
                let m = content.metres_from_pixels;
                let [x, y] = content.radial_centre_px;
                let plane = Plane::new(
                    Matrix3::from_fn(|i, j| m[i][j].get()),
                    [x.get(), y.get()],
                    content.radial_per_px2.get(),
                );
                let plane = plane.ok_or(CalibrationError::Singular { path })?;
                Ok(Plane { picture_px: content.picture_px, ..plane.viewed(content.view) })
            }
            _ => Err(CalibrationError::Incomplete),
        }
    }
}

/// Keys of which one occurs in every camera model that OpenCV, ROS, Kalibr or MATLAB write, and none in a [`CalibrationFile`].
const PINHOLE_MODEL_KEYS: [&str; 5] =
    ["camera_matrix", "cameraMatrix", "distortion_coefficients", "intrinsics", "IntrinsicMatrix"];

impl CalibrationFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`CalibrationError::InAir`] for the file of a pinhole camera, whatever its format; [`CalibrationError::File`].
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let unreadable = |source| StrictError::Unreadable { path: path.into(), source };
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let text = String::from_utf8_lossy(&bytes);
        if !text.contains("metres_from_pixels") && PINHOLE_MODEL_KEYS.iter().any(|word| text.contains(word)) {
            return Err(CalibrationError::InAir { path: path.into() });
        }
        Ok(strict::parse(&text, path)?)
    }
}

impl Plane {
    /// A camera square to the plane.
    pub fn square(metres_per_pixel: f64, origin_px: Px) -> Self {
        let [column, row] = origin_px;
        let s = metres_per_pixel;
        Self {
            metres_from_pixels: Matrix3::new(s, 0.0, -s * column, 0.0, -s, s * row, 0.0, 0.0, 1.0),
            pixels_from_metres: Matrix3::new(1.0 / s, 0.0, column, 0.0, -1.0 / s, row, 0.0, 0.0, 1.0),
            centre_px: Vector2::zeros(),
            radial_per_px2: 0.0,
            picture_px: None,
            view: View::default(),
        }
    }

    /// A plane seen through homography and radial term, as in [`CalibrationFile`]; `None` when singular.
    pub fn new(metres_from_pixels: Matrix3<f64>, centre_px: Px, radial_per_px2: f64) -> Option<Self> {
        let pixels_from_metres = metres_from_pixels.try_inverse()?;
        let centre_px = centre_px.into();
        let (picture_px, view) = (None, View::default());
        Some(Self { metres_from_pixels, pixels_from_metres, centre_px, radial_per_px2, picture_px, view })
    }

    /// The same plane, seen from `view`.
    pub fn viewed(self, view: View) -> Self {
        Self { view, ..self }
    }

    /// Which plane of the world it is.
    pub fn view(&self) -> View {
        self.view
    }

    /// Whether it holds for pictures of this width and height \[px\].
    ///
    /// # Errors
    /// [`CalibrationError::Size`] where it was made from others.
    pub fn fits(&self, got: [u32; 2]) -> Result<(), CalibrationError> {
        match self.picture_px {
            Some(wanted) if wanted != got => Err(CalibrationError::Size { wanted, got }),
            _ => Ok(()),
        }
    }

    /// Position \[m\] in the plane of what is seen at `px`, to the right and up: `[x, z]`, or what its [`View`] says.
    pub fn metres(&self, px: Px) -> [f64; 2] {
        project(&self.metres_from_pixels, self.straight(px))
    }

    /// Where what is seen at `px` would be seen without radial distortion \[px\].
    fn straight(&self, px: Px) -> Vector2<f64> {
        let offset = Vector2::from(px) - self.centre_px;
        self.centre_px + offset * (1.0 + self.radial_per_px2 * offset.norm_squared())
    }

    /// How the world position changes at `px` along the picture's columns' numbers and its rows', radial distortion left out, shape
    /// (2, 2) \[m/px\].
    pub fn straight_slope(&self, px: Px) -> Matrix2<f64> {
        let (map, at) = (&self.metres_from_pixels, self.straight(px));
        let [x, z] = project(map, at);
        let weight = map[(2, 0)] * at.x + map[(2, 1)] * at.y + map[(2, 2)];
        Matrix2::from_fn(|i, j| (map[(i, j)] - [x, z][i] * map[(2, j)]) / weight)
    }

    /// The same plane in another world; `None` when `world_from_this` is singular.
    pub fn in_world(&self, world_from_this: &Matrix3<f64>) -> Option<Self> {
        let plane =
            Self::new(world_from_this * self.metres_from_pixels, self.centre_px.into(), self.radial_per_px2)?;
        Some(plane.viewed(self.view))
    }

    /// Undistorted pixel `[column, row, 1]` to `[x, z, 1]` \[m\], up to a factor.
    pub fn metres_from_pixels(&self) -> &Matrix3<f64> {
        &self.metres_from_pixels
    }

    /// Centre of the radial distortion \[px\].
    pub fn radial_centre_px(&self) -> Px {
        self.centre_px.into()
    }

    /// Radial term \[1/px²\], as in [`CalibrationFile`].
    pub fn radial_per_px2(&self) -> f64 {
        self.radial_per_px2
    }

    /// Where the position \[m\] in the plane is seen \[px\]; see [`Self::metres`].
    pub fn pixel(&self, metres: [f64; 2]) -> Px {
        let straight = Vector2::from(project(&self.pixels_from_metres, metres.into())) - self.centre_px;
        // Newton on r (1 + k r²) = |straight|; converges at once for any lens that does not fold the picture.
        let wanted = straight.norm();
        let mut r = wanted;
        for _ in 0..8 {
            let slope = 1.0 + 3.0 * self.radial_per_px2 * r * r;
            r -= (r * (1.0 + self.radial_per_px2 * r * r) - wanted) / slope;
        }
        let scale = if wanted > 0.0 { r / wanted } else { 1.0 };
        (self.centre_px + straight * scale).into()
    }

    /// Local scale at `px` \[m/px\]: the square root of the area that one pixel shows.
    pub fn metres_per_pixel(&self, px: Px) -> f64 {
        /// Half the step of the central difference \[px\], chosen.
        const STEP_PX: f64 = 0.5;
        let [x, y] = px;
        let difference = |a: Px, b: Px| {
            let (a, b) = (self.metres(a), self.metres(b));
            [(a[0] - b[0]) / (2.0 * STEP_PX), (a[1] - b[1]) / (2.0 * STEP_PX)]
        };
        let across = difference([x + STEP_PX, y], [x - STEP_PX, y]);
        let down = difference([x, y + STEP_PX], [x, y - STEP_PX]);
        Matrix2::new(across[0], down[0], across[1], down[1]).determinant().abs().sqrt()
    }
}

fn project(map: &Matrix3<f64>, point: Vector2<f64>) -> [f64; 2] {
    let image = map * Vector3::new(point.x, point.y, 1.0);
    [image.x / image.z, image.y / image.z]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a few products of numbers near 1e3.
    const ROUNDING_TOLERANCE: f64 = 1e-9;

    #[test]
    fn square_camera_puts_z_up_and_x_right() {
        let plane = Plane::square(0.001, [100.0, 50.0]);
        assert_eq!(plane.metres([100.0, 50.0]), [0.0, 0.0]);
        let [x, z] = plane.metres([110.0, 30.0]);
        assert!((x - 0.010).abs() < ROUNDING_TOLERANCE && (z - 0.020).abs() < ROUNDING_TOLERANCE, "{x} {z}");
        assert!((plane.metres_per_pixel([3.0, 4.0]) - 0.001).abs() < ROUNDING_TOLERANCE);
    }

    #[test]
    fn pixel_undoes_metres_through_tilt_and_lens() {
        let map = Matrix3::new(2e-4, 1e-6, -0.05, -2e-6, -2.1e-4, 0.06, 1e-5, 2e-5, 1.0);
        let plane = Plane::new(map, [320.0, 240.0], -2e-7).unwrap();
        for px in [[0.0, 0.0], [639.0, 20.0], [320.0, 240.0], [100.0, 479.0]] {
            let back = plane.pixel(plane.metres(px));
            assert!((back[0] - px[0]).hypot(back[1] - px[1]) < ROUNDING_TOLERANCE * 100.0, "{px:?} {back:?}");
        }
    }

    #[test]
    fn camera_calibrated_in_air_is_refused_and_so_is_a_key_nobody_knows() {
        let folder = tempfile::tempdir().unwrap();
        let calibration = Calibration { file: Some("camera.yaml".into()), ..Calibration::default() };
        let plane = |text: &str| {
            std::fs::write(folder.path().join("camera.yaml"), text).unwrap();
            calibration.plane(folder.path())
        };
        let opencv = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n";
        let toml = "camera_matrix = [[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]\n";
        for text in [opencv, toml] {
            let message = plane(text).unwrap_err().to_string();
            assert!(message.contains("8 to 15 % wrong under water"), "{message}");
            assert!(message.contains("rig calibrate camera"), "{message}");
        }
        let whole = "metres_from_pixels = [[1e-3, 0.0, 0.0], [0.0, -1e-3, 0.0], [0.0, 0.0, 1.0]]\n\
                     radial_centre_px = [0.0, 0.0]\nradial_per_px2 = 0.0\ndate = \"2026-11-20\"\n";
        assert!(plane(whole).unwrap().fits([1, 1]).is_ok());
        let sized = plane(&format!("{whole}picture_px = [640, 480]\n")).unwrap();
        assert!(sized.fits([640, 480]).is_ok());
        assert!(matches!(sized.fits([480, 640]), Err(CalibrationError::Size { .. })));
        assert!(matches!(plane(&format!("{whole}dat = \"x\"\n")), Err(CalibrationError::File(_))));
        let above = format!("{whole}view = \"x-y\"\n");
        assert_eq!([plane(whole).unwrap().view(), plane(&above).unwrap().view()], [View::Xz, View::Xy]);
        let table = |view| Calibration { view: Some(view), ..calibration.clone() }.plane(folder.path());
        assert!(table(View::Xy).is_ok());
        let message = table(View::Xz).unwrap_err().to_string();
        assert!(message.contains("says view = \"x-z\"") && message.contains("says \"x-y\""), "{message}");
        assert!(plane(&format!("{whole}view = \"y-z\"\n")).is_err());
        assert!(matches!(plane("\u{0}"), Err(CalibrationError::File(_))));
    }

    #[test]
    fn half_a_calibration_is_refused() {
        let half = Calibration { metres_per_pixel: Positive::new(1.0), ..Calibration::default() };
        assert!(matches!(half.plane(Path::new(".")), Err(CalibrationError::Incomplete)));
    }
}
