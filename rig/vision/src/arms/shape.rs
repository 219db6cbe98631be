//! The shape of several arms on one free body, as its model lays it out.

use nalgebra::Matrix2;
use sim::math::Vec3;
use sim::model::GeomKind;
use sim::{JointKind, Model};

use crate::VisionError;
use crate::outline::Pose;

/// A free body, an ellipse in the picture, with arms that bend in a plane each.
#[derive(Debug, Clone, PartialEq)]
pub struct Swimmer {
    /// Names of the keypoints: P0 of the body, then those of each arm.
    pub(crate) keypoints: Vec<String>,
    /// Centre of the body's ellipse from P0, `[x, z]` at rest \[m\].
    pub(super) centre_m: [f64; 2],
    /// Its half axes \[m\], and how far the first one is turned from x towards z at rest \[rad\].
    pub(super) axes_m: [f64; 2],
    pub(super) turn_rad: f64,
    pub(super) arms: Vec<Arm>,
}

/// An arm: stiff segments, one after the other, in one plane.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arm {
    /// As its keypoints' names begin.
    pub(super) name: String,
    /// Where it begins, from P0 with the body at rest \[m\].
    pub(super) root_m: Vec3<f64>,
    /// The axis that all its joints turn about, the direction of its first segment, and what is a right angle on from it.
    pub(super) axis: Vec3<f64>,
    pub(super) along: Vec3<f64>,
    pub(super) across: Vec3<f64>,
    /// How far each segment is turned from the one before at rest \[rad\], and its length \[m\].
    pub(super) rest_rad: Vec<f64>,
    pub(super) lengths_m: Vec<f64>,
    /// Half of each segment's thickness in the plane and of its breadth along the axis \[m\].
    pub(super) half_m: Vec<[f64; 2]>,
    /// Its keypoints: place in the list, segment, and how far along it \[m\].
    pub(super) keypoints: Vec<(usize, usize, f64)>,
}

/// Directions and places that differ by less are the same.
const SAME: f64 = 1e-6;

/// `a1P2` is arm `a1`, keypoint 2.
fn arm_of(name: &str) -> Option<&str> {
    let (arm, digits) = name.rsplit_once('P')?;
    (!arm.is_empty() && digits.parse::<u32>().is_ok()).then_some(arm)
}

impl Swimmer {
    /// Of a model; none where it is not free or has no arms with keypoints of their own.
    ///
    /// # Errors
    /// [`VisionError::Config`] where its body is not an ellipsoid, or an arm does not bend in one plane.
    pub(crate) fn of(model: &Model) -> Result<Option<Self>, VisionError> {
        let refuse = |what: String| Err(VisionError::Config { what });
        let free = model.joints.iter().find(|joint| joint.kind == JointKind::Free);
        let keypoints = model.keypoints();
        let mut names: Vec<&str> = keypoints.iter().filter_map(|name| arm_of(name)).collect();
        names.dedup();
        let (Some(hub), false) = (free.map(|joint| joint.body), names.is_empty()) else { return Ok(None) };
        let sites = model.keypoint_sites();
        let rest = Pose::at(model, 0.0);
        let origin = keypoints.iter().position(|name| name == "P0");
        let Some(origin) = origin.filter(|&at| model.sites[sites[at]].body == hub) else {
            return refuse(format!("the model {} has arms, but no site P0 on its free body", model.name));
        };
        let origin = rest.sites[sites[origin]];
        let geoms: Vec<usize> =
            (0..model.geoms.len()).filter(|&geom| model.geoms[geom].body == hub).collect();
        let [geom] = geoms[..] else {
            return refuse(format!(
                "the free body of the model {} must be one ellipsoid or sphere",
                model.name
            ));
        };
        let [x, y, z] = model.geoms[geom].size;
        let radii = match model.geoms[geom].kind {
            GeomKind::Ellipsoid => [x, y, z],
            GeomKind::Sphere => [x; 3],
            _ => {
                return refuse(format!(
                    "the free body of the model {} must be an ellipsoid or a sphere",
                    model.name
                ));
            }
        };
        let (centre, own) = &rest.geoms[geom];
        let mut shadow = Matrix2::zeros();
        for (axis, radius) in own.iter().zip(radii) {
            let seen = nalgebra::Vector2::new(axis[0], axis[2]) * radius;
            shadow += seen * seen.transpose();
        }
        let turn_rad = f64::atan2(2.0 * shadow[(0, 1)], shadow[(0, 0)] - shadow[(1, 1)]) / 2.0;
        let (half, apart) =
            (shadow.trace() / 2.0, ((shadow[(0, 0)] - shadow[(1, 1)]) / 2.0).hypot(shadow[(0, 1)]));
        let arms = names.iter().map(|name| {
            let of = |keypoint: &&usize| arm_of(&keypoints[**keypoint]) == Some(name);
            let own: Vec<usize> =
                (0..keypoints.len()).collect::<Vec<_>>().iter().filter(of).copied().collect();
            Arm::of(model, &rest, (hub, origin), name, &own)
        });
        let arms = arms.collect::<Result<Vec<Arm>, VisionError>>()?;
        Ok(Some(Self {
            centre_m: [centre[0] - origin[0], centre[2] - origin[2]],
            axes_m: [(half + apart).sqrt(), (half - apart).sqrt()],
            turn_rad,
            arms,
            keypoints,
        }))
    }

