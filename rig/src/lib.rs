//! Runs tank experiments: drives a servo board, films, extracts keypoints, fits, reports, replays.
//!
//! One image's way through the house: [`camera`] hands it over with its stamp, [`record`] keeps it,
//! [`clock`] puts it on the run's time, [`vision`] turns it into a mask, a centreline and keypoints, the
//! run's trajectory goes to `ident`, and [`report`] shows what came out. [`run`] holds the whole together;
//! [`servo`] moves the mechanism meanwhile. [`tank`] is the simulated tank behind mock board and mock camera.

pub mod analysis;
pub mod app;
pub mod calibration;
pub mod camera;
pub mod claim;
pub mod cli;
pub mod clock;
pub mod config;
pub mod doctor;
pub mod error_chain;
pub mod images;
pub mod profile;
pub mod record;
pub mod report;
pub mod run;
pub mod schedule;
pub mod servo;
pub mod tank;
pub mod vision;
