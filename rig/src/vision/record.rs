//! What goes into an extraction and what comes out of it.

use serde::{Deserialize, Serialize};

use super::Mask;
use super::extractor::Learned;
use crate::calibration::Plane;
use crate::calibration::Px;

/// How far an image's keypoints can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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

impl Keypoint {
    /// A keypoint seen at `px`, sigma `std_px` per axis, in the plane of motion.
    pub fn seen(px: Px, std_px: f64, plane: &Plane) -> Self {
        Self { px, std_px, metres: plane.metres(px), std_m: std_px * plane.metres_per_pixel(px) }
    }
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
    /// What nobody had said of the mechanism's shape and the images told.
    pub learned: Vec<Learned>,
}

/// The keypoints P0..P`links` of `records` over time. Those that no image shows, as a round body's P1, are left out where any image
/// shows another.
pub(crate) fn trajectory(records: &[ImageRecord], links: usize) -> sim::Trajectory {
    let shown = records.iter().map(|record| record.keypoints.len()).max().filter(|&most| most > 0);
    let count = shown.map_or(links + 1, |most| most.min(links + 1));
    let mut trajectory = sim::Trajectory {
        keypoints: (0..count).map(|i| format!("P{i}")).collect(),
        ..sim::Trajectory::default()
    };
    let mut std_m = Vec::new();
    for record in records {
        trajectory.time_s.push(record.time_s);
        for i in 0..count {
            let keypoint = record.keypoints.get(i);
            let [x, z] = keypoint.map_or([f64::NAN; 2], |k| k.metres);
            trajectory.position_m.push([x, f64::NAN, z]);
            std_m.push(keypoint.map_or(f64::NAN, |k| k.std_m));
        }
    }
    trajectory.std_m = Some(std_m);
    trajectory
}

impl Extraction {
    /// Puts records of `links + 1` keypoints into one trajectory.
    pub fn of(records: Vec<ImageRecord>, links: usize, plane: Plane) -> Self {
        let trajectory = trajectory(&records, links);
        Self { records, trajectory, plane, learned: Vec::new() }
    }

    /// How many images have the given status.
    pub fn count(&self, status: Status) -> usize {
        self.records.iter().filter(|record| record.status == status).count()
    }
}

/// What is kept of an image's record to start again from its silhouette or its keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredRecord {
    /// The image's name.
    pub name: String,
    /// Mid-exposure \[s\].
    pub time_s: f64,
    /// How far to trust it.
    pub status: Status,
    /// Why not further; empty when `Ok`.
    pub reason: String,
    /// The silhouette, for [`super::Extractor::with_masks`].
    pub mask: Option<Mask>,
    /// P0..Pn in the picture; empty when rejected.
    pub keypoints: Vec<StoredKeypoint>,
}

/// A keypoint before it is put into metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredKeypoint {
    /// Position in the picture \[px\].
    pub px: Px,
    /// Sigma per axis \[px\].
    pub std_px: f64,
}

impl From<&ImageRecord> for StoredRecord {
    fn from(record: &ImageRecord) -> Self {
        let keypoint = |k: &Keypoint| StoredKeypoint { px: k.px, std_px: k.std_px };
        Self {
            name: record.name.clone(),
            time_s: record.time_s,
            status: record.status,
            reason: record.reason.clone(),
            mask: record.mask.clone(),
            keypoints: record.keypoints.iter().map(keypoint).collect(),
        }
    }
}

impl StoredRecord {
    /// The record again, its keypoints put into metres by `plane`; without its centreline, which is not kept.
    pub fn record(&self, plane: &Plane) -> ImageRecord {
        ImageRecord {
            name: self.name.clone(),
            time_s: self.time_s,
            status: self.status,
            reason: self.reason.clone(),
            keypoints: self.keypoints.iter().map(|k| Keypoint::seen(k.px, k.std_px, plane)).collect(),
            mask: self.mask.clone(),
            centreline: Vec::new(),
        }
    }
}
