//! Whether the mechanism will be in the picture: calibration and model together, before anything is filmed.

use std::path::Path;

use ident::characteristic_length_m;
use sim::Model;

use super::Check;
use camera::calibration::{Plane, Px};
use config::RigConfig;
use ground::error_chain::with_causes;
use vision::outline::Outline;

/// In a picture of a shorter mechanism its links cannot be distinguished \[px\]. Chosen.
const MECHANISM_MIN_LENGTH_PX: f64 = 20.0;

/// Whether the calibration of `config` goes with pictures of this size \[px\], and puts its mechanism into them. Relative paths start at
/// `base`.
pub fn calibration(config: &RigConfig, base: &Path, size_px: [u32; 2]) -> Check {
    let subject = "calibration";
    let plane = config.calibration.plane(base).and_then(|plane| plane.fits(size_px).map(|()| plane));
    let plane = match plane {
        Ok(plane) => plane,
        Err(error) => return Check::bad(subject, with_causes(&error)),
    };
    let middle = size_px.map(|side| (f64::from(side) - 1.0) / 2.0);
    let scale = plane.metres_per_pixel(middle) * 1e3;
    let from = config.calibration.file.as_deref().map_or("[calibration]".into(), Path::to_string_lossy);
    let from = format!("{from}: {scale:.4} mm/px in the middle of the picture");
    match model(config, base) {
        Ok(model) => place_in_picture(config, &model, &plane, size_px, &from),
        Err(error) => Check::bad("model", format!("{error:#}")),
    }
}

fn model(config: &RigConfig, base: &Path) -> anyhow::Result<Model> {
    use anyhow::Context as _;
    let path = base.join(&config.run.model);
    Model::read_mjcf(&path).with_context(|| format!("reading model {}", path.display()))
}

/// Where the base of the mechanism is in the picture \[px\]; none where it floats, or where that is not known.
fn begins(config: &RigConfig, model: &Model, plane: &Plane) -> Option<Px> {
    let fixed = || Outline::new(&config.vision, Some(model)).ok()?.base_m;
    config.vision.base().or_else(|| Some(plane.pixel(plane.view().seen(fixed()?))))
}

fn place_in_picture(
    config: &RigConfig,
    model: &Model,
    plane: &Plane,
    size_px: [u32; 2],
    from: &str,
) -> Check {
    let subject = "calibration";
    let [width, height] = size_px.map(f64::from);
    let length_m = characteristic_length_m(model);
    let begins = begins(config, model, plane);
    let at = begins.unwrap_or([width / 2.0, height / 2.0]);
    let length_px = length_m / plane.metres_per_pixel(at);
    let picture = format!("a picture of {width} x {height} px");
    let long = format!(
        "the mechanism, {:.0} mm, is {length_px:.*} px long",
        length_m * 1e3,
        usize::from(length_px < 100.0)
    );
    let finding = format!("{from}; {long}");
    if !(MECHANISM_MIN_LENGTH_PX..=width.hypot(height)).contains(&length_px) {
        let remedy =
            "metres_per_pixel is in metres, and the model's lengths are: one of them is of another unit";
        return Check::bad(subject, format!("{finding} in {picture}: {remedy}"));
    }
    let Some([column, row]) = begins else { return Check::good(subject, finding) };
    let beyond = |place: f64, side: f64| (-place).max(place - (side - 1.0)).max(0.0);
    let outside_px = beyond(column, width).hypot(beyond(row, height));
    let place = format!("{finding} and begins at ({column:.0}, {row:.0}) px");
    let remedy =
        "set origin_px under [calibration], or base_px under [vision]: a click in `rig preview` does";
    if outside_px > length_px {
        return Check::bad(
            subject,
            format!("{place}, so far outside of {picture} that nothing of it is seen: {remedy}"),
        );
    }
    if outside_px > 0.0 {
        return Check::doubtful(subject, format!("{place}, outside of {picture}: if it is in it, {remedy}"));
    }
    Check::good(subject, place)
}

#[cfg(test)]
mod tests {
    use ground::strict::{Finite, Positive};

    use super::super::Health;
    use super::*;

    fn configs() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs")
    }

    /// A shipped rig of 640 x 480 px, its scale and origin changed.
    fn looked_at(metres_per_pixel: f64, origin_px: [f64; 2]) -> Check {
        let mut config = RigConfig::read(&configs().join("chain-passive-hanging.toml")).unwrap();
        config.calibration.metres_per_pixel = Positive::new(metres_per_pixel);
        config.calibration.origin_px = Some(origin_px.map(|place| Finite::new(place).unwrap()));
        calibration(&config, &configs(), [640, 480])
    }

    #[test]
    fn scale_a_thousand_times_too_large_or_small_is_told_by_the_mechanism_s_length() {
        let right = looked_at(0.00025, [320.0, 60.0]);
        assert_eq!(right.health, Health::Good, "{right}");
        assert!(right.finding.contains("80 mm, is 320 px long and begins at (320, 60) px"), "{right}");
        let large = looked_at(0.25, [320.0, 60.0]);
        assert_eq!(large.health, Health::Bad);
        assert!(large.finding.contains("0.3 px long in a picture of 640 x 480 px"), "{large}");
        assert_eq!(looked_at(2.5e-7, [320.0, 60.0]).health, Health::Bad);
    }

    #[test]
    fn mechanism_that_begins_outside_of_the_picture_is_told_and_refused_where_nothing_of_it_is_seen() {
        let far = looked_at(0.00025, [3200.0, 600.0]);
        assert_eq!(far.health, Health::Bad, "{far}");
        assert!(far.finding.contains("begins at (3200, 600) px") && far.finding.contains("outside"), "{far}");
        let near = looked_at(0.00025, [320.0, -40.0]);
        assert_eq!(near.health, Health::Doubtful, "{near}");
        assert_eq!(looked_at(0.00025, [639.0, 479.0]).health, Health::Good);
    }

    #[test]
    fn every_shipped_rig_has_its_mechanism_in_the_picture() {
        let mut looked_at = 0;
        for entry in configs().read_dir().unwrap().flatten().filter(|entry| entry.path().is_file()) {
            let Ok(config) = RigConfig::read(&entry.path()) else { continue };
            let check = calibration(&config, &configs(), [config.camera.width_px, config.camera.height_px]);
            assert_eq!(check.health, Health::Good, "{}: {check}", entry.path().display());
            looked_at += 1;
        }
        assert!(looked_at > 5, "{looked_at}");
    }
}
