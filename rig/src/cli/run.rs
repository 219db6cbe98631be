//! `rig run`.
