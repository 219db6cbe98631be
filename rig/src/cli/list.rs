//! `rig list`.
