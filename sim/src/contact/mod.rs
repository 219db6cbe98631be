//! Watches for contact: where geoms that MuJoCo would let collide touch, whether their contact is simulated or not.
//!
//! Watching checks at coordinates after the fact, so a rollout that nobody watches costs nothing for it:
//!
//! ```
//! # let text = r#"<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.05"/>
//! #   <body><joint name="q" axis="0 1 0"/><geom name="leg" type="capsule" size="0.01" fromto="0 0 0 0.08 0 0"/></body>
//! #   </worldbody></mujoco>"#;
//! use sim::{Command, ContactWatch, Model, RolloutOptions, rollout};
//!
//! let model = Model::from_mjcf(text)?;
//! let times = [0.0, 0.05, 0.1, 0.15];
//! let run = rollout(&model, &model.rest_state(), &Command::default(), &times, &RolloutOptions::default())?;
//! let touch = ContactWatch::new(&model).and_then(|mut watch| watch.first_touch(&run)).expect("it falls on the floor");
//! assert_eq!(touch.geoms.geoms, ["floor", "leg"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod distance;

use crate::dynamics::contact::{Contacts, Point};
use crate::dynamics::plant::Plant;
use crate::dynamics::stages::ContactStage;
use crate::dynamics::{Work, integrate, kinematics};
use crate::math::{Quat, Vec3};
use crate::model::{GeomKind, Model, PossibleContact};
use crate::rollout::Rollout;
use crate::space::Spatial;
use distance::{Solid, distance};

/// Two geoms that have touched: where their contact is not simulated, MuJoCo's motion differs from ours from then on.
#[derive(Debug, Clone, PartialEq)]
pub struct Touch {
    /// The two geoms and how they may touch.
    pub geoms: PossibleContact,
    /// When they touched \[s\].
    pub time_s: f64,
}

/// Where two geoms push each other.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactPoint {
    /// Names of the two geoms.
    pub geoms: [String; 2],
    /// Midway between both surfaces \[m\].
    pub at_m: [f64; 3],
    /// From the first geom to the second, of length 1.
    pub normal: [f64; 3],
    /// Of the surfaces \[m\]; below 0 where they overlap.
    pub distance_m: f64,
}

/// Longest time between checks for contact \[s\] (chosen): what moves at 1 m/s moves a tenth of a millimetre in it.
const CHECK_INTERVAL_MAX_S: f64 = 1e-4;
/// Accuracy to which the time of a contact is found \[s\] (chosen).
const CONTACT_TIME_TOLERANCE_S: f64 = 1e-7;

/// Watches the pairs of geoms that MuJoCo would let collide ([`Model::possible_contacts`]).
///
/// A pair touches when it is closer than the sum of its margins, where MuJoCo's contact forces set in.
#[derive(Debug, Clone)]
pub struct ContactWatch {
    plant: Plant<Spatial<f64>>,
    work: Work<Spatial<f64>>,
    geoms: Vec<Shape>,
    pairs: Vec<Pair>,
    contacts: Option<Contacts<f64>>,
}

/// A geom on its body.
#[derive(Debug, Clone)]
struct Shape {
    name: String,
    body: usize,
    kind: GeomKind,
    size: [f64; 3],
    pos: Vec3<f64>,
    quat: Quat<f64>,
}

#[derive(Debug, Clone)]
struct Pair {
    geoms: [usize; 2],
    margin_m: f64,
    names: PossibleContact,
}

impl ContactWatch {
    /// Watches `model`; `None` when none of its geoms could collide.
    pub fn new(model: &Model) -> Option<Self> {
        Self::of(model, |_| true)
    }

    /// Watches for those that would collide in MuJoCo but pass through each other here; `None` when there are none.
    pub fn unsimulated(model: &Model) -> Option<Self> {
        Self::of(model, |possible| !possible.simulated)
    }

    fn of(model: &Model, watched: impl Fn(&PossibleContact) -> bool) -> Option<Self> {
        if !model.possible_contacts().iter().any(&watched) {
            return None;
        }
        let place = |name: &String| model.geoms.iter().position(|geom| geom.name == *name);
        let pairs = model.possible_contacts().iter().filter(|pair| watched(pair)).filter_map(|names| {
            let [first, second] = &names.geoms;
            let geoms = [place(first)?, place(second)?];
            let margin_m = geoms.iter().map(|&geom| model.geoms[geom].contact_margin_m).sum();
            Some(Pair { geoms, margin_m, names: names.clone() })
        });
        let geoms = model.geoms.iter().map(|geom| Shape {
            name: geom.name.clone(),
            body: geom.body,
            kind: geom.kind,
            size: geom.size,
            pos: geom.pos,
            quat: geom.quat,
        });
        let plant = Plant::new(model, ());
        Some(Self {
            work: Work::new(&plant),
            contacts: Contacts::new(model, &plant),
            plant,
            geoms: geoms.collect(),
            pairs: pairs.collect(),
        })
    }

