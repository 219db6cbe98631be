//! What is hidden in the data: the causes' numbers by the contract's names, and the terms they make.
//!
//! Definitions are those of `docs/causes.md`; friction and stops have laws of their own, as real ones have.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::chain::{Plane, Pose, add, dot};

/// Rate over which friction turns round \[rad/s\]: by a hyperbolic tangent.
const FRICTION_REVERSAL_RATE_RAD_PER_S: f64 = 0.02;
/// Angle over which a stop's corner is rounded \[rad\].
const STOP_ROUNDING_RAD: f64 = 0.005;
/// Damping of a stop over its stiffness \[s\].
const STOP_DAMPING_S: f64 = 0.002;
/// Notches of a detent in a turn.
const DETENT_NOTCHES: f64 = 8.0;
/// Strouhal number of shed vortices.
const STROUHAL: f64 = 0.2;
/// Half width of a wake \[m\].
const WAKE_HALF_WIDTH_M: f64 = 0.02;
/// Where the magnet is, and the distance at which its pull is half its greatest \[m\].
const MAGNET_PLACE_M: Plane = [0.05, -0.06];
const MAGNET_HALF_FORCE_DISTANCE_M: f64 = 0.02;

/// Numbers by name, `<cause>/<parameter>` as in `docs/causes.md`, those of one hinge alone called after `q1`, `q2`, ...; slosh has its
/// phases run by run, as `slosh/sin@<run>`, and any other number may be another in a run in the same way. Besides: `vortex/lift`, `detent/torque`, `wake/shelter`, `magnet/force`, which no library knows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hidden(pub BTreeMap<String, f64>);

impl Hidden {
    /// The number called `name`; `otherwise` where it is not there.
    pub fn get(&self, name: &str, otherwise: f64) -> f64 {
        self.0.get(name).copied().unwrap_or(otherwise)
    }

    /// What is hidden in run number `run`: there `<name>@<run>` is what `<name>` is otherwise.
    #[must_use]
    pub fn in_run(&self, run: usize) -> Self {
        let ending = format!("@{run}");
        let own = self.0.iter().filter_map(|(name, &value)| Some((name.strip_suffix(&ending)?, value)));
        own.fold(self.clone(), |all, (name, value)| all.with(name, value))
    }

    /// With `name` set to `value`.
    #[must_use]
    pub fn with(mut self, name: &str, value: f64) -> Self {
        self.0.insert(name.into(), value);
        self
    }
}

/// The terms of one run.
#[derive(Debug, Clone, Default)]
pub struct Terms {
    pub(super) added_mass: f64,
    pub(super) buoyancy: f64,
    pub(super) link_mass: f64,
    pub(super) cob_along: f64,
    pub(super) cob_across: f64,
    pub(super) linear_drag: f64,
    pub(super) basset: f64,
    current: Plane,
    /// Amplitudes \[m/s\] by sine and cosine, and the frequency \[Hz\].
    slosh: [f64; 3],
    exponent: f64,
    reference_speed: f64,
    /// Scale, place \[m\], reach \[m\].
    wall: [f64; 3],
    /// By hinge, as are the next two.
    damping: Vec<f64>,
    friction: Vec<f64>,
    /// Friction coefficient times radius of the bearings \[m\].
    pub(super) bearing_m: f64,
    stiffness: Vec<f64>,
    /// Resistance of what is around, a metre of link \[kg/m2\].
    pub(super) medium: f64,
    /// Stiffness and side.
    one_sided: [f64; 2],
    /// Stiffness and angle \[rad\].
    stop: [f64; 2],
    /// By hinge.
    detent: Vec<f64>,
    tether: f64,
    anchor: Plane,
    magnet: f64,
    shelter: f64,
    lift: f64,
    /// Phases of the vortices that the links shed \[rad\].
    pub(super) phases: Vec<f64>,
}

impl Terms {
    /// The terms that `hidden` makes in the run at place `run`.
    pub fn new(hidden: &Hidden, run: usize, links: usize) -> Self {
        let get = |name: &str| hidden.get(name, 0.0);
        let hinges = |cause: &str, all: &str| -> Vec<f64> {
            let all = get(&format!("{cause}/{all}"));
            (1..=links).map(|hinge| all + get(&format!("{cause}/q{hinge}"))).collect()
        };
        let phase = |link: usize| hidden.get(&format!("vortex/phase{link}@{run}"), 0.0);
        Self {
            added_mass: get("added_mass/scale"),
            buoyancy: get("buoyancy/scale"),
            link_mass: get("link_mass/scale"),
            cob_along: get("cob_offset/along"),
            cob_across: get("cob_offset/across"),
            linear_drag: get("linear_drag/drag"),
            basset: get("basset/history"),
            current: [get("current/x"), get("current/z")],
            slosh: [
                get(&format!("slosh/sin@{run}")),
                get(&format!("slosh/cos@{run}")),
                hidden.get("slosh/frequency", 1.0),
            ],
            exponent: get("drag_exponent/exponent"),
            reference_speed: hidden.get("drag_exponent/speed", 0.08),
            wall: [get("wall/scale"), hidden.get("wall/x", 0.1), hidden.get("wall/reach", 0.015)],
            damping: hinges("joint_damping", "damping"),
            friction: hinges("coulomb_friction", "torque"),
            bearing_m: get("load_friction/arm"),
            stiffness: hinges("stiffness", "stiffness"),
            medium: get("medium_drag/drag"),
            one_sided: [get("one_sided_stiffness/stiffness"), hidden.get("one_sided_stiffness/side", 1.0)],
            stop: [get("end_stop/stiffness"), hidden.get("end_stop/angle", 0.4)],
            detent: hinges("detent", "torque"),
            tether: get("tether/stiffness"),
            anchor: [hidden.get("tether/x", 0.05), hidden.get("tether/z", 0.05)],
            magnet: get("magnet/force"),
            shelter: get("wake/shelter"),
            lift: get("vortex/lift"),
            phases: (0..links).map(phase).collect(),
        }
    }

