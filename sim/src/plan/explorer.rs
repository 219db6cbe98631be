//! Finds how long each step may be along the nominal motion.

use super::{Nominal, STEP_MIN_S};
use crate::causes::CommandPath;
use crate::dynamics::stages::Stages;
use crate::dynamics::{integrate, kinematics};
use crate::error::RolloutError;
use crate::math::Vector;
use crate::model::{Encoder, Model, POINTER_M};
use crate::options::RolloutOptions;
use crate::rollout;
use crate::simulator::Engine;

/// Largest ratio of a step to the one before (chosen): what makes a nominal motion quick may come a little
/// earlier or later in another candidate.
const STEP_GROWTH_RATIO_MAX: f64 = 1.5;

/// Steps along the nominal motion and adapts each step to the tolerance.
pub(super) struct Explorer<'a> {
    pub(super) run: &'a Nominal<'a>,
    pub(super) model: &'a Model,
    pub(super) options: &'a RolloutOptions,
    pub(super) order: i32,
    pub(super) tolerance_m: f64,
    pub(super) longest_s: f64,
    pub(super) most: f64,
}

impl Explorer<'_> {
    pub(super) fn ends<S: Stages<T = f64>>(
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

        let read = |encoder: &Encoder<f64>| model.joints[encoder.joint].qpos_address;
        let tracked = TrackedPoints { points, angles: model.encoders.iter().map(read).collect() };

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
                    let between = tracked.worst(&mut whole, &sample, &middle.qpos);
                    let end = tracked.worst(&mut whole, &far.qpos, &near.qpos);
                    // an error of the velocity leads astray in the next step
                    let mut astray = [far.qpos.clone(), near.qpos.clone()];
                    for (astray, from) in astray.iter_mut().zip([&far, &near]) {
                        integrate::advance(&engine.plant, &from.qpos, &from.qvel, h, astray);
                    }
                    let next = tracked.worst(&mut whole, &astray[0], &astray[1]);
                    between.max(end).max(next)
                } else {
                    f64::INFINITY
                };
                let ratio = (tolerance_m / error_m.max(1e-15)).powf(1.0 / f64::from(order + 1));
                if ratio < 0.8 && h > STEP_MIN_S {
                    wanted = h * (0.9 * ratio).max(0.2);
                    continue;
                }
                if !sound {
                    return Err(halves
                        .diverged(&near, 0, start_s + h)
                        .or_else(|| whole.diverged(&far, 0, start_s + h))
                        .unwrap_or(RolloutError::Inexact {
                            accuracy_m: tolerance_m,
                            shortest_s: STEP_MIN_S,
                        }));
                }
                now = if parts <= 1.0 { corner } else { now + h };
                ends.push(now);
                if ends.len() as f64 >= most {
                    return Ok(None);
                }
                wanted = (h * (0.9 * ratio).min(STEP_GROWTH_RATIO_MAX)).max(wanted.min(h)).min(longest_s);
                (state, engine) = (near, halves);
            }
        }
        Ok(Some(ends))
    }
}

/// The sites and encoders whose errors are compared.
struct TrackedPoints<S: Stages> {
    /// Sites: body, and place on it.
    points: Vec<(usize, S::Vec)>,
    /// Coordinates that encoders read.
    angles: Vec<usize>,
}

impl<S: Stages<T = f64>> TrackedPoints<S> {
    /// The greatest distance \[m\] of one of them between two poses.
    fn worst(&self, engine: &mut Engine<S>, a: &[f64], b: &[f64]) -> f64 {
        let pointers = self.angles.iter().map(|&angle| POINTER_M * (a[angle] - b[angle]).abs());
        let turned = pointers.fold(0.0, f64::max);
        let [a, b] = [a, b].map(|qpos| {
            kinematics::kinematics(&engine.plant, qpos, &mut engine.work);
            let work = &engine.work;
            let place = |&(body, at): &(usize, S::Vec)| work.pos[body] + S::apply(&work.rot[body], at);
            self.points.iter().map(place).collect::<Vec<_>>()
        });
        a.into_iter().zip(b).map(|(a, b)| (a - b).norm()).fold(turned, f64::max)
    }
}
