//! `rig export`.
