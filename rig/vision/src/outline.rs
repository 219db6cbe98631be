//! What is known of the mechanism's shape before it is seen: from its model, from the `[vision]` table, which wins, or learned
//! from the pictures.

use sim::math::{Mat3, Vec3};
use sim::model::GeomKind;
use sim::{JointKind, Model};

use super::VisionError;
use super::arms::Swimmer;
use super::config::{Mode, VisionConfig};

/// A mechanism's shape in the plane of motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Number of links n: keypoints are P0..Pn.
    pub links: usize,
    /// How keypoints are placed.
    pub mode: Mode,
    /// Mode `links`: lengths from P0 to P1 and so on \[m\], shape (n); none where only their ratio, 1, is assumed.
    pub lengths_m: Option<Vec<f64>>,
    /// Mode `links`: how far a link reaches past its pivots and the sigma of that \[m\]; none where pictures must tell.
    pub overhang_m: Option<(f64, f64)>,
    /// Mode `links`: how far the last link reaches past Pn \[m\].
    pub tip_overhang_m: f64,
    /// Mode `links`: corner radius of the free ends as a share of the half width; none where pictures must tell.
    pub end_rounding: Option<f64>,
    /// Mode `arc`: P0..Pn at these shares of the arc length, end to end, shape (n + 1).
    pub shares: Vec<f64>,
    /// Mode `centroid`: from P0 to P1 \[m\]; none where pictures must tell.
    pub heading_m: Option<f64>,
    /// Mode `arms`: the body and its arms.
    pub swimmer: Option<Swimmer>,
    /// Where P0 is fixed in the world \[m\]; none where it moves or nobody says.
    pub base_m: Option<[f64; 3]>,
}

impl Outline {
    /// Of what `config` says, and for the rest of what `model` does.
    ///
    /// # Errors
    /// [`VisionError::Config`] where neither says how many links there are and how they are placed, or what they say does not go
    /// together.
    pub fn new(config: &VisionConfig, model: Option<&Model>) -> Result<Self, VisionError> {
        let refuse = |what: &str| Err(VisionError::Config { what: what.into() });
        let swimmer = model.map(Swimmer::of).transpose()?.flatten();
        let arms = swimmer.filter(|_| config.mode.is_none_or(|mode| mode == Mode::Arms));
        if config.mode == Some(Mode::Arms) && arms.is_none() {
            return refuse(
                "mode = \"arms\" needs a model with a free joint and arms whose sites are a1P0, a1P1 and so on",
            );
        }
        let mode = config.mode.or(arms.as_ref().map(|_| Mode::Arms));
        let free = mode.is_some_and(Mode::is_free);
        let known = match model.map(ModelShape::of).transpose() {
            // A free body's model need not have a chain of keypoints.
            Err(_) if free => None,
            known => known?,
        };
        if free && (config.links.is_some() || config.base_px.is_some()) {
            return refuse(
                "modes \"centroid\" and \"arms\" are for what nothing holds: remove `links` and `base_px`",
            );
        }
        let links = match &arms {
            Some(arms) => Some(arms.keypoints.len() - 1),
            // The centroid, and a point ahead of it.
            None if free => Some(1),
            None => config.links.or(known.as_ref().map(|known| known.lengths_m.len())),
        };
        let Some(links) = links else {
            return refuse("needs `links`, the number of links, or a model that has keypoints");
        };
        // What the model says of another number of links does not fit.
        let known = known.filter(|known| known.lengths_m.len() == links);
        let Some(mode) = mode.or(known.as_ref().map(|known| known.mode)) else {
            return refuse(
                "needs `mode` = \"links\", \"arc\" or \"paper\", or a model with as many keypoints",
            );
        };
        if !free {
            config.check(links)?;
        }
        let rigid = known.as_ref().filter(|known| known.mode == Mode::Links);
        let lengths_m = match &config.link_lengths_m {
            Some(lengths) => Some(lengths.iter().map(|length| length.get()).collect()),
            None => rigid.map(|known| known.lengths_m.clone()),
        };
        let equal = || (0..=links).map(|i| i as f64 / links as f64).collect();
        let shares = match &config.shares {
            Some(shares) => std::iter::once(0.0).chain(shares.iter().map(|share| share.get())).collect(),
            None => known.as_ref().map_or_else(equal, ModelShape::shares),
        };
        Ok(Self {
            links,
            mode,
            lengths_m,
            overhang_m: config
                .overhang_m
                .map(|overhang| overhang.get())
                .or(rigid.map(|known| known.back_m))
                .map(|overhang| (overhang, 0.0)),
            tip_overhang_m: rigid.map_or(0.0, |known| known.front_m),
            end_rounding: config
                .end_rounding
                .map(|share| share.get())
                .or(rigid.and_then(|known| known.rounding)),
            shares,
            heading_m: config
                .heading_m
                .map(|heading| heading.get())
                .or(rigid.map(|known| known.lengths_m[0]).filter(|_| free)),
            swimmer: arms,
            base_m: known.and_then(|known| known.base_m).filter(|_| !free),
        })
    }
}