    /// Arms that a camera which looks along y sees one before the other in every pose that they share: lists of places in
    /// [`Self::arms`].
    pub(super) fn branches(&self) -> Vec<Vec<usize>> {
        let mut branches: Vec<Vec<usize>> = Vec::new();
        for (i, arm) in self.arms.iter().enumerate() {
            match branches.iter_mut().find(|branch| self.arms[branch[0]].hides(arm)) {
                Some(branch) => branch.push(i),
                None => branches.push(vec![i]),
            }
        }
        branches
    }
}

impl Arm {
    fn of(
        model: &Model,
        rest: &Pose,
        (hub, origin): (usize, Vec3<f64>),
        name: &str,
        keypoints: &[usize],
    ) -> Result<Self, VisionError> {
        let refuse = |what: &str| {
            Err(VisionError::Config { what: format!("arm {name} of the model {}: {what}", model.name) })
        };
        let sites = model.keypoint_sites();
        let site = |keypoint: usize| &model.sites[sites[keypoint]];
        let Some(&tip) = keypoints.last() else { return refuse("it has no keypoints") };
        let mut bodies = Vec::new();
        let mut body = site(tip).body;
        while body != hub && body != 0 {
            bodies.push(body);
            body = model.bodies[body].parent;
        }
        bodies.reverse();
        if body != hub || bodies.is_empty() {
            return refuse("its tip does not hang on the free body");
        }
        let joints = bodies.iter().map(|&body| model.joints.iter().find(|joint| joint.body == body));
        let mut places: Vec<Vec3<f64>> = bodies.iter().map(|&body| rest.bodies[body]).collect();
        places.push(rest.sites[sites[tip]]);
        let steps: Vec<Vec3<f64>> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let lengths_m: Vec<f64> = steps.iter().map(|step| step.norm()).collect();
        if lengths_m.iter().any(|length| *length < SAME) {
            return refuse("two of its joints, or the last one and its tip, lie in one place");
        }
        let mut axes = joints.map(|joint| match joint {
            Some(joint) if joint.kind == JointKind::Hinge => Some(rest.turned(joint.body, joint.axis)),
            _ => None,
        });
        let Some(axis) = axes.next().flatten() else { return refuse("it must begin with a hinge") };
        let along = steps[0] * (1.0 / lengths_m[0]);
        let across = axis.cross(along);
        let planar = steps.iter().all(|step| step.dot(axis).abs() < SAME)
            && axes.all(|other| other.is_some_and(|other| (other - axis).norm() < SAME));
        if !planar {
            return refuse("all its segments must turn about hinges that are parallel, and lie in one plane");
        }
        let angles: Vec<f64> = steps.iter().map(|step| step.dot(across).atan2(step.dot(along))).collect();
        let rest_rad =
            (0..angles.len()).map(|i| if i == 0 { 0.0 } else { angles[i] - angles[i - 1] }).collect();
        let half = |(i, &body): (usize, &usize)| {
            let aside = axis.cross(steps[i] * (1.0 / lengths_m[i]));
            let geoms = (0..model.geoms.len()).filter(|&geom| model.geoms[geom].body == body);
            geoms.fold([0.0_f64; 2], |most, geom| {
                let reach = |way: Vec3<f64>| rest.extent(model, geom, way, rest.geoms[geom].0);
                [most[0].max(reach(aside)), most[1].max(reach(axis))]
            })
        };
        let half_m = bodies.iter().enumerate().map(half).collect();
        let on = |&keypoint: &usize| {
            let segment = bodies.iter().position(|&body| body == site(keypoint).body)?;
            let from = rest.sites[sites[keypoint]] - places[segment];
            Some((keypoint, segment, from.dot(steps[segment]) / lengths_m[segment]))
        };
        let Some(keypoints) = keypoints.iter().map(on).collect::<Option<Vec<_>>>() else {
            return refuse("all its keypoints must lie on the way to its tip");
        };
        let root_m = places[0] - origin;
        Ok(Self { name: name.into(), root_m, axis, along, across, rest_rad, lengths_m, half_m, keypoints })
    }

