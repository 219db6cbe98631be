//! The elements a model is made of.

use super::Gearmotor;
use crate::math::{Quat, Vec3};
use crate::scalar::Scalar;

/// How a step in time is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// Semi-implicit Euler, joint damping implicit.
    Euler,
    /// Euler with all velocity-dependent forces but the bias implicit, symmetrised.
    ImplicitFast,
    /// Euler with all velocity-dependent forces implicit: only in models; runs take another, or steps of our own.
    Implicit,
    /// Classical fourth-order Runge-Kutta.
    Rk4,
}

impl Integrator {
    /// All of them, by their names in MJCF.
    pub(crate) const NAMED: [(&'static str, Self); 4] = [
        ("Euler", Self::Euler),
        ("RK4", Self::Rk4),
        ("implicitfast", Self::ImplicitFast),
        ("implicit", Self::Implicit),
    ];
}

/// Which engines' Kutta lift a model has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum KuttaLift {
    /// The formula's: MuJoCo 3.14 and later.
    #[default]
    Whole,
    /// That of MuJoCo before 3.14, which clamped a denominator far above its size on links of centimetres: nearly
    /// none there.
    Clamped,
}

/// Time step, gravity and the water.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings<T> {
    /// Time step of the simulation \[s\].
    pub timestep_s: f64,
    /// How a step in time is taken.
    pub integrator: Integrator,
    /// Gravity, world axes \[m/s2\].
    pub gravity: Vec3<T>,
    /// Density of the water \[kg/m3\]; 0 for none.
    pub density: T,
    /// Dynamic viscosity of the water \[Pa s\].
    pub viscosity: T,
    /// Velocity of the water, world axes \[m/s\].
    pub wind: Vec3<T>,
    /// Kutta lift of current or older MuJoCo versions.
    pub kutta_lift: KuttaLift,
    /// Form of the friction cone of contacts.
    pub cone: Cone,
    /// How much stiffer than along the normal contacts are along the surface (MuJoCo's `impratio`).
    pub impratio: f64,
}

/// A rigid body.
#[derive(Debug, Clone, PartialEq)]
pub struct Body<T> {
    /// Its name, or `body#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// Index of the parent; the world is its own.
    pub parent: usize,
    /// Origin in the parent's frame, all joints at their reference \[m\].
    pub pos: Vec3<T>,
    /// `parent_from_body`, all joints at their reference.
    pub quat: Quat<T>,
    /// Mass \[kg\].
    pub mass: T,
    /// Principal moments of inertia about the centre of mass \[kg m2\].
    pub inertia: Vec3<T>,
    /// Centre of mass in the body's frame \[m\].
    pub com: Vec3<T>,
    /// `body_from_principal`: the axes of `inertia`.
    pub principal: Quat<T>,
    /// Share of its weight that is held up at the centre of mass; for buoyancy, water over body density.
    pub gravity_compensation: T,
}

/// Shapes of geoms, and the meaning of their sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeomKind {
    /// Sphere of this radius.
    Sphere,
    /// Capsule along z: radius, half length of the straight part.
    Capsule,
    /// Cylinder along z: radius, half length.
    Cylinder,
    /// Ellipsoid with these semi-axes.
    Ellipsoid,
    /// Box with these half sizes.
    Box,
    /// A wall or floor: no mass, no fluid force, but contact.
    Plane,
}

/// MuJoCo's five coefficients of the ellipsoid fluid model, all without unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FluidCoefficients<T> {
    /// Drag on the area projected along the motion.
    pub blunt: T,
    /// Drag on the rest of the largest area.
    pub slender: T,
    /// Drag torque against rotation.
    pub angular: T,
    /// Lift of an inclined shape.
    pub kutta: T,
    /// Lift of a spinning shape.
    pub magnus: T,
}

/// Form of the friction cone of a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cone {
    /// A pyramid with two edges for each direction.
    #[default]
    Pyramidal,
    /// The exact elliptic cone.
    Elliptic,
}

/// Contact parameters of a geom, by MuJoCo's names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// The geom with the higher one decides alone.
    pub priority: i32,
    /// In how many directions a contact acts: 1 normal, 3 with sliding friction, 4 with spinning, 6 with rolling.
    pub condim: usize,
    /// Sliding; spinning and rolling friction \[m\].
    pub friction: [f64; 3],
    /// Its weight where two geoms are mixed.
    pub solmix: f64,
    /// Time constant \[s\] and damping ratio; or, below 0, stiffness \[1/s2\] and damping \[1/s\].
    pub solref: [f64; 2],
    /// Least and greatest impedance, the depth over which it rises \[m\], the middle of the rise, its power.
    pub solimp: [f64; 5],
    /// Beyond the margin, contacts are only looked for \[m\].
    pub gap_m: f64,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            priority: 0,
            condim: 3,
            friction: [1.0, 0.005, 0.0001],
            solmix: 1.0,
            solref: [0.02, 1.0],
            solimp: [0.9, 0.95, 0.001, 0.5, 2.0],
            gap_m: 0.0,
        }
    }
}

