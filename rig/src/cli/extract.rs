//! `rig extract`.
