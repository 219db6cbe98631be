//! `rig mock-camera`.
