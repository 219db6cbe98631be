//! Physics of jointed bodies in water, and nothing else: no files but models in MJCF, no clocks, no fits.
//!
//! A [`Model`] comes from MJCF. [`rollout()`] moves it through time and hands back keypoint
//! positions; a [`Simulator`] moves it step by step. What they are made of is generic over [`Scalar`], so that the same
//! code carries plain numbers, derivatives and SIMD lanes.
//!
//! Rooms, each of which knows only those before it:
//! * [`error`], [`command`], [`base`], [`trajectory`], [`scalar`], [`math`], [`dual`], [`lanes`], [`steps`], [`options`]: numbers of all kinds, and what goes in and out;
//! * [`model`]: what MJCF says, as data, causes as values among them; `space`: motions and wrenches in space or in a plane;
//! * [`fluid`], `dynamics`: water on one shape; the stages of a step over the whole tree;
//! * [`causes`]: what a simulation may lack, one file each, by place: water, joint, drive, tether, camera;
//! * [`simulator`], [`mjcf`]: one step, by each of the methods; the format, read and written;
//! * `film`, [`rollout`](mod@rollout): a whole run as a camera sees it; `plan`: the cheapest steps for it; `contact`: where bodies meet, looked at afterwards;
//! * [`batch`], [`sensitivities`]: many candidates, or one with derivatives, in SIMD lanes; [`transitions`]: how a run answers to forces, piece by piece.

pub mod base;
pub mod batch;
pub mod causes;
pub mod command;
mod contact;
pub mod dual;
mod dynamics;
pub mod error;
mod film;
pub mod fluid;
pub mod lanes;
pub mod math;
pub mod mjcf;
pub mod model;
pub mod options;
mod plan;
pub mod rollout;
pub mod scalar;
pub mod sensitivities;
pub mod simulator;
mod space;
pub mod steps;
pub mod trajectory;
pub mod transitions;

pub use base::{BaseError, BaseMotion, BasePath};
pub use causes::{Cause, CauseValues, CommandPath};
pub use command::Command;
pub use contact::{ContactPoint, ContactWatch, Touch};
pub use dynamics::Poses;
pub use error::RolloutError;
pub use lanes::Isa;
pub use mjcf::MjcfError;
pub use model::{Integrator, JointKind, Model, State};
pub use options::RolloutOptions;
pub use plan::{ACCURACY_M, Plan, plan};
pub use rollout::{Rollout, rollout, rollout_of};
pub use scalar::Scalar;
pub use simulator::Simulator;
pub use steps::{Method, Steps};
pub use trajectory::Trajectory;
