//! `camera_tilt`: the camera does not look square at the plane of motion.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

const BOUNDS: [f64; 2] = [-3.0, 3.0];

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "camera_tilt",
    kind: Kind::Camera,
    parameters: &[
        ParameterInfo::size("x", "1/m", BOUNDS, 0.2, "how much larger things look per metre to the right"),
        ParameterInfo::size("z", "1/m", BOUNDS, 0.2, "how much larger things look per metre upwards"),
    ],
    aliases: &[],
    sentence: "the camera does not look square at the plane: one side looks larger",
    check: "`rig calibrate camera` with a board in the plane of motion",
    formula: "(1 + k_x x + k_z z) y",
    source: "perspective to first order: k = tan(tilt) / distance",
    mjcf: None,
    in_picture_plane: false,
};

/// The keystone.
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
        let factor = T::ONE + self.x * x + self.z * z;
        [x * factor, y, z * factor]
    }
}
