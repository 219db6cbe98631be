//! Forces of the water on a moving shape, as MuJoCo has them from version 3.14 on.
//!
//! Still or uniformly moving water without memory: no wake, no walls, no free surface, and of the added
//! mass only the part that depends on velocity.

mod added_mass;
mod ellipsoid;
mod inertia_box;

pub use added_mass::{AddedMass, added_mass};
pub use ellipsoid::Ellipsoid;
pub(crate) use ellipsoid::Immersed;
pub(crate) use inertia_box::ImmersedBox;
pub use inertia_box::InertiaBox;
