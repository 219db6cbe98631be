//! What does not change while a mechanism moves: bodies, joints, geoms, water, actuators.
//!
//! A [`Model`] is read from MJCF ([`Model::from_mjcf`]), changed by named parameters
//! ([`Model::set_parameter`]) and lifted to other number types ([`Model::map`]).

pub(crate) mod cause;
mod contacts;
mod elements;
mod encoder;
mod gearmotor;
mod joint;
mod parameters;
pub(crate) mod shape;
mod softness;
mod tendon;

pub(crate) use contacts::Contacts;
pub use contacts::PossibleContact;
pub use elements::{
    Actuator, ActuatorKind, Body, Cone, FluidCoefficients, Geom, GeomKind, Integrator, KuttaLift, Settings,
    Site, Surface,
};
pub(crate) use encoder::Encoder;
pub use encoder::{POINTER_M, encoded_joint, encoder_mark};
pub use gearmotor::{Gearmotor, LoadFriction};
pub use joint::{Coordinates, Joint, JointKind};
pub use parameters::{Parameter, UnknownParameter};
pub use softness::Softness;
pub use tendon::Tendon;
pub(crate) use tendon::reference_length;

use cause::{Cause, CauseValues};

use crate::scalar::Scalar;

/// A mechanism in its water. Element 0 of `bodies` is the world.
///
/// Bodies stand parent before child; joints, geoms and sites in the order of their bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Model<T = f64> {
    /// The model's name.
    pub name: String,
    /// Time step, gravity, water.
    pub settings: Settings<T>,
    /// The tree of bodies; the first is the world.
    pub bodies: Vec<Body<T>>,
    /// Joints, each between its body and that body's parent.
    pub joints: Vec<Joint<T>>,
    /// Shapes.
    pub geoms: Vec<Geom<T>>,
    /// Marked points.
    pub sites: Vec<Site<T>>,
    /// Springs and dampers along sums of joints' coordinates.
    pub tendons: Vec<Tendon<T>>,
    /// Drives.
    pub actuators: Vec<Actuator<T>>,
    /// What reads joints' angles, if anything does: no part of the mechanism, and of no file.
    pub(crate) encoders: Vec<Encoder<T>>,
    pub(crate) contacts: Contacts,
    pub(crate) causes: Vec<CauseValues<T>>,
    /// Causes that somebody wrote down, whether the model carries them or not.
    pub(crate) own: Vec<Cause>,
    /// Numbers called `<name>/<parameter>` in the model's file that belong to no cause known yet.
    pub(crate) foreign: Vec<(String, f64)>,
}

/// Generalized coordinates and velocities at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct State<T = f64> {
    /// Coordinates, shape (nq): angle \[rad\] or travel \[m\]; ball `w x y z`; free `x y z` \[m\] `w x y z`.
    pub qpos: Vec<T>,
    /// Velocities, shape (nv): \[rad/s\] or \[m/s\]; a ball's in the body's axes; a free joint's linear part
    /// in world axes, its angular part in the body's.
    pub qvel: Vec<T>,
}

impl<T: Scalar> Model<T> {
    /// Number of coordinates.
    pub fn nq(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.nq()).sum()
    }

    /// Number of velocities, the degrees of freedom.
    pub fn nv(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.nv()).sum()
    }

    /// Every joint at its reference, at rest.
    pub fn rest_state(&self) -> State<T> {
        let mut qpos = Vec::with_capacity(self.nq());
        for joint in &self.joints {
            let (pos, quat) = joint.rest(&self.bodies[joint.body]);
            for (coordinates, ..) in joint.coordinates() {
                match coordinates {
                    Coordinates::Axis => qpos.push(joint.reference),
                    Coordinates::Position => qpos.extend(pos.0),
                    Coordinates::Rotation => qpos.extend(quat.0),
                }
            }
        }
        State { qpos, qvel: vec![T::ZERO; self.nv()] }
    }

    /// Names of the keypoints: the sites called `P0`, `P1`, ..., in the order of their numbers, then those of arms, `a1P0`, `a1P1`, ...,
    /// `a2P0` and so on.
    pub fn keypoints(&self) -> Vec<String> {
        self.keypoint_sites().into_iter().map(|site| self.sites[site].name.clone()).collect()
    }

    /// Indices into `sites` of the keypoints, in the order of [`Model::keypoints`].
    pub fn keypoint_sites(&self) -> Vec<usize> {
        let number = |digits: &str| -> Option<u32> {
            // "P01" and "P+1" are other names
            let number: u32 = digits.parse().ok()?;
            (number.to_string() == digits).then_some(number)
        };
        let numbers = |name: &str| -> Option<[u32; 2]> {
            let (arm, digits) = name.split_once('P')?;
            // no arm is 0
            let arm =
                if arm.is_empty() { 0 } else { number(arm.strip_prefix('a')?).filter(|&arm| arm > 0)? };
            Some([arm, number(digits)?])
        };
        let mut found: Vec<([u32; 2], usize)> = self
            .sites
            .iter()
            .enumerate()
            .filter_map(|(index, site)| Some((numbers(&site.name)?, index)))
            .collect();
        found.sort_unstable();
        found.into_iter().map(|(_, index)| index).collect()
    }

    /// The geoms that would collide in MuJoCo if they met: here too where contact of their shapes is simulated. A
    /// [`ContactWatch`](crate::ContactWatch) says whether and when they first do in a rollout.
    pub fn possible_contacts(&self) -> &[PossibleContact] {
        &self.contacts.possible
    }

    /// The same model with every number put through `f`, for instance to lift it to another scalar.
    pub fn map<U: Scalar>(&self, f: impl Fn(T) -> U + Copy) -> Model<U> {
        Model {
            name: self.name.clone(),
            settings: self.settings.map(f),
            bodies: self.bodies.iter().map(|body| body.map(f)).collect(),
            joints: self.joints.iter().map(|joint| joint.map(f)).collect(),
            geoms: self.geoms.iter().map(|geom| geom.map(f)).collect(),
            sites: self.sites.iter().map(|site| site.map(f)).collect(),
            tendons: self.tendons.iter().map(|tendon| tendon.map(f)).collect(),
            actuators: self.actuators.iter().map(|actuator| actuator.map(f)).collect(),
            encoders: self
                .encoders
                .iter()
                .map(|own| Encoder { joint: own.joint, zero: f(own.zero) })
                .collect(),
            contacts: self.contacts.clone(),
            causes: self.causes.iter().map(|carried| carried.map(f)).collect(),
            own: self.own.clone(),
            foreign: self.foreign.clone(),
        }
    }
}