impl Outline {
    /// Names of the keypoints.
    pub fn keypoints(&self) -> Vec<String> {
        let of_arms = self.swimmer.as_ref().map(|swimmer| swimmer.keypoints.clone());
        of_arms.unwrap_or_else(|| (0..=self.links).map(|i| format!("P{i}")).collect())
    }
}

/// What a model says of the line P0..Pn.
struct ModelShape {
    mode: Mode,
    /// Along the bodies from each keypoint to the next \[m\].
    lengths_m: Vec<f64>,
    /// How far the first body reaches back past P0, and the last one past Pn \[m\].
    back_m: f64,
    front_m: f64,
    /// Of the ends, where both are alike.
    rounding: Option<f64>,
    base_m: Option<[f64; 3]>,
}

/// How far joints are turned \[rad, m\] to see what is rigid: no angle that a mechanism would have by itself.
const PROBES: [f64; 3] = [0.31, -0.23, 0.17];
/// Distances that differ by less \[m\] are the same.
const SAME_M: f64 = 1e-7;

impl ModelShape {
    fn of(model: &Model) -> Result<Self, VisionError> {
        let refuse = |what: String| Err(VisionError::Config { what });
        let sites = model.keypoint_sites();
        let names: Vec<&str> = sites.iter().map(|&site| model.sites[site].name.as_str()).collect();
        let expected: Vec<String> = (0..=sites.len()).map(|i| format!("P{i}")).collect();
        let from = if names.first() == Some(&"P0") { 0 } else { 1 };
        if names.len() + from < 2 || names.iter().zip(&expected[from..]).any(|(name, wanted)| name != wanted)
        {
            let found = names.join(", ");
            return refuse(format!(
                "the model {} has the keypoints [{found}]: sites P0 to Pn, one a joint and the tip, are needed, or `links` \
                 and `mode`",
                model.name
            ));
        }
        // Without a site P0 it is where the first body that moves is joined on.
        let first = model.joints.first().map_or(1, |joint| joint.body);
        let place = |pose: &Pose, i: usize| match i.checked_sub(from) {
            Some(site) => pose.sites[sites[site]],
            None => pose.bodies[first],
        };
        let links = sites.len() + from - 1;
        let rest = Pose::at(model, 0.0);
        let probes: Vec<Pose> = PROBES.iter().map(|&turn| Pose::at(model, turn)).collect();
        let stays = |distance: &dyn Fn(&Pose) -> f64| {
            probes.iter().all(|probe| (distance(probe) - distance(&rest)).abs() < SAME_M)
        };
        let apart = |i: usize| move |pose: &Pose| (place(pose, i + 1) - place(pose, i)).norm();
        let rigid = (0..links).all(|i| stays(&|pose| (place(pose, i + 1) - place(pose, i)).norm()));
        let body = |i: usize| i.checked_sub(from).map_or(first, |site| model.sites[sites[site]].body);
        let lengths_m = (0..links)
            .map(|i| match rigid {
                true => apart(i)(&rest),
                false => {
                    along(model, &rest, [(body(i), place(&rest, i)), (body(i + 1), place(&rest, i + 1))])
                }
            })
            .collect();
        let reach = |i: usize, towards: usize| {
            let (at, other) = (place(&rest, i), place(&rest, towards));
            let outward = (at - other) * (1.0 / (at - other).norm().max(f64::MIN_POSITIVE));
            let carried = |geom: &usize| {
                let held = |to: usize| stays(&|pose: &Pose| (pose.geoms[*geom].0 - place(pose, to)).norm());
                model.geoms[*geom].kind != GeomKind::Plane && held(i) && (!rigid || held(towards))
            };
            let geoms: Vec<usize> = (0..model.geoms.len()).filter(carried).collect();
            let farthest = geoms.iter().map(|&geom| (rest.extent(model, geom, outward, at), geom));
            farthest
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .map_or((0.0, None), |(reach, geom)| (reach.max(0.0), rounding(model.geoms[geom].kind)))
        };
        let (back, front) = (reach(0, 1), reach(links, links - 1));
        let base = place(&rest, 0);
        let fixed = probes.iter().all(|probe| (place(probe, 0) - base).norm() < SAME_M);
        Ok(Self {
            mode: if rigid { Mode::Links } else { Mode::Arc },
            lengths_m,
            back_m: back.0,
            front_m: front.0,
            rounding: back.1.filter(|_| back.1 == front.1),
            base_m: (fixed && !floats(model)).then_some(base.0),
        })
    }

