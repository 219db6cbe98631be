//! `rig simulate`.
