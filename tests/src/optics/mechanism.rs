//! Mechanisms: what is drawn about their sizes, and where their solids and keypoints are in a pose.

use crate::optics::octopus;
use crate::optics::solids::{Shape, Solid};
use crate::optics::vec::{V3, v3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// What kind of mechanism is filmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Rigid links.
    Chain,
    /// A soft arm of tapered segments.
    Arm,
    /// A body that nothing holds, with eight arms.
    Octopus,
}

/// How a link is made; the model knows boxes only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Made {
    /// Boxes with rounded ends.
    Slabs,
    /// Round, tapered.
    Round,
    /// Flat, tapered in the picture, of the same depth all along.
    Ribbon { half_depth_m: f64 },
    /// Only a small disc at each keypoint, to test where they are seen.
    #[cfg(test)]
    Dots { material: usize, radius_m: f64 },
}

/// A box of the model.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    /// From this hinge to the next one, or to the tip.
    pub(crate) pitch_m: f64,
    /// Half the width in the picture, half the depth, half the length.
    pub(crate) half_m: [f64; 3],
    /// From the hinge to the middle of the box.
    pub(crate) middle_m: f64,
    /// How far its middle is behind the plane of motion.
    pub(crate) layer_m: f64,
}

/// The sizes of a mechanism.
#[derive(Clone, Debug)]
pub(crate) struct Mechanism {
    pub(crate) kind: Kind,
    pub(crate) links: Vec<Link>,
    pub(crate) made: Made,
    /// Radius of a round arm as a multiple of the model's half width.
    pub(crate) fatness: f64,
}

/// Where a mechanism is: its root, and the angle of each hinge.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pose {
    pub(crate) root: V3,
    pub(crate) turn_rad: f64,
    pub(crate) angles_rad: Vec<f64>,
}

/// A point whose place is the truth.
#[derive(Clone, Debug)]
pub(crate) struct Keypoint {
    pub(crate) name: String,
    pub(crate) at: V3,
    pub(crate) owner: u16,
}

/// Width of the arm of `arm8.xml`: half width and half depth of the first and the last box [m].
pub(crate) const ARM_HALF_WIDTHS_M: [f64; 2] = [0.003, 0.0015];
pub(crate) const ARM_HALF_DEPTHS_M: [f64; 2] = [0.012, 0.004];

impl Mechanism {
    /// Draws the sizes round those of the shipped models; each third chain is of odd sizes.
    pub(crate) fn drawn(kind: Kind, seed: u64, rng: &mut ChaCha8Rng) -> Mechanism {
        match kind {
            Kind::Chain => Mechanism { kind, links: chain_links(seed, rng), made: Made::Slabs, fatness: 1.0 },
            Kind::Arm | Kind::Octopus => {
                let (size, width) = match kind {
                    Kind::Octopus => (1.0, 1.0),
                    _ => (rng.random_range(0.8..1.2), rng.random_range(0.9..1.3)),
                };
                Mechanism {
                    kind,
                    links: arm_links(size, width),
                    made: Made::Round,
                    fatness: rng.random_range(1.0..1.6),
                }
            }
        }
    }

    /// The length from root to tip.
    pub(crate) fn length_m(&self) -> f64 {
        self.links.iter().map(|l| l.pitch_m).sum()
    }

    /// The places of the hinges and of the tip, in the plane of motion.
    pub(crate) fn nodes(&self, pose: &Pose) -> Vec<V3> {
        let (mut at, mut turn) = (pose.root, pose.turn_rad);
        let mut nodes = vec![at];
        for (link, q) in self.links.iter().zip(&pose.angles_rad) {
            turn += q;
            at += v3(0.0, 0.0, -link.pitch_m).turned(turn);
            nodes.push(at);
        }
        nodes
    }

    /// The keypoints, named as the model's sites are.
    pub(crate) fn keypoints(&self, pose: &Pose) -> Vec<Keypoint> {
        if self.kind == Kind::Octopus {
            return octopus::keypoints(self, pose);
        }
        let nodes = self.nodes(pose);
        let which = if self.kind == Kind::Arm { vec![0, 4, 8] } else { (0..nodes.len()).collect() };
        which
            .iter()
            .enumerate()
            .map(|(i, &n)| Keypoint { name: format!("P{i}"), at: nodes[n], owner: 0 })
            .collect()
    }

    /// The solids in a pose, of this material and owner.
    pub(crate) fn solids(&self, pose: &Pose, material: usize, owner: u16) -> Vec<Solid> {
        if self.kind == Kind::Octopus {
            return octopus::solids(self, pose, material);
        }
        let nodes = self.nodes(pose);
        match self.made {
            #[cfg(test)]
            Made::Dots { material, radius_m } => self
                .keypoints(pose)
                .iter()
                .map(|k| {
                    let shape = Shape::Slab {
                        a: k.at,
                        b: k.at,
                        ra_m: radius_m,
                        rb_m: radius_m,
                        y0_m: -1e-6,
                        y1_m: 1e-6,
                        cut: None,
                    };
                    Solid::new(shape, material, owner)
                })
                .collect(),
            Made::Slabs => self.slabs(&nodes, material, owner),
            _ => self.soft(&nodes, material, owner),
        }
    }

