//! Ordinary faults of a rig: one bubble, one stiff hinge, a picture that is a pixel off, and whether `rig diagnose` says so.
//!
//! Mechanisms, runs and motion are those of [`crate::hidden`], which shares no code with the simulation. Sizes are natural ones and
//! owe nothing to what the runs can show. [`faults`] draws what is wrong, [`mod@judge`] has it diagnosed and compares. Folders bear
//! numbers, so that nothing in the files tells what is wrong.

pub mod faults;
pub mod judge;
