//! `camera_offset`: the picture's origin is not where the model's is.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "camera_offset",
    kind: Kind::Camera,
    parameters: &[
        ParameterInfo::size("x", "m", [-0.05, 0.05], 5e-4, "by which the picture is further to the right")
            .may_differ(),
        ParameterInfo::size("z", "m", [-0.05, 0.05], 5e-4, "by which the picture is further up").may_differ(),
    ],
    aliases: &[],
    sentence: "the picture's origin is not the mechanism's: the whole picture is shifted",
    check: "look where the first pivot is in the picture and state it as origin_px",
    formula: "y + (x, z)",
    source: "definition; after all else that the camera does",
    mjcf: None,
    in_picture_plane: false,
};

/// The shift.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    x: T,
    z: T,
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { x: values.one(0), z: values.one(1) }
    }

    #[inline(always)]
    fn see(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        [x + self.x, y, z + self.z]
    }
}
