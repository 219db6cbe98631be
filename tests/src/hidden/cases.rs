//! What is hidden where: the list of cases, each made anew from its own description.

use super::bench::{Bench, Draw};
use super::hide::{Hideout, OUTSIDE_EFFECTS, Truth};
use super::limit::Benches;
use super::terms::Hidden;

/// Sizes, as multiples of the limit.
pub const SIZES: [f64; 4] = [0.3, 2.0, 5.0, 20.0];
/// Sizes of the effects that are not in the library, as multiples of the limit.
const OUTSIDE_SIZES: [f64; 2] = [5.0, 20.0];
/// Seeds of the outside cases for each size.
const OUTSIDE_SEEDS: u64 = 5;
/// Pairs in the whole set.
pub const PAIR_CASES: u64 = 60;
/// Cases without anything hidden in the whole set, and their first seed.
pub const NOTHING_CASES: u64 = 300;
const NOTHING_SEED: u64 = 1000;
/// Size of both causes of a pair, each measured with the other one free too.
const PAIR_SIZE: f64 = 8.0;

/// The causes that are hidden in three links, in an order that pairs are drawn from.
pub const HIDDEN: [&str; 28] = [
    "current",
    "buoyancy",
    "link_mass",
    "joint_damping",
    "stiffness",
    "keypoint_slip",
    "added_mass",
    "slosh",
    "cob_offset",
    "linear_drag",
    "drag_exponent",
    "wall",
    "basset",
    "coulomb_friction",
    "one_sided_stiffness",
    "end_stop",
    "tether",
    "servo_gain",
    "servo_rate_limit",
    "servo_lag",
    "backlash",
    "servo_delay",
    "camera_delay",
    "rolling_shutter",
    "lens",
    "camera_tilt",
    "camera_scale",
    "camera_rotation",
];

/// What a case hides.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Nothing.
    Nothing,
    /// One cause, at a multiple of its limit.
    One(&'static str, f64),
    /// Two at once.
    Pair(&'static str, &'static str),
    /// Something that no library knows, at a multiple of its limit.
    Outside(&'static str, f64),
}

/// A case, not yet made.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Its name, unique.
    pub id: String,
    /// What its mechanism, runs and noise come from.
    pub seed: u64,
    /// What it hides.
    pub kind: Kind,
}

/// A case, made.
#[derive(Debug, Clone)]
pub struct Made<const N: usize> {
    /// Mechanism and runs.
    pub bench: Bench<N>,
    /// What is hidden.
    pub hidden: Hidden,
    /// What should be found.
    pub truth: Vec<Truth>,
}

/// All cases with `seeds` of each of `causes` in each of `sizes`, by group.
pub fn all(causes: &[&'static str], seeds: u64, sizes: &[f64]) -> Vec<Case> {
    let mut list = Vec::new();
    for seed in 0..seeds {
        for &name in causes {
            for &size in sizes {
                let id = format!("{name}-x{size}-s{seed}");
                list.push(Case { id, seed, kind: Kind::One(name, size) });
            }
        }
    }
    for pair in 0..PAIR_CASES {
        let mut draw = Draw::new(pair, 11);
        let first = causes[draw.place(causes.len())];
        let others = causes.iter().filter(|name| !same(name, first, false) && **name != first);
        let others: Vec<&'static str> = others.copied().collect();
        let second = others[draw.place(others.len())];
        let id = format!("pair-{first}+{second}-s{pair}");
        list.push(Case { id, seed: pair % seeds.max(1), kind: Kind::Pair(first, second) });
    }
    for seed in 0..NOTHING_CASES {
        let id = format!("nothing-s{seed}");
        list.push(Case { id, seed: NOTHING_SEED + seed, kind: Kind::Nothing });
    }
    for seed in 0..OUTSIDE_SEEDS {
        for (name, ..) in OUTSIDE_EFFECTS {
            for size in OUTSIDE_SIZES {
                let id = format!("outside-{name}-x{size}-s{seed}");
                list.push(Case { id, seed, kind: Kind::Outside(name, size) });
            }
        }
    }
    list
}

/// Whether no video tells the causes `a` and `b` apart, in experiments of which `all_driven` says whether every run is driven.
pub fn same(a: &str, b: &str, all_driven: bool) -> bool {
    let is = |x: &str, y: &str| (a, b) == (x, y) || (a, b) == (y, x);
    is("buoyancy", "link_mass") || all_driven && is("servo_delay", "camera_delay")
}

impl Case {
    /// Makes the case; `None` where its runs show nothing of what should be hidden at any size.
    pub fn make<const N: usize>(&self, benches: &mut Benches<N>) -> Option<Made<N>> {
        let of_joints = benches.mechanism().of_joints;
        let known = match self.kind {
            Kind::One(name, _) => of_joints.contains(&name),
            Kind::Pair(a, b) => of_joints.contains(&a) || of_joints.contains(&b),
            _ => false,
        };
        // a damping that is fitted is no candidate: a part of all cases has the nominal one and fits none
        let fits_joints = !known && !self.seed.is_multiple_of(3);
        let mut draw = Draw::new(self.seed, 2);
        if self.kind == Kind::Nothing {
            let bench = (benches.mechanism().draw)(self.seed, fits_joints);
            return Some(Made { bench, hidden: Hidden::default(), truth: Vec::new() });
        }
        let (hidden, truth) = match self.kind {
            Kind::Nothing => (Hidden::default(), Vec::new()),
            Kind::One(name, size) | Kind::Outside(name, size) => {
                let hideout = Hideout::draw(name, &benches.get(self.seed, fits_joints).0, &mut draw);
                let limit = benches.limit(self.seed, fits_joints, &hideout)?;
                let (bench, imitation) = benches.get(self.seed, fits_joints);
                let (hidden, mut truth) = hideout.hide(bench, imitation, limit, size)?;
                if matches!(self.kind, Kind::One(..)) {
                    truth.rival = Some(benches.nearest(self.seed, fits_joints, name, &hidden));
                }
                (hidden, vec![truth])
            }
            Kind::Pair(a, b) => {
                let mut draw = Draw::new(self.seed, 3);
                let (bench, imitation) = benches.get(self.seed, fits_joints);
                let [a, b] = [a, b].map(|name| Hideout::draw(name, bench, &mut draw));
                let hide = |hideout: &Hideout, partner: Option<(&Hideout, &Hidden)>| {
                    let limit = hideout.limit(bench, imitation, partner)?;
                    hideout.hide(bench, imitation, limit, PAIR_SIZE)
                };
                let (first, _) = hide(&a, None)?;
                let (second, other) = hide(&b, Some((&a, &first)))?;
                let (first, one) = hide(&a, Some((&b, &second)))?;
                let mut both = first;
                both.0.extend(second.0);
                (both, vec![one, other])
            }
        };
        let bench = benches.get(self.seed, fits_joints).0.clone();
        Some(Made { bench, hidden, truth })
    }
}
