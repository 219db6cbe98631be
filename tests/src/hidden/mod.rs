//! Measured data with a hidden effect, and how well `rig diagnose` finds it.
//!
//! A generator of its own, which shares definitions with the simulation and no code: the planar chain from Lagrange's equations
//! ([`chain`], [`fluid`]), the causes' terms ([`terms`]), the drive ([`drive`]), fine Runge-Kutta steps and Basset's integral by
//! quadrature ([`motion`]), the camera ([`camera`]). [`mod@bench`] has what a mechanism and its runs are, [`three_links`] and [`arm`] draw
//! theirs, [`limit`] finds the smallest size
//! that its runs can show, [`cases`] lists what is hidden where, [`mod@write`] writes an `experiment.toml`, [`pictures`] the films of its runs, [`score`] judges what the
//! program says and makes the tables.

pub mod arm;
pub mod bench;
pub mod camera;
pub mod cases;
pub mod chain;
pub mod diagnose;
pub mod drive;
pub mod fluid;
pub mod hide;
pub mod limit;
pub mod motion;
pub mod pictures;
pub mod rivals;
pub mod score;
pub mod terms;
pub mod three_links;
pub mod write;
