//! The part of a rig config that turns pictures, or what others saw in them, into trajectories.

use std::path::{Path, PathBuf};

use ground::strict::{self, Positive};
use serde::Deserialize;

use super::ConfigError;
use camera::calibration::{Calibration, CalibrationError, Plane, View};
use vision::VisionConfig;

/// The tables of any rig config that say how pictures are read; others belong to other verbs.
#[derive(Debug, Clone, Deserialize)]
pub struct ExtractionConfig {
    #[serde(default)]
    camera: Camera,
    calibration: Option<Calibration>,
    /// From images to keypoints.
    #[serde(default)]
    pub vision: VisionConfig,
    #[serde(default)]
    run: Run,
    /// The config's own folder.
    #[serde(skip)]
    folder: PathBuf,
}

/// The one key of `[run]` that matters here.
#[derive(Debug, Clone, Default, Deserialize)]
struct Run {
    model: Option<PathBuf>,
}

/// The one key of `[camera]` that matters here; `rig run` checks the others.
#[derive(Debug, Clone, Default, Deserialize)]
struct Camera {
    fps: Option<Positive>,
}

impl ExtractionConfig {
    /// Reads the config at `path`.
    ///
    /// # Errors
    /// [`ConfigError::Strict`] with file and line.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let folder = path.parent().unwrap_or(Path::new("")).into();
        Ok(Self { folder, ..strict::read(path)? })
    }

    /// Reads the config from `text`, as [`ExtractionConfig::read`] would at `path`.
    ///
    /// # Errors
    /// [`ConfigError::Strict`] with line.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let folder = path.parent().unwrap_or(Path::new("")).into();
        Ok(Self { folder, ..strict::parse(text, path)? })
    }

    /// The folder that the config's paths start from.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Images per second, where the config says it.
    pub fn fps(&self) -> Option<f64> {
        self.camera.fps.map(Positive::get)
    }

    /// The model of `[run]`.
    pub fn model(&self) -> Option<PathBuf> {
        self.run.model.as_ref().map(|model| self.folder.join(model))
    }

    /// From pixels to metres.
    ///
    /// # Errors
    /// [`CalibrationError`]; [`CalibrationError::Incomplete`] too where the table is missing.
    pub fn plane(&self) -> Result<Plane, CalibrationError> {
        self.calibration.as_ref().ok_or(CalibrationError::Incomplete)?.plane(&self.folder)
    }

    /// Which plane the camera looks at: x-z where there is no calibration to say otherwise.
    ///
    /// # Errors
    /// [`CalibrationError`] where its file cannot be read.
    pub fn view(&self) -> Result<View, CalibrationError> {
        match &self.calibration {
            Some(calibration) if calibration.file.is_some() => Ok(calibration.plane(&self.folder)?.view()),
            Some(calibration) => Ok(calibration.view.unwrap_or_default()),
            None => Ok(View::default()),
        }
    }
}
