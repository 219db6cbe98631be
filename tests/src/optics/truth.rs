//! The truth of a film: where each keypoint is seen, where it is, and what is in its way.

use crate::optics::camera::Ray;
use crate::optics::setting::Setting;
use crate::optics::solids::Solid;
use crate::optics::vec::V3;
use std::fmt::Write;

/// The truth of a keypoint in an image.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    pub(crate) name: String,
    pub(crate) column: f64,
    pub(crate) row: f64,
    pub(crate) at: V3,
    pub(crate) is_hidden: bool,
}

/// The truth of an image: each point as it is when its row is exposed.
pub(crate) fn of_image(setting: &Setting, image: usize) -> Vec<Truth> {
    let count = setting.keypoints(0.0).len();
    (0..count)
        .map(|k| {
            let mut row = 0.0;
            let mut found = None;
            // Where the point is seen tells when it is seen, and that where it is.
            for _ in 0..if setting.readout_s == 0.0 { 1 } else { 12 } {
                let t_s = setting.row_time_s(image, row);
                let point = setting.keypoints(t_s).swap_remove(k);
                let (column, r) = setting.camera.project(point.at);
                row = r;
                found = Some((t_s, point, column));
            }
            let (t_s, point, column) = found.unwrap_or_else(|| unreachable!("at least one round"));
            let solids = setting.moving(t_s, true);
            let is_hidden = hidden(setting, &solids, (column, row), point.at, point.owner);
            Truth { name: point.name, column, row, at: point.at, is_hidden }
        })
        .collect()
}

/// Whether something of another owner stands before a point.
fn hidden(setting: &Setting, solids: &[Solid], (column, row): (f64, f64), at: V3, owner: u16) -> bool {
    let ray: Ray = setting.camera.ray(column, row);
    let far = (at - ray.from).norm();
    solids
        .iter()
        .chain(&setting.world.fixed)
        .any(|s| s.owner != owner && s.hit(&ray).is_some_and(|h| h.t < far - 1e-6))
}

/// The file `truth.csv`.
pub(crate) fn csv(setting: &Setting) -> String {
    let mut text = String::from("image,time_s");
    for k in setting.keypoints(0.0) {
        let _ = write!(text, ",{0}_x_px,{0}_y_px,{0}_x_m,{0}_z_m", k.name);
    }
    text.push_str(",hidden,trouble\n");
    let (w, h) = (setting.camera.width_px as f64, setting.camera.height_px as f64);
    for image in 0..setting.images {
        let t_s = image as f64 / setting.fps;
        let _ = write!(text, "{image},{t_s:.6}");
        let all = of_image(setting, image);
        let mut trouble: Vec<String> = setting.troubles.iter().map(|t| t.to_string()).collect();
        trouble.extend(setting.actors.iter().filter_map(|a| a.trouble(t_s)).map(String::from));
        trouble.extend(shadow(setting, &all, t_s).map(String::from));
        for k in &all {
            let _ = write!(text, ",{:.5},{:.5},{:.8},{:.8}", k.column, k.row, k.at.x, k.at.z);
            if k.column < 0.0 || k.row < 0.0 || k.column > w - 1.0 || k.row > h - 1.0 {
                trouble.push(format!("outside {}", k.name));
            }
        }
        let hidden: Vec<&str> = all.iter().filter(|k| k.is_hidden).map(|k| k.name.as_str()).collect();
        let _ = writeln!(text, ",{},{}", hidden.join(" "), trouble.join(";"));
    }
    text
}

/// Says whether the passing shadow is on the mechanism.
fn shadow(setting: &Setting, all: &[Truth], t_s: f64) -> Option<&'static str> {
    setting.world.light.passing_shadow.as_ref()?;
    let mut light = setting.world.light.clone();
    light.caustics = None;
    all.iter().any(|k| light.modulation(k.at, t_s) < 0.9).then_some("shadow")
}
