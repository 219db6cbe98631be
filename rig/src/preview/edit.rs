//! Places clicked in the picture, written into the config: its comments, and all else in it, stay as they are.

use serde::Deserialize;
use toml_edit::{Array, Value};

use camera::calibration::Px;
use config::edit::{self, EditError};
use record::outputs::OutputFile;

/// What is to be written; what is left out stays as it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Places {
    /// `[vision] base_px`: P0.
    #[serde(default)]
    pub base_px: Option<Px>,
    /// `[calibration] origin_px`: the world's origin.
    #[serde(default)]
    pub origin_px: Option<Px>,
}

/// Why places cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum PlacesError {
    /// Nothing was given.
    #[error("nothing to write: neither base_px nor origin_px is set")]
    Nothing,
    /// A place that no picture has.
    #[error("{key} = [{}, {}] lies outside the picture of {}x{} px", got[0], got[1], picture_px[0], picture_px[1])]
    Outside {
        /// The config's key.
        key: &'static str,
        /// The place \[px\].
        got: Px,
        /// Width and height of the picture \[px\].
        picture_px: [u32; 2],
    },
    /// The origin belongs to the file.
    #[error("[calibration] has a file, which holds the origin: set it with rig calibrate camera --origin-px")]
    FromFile,
    /// The config's file.
    #[error(transparent)]
    Edit(#[from] EditError),
}

impl Places {
    /// Writes them into the `config`, as it stands there now.
    ///
    /// # Errors
    /// [`PlacesError`]; the config is as it was then.
    pub fn write(&self, config: &OutputFile, picture_px: [u32; 2]) -> Result<(), PlacesError> {
        edit::rewrite(config, |text| self.edited(text, picture_px))
    }

    /// `text` with them in it.
    fn edited(&self, text: &str, picture_px: [u32; 2]) -> Result<String, PlacesError> {
        let wanted = [("vision", "base_px", self.base_px), ("calibration", "origin_px", self.origin_px)];
        if wanted.iter().all(|(.., px)| px.is_none()) {
            return Err(PlacesError::Nothing);
        }
        let mut edited = text.to_owned();
        for (table, key, px) in wanted {
            let Some(px) = px else { continue };
            let within = |c: f64, side: u32| (-0.5..f64::from(side) - 0.5).contains(&c);
            if !within(px[0], picture_px[0]) || !within(px[1], picture_px[1]) {
                return Err(PlacesError::Outside { key, got: px, picture_px });
            }
            if key == "origin_px" && edit::has(&edited, table, "file")? {
                return Err(PlacesError::FromFile);
            }
            edited = edit::set(&edited, table, key, Value::from(Array::from_iter(px.map(tenth))))?;
        }
        Ok(edited)
    }
}

/// A click is no better than that \[px\].
fn tenth(px: f64) -> f64 {
    (px * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::outputs::Outputs;

    const CONFIG: &str = "# My rig.\n\n[calibration]   # a ruler\nmetres_per_pixel = 0.00025 # measured\norigin_px = [ 320.0,60.0 ]   # the pivot\n\n[camera]\nfps = 50.0\n";
    const SIZE: [u32; 2] = [640, 480];

    fn places(base: Option<Px>, origin: Option<Px>) -> Places {
        Places { base_px: base, origin_px: origin }
    }

    #[test]
    fn places_come_in_and_everything_else_stays_to_the_byte() {
        let edited = places(None, Some([319.96, 61.0])).edited(CONFIG, SIZE).unwrap();
        assert_eq!(edited, CONFIG.replace("[ 320.0,60.0 ]", "[320.0, 61.0]"));
        let edited = places(Some([1.25, 2.0]), None).edited(CONFIG, SIZE).unwrap();
        assert_eq!(edited, format!("{CONFIG}\n[vision]\nbase_px = [1.3, 2.0]\n"));
        let inline = "vision = { links = 3 } # three\n";
        let edited = places(Some([1.0, 2.0]), None).edited(inline, SIZE).unwrap();
        assert_eq!(edited, "vision = { links = 3, base_px = [1.0, 2.0] } # three\n");
    }

    #[test]
    fn what_cannot_be_written_is_refused_with_the_reason() {
        let refused = |places: Places, text: &str| places.edited(text, SIZE).unwrap_err().to_string();
        assert!(refused(Places::default(), CONFIG).contains("nothing to write"));
        for outside in [[640.0, 3.0], [-1.0, 3.0], [f64::NAN, 3.0], [3.0, f64::INFINITY]] {
            assert!(refused(places(Some(outside), None), CONFIG).contains("outside the picture of 640x480"));
        }
        let file = "[calibration]\nfile = \"tank.toml\"\n";
        assert!(refused(places(None, Some([1.0, 1.0])), file).contains("rig calibrate camera"));
        assert!(refused(places(Some([1.0, 1.0]), None), "vision = 3\n").contains("no table"));
        assert!(refused(places(Some([1.0, 1.0]), None), "= 3\n").contains("reading the config"));
    }

    #[test]
    fn a_config_that_would_not_be_one_is_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, CONFIG).unwrap();
        let error = places(Some([1.0, 2.0]), None).write(&Outputs::edited(&path).unwrap(), SIZE).unwrap_err();
        assert!(matches!(error, PlacesError::Edit(EditError::Invalid(_))), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), CONFIG);
    }
}