    /// The water's own velocity \[m/s\].
    pub(super) fn water(&self, time_s: f64) -> Plane {
        let [sin, cos, frequency] = self.slosh;
        if sin == 0.0 && cos == 0.0 {
            return self.current;
        }
        let turn = TAU * frequency * time_s;
        [self.current[0] + sin * turn.sin() + cos * turn.cos(), self.current[1]]
    }

    /// By what the quadratic drag changes at `speed` \[m/s\].
    pub(super) fn speed_law(&self, speed: f64) -> f64 {
        if self.exponent == 0.0 {
            return 1.0;
        }
        ((speed / self.reference_speed).powi(2) + 1e-6).powf(0.5 * self.exponent)
    }

    /// By what all drag changes at the height of a wall.
    pub(super) fn nearness(&self, x: f64) -> f64 {
        let [scale, place, reach] = self.wall;
        if scale == 0.0 {
            return 1.0;
        }
        1.0 + scale * (-(place - x).abs() / reach).exp()
    }

    /// By what drag is less where link `i`, moving at `relative`, follows another.
    pub(super) fn shelter<const N: usize>(&self, i: usize, poses: &[Pose; N], relative: Plane) -> f64 {
        let speed = relative[0].hypot(relative[1]);
        if self.shelter == 0.0 || speed == 0.0 {
            return 1.0;
        }
        let ahead = |other: &Pose| {
            let to = add(other.centre, poses[i].centre, -1.0);
            let along = dot(to, relative) / speed;
            let aside = dot(to, to) - along * along;
            if along > 0.0 {
                (along / 0.01).tanh() * (-aside / (WAKE_HALF_WIDTH_M * WAKE_HALF_WIDTH_M)).exp()
            } else {
                0.0
            }
        };
        let most = (0..N).filter(|&j| j != i).map(|j| ahead(&poses[j])).fold(0.0, f64::max);
        1.0 - self.shelter * most
    }

    /// Force along and across \[N\] of the vortices that link `i` sheds, square to its motion.
    pub(super) fn shedding(&self, i: usize, density: f64, speed: f64, own: Plane) -> Plane {
        if self.lift == 0.0 {
            return [0.0; 2];
        }
        const SIDE_M2: f64 = 0.03 * 0.005;
        let size = 0.5 * density * self.lift * SIDE_M2 * speed * self.phases[i].sin();
        [-size * own[1], size * own[0]]
    }

    /// Lets the vortices turn on for `h` \[s\] behind links that move at these speeds \[m/s\].
    pub(super) fn shed<const N: usize>(&mut self, poses: &[Pose; N], h: f64) {
        const WIDTH_M: f64 = 0.01;
        if self.lift != 0.0 {
            for (phase, pose) in self.phases.iter_mut().zip(poses) {
                let speed = pose.velocity[0].hypot(pose.velocity[1]);
                *phase += TAU * STROUHAL * speed / WIDTH_M * h;
            }
        }
    }

    /// Torque of hinge `i` at the rate `turn` \[rad/s\].
    pub(super) fn hinge(&self, i: usize, turn: f64) -> f64 {
        let friction =
            if self.friction[i] == 0.0 { 0.0 } else { (turn / FRICTION_REVERSAL_RATE_RAD_PER_S).tanh() };
        -self.damping[i] * turn - self.friction[i] * friction
    }

    /// Torque of a bearing that turns at `turn` \[rad/s\] under `borne` \[N\].
    pub(super) fn bearing(&self, turn: f64, borne: Plane) -> f64 {
        -self.bearing_m * borne[0].hypot(borne[1]) * (turn / FRICTION_REVERSAL_RATE_RAD_PER_S).tanh()
    }

    /// Torque of hinge `i`, between links, bent by `bend` \[rad\].
    pub(super) fn spring(&self, i: usize, bend: f64, turn: f64) -> f64 {
        let [pull, side] = self.one_sided;
        let [stop, angle] = self.stop;
        let mut torque = -self.stiffness[i] * bend - pull * side * (side * bend).max(0.0);
        if stop != 0.0 {
            let beyond = bend.abs() - angle;
            let pressed = 0.5 * (beyond + beyond.hypot(STOP_ROUNDING_RAD));
            let contact = 0.5 * (1.0 + beyond / beyond.hypot(STOP_ROUNDING_RAD));
            torque -= stop * (pressed * bend.signum() + contact * STOP_DAMPING_S * turn);
        }
        if self.detent[i] != 0.0 {
            torque -= self.detent[i] * (DETENT_NOTCHES * bend).sin();
        }
        torque
    }

    /// Force on the last link's end.
    pub(super) fn at_tip(&self, tip: Plane) -> Plane {
        let pull = add(self.anchor, tip, -1.0).map(|d| self.tether * d);
        if self.magnet == 0.0 {
            return pull;
        }
        let to = add(MAGNET_PLACE_M, tip, -1.0);
        let distance = dot(to, to).sqrt();
        let strength =
            self.magnet / (1.0 + (distance / MAGNET_HALF_FORCE_DISTANCE_M).powi(4)) / distance.max(1e-3);
        add(pull, to, strength)
    }
}
