//! A file for each scene, or for a few that are alike.

pub(crate) mod bubbles;
pub(crate) mod clutter;
pub(crate) mod course;
pub(crate) mod fish;
pub(crate) mod hand;
pub(crate) mod light_and_colour;
pub(crate) mod made;
pub(crate) mod reflections;
pub(crate) mod surface;
pub(crate) mod usual;
