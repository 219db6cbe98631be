//! `camera_rotation`: the camera is not level.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "camera_rotation",
    kind: Kind::Camera,
    parameters: &[ParameterInfo::size(
        "angle",
        "rad",
        [-0.3, 0.3],
        0.01,
        "by which the picture is turned counter-clockwise",
    )],
    aliases: &[],
    sentence: "the camera is not level: the whole picture is turned",
    check: "hang a plumb line into the picture, or look at the still surface",
    formula: "R(angle) y, about the world's origin",
    source: "definition",
    mjcf: None,
    in_picture_plane: false,
};

/// The turn.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    sin: T,
    cos: T,
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        let (sin, cos) = values.one(0).sin_cos();
        Self { sin, cos }
    }

    #[inline(always)]
    fn see(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        [self.cos * x - self.sin * z, y, self.sin * x + self.cos * z]
    }
}
