//! Studies: many experiments times variations, each a task, and what all results together say.
//!
//! One study's way: `STUDY.toml` ([`plan`]) names experiments and variations; each pair, seed and resample becomes a task ([`task`]), one file in
//! the study's folder ([`folder`]). An [`engine`] sees to it that `rig task` is run for each, on this machine or on others that see the same
//! folder; [`conduct`] tells it to, and looks. [`results`] are files too, so [`collect`] needs nothing but the folder: one table ([`table`], [`parquet`]) and what it says
//! ([`findings`]).
//!
//! A task is a pure function of its file and what that names. It may be begun any number of times, anywhere, at once: its result is there whole
//! or not at all, and always the same bytes. So nothing that an engine does can harm a study; retries, lost nodes and placement are left to it.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod carry_out;
pub mod collect;
pub mod conduct;
pub mod engine;
pub mod findings;
pub mod folder;
mod glob;
mod inputs;
pub mod parquet;
pub mod plan;
mod resample;
pub mod results;
pub mod supervise;
pub mod table;
pub mod task;
pub mod tries;
