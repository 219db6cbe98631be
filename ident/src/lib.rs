//! From keypoint trajectories to the parameters of a simulation.

pub mod strict;
pub mod table;
