//! Plans the cheapest time steps that are as accurate as wanted.

use crate::causes::{CommandPath, Kind};
use crate::command::Command;
use crate::dynamics::plant::Plant;
use crate::dynamics::{Work, kinematics};
use crate::error::RolloutError;
use crate::math::Vec3;
use crate::model::{Encoder, Model, State};
use crate::options::RolloutOptions;
use crate::rollout::{self, rollout};
use crate::simulator;
use crate::space::{Planar, Spatial};
use crate::steps::{self, Method, Steps};

mod explorer;
mod search;

use explorer::Explorer;
use search::Search;

/// Steps that are as exact as wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The planned steps.
    pub steps: Steps,
    /// Estimated error of the worst site at the worst instant \[m\].
    pub error_m: f64,
}

/// Default accuracy of keypoints \[m\] (chosen): a fortieth of what a camera resolves.
pub const ACCURACY_M: f64 = 1e-5;
/// Shortest step that is tried \[s\] (chosen).
const STEP_MIN_S: f64 = 1e-5;
/// Methods with their order and what a step costs, in evaluations of all forces; first the one that is never unstable.
const METHODS: [(Method, i32, f64); 2] = [(Method::Rosenbrock, 3, 4.5), (Method::RungeKutta, 4, 4.0)];
/// An attempt may cost this many times what the rival method is expected to cost (chosen).
const EXPECTED_COST_MARGIN: f64 = 2.0;
/// Earlier steps whose error is below this share of the wanted accuracy are too short to be reused (chosen).
const REUSED_ERROR_SHARE_MIN: f64 = 0.3;
/// Earlier steps are not rescaled if their error is off by more than this factor (chosen): they are for another motion.
const REUSED_ERROR_RATIO_MAX: f64 = 30.0;
/// Most steps, over the number of earlier ones (chosen): what needs more is another mechanism, and a fit would not finish.
const STEP_COUNT_RATIO_MAX: f64 = 10.0;
/// Explicit steps must stay stable when all are longer by this factor, for candidates that are stiffer (chosen).
const STABILITY_STEP_RATIO: f64 = 1.3;

/// Looks for the cheapest steps whose keypoints and other sites are within `accuracy_m` \[m\] of the motion itself at
/// `sample_times_s`. Made once for a run, with its nominal model: every candidate of a fit then takes the same
/// steps, so that the loss stays smooth.
///
/// Steps are short where the motion is quick: each as long as leaves the same error, which a step and two of half the
/// length tell. With friction loss, end stops or contacts they are even, because where a joint comes to stand differs from
/// candidate to candidate. Where a servo turns in jerks, steps are planned for the commands as given: a rollout takes none that is longer
/// than the jerks bear. The error of the whole is estimated by the difference to steps half as long, over what the
/// order of the method leaves of it. Planned steps in `options` stay where they are as exact as wanted and not much more so, or
/// can be made so all alike; where others are needed, there are at most ten times as many.
///
/// # Errors
/// [`RolloutError`] of the last attempt where no step is stable and exact enough.
pub fn plan(
    model: &Model,
    state: &State,
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    accuracy_m: f64,
) -> Result<Plan, RolloutError> {
    rollout::check(model, state, sample_times_s)?;
    let smooth = CommandPath::new(model, command).longest_step_s().is_finite().then(|| {
        let mut smooth = model.clone();
        smooth.causes.retain(|carried| carried.cause().info().kind != Kind::Drive);
        smooth
    });
    let model = smooth.as_ref().unwrap_or(model);
    let run = Nominal { model, state, command, sample_times_s, options };
    if let Some(plan) = options.steps.as_ref().and_then(|steps| run.reused(steps, accuracy_m)) {
        return Ok(plan);
    }
    let mut searches =
        METHODS.map(|(method, order, evaluations)| Search::new(&run, method, order, evaluations, accuracy_m));
    // the method whose expected cost is lower has the next attempt
    loop {
        let found = searches.iter().filter_map(Search::cost).fold(f64::INFINITY, f64::min);
        let expected = |search: &Search| (!search.over).then_some(search.expected_cost);
        let next = (0..searches.len())
            .filter(|&index| expected(&searches[index]).is_some_and(|cost| cost < found))
            .min_by(|&a, &b| searches[a].expected_cost.total_cmp(&searches[b].expected_cost));
        let Some(next) = next else { break };
        let rivals = searches.iter().filter(|search| search.method != searches[next].method);
        let rival_cost = rivals.filter_map(expected).filter(|&cost| cost > 0.0).fold(f64::INFINITY, f64::min);
        searches[next].attempt(&run, accuracy_m, found.min(EXPECTED_COST_MARGIN * rival_cost))?;
    }
    let cheapest = searches.iter_mut().min_by(|a, b| {
        let [a, b] = [a, b].map(|search| search.cost().unwrap_or(f64::INFINITY));
        a.total_cmp(&b)
    });
    let inexact = RolloutError::Inexact { accuracy_m, shortest_s: run.span() / run.most() };
    match cheapest.and_then(|search| search.best.take()) {
        Some((plan, _)) => Ok(plan),
        None => Err(searches.into_iter().rev().find_map(|search| search.diverged).unwrap_or(inexact)),
    }
}