    fn slabs(&self, nodes: &[V3], material: usize, owner: u16) -> Vec<Solid> {
        let mut solids = Vec::new();
        for (i, link) in self.links.iter().enumerate() {
            let w = (nodes[i + 1] - nodes[i]).unit();
            let [r, depth, half] = link.half_m;
            let (a, b) =
                (nodes[i] + w * (link.middle_m - half + r), nodes[i] + w * (link.middle_m + half - r));
            // A hair's breadth between links that lie in one plane tells which is seen.
            let y = nodes[i].y + link.layer_m - 2e-5 * i as f64;
            let shape = Shape::Slab {
                a: a.in_plane(),
                b: b.in_plane(),
                ra_m: r,
                rb_m: r,
                y0_m: y - depth,
                y1_m: y + depth,
                cut: None,
            };
            let mut s = Solid::new(shape, material, owner);
            s.along_m = i as f64 * 0.05;
            solids.push(s);
        }
        solids
    }

    /// An arm through these nodes: cut square at the root, and with its tip's round end at the last node.
    pub(crate) fn soft(&self, nodes: &[V3], material: usize, owner: u16) -> Vec<Solid> {
        let n = self.links.len();
        let radius = |i: usize| {
            let first = self.links[0].half_m[0];
            let slope = (self.links[n - 1].half_m[0] - first) / (n as f64 - 1.0);
            self.fatness_here() * (first + slope * (i as f64 - 0.5))
        };
        let mut solids = Vec::new();
        let mut along_m = 0.0;
        for i in 0..n {
            let (a, mut b) = (nodes[i], nodes[i + 1]);
            let w = (b - a).unit();
            let (ra_m, mut rb_m) = (radius(i), radius(i + 1));
            if i + 1 == n {
                // The ball at the end touches the tip from inside.
                let length = (b - a).norm();
                rb_m = rb_m.min(length * 0.5);
                b = b - w * rb_m;
            }
            let cut = (i == 0).then_some((a, w));
            let shape = match self.made {
                Made::Ribbon { half_depth_m: h } => Shape::Slab {
                    a: a.in_plane(),
                    b: b.in_plane(),
                    ra_m,
                    rb_m,
                    y0_m: a.y - h,
                    y1_m: a.y + h,
                    cut,
                },
                _ => Shape::RoundCone { a, b, ra_m, rb_m, cut },
            };
            let mut s = Solid::new(shape, material, owner);
            s.along_m = along_m;
            along_m += self.links[i].pitch_m;
            solids.push(s);
        }
        solids
    }

    fn fatness_here(&self) -> f64 {
        if matches!(self.made, Made::Round) { self.fatness } else { 1.0 }
    }

    /// The greatest half width in the picture.
    pub(crate) fn half_width_m(&self) -> f64 {
        self.links.iter().map(|l| l.half_m[0]).fold(0.0, f64::max) * self.fatness_here()
    }
}

fn chain_links(seed: u64, rng: &mut ChaCha8Rng) -> Vec<Link> {
    let odd = seed.is_multiple_of(3);
    let size = rng.random_range(0.85..1.25);
    let width_m = 0.005 * size * rng.random_range(0.85..1.2);
    let depth_m = 0.0025 * size * rng.random_range(0.8..1.4);
    let overhang_m = 0.0025 * size * rng.random_range(0.7..1.6);
    (0..3)
        .map(|i| {
            let stretch = if odd { rng.random_range(0.7..1.45) } else { 1.0 };
            let pivots_m = 0.025 * size * stretch;
            let half_m = pivots_m * 0.5 + overhang_m;
            Link {
                pitch_m: if i == 2 { pivots_m + overhang_m } else { pivots_m },
                half_m: [width_m, depth_m, half_m],
                middle_m: pivots_m * 0.5,
                layer_m: 0.0,
            }
        })
        .collect()
}

fn arm_links(size: f64, width: f64) -> Vec<Link> {
    (0..8)
        .map(|i| {
            let at = |ends: [f64; 2]| ends[0] + (ends[1] - ends[0]) * i as f64 / 7.0;
            let half = 0.01 * size;
            Link {
                pitch_m: 2.0 * half,
                half_m: [at(ARM_HALF_WIDTHS_M) * width, at(ARM_HALF_DEPTHS_M) * width, half],
                middle_m: half,
                layer_m: 0.0,
            }
        })
        .collect()
}
