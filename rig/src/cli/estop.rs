//! `rig estop`.
