//! `servo_delay`: the servo starts late.

use crate::causes::drive::stage::Stage;
use crate::model::cause::{Alias, AliasWhen, CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_delay",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size("delay", "s", [0.0, 0.2], 0.005, "time from the command to the drive")],
    aliases: &[Alias { name: "camera_delay", when: AliasWhen::NoReleaseStated }],
    sentence: "the servo acts later than it was told",
    check: "put the board's sync lamp into view and compare its flash with the horn's first motion",
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
    fn new(values: &CauseValues<T>) -> Self {
        Self { delay: values.one(0) }
    }

    #[inline(always)]
    fn given(&self, time_s: T) -> T {
        time_s - self.delay
    }
}