    /// Where geoms whose contact is simulated push each other at the coordinates `qpos`, shape (nq).
    ///
    /// # Panics
    /// When `qpos` has another length than the model's.
    pub fn points(&mut self, qpos: &[f64]) -> Vec<ContactPoint> {
        let Some(contacts) = &mut self.contacts else { return Vec::new() };
        kinematics::kinematics(&self.plant, qpos, &mut self.work);
        contacts.find(&self.work);
        let point = |(geoms, point): ([usize; 2], &Point<f64>)| ContactPoint {
            geoms: geoms.map(|geom| self.geoms[geom].name.clone()),
            at_m: point.at.0,
            normal: point.normal.0,
            distance_m: point.distance,
        };
        contacts.found().map(point).collect()
    }

    /// The pair that is closest at the coordinates `qpos`, shape (nq), and by how much its distance exceeds its margins
    /// \[m\]: 0 or less when it touches.
    ///
    /// # Panics
    /// When `qpos` has another length than the model's.
    pub fn closest(&mut self, qpos: &[f64]) -> (&PossibleContact, f64) {
        let (pair, gap_m) = self.look(qpos);
        (&self.pairs[pair].names, gap_m)
    }

    fn look(&mut self, qpos: &[f64]) -> (usize, f64) {
        kinematics::kinematics(&self.plant, qpos, &mut self.work);
        let solid = |geom: usize| {
            let Shape { body, kind, size, pos, quat, .. } = self.geoms[geom];
            let rot = &self.work.rot[body];
            let at = self.work.pos[body] + rot.apply(pos);
            Solid { kind, size, at, rot: rot.product(&quat.matrix()) }
        };
        let mut closest = (0, f64::INFINITY);
        for (index, pair) in self.pairs.iter().enumerate() {
            let [a, b] = pair.geoms.map(solid);
            // what cannot be the closest need not be measured
            let apart = (a.at - b.at).norm() - a.reach() - b.reach() - pair.margin_m;
            let gap_m = if apart < closest.1 { distance(&a, &b) - pair.margin_m } else { apart };
            if gap_m < closest.1 {
                closest = (index, gap_m);
            }
        }
        closest
    }

    /// The first touch of `rollout`, which `self`'s model made; between its samples motion is the cubic through both.
    ///
    /// # Panics
    /// When `rollout` is another model's.
    pub fn first_touch(&mut self, rollout: &Rollout<f64>) -> Option<Touch> {
        let samples = rollout.time_s.len();
        let (nq, nv) = (rollout.qpos.len() / samples.max(1), rollout.qvel.len() / samples.max(1));
        let instant =
            |row: usize| (&rollout.qpos[row * nq..(row + 1) * nq], &rollout.qvel[row * nv..(row + 1) * nv]);
        let touch = |watch: &Self, pair: usize, time_s| {
            Some(Touch { geoms: watch.pairs[pair].names.clone(), time_s })
        };
        let mut between = vec![0.0; nq];
        for row in 0..samples {
            let (pair, gap_m) = self.look(instant(row).0);
            if row == 0 {
                if gap_m <= 0.0 {
                    return touch(self, pair, rollout.time_s[0]);
                }
                continue;
            }
            let (from_s, to_s) = (rollout.time_s[row - 1], rollout.time_s[row]);
            let h = to_s - from_s;
            let (start, end) = (instant(row - 1), instant(row));
            let mut at = |watch: &mut Self, share: f64| {
                integrate::between(&watch.plant, start, end, h, share, &mut between);
                watch.look(&between)
            };
            let checks = (h / CHECK_INTERVAL_MAX_S).ceil().max(1.0) as usize;
            for look in 1..=checks {
                let share = look as f64 / checks as f64;
                let (mut found, gap_m) = if look == checks { (pair, gap_m) } else { at(self, share) };
                if gap_m > 0.0 {
                    continue;
                }
                let (mut before, mut after) = (share - 1.0 / checks as f64, share);
                while (after - before) * h > CONTACT_TIME_TOLERANCE_S {
                    let middle = 0.5 * (before + after);
                    let (pair, gap_m) = at(self, middle);
                    if gap_m > 0.0 {
                        before = middle;
                    } else {
                        (after, found) = (middle, pair);
                    }
                }
                return touch(self, found, from_s + after * h);
            }
        }
        None
    }
}
