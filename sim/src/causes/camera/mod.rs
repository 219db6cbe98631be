//! Causes in the camera, or in what it is taken to see.
//!
//! A rollout's keypoint positions are what is seen: at the time that each point is seen, then through the optics. A picture's
//! coordinates are the world's x and z; y, the depth, stays.

pub(crate) mod camera_delay;
pub(crate) mod camera_offset;
pub(crate) mod camera_rotation;
pub(crate) mod camera_scale;
pub(crate) mod camera_tilt;
pub(crate) mod keypoint_slip;
pub(crate) mod lens;
pub(super) mod look;
pub(crate) mod rolling_shutter;
