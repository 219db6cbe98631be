//! `lens`: the optics bend the picture towards its corners.

use crate::causes::camera::look::Look;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "lens",
    kind: Kind::Camera,
    parameters: &[
        ParameterInfo::size(
            "radial",
            "1/m^2",
            [-50.0, 50.0],
            2.0,
            "growth of lengths per square of the distance",
        ),
        ParameterInfo::size(
            "x",
            "m",
            [-1.0, 1.0],
            0.02,
            "where the camera's axis meets the plane, to the right",
        )
        .role(Role::Detail, 0.0),
        ParameterInfo::size("z", "m", [-1.0, 1.0], 0.02, "where the camera's axis meets the plane, upwards")
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the lens or the tank's window bends the picture towards its corners",
    check: "`rig calibrate camera` with a board in the plane of motion",
    formula: "c + (1 + k r^2) (y - c), r the distance from the camera's axis c",
    source: "radial term of Brown's model; a flat port in water gives tan asin(sin a / 1.33)",
    mjcf: None,
    in_picture_plane: false,
};

/// The radial term.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    radial: T,
    centre: [T; 2],
}

impl<T: Scalar> Look<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { radial: values.one(0), centre: [values.one(1), values.one(2)] }
    }

    #[inline(always)]
    fn see(&self, [x, y, z]: [T; 3]) -> [T; 3] {
        let (dx, dz) = (x - self.centre[0], z - self.centre[1]);
        let grown = self.radial * (dx * dx + dz * dz);
        [x + dx * grown, y, z + dz * grown]
    }
}
