//! `camera_delay`: the images show a later instant than their times say.

use crate::causes::camera::look::Look;
use crate::model::cause::{Alias, AliasWhen, CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "camera_delay",
    kind: Kind::Camera,
    parameters: &[ParameterInfo::size(
        "delay",
        "s",
        [-0.2, 0.2],
        0.005,
        "how much later than its time says an image was taken; below 0: earlier",
    )
    .may_differ()],
    aliases: &[Alias { name: "servo_delay", when: AliasWhen::NoReleaseStated }],
    sentence: "the camera's clock is off: images show another instant than their times say",
    check: "put the board's sync lamp into view and compare its flash with the times of the pictures",
    formula: "y(t + d)",
    source: "definition",
    mjcf: None,
    in_picture_plane: false,
};

/// The clock's error.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    delay: T,
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { delay: values.one(0) }
    }

    fn shifts(&self) -> bool {
        true
    }

    #[inline(always)]
    fn late(&self) -> T {
        self.delay
    }
}
