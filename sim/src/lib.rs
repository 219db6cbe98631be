//! Physics of jointed bodies in water, and nothing else: no files but MJCF text, no clocks, no fits.
//!
//! A [`Model`] comes from MJCF text. [`rollout()`] moves it through time and hands back keypoint
//! positions. Everything is generic over [`Scalar`], so that the same code carries plain numbers,
//! derivatives and SIMD lanes.

pub mod command;
pub mod trajectory;

pub use command::Command;
pub use trajectory::Trajectory;
