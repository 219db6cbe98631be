//! The cheapest steps that are as exact as wanted.

use crate::command::Command;
use crate::dynamics::plant::Plant;
use crate::dynamics::{Work, integrate, kinematics, restraint};
use crate::effects::CommandPath;
use crate::math::{Vec3, Vector};
use crate::model::{Model, State};
use crate::rollout::{self, RolloutError, RolloutOptions, rollout};
use crate::simulator::{self, Engine};
use crate::space::{Planar, Space, Spatial};
use crate::steps::{self, Method, Steps};

/// Steps that are as exact as wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The steps.
    pub steps: Steps,
    /// Estimated error of the worst site at the worst instant \[m\].
    pub error_m: f64,
}

/// The wanted accuracy of keypoints where nobody says another \[m\]: a fortieth of what a camera resolves.
pub const ACCURACY_M: f64 = 1e-5;
/// Longest step tried \[s\].
const LONGEST_S: f64 = 0.1;
/// Shortest step worth trying \[s\].
const SHORTEST_S: f64 = 1e-5;
/// Methods with their order and what a step costs, in evaluations of all forces; first the one that is never unstable.
const METHODS: [(Method, i32, f64); 2] = [(Method::Rosenbrock, 3, 4.5), (Method::RungeKutta, 4, 4.0)];
/// The first attempt allows each step this share of the wanted accuracy: errors add up.
const FIRST_SHARE: f64 = 1.0 / 30.0;
/// What an attempt promises may turn out so many times as costly.
const DOUBTFUL: f64 = 2.0;
/// Attempts at meeting the wanted accuracy from below, once it is met.
const REFINEMENTS: usize = 4;
/// What an attempt aims at, as a share of the wanted accuracy, and the share that is close enough.
const AIM: f64 = 0.85;
const CLOSE: f64 = 0.7;
/// Even steps are many, each attempt follows the whole motion some five times, and the next one would save less than a fifth.
const CLOSE_IF_EVEN: f64 = 0.4;
/// Steps from before that leave less than this share are too short to stay.
const IDLE: f64 = 0.3;
/// A step is longer than the one before by this factor at most: what makes a nominal motion quick may come a little
/// earlier or later in another candidate.
const LONGER: f64 = 1.5;
/// Explicit steps must stay sound when all are longer by this factor, for candidates that are stiffer.
const STIFFER: f64 = 1.3;

