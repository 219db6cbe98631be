//! `rig doctor`.
