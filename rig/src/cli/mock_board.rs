//! `rig mock-board`.
