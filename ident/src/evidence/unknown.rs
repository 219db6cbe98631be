//! The unknown that stands in every hypothesis: a repeatable force, a force of each run's own, a slip of keypoints over pose.
//!
//! Its sizes are linear and small, so it is never simulated: its columns are the answers of the run at hand to forces over time
//! ([`sim::transitions`]). The repeatable force is, per joint, a sum of functions of angle, rate and slow time; as a force over time it is a
//! straight line between the knots of the pieces, 0.02 s apart. A run's own force is a process with knots 0.1 s apart.
//!
//! Forces are in units of each joint's own: the size at which a run's own force at one knot moves whitened keypoints by a length of 1, rms
//! over the knots. So a scale says the same of any mechanism.

use nalgebra::DMatrix;
use sim::Model;
use sim::transitions::Transitions;

use crate::fit::problem::Term;
use crate::initial::prescribed_dofs;
use crate::noise::pose::PoseErrors;

/// Time between knots of a run's own force \[s\] (chosen by a prototype); two correlation times below span 0.1 to 1 s.
const KNOT_S: f64 = 0.1;
/// Correlation times of a run's own force, quick and slow \[s\] (a prototype, chosen).
const CORRELATION_TIMES_S: [f64; 2] = [0.1, 1.0];
/// Most knots of one run, all joints together (chosen): beyond, knots are further apart, or a long run would cost more than its simulation.
const MOST_KNOTS: usize = 160;
/// Most joints that an unknown force acts on, the first that move (chosen, for the same reason).
const MOST_JOINTS: usize = 6;
/// Length of the pieces \[s\]: a fifth of a knot's distance; the fastest function of angle turns in no less than five of them.
pub(super) const PIECE_S: f64 = KNOT_S / 5.0;
/// Times over which rates are averaged for forces that remember \[s\] (a prototype, chosen).
const MEMORIES_S: [f64; 2] = [0.15, 0.6];
/// How often the force turns round within a turn of the joint: notches, magnets (a prototype, chosen).
const TURNS: [f64; 2] = [3.0, 6.0];
/// The greatest rate over the rate within which dry friction turns round.
const TURNS_ROUND: f64 = 5.0;
/// A joint that turns by less does not move \[rad\] or \[m\].
const STILL: f64 = 1e-9;

/// A joint that an unknown force acts on.
#[derive(Debug, Clone)]
struct Joint {
    qpos: usize,
    dof: usize,
    is_slide: bool,
    /// Half the width of its angles, and the greatest rate, over all runs.
    half: f64,
    most: f64,
    /// The unit of its force \[N m\] or \[N\].
    unit: f64,
}

/// What is the same in all hypotheses about the unknown.
#[derive(Debug, Clone)]
pub(super) struct Unknown {
    joints: Vec<Joint>,
    /// Of each run, whitened columns of the slip, per standard deviation of the noise.
    slips: Vec<DMatrix<f64>>,
    /// Standard deviation of a slip that the pictures themselves are said to have, over that of the noise; 0 where nothing is said.
    pub(super) stated_slip: f64,
    /// Of each run, its knots \[s\], and for each of them the joint, as places.
    knots: Vec<Vec<(usize, f64)>>,
}

/// Whitened columns of the unknown in one run, per unit.
#[derive(Debug, Clone)]
pub(super) struct UnknownColumns {
    pub(super) weights: DMatrix<f64>,
    pub(super) own: DMatrix<f64>,
}