    /// P0..Pn as shares of the whole length, end to end.
    fn shares(&self) -> Vec<f64> {
        let total = self.back_m + self.lengths_m.iter().sum::<f64>() + self.front_m;
        let mut at = self.back_m;
        let next = self.lengths_m.iter().map(|length| {
            at += length;
            at / total
        });
        std::iter::once(self.back_m / total).chain(next).collect()
    }
}

fn floats(model: &Model) -> bool {
    model.joints.iter().any(|joint| joint.kind == JointKind::Free)
}

/// Where everything is in one pose.
pub(super) struct Pose {
    pub(super) bodies: Vec<Vec3<f64>>,
    turns: Vec<Mat3<f64>>,
    pub(super) sites: Vec<Vec3<f64>>,
    /// Centre, and the axes as columns in the world.
    pub(super) geoms: Vec<(Vec3<f64>, [Vec3<f64>; 3])>,
}

impl Pose {
    /// At rest, but for each hinge and slide `turn` further on, each by another share of it.
    pub(super) fn at(model: &Model, turn: f64) -> Self {
        let mut qpos = model.rest_state().qpos;
        for (i, joint) in model.joints.iter().enumerate() {
            if matches!(joint.kind, JointKind::Hinge | JointKind::Slide) {
                qpos[joint.qpos_address] += turn * (1.0 + 0.37 * i as f64);
            }
        }
        let poses = model.poses(&qpos);
        let axes = poses.geom_rot.iter().map(|rot| [0, 1, 2].map(|k| rot.column(k)));
        Self {
            bodies: poses.body_pos,
            turns: poses.body_rot,
            sites: poses.site_pos,
            geoms: poses.geom_pos.iter().copied().zip(axes).collect(),
        }
    }

    /// `way` in the frame of `body`, in the world's.
    pub(super) fn turned(&self, body: usize, way: Vec3<f64>) -> Vec3<f64> {
        self.turns[body].apply(way)
    }

    /// How far geom `geom` reaches from `from` in the direction `along` \[m\].
    pub(super) fn extent(&self, model: &Model, geom: usize, along: Vec3<f64>, from: Vec3<f64>) -> f64 {
        let (centre, axes) = &self.geoms[geom];
        let [a, b, c] = axes.map(|axis| axis.dot(along).abs());
        let [x, y, z] = model.geoms[geom].size;
        let own = match model.geoms[geom].kind {
            GeomKind::Sphere => x,
            GeomKind::Capsule => x + y * c,
            GeomKind::Cylinder => x * a.hypot(b) + y * c,
            GeomKind::Ellipsoid => (x * a).hypot(y * b).hypot(z * c),
            GeomKind::Box => x * a + y * b + z * c,
            GeomKind::Plane => 0.0,
        };
        (*centre - from).dot(along) + own
    }
}

