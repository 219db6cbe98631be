//! `rig jog`.