impl Unknown {
    /// Made ready for the runs `terms` of `model` as `transitions` say that they go.
    pub(super) fn new(model: &Model, terms: &[Term<'_>], transitions: &[Transitions]) -> Self {
        let mut joints = Vec::new();
        for joint in model.joints.iter().filter(|joint| joint.kind.nq() == 1) {
            let (qpos, dof) = (joint.qpos_address, joint.dof_address);
            let (mut low, mut high, mut most) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
            for (run, term) in transitions.iter().zip(terms) {
                if prescribed_dofs(model, term.rehearsal.run)[dof] {
                    continue;
                }
                for state in &run.states {
                    (low, high) = (low.min(state.qpos[qpos]), high.max(state.qpos[qpos]));
                    most = most.max(state.qvel[dof].abs());
                }
            }
            if high - low > STILL && most > STILL && joints.len() < MOST_JOINTS {
                let is_slide = joint.kind == sim::JointKind::Slide;
                joints.push(Joint { qpos, dof, is_slide, half: 0.5 * (high - low), most, unit: 1.0 });
            }
        }
        let mut unknown =
            Self { joints, slips: Vec::new(), stated_slip: stated_slip(terms), knots: Vec::new() };
        for (run, term) in transitions.iter().zip(terms) {
            unknown.knots.push(unknown.knots_of(model, run, term));
        }
        let mut squares = vec![(0.0, 0.0); unknown.joints.len()];
        for (run, (at, term)) in transitions.iter().zip(terms).enumerate() {
            let own = unknown.own(run, at, term);
            for ((joint, _), column) in unknown.knots[run].iter().zip(own.column_iter()) {
                squares[*joint].0 += column.norm_squared();
                squares[*joint].1 += 1.0;
            }
        }
        for (joint, (sum, count)) in unknown.joints.iter_mut().zip(squares) {
            joint.unit = if sum > 0.0 { f64::sqrt(count / sum) } else { 0.0 };
        }
        unknown.slips = terms.iter().map(|term| slips(model, term)).collect();
        unknown
    }

    /// Nothing is seen any longer in the runs from place `run` on.
    pub(super) fn forget_from(&mut self, run: usize) {
        for slips in self.slips.iter_mut().skip(run) {
            *slips = DMatrix::zeros(0, slips.ncols());
        }
    }

    /// Columns of the slip in the run at place `run`.
    pub(super) fn slips(&self, run: usize) -> &DMatrix<f64> {
        &self.slips[run]
    }

    /// Columns of the forces in the run at place `run`.
    pub(super) fn columns(&self, run: usize, at: &Transitions, term: &Term<'_>) -> UnknownColumns {
        UnknownColumns { weights: self.weights(run, at, term), own: self.own(run, at, term) }
    }

    fn knots_of(&self, model: &Model, at: &Transitions, term: &Term<'_>) -> Vec<(usize, f64)> {
        let frozen = prescribed_dofs(model, term.rehearsal.run);
        let free: Vec<usize> =
            (0..self.joints.len()).filter(|&joint| !frozen[self.joints[joint].dof]).collect();
        let (Some(&from), Some(&to)) = (at.knots_s.first(), at.knots_s.last()) else { return Vec::new() };
        let most = (MOST_KNOTS / free.len().max(1)).max(2);
        let count = (((to - from) / KNOT_S).ceil() as usize + 1).clamp(2, most);
        let knot = |k: usize| from + (to - from) * k as f64 / (count - 1) as f64;
        free.iter().flat_map(|&joint| (0..count).map(move |k| (joint, knot(k)))).collect()
    }

    fn own(&self, run: usize, at: &Transitions, term: &Term<'_>) -> DMatrix<f64> {
        let knots = &self.knots[run];
        let spacing_s = knots
            .windows(2)
            .map(|pair| pair[1].1 - pair[0].1)
            .fold(f64::INFINITY, |a, b| if b > 0.0 { a.min(b) } else { a });
        let column = |&(joint, knot_s): &(usize, f64)| {
            let joint = &self.joints[joint];
            let hat = |&time_s: &f64| joint.unit * (1.0 - (time_s - knot_s).abs() / spacing_s).max(0.0);
            let force: Vec<f64> = at.knots_s.iter().map(hat).collect();
            answer(at, term, joint.dof, &force)
        };
        from_columns(term, knots.iter().map(column).collect())
    }

    fn weights(&self, run: usize, at: &Transitions, term: &Term<'_>) -> DMatrix<f64> {
        let acts = |joint: &usize| self.knots[run].iter().any(|(own, _)| own == joint);
        let mut columns = Vec::new();
        for (place, joint) in self.joints.iter().enumerate() {
            for values in joint.functions(at) {
                let force: Vec<f64> = values.iter().map(|value| joint.unit * value).collect();
                columns.push(match acts(&place) {
                    true => answer(at, term, joint.dof, &force),
                    false => vec![0.0; term.observations.len()],
                });
            }
        }
        from_columns(term, columns)
    }

    /// Covariance of the forces at the knots of the run at place `run`, in units.
    pub(super) fn covariance(&self, run: usize) -> DMatrix<f64> {
        let knots = &self.knots[run];
        DMatrix::from_fn(knots.len(), knots.len(), |i, j| {
            if knots[i].0 != knots[j].0 {
                return 0.0;
            }
            let apart_s = (knots[i].1 - knots[j].1).abs();
            let parts = CORRELATION_TIMES_S.map(|time_s| (-apart_s / time_s).exp());
            parts.iter().sum::<f64>() / parts.len() as f64
        })
    }
}

impl Joint {
    /// The functions that a repeatable force is a sum of, at the knots of `at`.
    fn functions(&self, at: &Transitions) -> Vec<Vec<f64>> {
        let (Some(&from), Some(&to)) = (at.knots_s.first(), at.knots_s.last()) else { return Vec::new() };
        let span_s = (to - from).max(STILL);
        let mut lists: Vec<Vec<f64>> = Vec::new();
        let mut slow = MEMORIES_S.map(|_| 0.0);
        let mut last_s = from;
        for (state, &time_s) in at.states.iter().zip(&at.knots_s) {
            let q = state.qpos[self.qpos];
            let (a, r) = (q / self.half.max(STILL), state.qvel[self.dof] / self.most);
            for (slow, memory_s) in slow.iter_mut().zip(MEMORIES_S) {
                *slow += (1.0 - (-(time_s - last_s) / memory_s).exp()) * (r - *slow);
            }
            last_s = time_s;
            let mut all =
                vec![1.0, a, r, a * a, a * r, r * r, a.powi(3) / 2.0, a * a * r, a * r * r, r.powi(3) / 2.0];
            // a slide goes through one turn where a hinge goes through its angles
            let turn = if self.is_slide { std::f64::consts::FRAC_PI_2 * a } else { q };
            all.extend(TURNS.iter().flat_map(|k| [(k * turn).sin(), (k * turn).cos()]));
            all.push((TURNS_ROUND * r).tanh());
            all.push(r * (time_s - from) / span_s);
            all.extend(slow.iter().flat_map(|&x| [x, x * r.abs()]));
            lists.resize_with(all.len(), Vec::new);
            lists.iter_mut().zip(all).for_each(|(list, value)| list.push(value));
        }
        lists
    }
}

/// What a force over time does to the whitened residuals of `term`.
fn answer(at: &Transitions, term: &Term<'_>, dof: usize, force: &[f64]) -> Vec<f64> {
    let moved = at.response(dof, force);
    let marks = moved.len() / term.instants.max(1);
    let moved = term.rehearsal.measured(moved, marks);
    let width = term.rehearsal.run.trajectory.keypoints.len();
    let shift = term.observations.iter().map(|o| -moved[o.instant * width + o.keypoint][o.axis] * o.per_m);
    whitened(term, shift.collect())
}

/// What pictures get wrong with the pose, as the runs state it, over the noise; 0 where none does.
fn stated_slip(terms: &[Term<'_>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for term in terms {
        let Some(errors) = PoseErrors::of(&term.rehearsal.run.trajectory) else { continue };
        sum += term.observations.iter().map(|o| (errors.std_m(o) * o.per_m).powi(2)).sum::<f64>();
        count += term.observations.len();
    }
    f64::sqrt(sum / count.max(1) as f64)
}

fn whitened(term: &Term<'_>, mut column: Vec<f64>) -> Vec<f64> {
    if let Some(whitening) = &term.whitening {
        whitening.apply(&mut column);
    }
    column
}

fn from_columns(term: &Term<'_>, columns: Vec<Vec<f64>>) -> DMatrix<f64> {
    let (rows, count) = (term.observations.len(), columns.len());
    DMatrix::from_vec(rows, count, columns.into_iter().flatten().collect())
}

/// Whitened columns of keypoints that slip on their links as the pose goes, along and across the link: constant, with the sine and with the
/// cosine of the link's angle in the picture; one standard deviation of the noise each. Angles are those of the model as it stands.
fn slips(model: &Model, term: &Term<'_>) -> DMatrix<f64> {
    let run = term.rehearsal.run;
    let names = &run.trajectory.keypoints;
    let offsets = vec![0.0; term.rehearsal.nuisances.len()];
    let Ok(rollout) = term.rehearsal.rolled(model, &offsets, term.instants) else {
        return DMatrix::zeros(term.observations.len(), 0);
    };
    let poses: Vec<_> = rollout.qpos.chunks(model.nq().max(1)).map(|qpos| model.poses(qpos)).collect();
    // the picture's second axis: z from the side, y from above
    let up = if term.observations.iter().any(|o| o.axis == 2) { 2 } else { 1 };
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for (keypoint, name) in names.iter().enumerate() {
        let Some(site) = model.sites.iter().position(|site| site.name == *name) else { continue };
        let body = model.sites[site].body;
        let along: Vec<[f64; 3]> = poses
            .iter()
            .map(|pose| {
                let arm = pose.site_pos[site] - pose.body_pos[body];
                let length = arm.dot(arm).sqrt().max(STILL);
                arm.0.map(|x| x / length)
            })
            .collect();
        for across in [false, true] {
            for function in 0..3 {
                let shift = term.observations.iter().map(|o| {
                    if o.keypoint != keypoint {
                        return 0.0;
                    }
                    let (x, y) = (along[o.instant][0], along[o.instant][up]);
                    let way = match (across, o.axis == 0) {
                        (false, true) => x,
                        (false, false) => y,
                        (true, true) => -y,
                        (true, false) => x,
                    };
                    -way * [1.0, x, y][function]
                });
                columns.push(whitened(term, shift.collect()));
            }
        }
    }
    from_columns(term, columns)
}
