//! Runs tank experiments: drives a servo board, films, extracts keypoints, fits, reports, replays. This crate is the command line; what
//! carries a verb out is in crates beside it.
//!
//! One image's way through the house: `camera` hands it over with its stamp, `run` passes it on, `record` keeps it, `images` gives it out
//! again, just filmed or from a recording alike, `vision` turns it into a mask, a centreline and keypoints, `analysis` gives the run's
//! trajectory to `ident`, and `report` shows what came out.
//!
//! Crates, each of which knows only those before it:
//! * `ground`: strict configs, statistics, one clock, claims and holds;
//! * `camera`, `servo`: the two traits, a real, a mock and a recorded device behind each, pixels in metres, and the stroke;
//! * `record`: run folders, recordings, and the gate to everything that is written;
//! * `tank`: the simulated tank behind the mocks;
//! * `images`, `report`, `calibrate`: where images come from, the page that is made of results, pictures of a board to a plane;
//! * `vision`, `config`, `interchange`: images to keypoints, the config as a whole, keypoints from and to other programs;
//! * `run`, `analysis`: a film from still water to the safe stop, a recording to a report, and what a job shows while it goes on;
//! * `store`: the queue of jobs and the index of runs, beside the run folders;
//! * `app`: one experiment, fits, diagnoses, campaigns, what is wrong with the rig;
//! * `study`: many experiments times variations, on this machine or a cluster, and what they say together;
//! * `daemon`: jobs one after the other, a schedule, the page and its API;
//! * here: [`cli`], arguments and printing; [`setup`], answers about a chain of links to a config and a model; [`preview`], what the camera
//!   sees.
//!
//! Who works beside whom, and what lies between them: `docs/threads.md`.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod cli;
pub mod preview;
pub mod setup;
