//! Causes in the water or in the bodies.

pub(crate) mod added_mass;
pub(crate) mod basset;
pub(crate) mod buoyancy;
pub(crate) mod cob_offset;
pub(crate) mod current;
pub(crate) mod drag_exponent;
pub(crate) mod linear_drag;
pub(crate) mod link_mass;
pub(super) mod shapes;
pub(crate) mod slosh;
pub(crate) mod wall;
