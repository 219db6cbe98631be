//! Runs tank experiments: drives a servo board, films, extracts keypoints, fits, reports, replays.
//!
//! One image's way through the house: [`camera`] hands it over with its stamp, [`run`] passes it on, [`record`] keeps it,
//! [`images`] gives it out again, just filmed or from a recording alike, [`vision`] turns it into a mask, a centreline and
//! keypoints, [`analysis`] gives the run's trajectory to `ident`, and [`report`] shows what came out.
//!
//! Rooms, each of which knows only those before it:
//! * [`error_chain`], [`reasons`], [`lettering`], [`claim`], [`schedule`], [`goal`], [`service`], [`web`], [`shell`], [`urgency`], [`clock`],
//!   [`calibration`]: an error's causes, reasons told together, words in pictures, what one process has alone, when a daemon runs, what a
//!   campaign is for, what a daemon tells its manager, who may ask a server of this machine, commands to be typed, who has the processor first, ticks and stamps on
//!   one clock, pixels in metres;
//! * [`camera`], [`servo`]: the two traits, and a real, a mock and a recorded device behind each;
//! * [`profile`], [`tank`], [`record`]: the stroke, the simulated tank behind the mocks, run folders and recordings;
//! * [`outputs`]: where a command may write, and how a file comes to be there;
//! * [`images`], [`report`], [`calibrate`]: where images come from, the page that is made of results, pictures of a board to a plane;
//! * [`vision`], [`config`], [`interchange`]: images to keypoints, the config as a whole, keypoints from and to other programs;
//! * [`setup`]: answers about a chain of links to a config and a model;
//! * [`run`], [`showing`], [`analysis`], [`doctor`], [`preview`]: a film from still water to the safe stop, what a job shows while it goes
//!   on, a recording to a report, what is wrong with the rig, what its camera sees;
//! * [`store`]: the queue of jobs and the index of runs, beside the run folders;
//! * [`app`]: one experiment, fits, diagnoses, campaigns; [`daemon`]: jobs one after the other, and a schedule; [`cli`]: arguments and printing.
//!
//! Who works beside whom, and what lies between them: `docs/threads.md`.

pub mod analysis;
pub mod app;
pub mod calibrate;
pub mod calibration;
pub mod camera;
pub mod claim;
pub mod cli;
pub mod clock;
pub mod config;
mod coverage;
pub mod daemon;
pub mod doctor;
pub mod error_chain;
pub mod goal;
pub mod hold;
pub mod images;
pub mod in_place;
pub mod interchange;
pub mod lettering;
pub mod outputs;
pub mod preview;
pub mod profile;
pub mod reasons;
pub mod record;
pub mod report;
pub mod run;
pub mod schedule;
pub mod service;
pub mod servo;
pub mod setup;
pub mod shell;
pub mod showing;
pub mod store;
pub mod tank;
pub mod urgency;
pub mod vision;
pub mod web;
