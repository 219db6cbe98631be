//! A calibration for people, and the file of it.

use std::fmt::Write as _;

use super::Calibrated;

const MM_PER_M: f64 = 1e3;
/// Smaller angles cannot be distinguished from none: their cosine is as near to 1 as the scale is known.
const TILT_MIN_DEGREES: f64 = 1.0;

/// The quality of a calibration as lines of text.
pub fn text(calibrated: &Calibrated) -> String {
    let quality = &calibrated.quality;
    let mut out = table(calibrated);
    for (name, reason) in &quality.without_board {
        let _ = writeln!(out, "{name}: left out: {reason}");
    }
    let [across, down] = quality.scale_change.map(|share| 100.0 * share);
    let [width, height] = quality.cover.map(|share| 100.0 * share);
    let _ = writeln!(
        out,
        "rms {:.3} mm, worst {:.3} mm, over all corners",
        quality.rms_m * MM_PER_M,
        quality.worst_m * MM_PER_M
    );
    let _ = writeln!(
        out,
        "scale {:.4} mm/px in the middle; {across:+.1} % from left to right, {down:+.1} % from top to bottom",
        quality.metres_per_px * MM_PER_M
    );
    let degrees = quality.tilt_rad.to_degrees();
    let note = if degrees < TILT_MIN_DEGREES { ", not distinguishable from none" } else { "" };
    let _ = writeln!(out, "camera's axis {degrees:.1}° off the plane's normal{note}");
    let [column, row] = calibrated.plane.radial_centre_px();
    let _ = writeln!(
        out,
        "radial term {:.3e} /px² about [{column:.1}, {row:.1}] px: {:+.2} % at the picture's corners",
        calibrated.plane.radial_per_px2(),
        100.0 * quality.radial_share
    );
    let _ =
        writeln!(out, "the boards cover {width:.0} % of the picture's width, {height:.0} % of its height");
    if let (Some(worst_m), Some((behind_m, _))) = (quality.offset_worst_m, calibrated.setup.offset) {
        let _ = writeln!(
            out,
            "moved to the plane {behind_m:+} m behind the board by Snell's law, within {:.3} mm",
            worst_m * MM_PER_M
        );
    }
    for warning in &quality.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}

/// One line for each picture with the board.
fn table(calibrated: &Calibrated) -> String {
    let pictures = &calibrated.quality.pictures;
    let widest = pictures.iter().map(|picture| picture.name.chars().count()).max().unwrap_or(0).max(7);
    let mut out = format!("{:<widest$} corners misread  rms_mm worst_mm\n", "picture");
    for picture in pictures {
        let _ = writeln!(
            out,
            "{:<widest$} {:>7} {:>7} {:>7.3} {:>8.3}",
            picture.name,
            picture.corners,
            picture.misread,
            picture.rms_m * MM_PER_M,
            picture.worst_m * MM_PER_M
        );
    }
    out
}

/// The calibration file, as [`camera::calibration::CalibrationFile`] reads it; `date` is when the calibration was made, `camera` which
/// camera it is of.
pub fn toml(calibrated: &Calibrated, date: &str, camera: Option<&str>) -> String {
    let string = |text: &str| toml::Value::from(text).to_string();
    let quality = &calibrated.quality;
    let map = calibrated.plane.metres_from_pixels();
    let rows: Vec<String> =
        map.row_iter().map(|row| format!("    [{:?}, {:?}, {:?}],\n", row[0], row[1], row[2])).collect();
    let [column, row] = calibrated.plane.radial_centre_px();
    let [width, height] = calibrated.size_px;
    let comment: String = text(calibrated).lines().map(|line| format!("# {line}\n")).collect();
    let mut out = format!(
        "# The mechanism's plane of motion as the camera sees it through the wall, in water; made by rig calibrate camera.\n\
         # Valid until camera, lens, zoom, focus, tank or plane move. In a rig config: [calibration] file = \"...\"\n#\n{comment}\n\
         date = {}\n",
        string(date)
    );
    if let Some(camera) = camera {
        let _ = writeln!(out, "camera = {}", string(camera));
    }
    let _ = writeln!(out, "board = {}", string(&calibrated.setup.board.to_string()));
    let _ = writeln!(out, "images = {}", quality.pictures.len());
    let _ = writeln!(out, "picture_px = [{width}, {height}]         # [px]: width, height");
    let _ = writeln!(
        out,
        "rms_mm = {:.4}                  # corners from where the board has them [mm]",
        quality.rms_m * MM_PER_M
    );
    let _ = writeln!(out, "worst_mm = {:.4}                # [mm]", quality.worst_m * MM_PER_M);
    if let Some((behind_m, _)) = calibrated.setup.offset {
        let _ = writeln!(
            out,
            "plane_offset_m = {behind_m:?}           # the plane lies so much behind the board [m]"
        );
    }
    let [(_, right), (_, up)] = calibrated.plane.view().seen_axes();
    let _ = writeln!(
        out,
        "view = \"{}\"                    # the plane that the camera looks at: {right} to the right in the picture, {up} up",
        calibrated.plane.view()
    );
    let _ = writeln!(
        out,
        "\n# Undistorted pixel [column, row, 1] to [{right}, {up}, 1] [m], up to a factor.\nmetres_from_pixels = [\n{}]\n\
         # Undistorted = centre + (seen - centre) (1 + k r^2), r the seen distance from the centre.\n\
         radial_centre_px = [{column:?}, {row:?}]  # [px]\n\
         radial_per_px2 = {:?}  # k [1/px^2]",
        rows.concat(),
        calibrated.plane.radial_per_px2()
    );
    out
}
