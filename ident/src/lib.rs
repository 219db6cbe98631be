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
//! Rooms, each of which knows only those before it:
//! * [`table`]: CSV read strictly (strict TOML, statistics and names as people type them are in `ground`);
//! * [`loss`], `noise`: how far keypoints are off, how large their noise is and how long it lasts;
//! * [`cmaes`]: a sampler that searches; `config`, `own_cause`, [`parameters`], [`weights`]: the `[fit]` and `[[cause]]` tables, what a fit turns, what a balance
//!   knows;
//! * [`experiment`]: a model and its runs; [`initial`]: where and when each starts; [`simulate`]: a run repeated;
//! * [`fit`]: search and least squares, error bars; [`description`]: whether the files describe the runs as they were;
//! * `hypothesis`: a model with some causes, and what a further one would gain; `evidence`: which set of causes explains runs, an unknown force
//!   in every one; [`design`]: the next run; [`diagnose`]: what the simulation gets wrong, as a report has it.

pub mod cmaes;
mod config;
pub mod description;
pub mod design;
pub mod diagnose;
mod evidence;
pub mod experiment;
pub mod fit;
mod geometry;
mod hypothesis;
pub mod initial;
pub mod loss;
mod noise;
mod own_cause;
pub mod parameters;
pub mod simulate;
pub mod table;
mod text;
pub mod weights;

pub use geometry::characteristic_length_m;
pub use text::millimetres;
