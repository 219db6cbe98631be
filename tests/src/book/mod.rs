//! The book in `docs/`: what its pages link to, and what they tell people to type.

pub mod checks;
pub mod commands;
pub mod links;
