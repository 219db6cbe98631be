//! Writes the folder of a film.

use crate::optics::calibrate::Calibration;
use crate::optics::mechanism::Kind;
use crate::optics::model;
use crate::optics::render::Renderer;
use crate::optics::setting::Setting;
use crate::optics::truth;
use image::ExtendedColorType;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::path::Path;

/// Renders a film into a folder, with all that belongs to it.
pub(crate) fn write(
    setting: &Setting,
    folder: &Path,
    empty: bool,
    title: &str,
    rng: &mut ChaCha8Rng,
) -> Result<(), String> {
    let frames = folder.join("frames");
    fs::create_dir_all(&frames).map_err(|e| format!("cannot make {}: {e}", frames.display()))?;
    let put = |name: &str, text: &[u8]| {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|e| format!("cannot write {}: {e}", path.display()))
    };
    let calibration = Calibration::of(&setting.camera);
    put("tank.toml", calibration.to_toml(&setting.camera).as_bytes())?;
    put("model.xml", model::mjcf(&setting.mechanism).as_bytes())?;
    put("truth.csv", truth::csv(setting).as_bytes())?;
    put("extract.toml", config(setting, title, rng).as_bytes())?;
    let renderer = Renderer::new(setting);
    let (w, h) = (setting.camera.width_px, setting.camera.height_px);
    let key = |image: usize| setting.seed.wrapping_mul(1_000_003).wrapping_add(image as u64);
    if empty {
        let rgb = setting.sensor.develop(&renderer.image(0, false), 0.0, key(usize::MAX));
        let path = folder.join("empty.png");
        image::save_buffer(&path, &rgb, w as u32, h as u32, ExtendedColorType::Rgb8)
            .map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    }
    for image in 0..setting.images {
        let light = renderer.image(image, true);
        let rgb = setting.sensor.develop(&light, image as f64 / setting.fps, key(image));
        let path = frames.join(format!("{image:06}.jpg"));
        fs::write(&path, setting.sensor.jpeg(&rgb, w, h)?)
            .map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    }
    Ok(())
}

/// The file `extract.toml`, with P0 as somebody would have clicked it.
fn config(setting: &Setting, title: &str, rng: &mut ChaCha8Rng) -> String {
    let c = &setting.camera;
    let p0 = &truth::of_image(setting, 0)[0];
    let (angle, off): (f64, f64) = (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(0.0..3.0));
    let base = match setting.mechanism.kind {
        Kind::Octopus => String::new(),
        _ => format!("base_px = [{:.1}, {:.1}]\n", p0.column + off * angle.cos(), p0.row + off * angle.sin()),
    };
    let readout =
        if setting.readout_s > 0.0 { format!("readout_s = {}\n", setting.readout_s) } else { String::new() };
    format!(
        "# {title}, rendered\n\n[run]\nname = \"{title}\"\nmodel = \"model.xml\"\n\n[camera]\nkind = \"folder\"\nfps = {:.1}\n\
         width_px = {}\nheight_px = {}\nformat = \"jpeg\"\nexposure_s = {}\n{readout}\n[calibration]\nfile = \"tank.toml\"\n\n[vision]\n\
         {base}# camera_distance_m = {:.6}\n\n[mechanism]\nmount = \"hanging\"\n",
        setting.fps,
        c.width_px,
        c.height_px,
        setting.exposure_s,
        c.effective_distance_m()
    )
}
