//! `rig replay`.
