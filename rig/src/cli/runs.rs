//! `rig runs`.
