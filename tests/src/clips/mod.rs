//! Films of mechanisms that move as is known, drawn by a renderer that shares no code with the mock camera's, and how well the
//! extraction finds the keypoints in them.
//!
//! [`shape`]: outlines by their distance; [`picture`]: light, lens and sensor; [`mechanism`], [`body`], [`octopus`]: what moves and how; [`subject`]:
//! what is said of it; [`clip`]: a film of one level of difficulty, all of it drawn from a seed; [`score`]: what the extraction made of it.

pub mod body;
pub mod clip;
pub mod mechanism;
pub mod octopus;
pub mod picture;
pub mod score;
pub mod shape;
pub mod subject;
