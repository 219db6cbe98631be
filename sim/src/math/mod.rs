//! Small fixed-size algebra over any [`Scalar`](crate::Scalar): vectors and rotations.

mod rotation;
mod vector;

pub use rotation::{Mat3, Quat, Sym3};
pub use vector::{Vec1, Vec2, Vec3, Vector};
