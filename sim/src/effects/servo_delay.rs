//! `servo_delay`: the servo starts late.

use super::drive::Stage;
use super::{Alias, AliasWhen, Effect, Info, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: Info = Info {
    name: "servo_delay",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size("delay", "s", [0.0, 0.2], 0.005, "time from the command to the drive")],
    aliases: &[Alias { name: "camera_delay", when: AliasWhen::NoReleaseStated }],
    sentence: "the servo acts later than it was told",
    formula: "q_cmd(t - d)",
    source: "dead time: transmission, pulse period, controller",
    mjcf: None,
    in_picture_plane: false,
};

/// The dead time.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    delay: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(effect: &Effect<T>) -> Self {
        Self { delay: effect.one(0) }
    }

    #[inline(always)]
    fn given(&self, time_s: T) -> T {
        time_s - self.delay
    }
}