impl Surface {
    /// What acts between two geoms: the higher priority's; else the larger condim and friction, the mixed solref (the
    /// smaller one where either is below 0) and solimp.
    pub(crate) fn with(&self, other: &Self) -> Self {
        /// A `solmix` below this counts as 0.
        const SOLMIX_ZERO_MAX: f64 = 1e-15;
        match self.priority.cmp(&other.priority) {
            std::cmp::Ordering::Greater => return *self,
            std::cmp::Ordering::Less => return *other,
            std::cmp::Ordering::Equal => {}
        }
        let share = match (self.solmix >= SOLMIX_ZERO_MAX, other.solmix >= SOLMIX_ZERO_MAX) {
            (true, true) => self.solmix / (self.solmix + other.solmix),
            (false, false) => 0.5,
            (own, _) => f64::from(u8::from(own)),
        };
        let mix = |a: f64, b: f64| share * a + (1.0 - share) * b;
        let timed = self.solref[0] > 0.0 && other.solref[0] > 0.0;
        Self {
            condim: self.condim.max(other.condim),
            friction: std::array::from_fn(|i| self.friction[i].max(other.friction[i])),
            solref: std::array::from_fn(|i| {
                let (a, b) = (self.solref[i], other.solref[i]);
                if timed { mix(a, b) } else { a.min(b) }
            }),
            solimp: std::array::from_fn(|i| mix(self.solimp[i], other.solimp[i])),
            ..*self
        }
    }
}

/// A shape fixed to a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Geom<T> {
    /// Its name, or `geom#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// The body it is fixed to.
    pub body: usize,
    /// Kind of shape.
    pub kind: GeomKind,
    /// Sizes \[m\], see [`GeomKind`]; unused ones are 0.
    pub size: [f64; 3],
    /// Centre in the body's frame \[m\].
    pub pos: Vec3<T>,
    /// Orientation in the body's frame, `body_from_geom`.
    pub quat: Quat<T>,
    /// The ellipsoid fluid model's coefficients, where the geom uses it.
    pub fluid: Option<FluidCoefficients<T>>,
    /// MuJoCo's contact bits: which others it could collide with.
    pub contact_bits: [u32; 2],
    /// MuJoCo's contact margin \[m\]: two geoms touch when closer than the sum of theirs.
    pub contact_margin_m: f64,
    /// Contact parameters of its surface.
    pub surface: Surface,
}

/// A marked point fixed to a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Site<T> {
    /// Its name, or `site#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// The body it is fixed to.
    pub body: usize,
    /// Position in the body's frame \[m\].
    pub pos: Vec3<T>,
}

/// The kinds of drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActuatorKind {
    /// Force `kp (command - gear q) - kv gear v`.
    Position,
    /// Force `kv (command - gear v)`.
    Velocity,
    /// Force equal to the command.
    Motor,
}

/// A drive on a hinge or slide, or on several through a fixed tendon.
#[derive(Debug, Clone, PartialEq)]
pub struct Actuator<T> {
    /// Its name, or `actuator#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// Kind of drive.
    pub kind: ActuatorKind,
    /// The joint it drives; the first, where a tendon couples several.
    pub joint: usize,
    /// The others, each with its share in the drive's coordinate, of which that of `joint` is 1.
    pub also: Vec<(usize, f64)>,
    /// Position gain `kp`; 0 for the other kinds.
    pub kp: T,
    /// Velocity gain `kv`; 0 for a motor.
    pub kv: T,
    /// Gear: joint force over actuator force.
    pub gear: T,
    /// The command is clamped to this range.
    pub command_range: Option<[T; 2]>,
    /// The force, before the gear, is clamped to this range.
    pub force_range: Option<[T; 2]>,
    /// Motor and gear, where they are not MuJoCo's.
    pub gearmotor: Option<Gearmotor<T>>,
}

impl<T: Scalar> Quat<T> {
    pub(crate) fn map<U>(self, f: impl Fn(T) -> U) -> Quat<U> {
        Quat(self.0.map(f))
    }
}

impl<T: Scalar> Settings<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Settings<U> {
        Settings {
            timestep_s: self.timestep_s,
            integrator: self.integrator,
            gravity: self.gravity.map(f),
            density: f(self.density),
            viscosity: f(self.viscosity),
            wind: self.wind.map(f),
            kutta_lift: self.kutta_lift,
            cone: self.cone,
            impratio: self.impratio,
        }
    }
}

impl<T: Scalar> Body<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Body<U> {
        Body {
            name: self.name.clone(),
            named: self.named,
            parent: self.parent,
            pos: self.pos.map(f),
            quat: self.quat.map(f),
            mass: f(self.mass),
            inertia: self.inertia.map(f),
            com: self.com.map(f),
            principal: self.principal.map(f),
            gravity_compensation: f(self.gravity_compensation),
        }
    }
}

impl<T: Scalar> Geom<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Geom<U> {
        Geom {
            name: self.name.clone(),
            named: self.named,
            body: self.body,
            kind: self.kind,
            size: self.size,
            pos: self.pos.map(f),
            quat: self.quat.map(f),
            fluid: self.fluid.map(|c| FluidCoefficients {
                blunt: f(c.blunt),
                slender: f(c.slender),
                angular: f(c.angular),
                kutta: f(c.kutta),
                magnus: f(c.magnus),
            }),
            contact_bits: self.contact_bits,
            contact_margin_m: self.contact_margin_m,
            surface: self.surface,
        }
    }
}

impl<T: Scalar> Site<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Site<U> {
        Site { name: self.name.clone(), named: self.named, body: self.body, pos: self.pos.map(f) }
    }
}

impl<T: Scalar> Actuator<T> {
    /// Whether it pushes on the joint at this place.
    pub fn drives(&self, joint: usize) -> bool {
        self.joint == joint || self.also.iter().any(|(other, _)| *other == joint)
    }

    pub(crate) fn map<U: Scalar>(&self, f: impl Fn(T) -> U + Copy) -> Actuator<U> {
        Actuator {
            name: self.name.clone(),
            named: self.named,
            kind: self.kind,
            joint: self.joint,
            also: self.also.clone(),
            kp: f(self.kp),
            kv: f(self.kv),
            gear: f(self.gear),
            command_range: self.command_range.map(|range| range.map(f)),
            force_range: self.force_range.map(|range| range.map(f)),
            gearmotor: self.gearmotor.as_ref().map(|motor| motor.map(f)),
        }
    }
}
