//! The stages of a run's analysis, whose results its folder keeps.

use ground::choice::Choice;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The stage to begin with; the ones before are taken as they stand in the run's folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// From the recorded images.
    #[default]
    Frames,
    /// From the silhouettes found in them.
    Mask,
    /// From the keypoints in the picture: with another calibration, say.
    Keypoints,
    /// From `trajectory.csv`.
    Trajectory,
}

impl Choice for Stage {
    const ALL: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Frames, "frames", "From the recorded images"),
        (Self::Mask, "mask", "From the silhouettes found in them"),
        (Self::Keypoints, "keypoints", "From the keypoints in the picture: with another calibration, say"),
        (Self::Trajectory, "trajectory", "From `trajectory.csv`"),
    ];
}
