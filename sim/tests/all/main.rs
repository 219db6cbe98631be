//! Against analytic limits, what must be conserved, and MuJoCo.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test stops where it cannot go on, and shows its figures"
)]

mod base;
mod causes;
mod common;
mod contact;
mod derivatives;
mod forces;
mod golden;
mod lanes;
mod mjcf;
mod mjcf_files;
mod other_ways;
mod own_causes;
mod physics;
mod random_models;
mod transitions;
