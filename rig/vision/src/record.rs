//! What goes into an extraction and what comes out of it.

use serde::{Deserialize, Serialize};

use super::Mask;
use super::extractor::Learned;
use super::keypoints::Sigma;
use super::self_check::{SelfCheck, SelfCheckError};
use camera::calibration::Px;
use camera::calibration::{Plane, View};

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
    /// The part of it that comes back with the pose \[px\].
    pub pose_std_px: f64,
    /// Position in the plane of motion, `[x, z]` \[m\].
    pub metres: [f64; 2],
    /// Sigma per axis \[m\].
    pub std_m: f64,
    /// The part of it that comes back with the pose \[m\].
    pub pose_std_m: f64,
}

impl Keypoint {
    /// A keypoint seen at `px`, as surely as `sigma` says, in the plane of motion.
    pub fn seen(px: Px, sigma: Sigma, plane: &Plane) -> Self {
        let Sigma { whole_px: std_px, pose_px: pose_std_px } = sigma;
        let scale_m = plane.metres_per_pixel(px);
        let (std_m, pose_std_m) = (std_px * scale_m, pose_std_px * scale_m);
        Self { px, std_px, pose_std_px, metres: plane.metres(px), std_m, pose_std_m }
    }

    fn stored(stored: Option<&StoredKeypoint>, plane: &Plane) -> Self {
        let nothing = ([f64::NAN; 2], f64::NAN, f64::NAN);
        let (px, std_px, pose_std_px) =
            stored.map_or(nothing, |stored| (stored.px, stored.std_px, stored.pose_std_px));
        Self::seen(px, Sigma { whole_px: std_px, pose_px: pose_std_px }, plane)
    }

    /// How sure it is.
    pub fn sigma(&self) -> Sigma {
        Sigma { whole_px: self.std_px, pose_px: self.pose_std_px }
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
    /// P0..Pn; empty when rejected. One that is not seen is no number.
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
    /// P0..Pn over time in the plane of motion; NaN where an image was rejected. What is along the camera's view is never observed.
    pub trajectory: sim::Trajectory,
    /// Names of the records' keypoints.
    pub names: Vec<String>,
    /// From pixels to metres.
    pub plane: Plane,
    /// What nobody had said of the mechanism's shape and the images told.
    pub learned: Vec<Learned>,
    /// What the film drawn again told of its keypoints' errors, or why it could not; none where nobody asked.
    pub checked: Option<Result<SelfCheck, SelfCheckError>>,
    /// Once all images were seen, some of what had been found in them was changed.
    pub is_revised: bool,
}

/// The keypoints of `records`, which are called `names`, over time, as `view` shows them. Those that no image
/// shows, as a round body's P1, are left out where any image shows another.
pub fn trajectory(records: &[ImageRecord], names: &[String], view: View) -> sim::Trajectory {
    let shown = |i: &usize| {
        records
            .iter()
            .any(|record| record.keypoints.get(*i).is_some_and(|k| k.px.iter().all(|px| px.is_finite())))
    };
    let mut kept: Vec<usize> = (0..names.len()).filter(shown).collect();
    if kept.is_empty() {
        kept = (0..names.len()).collect();
    }
    let mut trajectory = sim::Trajectory {
        keypoints: kept.iter().map(|&i| names[i].clone()).collect(),
        ..sim::Trajectory::default()
    };
    let (mut std_m, mut pose_std_m) = (Vec::new(), Vec::new());
    for record in records {
        trajectory.time_s.push(record.time_s);
        for &i in &kept {
            let keypoint = record.keypoints.get(i);
            trajectory.position_m.push(view.world(keypoint.map_or([f64::NAN; 2], |k| k.metres)));
            std_m.push(keypoint.map_or(f64::NAN, |k| k.std_m));
            let pose = keypoint.map(|k| k.pose_std_m).filter(|std| *std > 0.0);
            pose_std_m.push(pose.unwrap_or(f64::NAN));
        }
    }
    trajectory.std_m = Some(std_m);
    trajectory.pose_std_m = Some(pose_std_m);
    trajectory
}

impl Extraction {
    /// Puts records of `links + 1` keypoints into one trajectory.
    pub fn of(records: Vec<ImageRecord>, links: usize, plane: Plane) -> Self {
        Self::named(records, (0..=links).map(|i| format!("P{i}")).collect(), plane)
    }

    /// Puts records whose keypoints are called `names` into one trajectory.
    pub fn named(records: Vec<ImageRecord>, names: Vec<String>, plane: Plane) -> Self {
        let trajectory = trajectory(&records, &names, plane.view());
        Self { records, trajectory, names, plane, learned: Vec::new(), checked: None, is_revised: false }
    }

    /// Takes the records' keypoints into the trajectory again, after they were changed.
    pub(super) fn renew_trajectory(&mut self) {
        self.trajectory = trajectory(&self.records, &self.names, self.plane.view());
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
    /// P0..Pn in the picture, nothing for one that is not seen; empty when rejected.
    pub keypoints: Vec<Option<StoredKeypoint>>,
    /// The middle line, base first, points 4 px apart to 0.1 px \[px\]; not there in runs from before 2026-11-26.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub centreline: Vec<Px>,
}

/// How far apart points of a stored centreline are \[px\], the last one excepted.
const STORED_STEP_PX: f64 = 4.0;

/// A centreline as it is stored; a stored one stays as it is.
pub fn sparse(centreline: &[Px]) -> Vec<Px> {
    let rounded = |px: &Px| px.map(|px| (px * 10.0).round() / 10.0);
    let mut kept: Vec<Px> = Vec::new();
    for (i, px) in centreline.iter().map(rounded).enumerate() {
        let far = |last: &Px| (px[0] - last[0]).hypot(px[1] - last[1]) >= STORED_STEP_PX;
        if i + 1 == centreline.len() || kept.last().is_none_or(far) {
            kept.push(px);
        }
    }
    kept
}

/// A keypoint before it is put into metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredKeypoint {
    /// Position in the picture \[px\].
    pub px: Px,
    /// Sigma per axis \[px\].
    pub std_px: f64,
    /// The part of it that comes back with the pose \[px\]; 0 in runs from before it was told apart.
    #[serde(default)]
    pub pose_std_px: f64,
}

impl From<&ImageRecord> for StoredRecord {
    fn from(record: &ImageRecord) -> Self {
        let keypoint = |k: &Keypoint| {
            let seen = k.px.iter().all(|px| px.is_finite());
            seen.then_some(StoredKeypoint { px: k.px, std_px: k.std_px, pose_std_px: k.pose_std_px })
        };
        Self {
            name: record.name.clone(),
            time_s: record.time_s,
            status: record.status,
            reason: record.reason.clone(),
            mask: record.mask.clone(),
            keypoints: record.keypoints.iter().map(keypoint).collect(),
            centreline: sparse(&record.centreline),
        }
    }
}

impl StoredRecord {
    /// The record again, its keypoints put into metres by `plane`.
    pub fn record(&self, plane: &Plane) -> ImageRecord {
        ImageRecord {
            name: self.name.clone(),
            time_s: self.time_s,
            status: self.status,
            reason: self.reason.clone(),
            keypoints: self.keypoints.iter().map(|k| Keypoint::stored(k.as_ref(), plane)).collect(),
            mask: self.mask.clone(),
            centreline: self.centreline.clone(),
        }
    }
}
