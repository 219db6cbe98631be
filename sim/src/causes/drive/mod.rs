//! Causes between the command and the drive.

pub(crate) mod back_emf;
pub(crate) mod backlash;
pub(crate) mod dead_band;
pub(crate) mod drive_offset;
pub(crate) mod gear_friction;
pub(crate) mod servo_delay;
pub(crate) mod servo_gain;
pub(crate) mod servo_lag;
pub(crate) mod servo_loop;
pub(crate) mod servo_rate_limit;
pub(crate) mod servo_refresh;
pub(crate) mod servo_sag;
pub(crate) mod stage;