/// Corner radius of a shape's end as a share of its half width.
fn rounding(kind: GeomKind) -> Option<f64> {
    match kind {
        GeomKind::Box | GeomKind::Cylinder => Some(0.0),
        GeomKind::Sphere | GeomKind::Capsule => Some(1.0),
        // Its end is none of the two.
        GeomKind::Ellipsoid | GeomKind::Plane => None,
    }
}

/// The way from one point on a body to one on a body that it carries, through the origins of the bodies between \[m\].
fn along(model: &Model, pose: &Pose, [(first, from), (last, to)]: [(usize, Vec3<f64>); 2]) -> f64 {
    let (mut body, mut end, mut length) = (last, to, 0.0);
    while body != first && body != 0 {
        length += (end - pose.bodies[body]).norm();
        end = pose.bodies[body];
        body = model.bodies[body].parent;
    }
    length + (end - from).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped(name: &str) -> Model {
        let path = format!("{}/../../configs/models/{name}", env!("CARGO_MANIFEST_DIR"));
        Model::from_mjcf(&std::fs::read_to_string(path).unwrap()).unwrap()
    }

    fn near(a: &[f64], b: &[f64]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    #[test]
    fn rigid_links_are_read_off_a_chain() {
        for name in ["chain-passive.xml", "chain-driven-flat.xml", "chain-driven-hanging.xml"] {
            let outline = Outline::new(&VisionConfig::default(), Some(&shipped(name))).unwrap();
            assert_eq!((outline.links, outline.mode), (3, Mode::Links), "{name}");
            assert!(near(&outline.lengths_m.unwrap(), &[0.025, 0.025, 0.0275]), "{name}");
            assert!(near(&[outline.overhang_m.unwrap().0, outline.tip_overhang_m], &[0.0025, 0.0]), "{name}");
            assert_eq!((outline.end_rounding, outline.base_m), (Some(0.0), Some([0.0; 3])), "{name}");
        }
    }

    #[test]
    fn shares_are_read_off_an_arm() {
        let outline = Outline::new(&VisionConfig::default(), Some(&shipped("arm8.xml"))).unwrap();
        assert_eq!((outline.links, outline.mode, outline.lengths_m), (2, Mode::Arc, None));
        assert!(near(&outline.shares, &[0.0, 0.5, 1.0]), "{:?}", outline.shares);
    }

    #[test]
    fn a_tip_short_of_the_end_and_round_ends_are_seen() {
        let text = r#"<mujoco><worldbody><body><joint name="q" axis="0 -1 0"/><site name="P0"/>
            <geom type="capsule" size="0.004" fromto="0 0 0 0 0 -0.05"/><site name="P1" pos="0 0 -0.05"/>
            </body></worldbody></mujoco>"#;
        let model = Model::from_mjcf(text).unwrap();
        let outline = Outline::new(&VisionConfig::default(), Some(&model)).unwrap();
        assert!(near(&outline.lengths_m.unwrap(), &[0.05]));
        assert!(near(&[outline.overhang_m.unwrap().0, outline.tip_overhang_m], &[0.004, 0.004]));
        assert_eq!(outline.end_rounding, Some(1.0));
    }

    #[test]
    fn the_table_wins_and_a_model_of_other_keypoints_says_nothing() {
        let model = shipped("chain-passive.xml");
        let config =
            VisionConfig { overhang_m: ground::strict::NonNegative::new(0.001), ..VisionConfig::default() };
        let outline = Outline::new(&config, Some(&model)).unwrap();
        assert_eq!((outline.links, outline.overhang_m), (3, Some((0.001, 0.0))));
        let outline = Outline::new(&VisionConfig::new(2, Mode::Links), Some(&model)).unwrap();
        assert_eq!((outline.lengths_m, outline.overhang_m, outline.base_m), (None, None, None));
        let nothing = Outline::new(&VisionConfig::default(), None).unwrap_err().to_string();
        assert!(nothing.contains("links"), "{nothing}");
    }
}
