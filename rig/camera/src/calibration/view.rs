//! Which plane of the world a camera looks at, and so which coordinates a picture shows.

use ground::choice::Choice;
use serde::{Deserialize, Serialize};
use sim::{JointKind, Model, Trajectory};

/// The plane of motion as the camera has it: the first axis points to the right in the picture, the second one up. A positive planar
/// angle is counter-clockwise as the camera sees it, whichever plane it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum View {
    /// From the side: z up in the picture, y away from the camera; hinges turn about -y
    #[default]
    #[serde(rename = "x-z")]
    Xz,
    /// From above: y up in the picture, z towards the camera; hinges turn about z, gravity is along -z
    #[serde(rename = "x-y")]
    Xy,
}

impl Choice for View {
    const ALL: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Xz, "x-z", "From the side: z up in the picture, y away from the camera; hinges turn about -y"),
        (
            Self::Xy,
            "x-y",
            "From above: y up in the picture, z towards the camera; hinges turn about z, gravity is along -z",
        ),
    ];
}

/// A hinge turns in the picture when its axis has more than this component along the viewing direction, chosen.
const MIN_HINGE_AXIS_COMPONENT: f64 = 0.5;

impl View {
    /// The world's axes to the right and up in the picture, and the one along which the camera looks: 0, 1, 2 for x, y, z.
    fn axes(self) -> [usize; 3] {
        match self {
            Self::Xz => [0, 2, 1],
            Self::Xy => [0, 1, 2],
        }
    }

    /// The two axes that are seen: number and name, to the right and up in the picture.
    pub fn seen_axes(self) -> [(usize, &'static str); 2] {
        let [right, up, _] = self.axes();
        [right, up].map(|axis| (axis, ["x", "y", "z"][axis]))
    }

    /// The two coordinates of a world position that are seen, to the right and up \[m\].
    pub fn seen(self, world: [f64; 3]) -> [f64; 2] {
        let [right, up, _] = self.axes();
        [world[right], world[up]]
    }

    /// The world position \[m\] of a point seen in the plane; NaN along the axis that no picture shows.
    pub fn world(self, seen: [f64; 2]) -> [f64; 3] {
        let [right, up, depth] = self.axes();
        let mut world = [0.0; 3];
        (world[right], world[up], world[depth]) = (seen[0], seen[1], f64::NAN);
        world
    }

    /// The number of the axis that no picture shows.
    pub fn depth_axis(self) -> usize {
        self.axes()[2]
    }

    /// The view from which `trajectory` was filmed: from above where it has y and no z.
    pub fn of(trajectory: &Trajectory) -> Self {
        let has = |axis: usize| trajectory.position_m.iter().any(|place| place[axis].is_finite());
        if has(1) && !has(2) { Self::Xy } else { Self::Xz }
    }

    /// Whether no hinge of `model` turns in this view, but some hinge does in the other view: then the camera looks along the plane of
    /// motion.
    pub fn misses(self, model: &Model) -> bool {
        let poses = model.poses(&model.rest_state().qpos);
        let turns = |view: Self| {
            model.joints.iter().filter(|joint| joint.kind == JointKind::Hinge).any(|joint| {
                poses.body_rot[joint.body].apply(joint.axis)[view.depth_axis()].abs()
                    > MIN_HINGE_AXIS_COMPONENT
            })
        };
        let other = match self {
            Self::Xz => Self::Xy,
            Self::Xy => Self::Xz,
        };
        !turns(self) && turns(other)
    }
}

impl std::fmt::Display for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [(_, right), (_, up)] = self.seen_axes();
        write!(f, "{right}-{up}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_position_comes_back_from_what_is_seen_of_it() {
        for view in [View::Xz, View::Xy] {
            let world = view.world([0.1, 0.2]);
            assert_eq!(view.seen(world), [0.1, 0.2]);
            assert!(world[view.depth_axis()].is_nan());
            let trajectory = Trajectory { position_m: vec![world], ..Trajectory::default() };
            assert_eq!(View::of(&trajectory), view);
            assert_eq!(toml::Value::try_from(view).unwrap().as_str(), Some(view.to_string().as_str()));
        }
    }

    #[test]
    fn counter_clockwise_as_the_camera_sees_it_is_positive_from_either_side() {
        for (view, axis) in [(View::Xz, "0 -1 0"), (View::Xy, "0 0 1")] {
            let text = format!(
                r#"<mujoco><worldbody><body><joint name="q" axis="{axis}"/><geom type="sphere" size="0.01" pos="0.1 0 0"/>
                <site name="P1" pos="0.1 0 0"/></body></worldbody></mujoco>"#
            );
            let model = Model::from_mjcf(&text).unwrap();
            let [x, up] = view.seen(model.poses(&[0.1]).site_pos[0].0);
            assert!(up > 0.009 && x > 0.09, "{view} {x} {up}");
            let other = if view == View::Xz { View::Xy } else { View::Xz };
            assert!(!view.misses(&model) && other.misses(&model), "{view}");
        }
    }
}
