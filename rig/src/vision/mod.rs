//! From images to keypoints.
