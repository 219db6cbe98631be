//! Which other cause looks most like the one that is hidden, and how far apart the two are in a case's runs.
//!
//! A diagnosis can name a cause only where no other one imitates it. Like the limit, this is found from the generator's own
//! differences: what a fit and the rival together can imitate is projected out, and what is left has a chi-square. A rival of one
//! number takes the size, within its bounds, at which it comes nearest, as strong as it then is: added mass bends on its way.

use nalgebra::DVector;
use sim::Cause;
use sim::causes::{ParameterInfo, Role};

use super::bench::{Bench, Run};
use super::cases::same;
use super::limit::{Imitation, largest_bend, orthonormal};
use super::terms::Hidden;

/// Steps of the differences, as a share of usual sizes.
const DIFFERENCE_STEP_SHARE: f64 = 0.1;
/// Rivals, nearest first by their small steps, whose sizes are sought, and steps on the way there.
const SEARCHED_RIVALS: usize = 5;
const SEARCH_STEPS: usize = 4;

/// A rival in one of its shapes: the directions in which it changes what is seen, orthonormal.
#[derive(Debug)]
struct Rival {
    cause: &'static str,
    directions: Vec<DVector<f64>>,
    /// Its only step and the size in it, where it has one number.
    single: Option<(Hidden, &'static ParameterInfo)>,
}

impl Rival {
    /// The chi-square by which `own` differs from it, by its small steps.
    fn apart(&self, own: &DVector<f64>) -> f64 {
        own.norm_squared() - self.directions.iter().map(|along| along.dot(own).powi(2)).sum::<f64>()
    }

    /// The same at the size at which it is nearest.
    fn nearest<const N: usize>(&self, bench: &Bench<N>, imitation: &Imitation<N>, own: &DVector<f64>) -> f64 {
        let Some((step, size)) = &self.single else { return self.apart(own) };
        let name = format!("{}/{}", self.cause, size.name);
        let [lower, upper] = size.bounds;
        let left = |value: f64| imitation.left(bench, &step.clone().with(&name, value));
        let mut nearest = own.norm_squared();
        let (mut value, mut there) = (0.0, DVector::zeros(own.len()));
        for _ in 0..SEARCH_STEPS {
            let by = if value == 0.0 { step.get(&name, 0.0) } else { 0.05 * value };
            let slope = (left(value + by) - &there) / by;
            value = (value + slope.dot(&(own - &there)) / slope.norm_squared()).clamp(lower, upper);
            there = left(value);
            nearest = nearest.min((own - &there).norm_squared());
        }
        nearest
    }
}

/// All causes as rivals of each other on one bench.
#[derive(Debug)]
pub struct Rivals(Vec<Rival>);

/// For each shape of `cause` the steps that span it.
fn shapes<const N: usize>(cause: Cause, bench: &Bench<N>, runs: &[Run<N>]) -> Vec<Vec<Hidden>> {
    let info = cause.info();
    let name = info.name;
    let size = info.parameters.iter().find(|parameter| parameter.role == Role::Size);
    let step = DIFFERENCE_STEP_SHARE * size.map_or(0.0, |size| size.typical);
    let of = |numbers: &[(String, f64)]| Hidden(numbers.iter().cloned().collect());
    let own = |parameter: &str| format!("{name}/{parameter}");
    let beside = |parameter: &str, value: f64| {
        let size = size.map_or("", |size| size.name);
        vec![of(&[(own(size), step), (own(parameter), value)])]
    };
    match name {
        "current" | "camera_tilt" => vec![["x", "z"].map(|axis| of(&[(own(axis), step)])).to_vec()],
        "cob_offset" => vec![["along", "across"].map(|axis| of(&[(own(axis), step)])).to_vec()],
        "keypoint_slip" => vec![bench.keypoints().iter().map(|point| of(&[(own(point), step)])).collect()],
        "joint_zero" => vec![vec![of(&[(own("q1"), step)])]],
        "tether" => {
            // a stiffness and two coordinates of the anchor act in proportion
            let anchors = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]];
            let pulls = anchors.map(|[x, z]| of(&[(own("stiffness"), step), (own("x"), x), (own("z"), z)]));
            vec![pulls.to_vec()]
        }
        "slosh" => [0.7, 1.0, 1.4, 1.8]
            .map(|frequency| {
                let parts = runs.iter().flat_map(|run| ["sin", "cos"].map(|part| (part, run.motion.run)));
                let part =
                    |(part, run)| of(&[(format!("slosh/{part}@{run}"), step), (own("frequency"), frequency)]);
                parts.map(part).collect()
            })
            .to_vec(),
        "wall" => [-0.09, -0.075, 0.075, 0.09].map(|x| beside("x", x)).to_vec(),
        "one_sided_stiffness" => [-1.0, 1.0].map(|side| beside("side", side)).to_vec(),
        "end_stop" => {
            let most = largest_bend(bench);
            [0.2, 0.4, 0.6, 0.8].map(|share| beside("angle", share * most)).to_vec()
        }
        "servo_rate_limit" => {
            [4.0, 2.8, 2.0, 1.4].map(|rate| vec![of(&[(own("share"), 1.0), (own("rate"), rate)])]).to_vec()
        }
        _ => vec![vec![of(&[(own(size.map_or("", |size| size.name)), step)])]],
    }
}

impl Rivals {
    /// All causes that a fit of `bench` does not already have.
    pub fn new<const N: usize>(bench: &Bench<N>, imitation: &Imitation<N>) -> Self {
        let known = bench.mechanism.causes;
        let causes =
            Cause::ALL.iter().filter(|cause| known.contains(&cause.name()) && !bench.fits(cause.name()));
        let each = causes.flat_map(|&cause| {
            shapes(cause, bench, &imitation.runs).into_iter().map(move |steps| {
                let size = cause.info().parameters.iter().find(|parameter| parameter.role == Role::Size);
                let single = size.filter(|_| steps.len() == 1).map(|size| (steps[0].clone(), size));
                let directions = orthonormal(steps.iter().map(|step| imitation.left(bench, step)));
                Rival { cause: cause.info().name, directions, single }
            })
        });
        Self(each.collect())
    }

    /// The rival nearest to `cause` as `hidden` has it, and the chi-square by which they differ.
    pub fn nearest<const N: usize>(
        &self,
        bench: &Bench<N>,
        imitation: &Imitation<N>,
        cause: &str,
        hidden: &Hidden,
    ) -> (String, f64) {
        let own = imitation.left(bench, hidden);
        let others = self.0.iter().filter(|rival| rival.cause != cause && !same(rival.cause, cause, false));
        let mut others: Vec<(&Rival, f64)> = others.map(|rival| (rival, rival.apart(&own))).collect();
        others.sort_by(|a, b| a.1.total_cmp(&b.1));
        let sought = others
            .iter()
            .take(SEARCHED_RIVALS)
            .map(|(rival, _)| (rival.cause, rival.nearest(bench, imitation, &own)));
        let nearest = sought.min_by(|a, b| a.1.total_cmp(&b.1));
        nearest.map_or((String::new(), own.norm_squared()), |(rival, chi)| (rival.to_owned(), chi))
    }
}