/// Looks for the cheapest steps whose keypoints and other sites are within `accuracy_m` \[m\] of the motion itself at
/// `sample_times_s`. Made once for a run, with its nominal model: every candidate of a fit then takes the same
/// steps, so that the loss stays smooth.
///
/// Steps are short where the motion is quick: each as long as leaves the same error, which a step and two of half the
/// length tell. With friction loss or end stops they are even, because where a joint comes to stand differs from
/// candidate to candidate. The error of the whole is estimated by the difference to steps half as long, over what the
/// order of the method leaves of it. Planned steps in `options` stay where they are as exact as wanted, and not much more so.
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
    let run = Nominal { model, state, command, sample_times_s, options };
    if let Some(plan) = options.steps.as_ref().and_then(|steps| run.still_good(steps, accuracy_m)) {
        return Ok(plan);
    }
    let mut searches =
        METHODS.map(|(method, order, evaluations)| Search::new(&run, method, order, evaluations, accuracy_m));
    // the method that promises to be cheaper has the next attempt
    loop {
        let found = searches.iter().filter_map(Search::cost).fold(f64::INFINITY, f64::min);
        let promised = |search: &Search| (!search.over).then_some(search.promised);
        let next = (0..searches.len())
            .filter(|&index| promised(&searches[index]).is_some_and(|promised| promised < found))
            .min_by(|&a, &b| searches[a].promised.total_cmp(&searches[b].promised));
        let Some(next) = next else { break };
        let rivals = searches.iter().filter(|search| search.method != searches[next].method);
        let hoped =
            rivals.filter_map(promised).filter(|&promised| promised > 0.0).fold(f64::INFINITY, f64::min);
        searches[next].attempt(&run, accuracy_m, found.min(DOUBTFUL * hoped))?;
    }
    let cheapest = searches.iter_mut().min_by(|a, b| {
        let [a, b] = [a, b].map(|search| search.cost().unwrap_or(f64::INFINITY));
        a.total_cmp(&b)
    });
    let inexact = RolloutError::Inexact { accuracy_m, shortest_s: SHORTEST_S };
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
    /// `steps`, planned for a motion like this one, if they do for this one too.
    fn still_good(&self, steps: &Steps, accuracy_m: f64) -> Option<Plan> {
        let (_, order, _) = METHODS.into_iter().find(|(method, ..)| *method == steps.method)?;
        let span = self.span();
        let before = steps.ends_s.partition_point(|&end| end < span - SHORTEST_S);
        if before == 0 || self.even() {
            return None;
        }
        let ends_s = steps.ends_s[..before].iter().copied().chain([span]).collect();
        let steps = Steps { ends_s, ..steps.clone() };
        let (error_m, positions) = self.error(&steps, order).ok()?;
        let exact = (IDLE * accuracy_m..=accuracy_m).contains(&error_m);
        (exact && self.robust(&steps, &positions, error_m).ok()?).then_some(Plan { steps, error_m })
    }

    /// Whether steps are to be even.
    fn even(&self) -> bool {
        self.model.joints.iter().any(|joint| joint.limit.is_some() || joint.friction_loss != 0.0)
    }

    /// How long the motion is followed \[s\].
    fn span(&self) -> f64 {
        self.sample_times_s.last().map_or(0.0, |last| (last - self.options.start_s).max(SHORTEST_S))
    }

    /// Where the sites are at each sample.
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
        Ok((apart(&coarse, &fine) / (1.0 - 0.5_f64.powi(order)), coarse))
    }

    /// Whether explicit steps longer than those that lead to the positions `here` would be less exact, but no worse.
    fn robust(&self, steps: &Steps, here: &[Vec3<f64>], error_m: f64) -> Result<bool, RolloutError> {
        if steps.method != Method::RungeKutta {
            return Ok(true);
        }
        /// Over what the order explains.
        const WORSE: f64 = 10.0;
        match self.positions(self.scaled(steps, STIFFER)) {
            Ok(longer) => Ok(apart(here, &longer) < WORSE * error_m),
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

/// Attempts at the cheapest steps of one method.
struct Search {
    method: Method,
    order: i32,
    /// What a step costs, in evaluations of all forces.
    evaluations: f64,
    /// What the next attempt is made with.
    longest_s: f64,
    tolerance_m: f64,
    /// What exact steps will cost, going by the last attempt; 0 before the first.
    promised: f64,
    /// The cheapest exact steps so far, and how many they are.
    best: Option<(Plan, f64)>,
    /// Attempts left once they are exact.
    left: usize,
    diverged: Option<RolloutError>,
    over: bool,
}

impl Search {
    fn new(run: &Nominal<'_>, method: Method, order: i32, evaluations: f64, accuracy_m: f64) -> Self {
        Self {
            method,
            order,
            evaluations,
            longest_s: if run.even() { restraint::LONGEST_STEP_S } else { LONGEST_S },
            tolerance_m: FIRST_SHARE * accuracy_m,
            promised: 0.0,
            best: None,
            left: REFINEMENTS,
            diverged: None,
            over: false,
        }
    }

    /// What the best steps cost.
    fn cost(&self) -> Option<f64> {
        self.best.as_ref().map(|(_, count)| self.evaluations * count)
    }

    /// One attempt, which is the last unless its steps cost less than is `affordable`.
    fn attempt(&mut self, run: &Nominal<'_>, accuracy_m: f64, affordable: f64) -> Result<(), RolloutError> {
        let (longest_s, order) = (self.longest_s, self.order);
        let most = (affordable / self.evaluations).min(run.span() / SHORTEST_S);
        let ends_s = match run.ends(self.method, order, self.tolerance_m, longest_s, most) {
            Ok(Some(ends_s)) => ends_s,
            // what is left to try costs more
            Ok(None) => {
                self.over = true;
                return Ok(());
            }
            Err(error @ RolloutError::Diverged { .. }) => {
                (self.diverged, self.over) = (Some(error), true);
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let count = ends_s.len() as f64;
        let steps = Steps { method: self.method, longest_s, ends_s: ends_s.into() };
        let (error_m, positions) = match run.error(&steps, order) {
            Ok(found) => found,
            Err(error @ RolloutError::Diverged { .. }) => {
                self.diverged = Some(error);
                self.longest_s *= 0.6;
                self.tolerance_m *= 0.5;
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let exact = error_m <= accuracy_m;
        if exact && !run.robust(&steps, &positions, error_m.max(0.1 * accuracy_m))? {
            self.longest_s *= 0.8;
            self.promised = self.evaluations * count / 0.8;
            return Ok(());
        }
        // what the error of the whole leaves to be gained, or asks for
        let ratio = (AIM * accuracy_m / error_m.max(1e-12)).clamp(1e-3, 1e3);
        self.promised = self.evaluations * count / ratio.powf(1.0 / f64::from(order));
        if exact {
            self.best = Some((Plan { steps, error_m }, count));
            self.left -= 1;
            let (close, longest) = match run.even() {
                true => (CLOSE_IF_EVEN, longest_s >= restraint::LONGEST_STEP_S),
                false => (CLOSE, false),
            };
            self.over = self.left == 0 || error_m > close * accuracy_m || longest;
        }
        if run.even() {
            let longer = longest_s * ratio.powf(1.0 / f64::from(order)).clamp(0.3, 2.0);
            self.longest_s = longer.min(restraint::LONGEST_STEP_S);
        } else {
            self.tolerance_m *= ratio.powf(f64::from(order + 1) / f64::from(order)).clamp(1e-2, 1e2);
        }
        Ok(())
    }
}

fn apart(a: &[Vec3<f64>], b: &[Vec3<f64>]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Goes along the nominal motion and finds out how long steps may be.
struct Explorer<'a> {
    run: &'a Nominal<'a>,
    model: &'a Model,
    options: &'a RolloutOptions,
    order: i32,
    tolerance_m: f64,
    longest_s: f64,
    most: f64,
}

impl Explorer<'_> {
    fn ends<S: Space<T = f64>>(
        &self,
        layout: S::Layout,
        corners: &[f64],
    ) -> Result<Option<Vec<f64>>, RolloutError> {
        let Self { run, model, options, order, tolerance_m, longest_s, most } = *self;
        let columns = rollout::columns(model, run.command)?;
        let path = CommandPath::new(model, run.command);
        let command = |drive: usize, time_s: f64| path.at(drive, time_s);
        let mut engine = Engine::<S>::new(model, layout, options)?;
        engine.switch_off(&columns.iter().map(Option::is_none).collect::<Vec<_>>());
        let mut state = run.state.clone();
        engine.align(&mut state, options.start_s, &command);
        let points: Vec<(usize, S::Vec)> = model
            .sites
            .iter()
            .map(|site| (site.body, S::vector(&engine.plant.layout, site.body, site.pos)))
            .collect();

        let mut ends = Vec::new();
        let mut now = 0.0;
        // as a first guess, short; then as long as the last one would have been
        let mut wanted = 0.1 * longest_s;
        for &corner in corners {
            while now < corner {
                let left = corner - now;
                // no sliver before the corner
                let parts = (left / wanted - 0.01).ceil().max(1.0);
                let h = if parts <= 2.0 { left / parts } else { wanted };
                let mut whole = engine.clone();
                let mut far = state.clone();
                let sound = whole.step_with(&mut far, options.start_s + now, h, &command);
                let mut halves = engine.clone();
                let mut near = state.clone();
                let start_s = options.start_s + now;
                let sound = sound && halves.step_with(&mut near, start_s, 0.5 * h, &command);
                let departure = halves.departure.clone();
                let middle = near.clone();
                let sound = sound && halves.step_with(&mut near, start_s + 0.5 * h, 0.5 * h, &command);
                let error_m = if sound {
                    let mut sample = far.qpos.clone();
                    let (from, to) = ((&state.qpos[..], &departure[..]), (&far.qpos[..], &far.qvel[..]));
                    integrate::between(&engine.plant, from, to, h, 0.5, &mut sample);
                    let between = worst(&mut whole, &points, &sample, &middle.qpos);
                    let end = worst(&mut whole, &points, &far.qpos, &near.qpos);
                    // an error of the velocity leads astray in the next step
                    let mut astray = [far.qpos.clone(), near.qpos.clone()];
                    for (astray, from) in astray.iter_mut().zip([&far, &near]) {
                        integrate::advance(&engine.plant, &from.qpos, &from.qvel, h, astray);
                    }
                    let next = worst(&mut whole, &points, &astray[0], &astray[1]);
                    between.max(end).max(next)
                } else {
                    f64::INFINITY
                };
                let ratio = (tolerance_m / error_m.max(1e-15)).powf(1.0 / f64::from(order + 1));
                if ratio < 0.8 && h > SHORTEST_S {
                    wanted = h * (0.9 * ratio).max(0.2);
                    continue;
                }
                if !sound {
                    return Err(halves
                        .diverged(&near, 0, start_s + h)
                        .or_else(|| whole.diverged(&far, 0, start_s + h))
                        .unwrap_or(RolloutError::Inexact {
                            accuracy_m: tolerance_m,
                            shortest_s: SHORTEST_S,
                        }));
                }
                now = if parts <= 1.0 { corner } else { now + h };
                ends.push(now);
                if ends.len() as f64 >= most {
                    return Ok(None);
                }
                wanted = (h * (0.9 * ratio).min(LONGER)).max(wanted.min(h)).min(longest_s);
                (state, engine) = (near, halves);
            }
        }
        Ok(Some(ends))
    }
}

/// How far apart \[m\] the coordinates `a` and `b` put some of the `points`, fixed to their bodies.
fn worst<S: Space<T = f64>>(engine: &mut Engine<S>, points: &[(usize, S::Vec)], a: &[f64], b: &[f64]) -> f64 {
    let [a, b] = [a, b].map(|qpos| {
        kinematics::kinematics(&engine.plant, qpos, &mut engine.work);
        let work = &engine.work;
        points.iter().map(|&(body, at)| work.pos[body] + S::apply(&work.rot[body], at)).collect::<Vec<_>>()
    });
    a.into_iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}
