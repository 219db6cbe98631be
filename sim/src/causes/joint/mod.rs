//! Causes in the joints.

pub(super) mod axles;
pub(crate) mod coulomb_friction;
pub(crate) mod end_stop;
pub(crate) mod joint_damping;
pub(crate) mod joint_zero;
pub(crate) mod load_friction;
pub(crate) mod one_sided_stiffness;
pub(crate) mod stiffness;
