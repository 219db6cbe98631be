//! `rig daemon`: runs the experiment on its schedule, one run at a time.