/// A run to be planned.
struct Nominal<'a> {
    model: &'a Model,
    state: &'a State,
    command: &'a Command,
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
}

impl Nominal<'_> {
    /// `steps`, planned for a motion like this one, if they do for this one too, all longer or shorter if need be.
    fn reused(&self, steps: &Steps, accuracy_m: f64) -> Option<Plan> {
        let (_, order, _) = METHODS.into_iter().find(|(method, ..)| *method == steps.method)?;
        let span = self.span();
        let before = steps.ends_s.partition_point(|&end| end < span - STEP_MIN_S);
        if before == 0 || self.even() {
            return None;
        }
        let ends_s = steps.ends_s[..before].iter().copied().chain([span]).collect();
        let mut steps = Steps { ends_s, ..steps.clone() };
        let (mut error_m, mut positions) = self.error(&steps, order).ok()?;
        let exact = |error_m: f64| (REUSED_ERROR_SHARE_MIN * accuracy_m..=accuracy_m).contains(&error_m);
        let ratio = search::AIMED_ERROR_SHARE * accuracy_m / error_m.max(f64::MIN_POSITIVE);
        if !exact(error_m) && (REUSED_ERROR_RATIO_MAX.recip()..REUSED_ERROR_RATIO_MAX).contains(&ratio) {
            steps = self.scaled(&steps, ratio.powf(1.0 / f64::from(order)));
            (error_m, positions) = self.error(&steps, order).ok()?;
        }
        let good = exact(error_m) && self.robust(&steps, &positions, error_m).ok()?;
        good.then_some(Plan { steps, error_m })
    }

    /// Whether steps must be even.
    fn even(&self) -> bool {
        let altered = self.model.altered();
        let model = altered.as_ref().unwrap_or(self.model);
        let restrained = model.joints.iter().any(|joint| joint.limit.is_some() || joint.friction_loss != 0.0);
        restrained
            || model.contacts.simulated()
            || CommandPath::new(model, self.command).longest_step_s().is_finite()
    }

    /// Largest number of steps that is tried.
    fn most(&self) -> f64 {
        let before = self.options.steps.as_ref().map_or(0, |steps| steps.ends_s.len());
        let dear = if before == 0 { f64::INFINITY } else { STEP_COUNT_RATIO_MAX * before as f64 };
        dear.min(self.span() / STEP_MIN_S)
    }

    /// Duration of the simulated motion \[s\].
    fn span(&self) -> f64 {
        self.sample_times_s.last().map_or(0.0, |last| (last - self.options.start_s).max(STEP_MIN_S))
    }

    /// Where the sites and the encoders' pointers are at each sample.
    fn positions(&self, steps: Steps) -> Result<Vec<Vec3<f64>>, RolloutError> {
        let options = RolloutOptions { steps: Some(steps), ..self.options.clone() };
        let run = rollout(self.model, self.state, self.command, self.sample_times_s, &options)?;
        let plant = Plant::<Spatial<f64>>::new(self.model, ());
        let mut work = Work::new(&plant);
        let mut positions = Vec::with_capacity(self.sample_times_s.len() * self.model.sites.len());
        for qpos in run.qpos.chunks(self.model.nq().max(1)) {
            kinematics::kinematics(&plant, qpos, &mut work);
            let sites = self.model.sites.iter();
            positions.extend(sites.map(|site| work.pos[site.body] + work.rot[site.body].apply(site.pos)));
            let pointer = |encoder: &Encoder<f64>| {
                Vec3(encoder.pointer(qpos[self.model.joints[encoder.joint].qpos_address]))
            };
            positions.extend(self.model.encoders.iter().map(pointer));
        }
        Ok(positions)
    }

    /// When the commands have corners \[s\], counted from the start of motion; last the end of it.
    fn corners(&self, timestep_s: f64) -> Vec<f64> {
        let corners = steps::corners(self.command, timestep_s).into_iter();
        let mut corners: Vec<f64> = corners
            .map(|corner| corner - self.options.start_s)
            .filter(|&corner| corner > 0.0 && corner < self.span())
            .collect();
        corners.push(self.span());
        corners
    }

    /// `steps`, between every two corners as many fewer as each is to be longer.
    fn scaled(&self, steps: &Steps, factor: f64) -> Steps {
        let mut ends = Vec::with_capacity((steps.ends_s.len() as f64 / factor) as usize + 1);
        let mut first = 0;
        for corner in self.corners(steps.longest_s) {
            let last = steps.ends_s.partition_point(|&end| end < corner - 1e-9 * steps.longest_s) + 1;
            let instant = |index: usize| if index == 0 { 0.0 } else { steps.ends_s[index - 1] };
            let parts = ((last - first) as f64 / factor).ceil() as usize;
            for part in 1..parts {
                let place = first as f64 + (last - first) as f64 * part as f64 / parts as f64;
                let index = place as usize;
                let rest = place - index as f64;
                ends.push(instant(index) + rest * (instant((index + 1).min(last)) - instant(index)));
            }
            ends.push(corner);
            first = last;
        }
        Steps { ends_s: ends.into(), ..steps.clone() }
    }

    /// Estimated error of `steps` \[m\], and the positions with them.
    fn error(&self, steps: &Steps, order: i32) -> Result<(f64, Vec<Vec3<f64>>), RolloutError> {
        let (coarse, fine) =
            rayon::join(|| self.positions(steps.clone()), || self.positions(self.scaled(steps, 0.5)));
        let (coarse, fine) = (coarse?, fine?);
        Ok((largest_distance(&coarse, &fine) / (1.0 - 0.5_f64.powi(order)), coarse))
    }

    /// Whether explicit steps longer than those that lead to the positions `here` would be less exact, but no worse.
    fn robust(&self, steps: &Steps, here: &[Vec3<f64>], error_m: f64) -> Result<bool, RolloutError> {
        if steps.method != Method::RungeKutta {
            return Ok(true);
        }
        /// Difference, over the estimated error, from which on longer steps are unstable (chosen).
        const UNSTABLE_ERROR_RATIO: f64 = 10.0;
        match self.positions(self.scaled(steps, STABILITY_STEP_RATIO)) {
            Ok(longer) => Ok(largest_distance(here, &longer) < UNSTABLE_ERROR_RATIO * error_m),
            Err(RolloutError::Diverged { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// When steps end that each leave an error of `tolerance_m`, none longer than `longest_s`; `None` for `most` or more.
    fn ends(
        &self,
        method: Method,
        order: i32,
        tolerance_m: f64,
        longest_s: f64,
        most: f64,
    ) -> Result<Option<Vec<f64>>, RolloutError> {
        let altered = self.model.altered();
        let model = altered.as_ref().unwrap_or(self.model);
        let options = RolloutOptions { steps: Some(Steps::even(method, longest_s)), ..self.options.clone() };
        let corners = self.corners(longest_s);
        if self.even() {
            let mut ends = Vec::new();
            let mut from = 0.0;
            for to in corners {
                let parts = ((to - from) / longest_s - 1e-9).ceil().max(1.0);
                ends.extend((1..=parts as usize).map(|part| from + (to - from) * part as f64 / parts));
                from = to;
            }
            return Ok(((ends.len() as f64) < most).then_some(ends));
        }
        let explorer = Explorer { run: self, model, options: &options, order, tolerance_m, longest_s, most };
        match simulator::plane(model, &options) {
            Some(plane) => explorer.ends::<Planar<f64>>(plane, &corners),
            None => explorer.ends::<Spatial<f64>>((), &corners),
        }
    }
}

/// Largest distance between points of the same place in `a` and `b` \[m\].
fn largest_distance(a: &[Vec3<f64>], b: &[Vec3<f64>]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (a - b).norm()).fold(0.0, f64::max)
}
