//! Fits and diagnoses of runs whose truth is known.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test stops where it cannot go on, and shows its figures"
)]

mod adrift;
mod bad_input;
mod base;
mod cmaes;
mod common;
mod description;
mod diagnose;
mod drives;
mod encoders;
mod evidence;
mod honesty;
mod interrupt;
mod parameters;
mod pendulum;
mod recovery;
mod reproducible;
mod starts;
mod unknown_force;
