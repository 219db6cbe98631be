//! `camera_scale`: the metres per pixel are wrong.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "camera_scale",
    kind: Kind::Camera,
    parameters: &[ParameterInfo::size(
        "scale",
        "1",
        [-0.3, 0.3],
        0.01,
        "error of all lengths, as a share of them",
    )],
    aliases: &[],
    sentence: "the calibration's scale is wrong: all lengths by the same share",
    check: "lay a ruler into the plane of motion, in the water",
    formula: "(1 + s) y, about the world's origin",
    source: "definition",
    mjcf: None,
    in_picture_plane: false,
};

/// The scale.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    factor: T,
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { factor: T::ONE + values.one(0) }
    }

    #[inline(always)]
    fn see(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        [x * self.factor, y, z * self.factor]
    }
}
