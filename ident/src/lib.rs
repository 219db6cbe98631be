//! From keypoint trajectories to the parameters of a simulation.
//!
//! [`Experiment::read`](experiment::Experiment::read) loads a model and the runs it should repeat,
//! [`fit::fit`] turns the model's numbers until it does, and says which of them the runs determine:
//!
//! ```no_run
//! use ident::{experiment::Experiment, fit};
//!
//! let experiment = Experiment::read("experiment.toml".as_ref())?;
//! let fitted = fit::fit(&experiment, &mut ())?;
//! std::fs::write("fit.json", fitted.fit.to_json()?)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! On the way: [`table`] reads trajectories and servo commands, [`initial`] finds where and when each run
//! starts, [`parameters`] names what may be turned, [`weights`] what a balance
//! knows of it, [`simulate`] repeats a run, [`loss`] compares,
//! [`cmaes`] searches.

pub mod cmaes;
mod config;
pub mod design;
pub mod diagnose;
pub mod experiment;
pub mod fit;
mod geometry;
mod hypothesis;
pub mod initial;
pub mod loss;
mod names;
mod noise;
pub mod parameters;
pub mod simulate;
pub mod statistics;
pub mod strict;
pub mod table;
mod text;
pub mod weights;

pub use geometry::characteristic_length_m;
pub use text::millimetres;
