//! Angles that an encoder reads on a hinge, beside what a camera sees.

use super::{JointKind, Model};
use crate::scalar::Scalar;

/// The way \[m\] that a turn by a radian counts as: errors of encoders and of keypoints are then of one kind, as if each encoder were
/// read by a pointer 12.5 cm long, an eighth of a metre: angles go to and fro without rounding.
pub const POINTER_M: f64 = 0.125;

/// Suffix of a column of joint angles.
const ANGLE_COLUMN_SUFFIX: &str = "_rad";

/// An encoder.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Encoder<T> {
    /// Its hinge's place in `joints`.
    pub(crate) joint: usize,
    /// What it reads where the hinge is at 0 \[rad\].
    pub(crate) zero: T,
}

impl<T: Scalar> Encoder<T> {
    /// Where its pointer seems to be: all of the angle is in the first number, which is the way along the circle.
    #[inline(always)]
    pub(crate) fn pointer(&self, qpos: T) -> [T; 3] {
        [(qpos + self.zero) * T::from_f64(POINTER_M), T::ZERO, T::ZERO]
    }
}

/// The joint whose angles the column, or mark, called `name` holds: `q1` for `q1_rad`.
pub fn encoded_joint(name: &str) -> Option<&str> {
    name.strip_suffix(ANGLE_COLUMN_SUFFIX).filter(|joint| !joint.is_empty())
}

/// The column, or mark, that holds the angles of the joint called `joint`: `q1_rad` for `q1`.
pub fn encoder_mark(joint: &str) -> String {
    format!("{joint}{ANGLE_COLUMN_SUFFIX}")
}

impl<T: Scalar> Model<T> {
    /// Puts an encoder on the hinge called `joint`, unless it has one: rollouts then yield its readings as a mark called `<joint>_rad`
    /// after the keypoints, its angle times [`POINTER_M`] in place of x. Whether there is such a hinge.
    pub fn add_encoder(&mut self, joint: &str) -> bool {
        let hinge = |joint: &super::Joint<T>| joint.kind == JointKind::Hinge;
        let Some(place) = self.joints.iter().position(|own| own.name == joint && hinge(own)) else {
            return false;
        };
        if !self.encoders.iter().any(|encoder| encoder.joint == place) {
            self.encoders.push(Encoder { joint: place, zero: T::ZERO });
        }
        true
    }

    /// Names of the hinges.
    pub fn hinges(&self) -> impl Iterator<Item = &str> {
        self.joints.iter().filter(|joint| joint.kind == JointKind::Hinge).map(|joint| joint.name.as_str())
    }

    /// Names of what rollouts yield: the keypoints, then the encoders.
    pub fn marks(&self) -> Vec<String> {
        let encoders = self.encoders.iter().map(|encoder| encoder_mark(&self.joints[encoder.joint].name));
        self.keypoints().into_iter().chain(encoders).collect()
    }
}
