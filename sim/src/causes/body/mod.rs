//! Causes in the bodies: what they measure, how their mass lies, what the medium around does where there is no water.

pub(crate) mod inertia;
pub(crate) mod link_length;
pub(crate) mod medium_drag;
