//! What a camera with faults of its own makes of the motion.

use super::chain::{Plane, add};
use super::motion::Record;
use super::terms::Hidden;

/// The ends of the links `keypoints` as images taken at `times_s` show them \[m\], shape (images, keypoints).
pub fn images<const N: usize>(
    record: &Record<N>,
    keypoints: &[usize],
    hidden: &Hidden,
    times_s: &[f64],
) -> Vec<Vec<Plane>> {
    let get = |name: &str| hidden.get(name, 0.0);
    let late_s = get("camera_delay/delay");
    let slowness = get("rolling_shutter/slowness");
    let radial = get("lens/radial");
    let axis = [get("lens/x"), get("lens/z")];
    let tilt = [get("camera_tilt/x"), get("camera_tilt/z")];
    let scale = 1.0 + get("camera_scale/scale");
    let (sin, cos) = get("camera_rotation/angle").sin_cos();
    let origin = [get("camera_offset/x"), get("camera_offset/z")];
    // a keypoint further along its link lies on the line from the end before through its own
    let slipped = |(i, slip): (usize, f64), when: f64| -> Plane {
        let end = record.end(i, when);
        if slip == 0.0 {
            return end;
        }
        let base = if i == 0 { [0.0; 2] } else { record.end(i - 1, when) };
        let link = add(end, base, -1.0);
        add(end, link, slip / link[0].hypot(link[1]))
    };
    let seen = |mark: (usize, f64), time_s: f64| -> Plane {
        let mut at = slipped(mark, time_s + late_s);
        if slowness != 0.0 {
            at = slipped(mark, time_s + late_s + slowness * at[1]);
        }
        let off = add(at, axis, -1.0);
        at = add(at, off, radial * (off[0] * off[0] + off[1] * off[1]));
        let keystone = scale * (1.0 + tilt[0] * at[0] + tilt[1] * at[1]);
        let [x, z] = at.map(|a| a * keystone);
        [cos * x - sin * z + origin[0], sin * x + cos * z + origin[1]]
    };
    let slips = (1..).map(|k| get(&format!("keypoint_slip/P{k}")));
    let marks: Vec<(usize, f64)> = keypoints.iter().copied().zip(slips).collect();
    times_s.iter().map(|&time_s| marks.iter().map(|&mark| seen(mark, time_s)).collect()).collect()
}
