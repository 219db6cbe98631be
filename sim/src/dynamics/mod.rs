//! Forward dynamics of a tree of bodies, one stage per file, in the order of a step.
//!
//! Spatial quantities stand in world axes about the origin of each tree's first body.

pub(crate) mod actuation;
pub(crate) mod bias;
pub(crate) mod contact;
pub(crate) mod fluid;
pub(crate) mod friction_and_limits;
pub(crate) mod implicit;
pub(crate) mod inertia;
pub(crate) mod integrate;
pub(crate) mod joint;
pub(crate) mod kinematics;
pub(crate) mod passive;
pub(crate) mod plane;
pub(crate) mod plant;
mod poses;
mod spaces;
pub(crate) mod stages;
pub(crate) mod tendon;
mod work;

pub use poses::Poses;
pub(crate) use work::Work;
