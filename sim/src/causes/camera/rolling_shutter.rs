//! `rolling_shutter`: the image's rows are taken one after the other.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "rolling_shutter",
    kind: Kind::Camera,
    parameters: &[ParameterInfo::size(
        "slowness",
        "s/m",
        [-1.0, 1.0],
        0.1,
        "how much later a row is taken per metre that it shows higher",
    )],
    aliases: &[],
    sentence: "the camera takes its rows one after the other",
    check: "look up the sensor's readout time and state readout_s under [camera]",
    formula: "y(t + r z), z the point's height at t",
    source: "rolling shutter of CMOS sensors: 10-30 ms over an image, 50-300 ms/m; an image's time is that of z = 0",
    mjcf: None,
    in_picture_plane: false,
};

/// The shutter.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    slowness: T,
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { slowness: values.one(0) }
    }

    fn shifts(&self) -> bool {
        true
    }

    #[inline(always)]
    fn late_at(&self, at: [T; 3]) -> T {
        self.slowness * at[2]
    }
}
