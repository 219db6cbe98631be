//! `rig daemon`.
