//! `rig fit`.
