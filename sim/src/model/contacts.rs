//! Which geoms would collide in MuJoCo.

use super::{GeomKind, Model};

/// Two geoms that MuJoCo would let collide.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PossibleContact {
    /// Names of the two geoms.
    pub geoms: [String; 2],
    /// Whether they do here; else they pass through each other.
    pub simulated: bool,
}

impl PossibleContact {
    /// Whether contact of these two shapes is simulated: a plane with any other, spheres and capsules, and boxes.
    pub(crate) fn is_simulated(a: GeomKind, b: GeomKind) -> bool {
        use GeomKind::{Box, Capsule, Plane, Sphere};
        let round = |kind| matches!(kind, Sphere | Capsule);
        (a == Plane) != (b == Plane) || round(a) && round(b) || (a, b) == (Box, Box)
    }
}

/// What the model says about contact.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Contacts {
    /// Whether the model switches contact off altogether.
    pub(crate) off: bool,
    /// Pairs of bodies whose geoms never collide.
    pub(crate) excluded: Vec<[usize; 2]>,
    pub(crate) possible: Vec<PossibleContact>,
}

impl Contacts {
    pub(crate) fn new(model: &Model<f64>, off: bool, excluded: Vec<[usize; 2]>) -> Self {
        let possible = if off { Vec::new() } else { possible(model, &excluded) };
        Self { off, excluded, possible }
    }

    /// Whether some pair's contact is simulated.
    pub(crate) fn simulated(&self) -> bool {
        self.possible.iter().any(|pair| pair.simulated)
    }
}

/// All pairs of geoms that MuJoCo's filters let through: bits match, not fixed to each other, not parent and
/// child (but for the world's), not excluded by name of their bodies.
fn possible(model: &Model<f64>, excluded: &[[usize; 2]]) -> Vec<PossibleContact> {
    let Model { bodies, joints, geoms, .. } = model;
    // bodies without joints of their own move with their parent
    let mut carrier: Vec<usize> = Vec::with_capacity(bodies.len());
    for (index, body) in bodies.iter().enumerate() {
        let moves = joints.iter().any(|joint| joint.body == index);
        carrier.push(if moves || index == 0 { index } else { carrier[body.parent] });
    }
    let mut pairs = Vec::new();
    for (i, first) in geoms.iter().enumerate() {
        for second in &geoms[i + 1..] {
            let bits = first.contact_bits[0] & second.contact_bits[1]
                | second.contact_bits[0] & first.contact_bits[1];
            let (a, b) = (carrier[first.body], carrier[second.body]);
            let adjacent = |child: usize, parent: usize| {
                child != 0 && parent != 0 && carrier[bodies[child].parent] == parent
            };
            let named =
                |pair: &[usize; 2]| *pair == [first.body, second.body] || *pair == [second.body, first.body];
            if bits != 0 && a != b && !adjacent(a, b) && !adjacent(b, a) && !excluded.iter().any(named) {
                let simulated = PossibleContact::is_simulated(first.kind, second.kind);
                pairs.push(PossibleContact { geoms: [first.name.clone(), second.name.clone()], simulated });
            }
        }
    }
    pairs
}