    /// How much of the arm's plane is seen: 1 where it lies in the picture's plane, 0 where it stands upright on it.
    pub(super) fn openness(&self) -> f64 {
        self.axis[1].abs()
    }

    fn hides(&self, other: &Self) -> bool {
        let seen = |a: Vec3<f64>, b: Vec3<f64>| (a[0] - b[0]).abs() < SAME && (a[2] - b[2]).abs() < SAME;
        seen(self.root_m, other.root_m)
            && seen(self.along, other.along)
            && seen(self.across, other.across)
            && self.lengths_m.len() == other.lengths_m.len()
            && self.lengths_m.iter().zip(&other.lengths_m).all(|(a, b)| (a - b).abs() < SAME)
    }

    /// Where its segments begin, from P0 with the body at rest, and its tip, when each joint has turned by `turns`, shape (segments);
    /// and the direction of each segment.
    pub(super) fn line(&self, turns: &[f64]) -> (Vec<Vec3<f64>>, Vec<Vec3<f64>>) {
        let (mut at, mut angle) = (self.root_m, 0.0);
        let (mut places, mut ways) = (vec![at], Vec::with_capacity(turns.len()));
        for ((turn, rest), length) in turns.iter().zip(&self.rest_rad).zip(&self.lengths_m) {
            angle += turn + rest;
            let way = self.along * f64::cos(angle) + self.across * f64::sin(angle);
            at += way * *length;
            places.push(at);
            ways.push(way);
        }
        (places, ways)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn octopus() -> Model {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/models/octopus8.xml");
        Model::from_mjcf(&std::fs::read_to_string(path).unwrap()).unwrap()
    }

    #[test]
    fn an_octopus_is_eight_arms_round_an_ellipse_of_which_five_branches_are_seen() {
        let swimmer = Swimmer::of(&octopus()).unwrap().unwrap();
        assert_eq!((swimmer.arms.len(), swimmer.keypoints.len()), (8, 25));
        assert!((swimmer.axes_m[0] - 0.04).abs() < 1e-9 && (swimmer.axes_m[1] - 0.02).abs() < 1e-9);
        assert_eq!(swimmer.branches(), vec![vec![0], vec![1, 7], vec![2, 6], vec![3, 5], vec![4]]);
        let arm = &swimmer.arms[1];
        assert!((arm.lengths_m.iter().sum::<f64>() - 0.16).abs() < 1e-9);
        assert!((arm.half_m[0][0] - 0.003).abs() < 1e-9 && (arm.half_m[0][1] - 0.012).abs() < 1e-9);
        assert!((arm.openness() - 0.5_f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn turned_joints_lead_where_the_model_leads() {
        let model = octopus();
        let swimmer = Swimmer::of(&model).unwrap().unwrap();
        let turns: Vec<f64> = (0..8).map(|i| 0.3 - 0.1 * f64::from(i)).collect();
        let mut qpos = model.rest_state().qpos;
        for joint in model.joints.iter().filter(|joint| joint.name.starts_with("a2q")) {
            let i: usize = joint.name[3..].parse().unwrap();
            qpos[joint.qpos_address] += turns[i - 1];
        }
        let tip = model.sites.iter().position(|site| site.name == "a2P2").unwrap();
        let wanted = model.poses(&qpos).site_pos[tip];
        let got = swimmer.arms[1].line(&turns).0[8];
        assert!((got - wanted).norm() < 1e-9, "{got:?} {wanted:?}");
    }

    #[test]
    fn a_chain_has_no_arms() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/models/chain-passive.xml");
        let model = Model::from_mjcf(&std::fs::read_to_string(path).unwrap()).unwrap();
        assert_eq!(Swimmer::of(&model).unwrap(), None);
    }
}
