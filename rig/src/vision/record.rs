//! What goes into an extraction and what comes out of it.

use image::GrayImage;

use super::calibration::Plane;
use super::{Mask, Px};

/// An image and when it was exposed.
#[derive(Debug, Clone)]
pub struct TimedImage {
    /// File name, or whatever else tells it from the others.
    pub name: String,
    /// Mid-exposure \[s\].
    pub time_s: f64,
    /// The picture, or why it could not be read.
    pub grey: Result<GrayImage, String>,
}

/// How far an image's keypoints can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// As far as their sigma says.
    Ok,
    /// They are there, but something in the image may have misled: see the reason.
    Doubtful,
    /// There are none: see the reason.
    Rejected,
}

/// A keypoint in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Position in the picture \[px\].
    pub px: Px,
    /// Sigma per axis in the picture \[px\].
    pub std_px: f64,
    /// Position in the plane of motion, `[x, z]` \[m\].
    pub metres: [f64; 2],
    /// Sigma per axis \[m\].
    pub std_m: f64,
}

/// What one image gave.
#[derive(Debug, Clone)]
pub struct ImageRecord {
    /// The image's name.
    pub name: String,
    /// Mid-exposure \[s\].
    pub time_s: f64,
    /// How far to trust it.
    pub status: Status,
    /// Why not further; empty when `Ok`.
    pub reason: String,
    /// P0..Pn; empty when rejected.
    pub keypoints: Vec<Keypoint>,
    /// The silhouette, as far as the stages got.
    pub mask: Option<Mask>,
    /// The middle line, base first, about a pixel apart \[px\]; empty when rejected.
    pub centreline: Vec<Px>,
}

/// A whole sequence's result.
#[derive(Debug, Clone)]
pub struct Extraction {
    /// One record an image, in order.
    pub records: Vec<ImageRecord>,
    /// P0..Pn over time in the plane of motion; NaN where an image was rejected. y is never observed.
    pub trajectory: sim::Trajectory,
    /// From pixels to metres.
    pub plane: Plane,
}

impl Extraction {
    /// Puts records of `links + 1` keypoints into one trajectory.
    pub fn of(records: Vec<ImageRecord>, links: usize, plane: Plane) -> Self {
        let mut trajectory = sim::Trajectory {
            keypoints: (0..=links).map(|i| format!("P{i}")).collect(),
            std_m: Some(Vec::new()),
            ..sim::Trajectory::default()
        };
        let mut std_m = Vec::new();
        for record in &records {
            trajectory.time_s.push(record.time_s);
            for i in 0..=links {
                let keypoint = record.keypoints.get(i);
                let [x, z] = keypoint.map_or([f64::NAN; 2], |k| k.metres);
                trajectory.position_m.push([x, f64::NAN, z]);
                std_m.push(keypoint.map_or(f64::NAN, |k| k.std_m));
            }
        }
        trajectory.std_m = Some(std_m);
        Self { records, trajectory, plane }
    }

    /// How many images have the given status.
    pub fn count(&self, status: Status) -> usize {
        self.records.iter().filter(|record| record.status == status).count()
    }
}
