//! `rig experiment`.
