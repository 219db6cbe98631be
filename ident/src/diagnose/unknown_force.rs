//! What is left as a force that nobody has a name for.
//!
//! Where no cause explains the runs, each joint gets a torque that is a smooth function of its own angle and rate: all products of their
//! powers up to the third order, waves over the angle for what comes and goes along it, and one term that turns round with the rate as
//! friction does. The weights are fitted through the
//! simulation as every other number, kept small by a ridge that leaving out one run after the other chooses; and the force is shown only
//! where it helps on runs that it was not fitted to. It says where in the motion something is missing, and which cause it resembles.
//!
//! # Source
//! A. E. Hoerl, R. W. Kennard, "Ridge regression", Technometrics 12 (1970) 55-67; M. C. Kennedy, A. O'Hagan, "Bayesian calibration of
//! computer models", Journal of the Royal Statistical Society B 63 (2001) 425-464, for a discrepancy fitted beside the model.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};
use sim::{Cause, Model};

use super::force::{ForceCurve, JointForce, Resembled, RestCurve, UnknownForce};
use super::gain;
use super::goodness::goodness_of_fit;
use crate::config::Prior;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::nuisances::crossed_cost;
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;
use ground::strict::{Finite, Positive};

/// Slow residuals this many standard deviations beyond noise leave something to look for.
const BEYOND_NOISE_Z: f64 = 6.0;
/// Highest order of the products of angle and rate, a choice: ten numbers for each joint.
const ORDER: i32 = 3;
/// Half waves over the angles that a joint goes through, a choice: fewer than these look like the products, more of them are finer than a
/// twentieth of the way.
const HALF_WAVES: std::ops::RangeInclusive<i32> = 4..=12;
/// Share of the largest rate over which the term that turns round with it does so.
const TURNS_ROUND_SHARE: f64 = 0.05;
/// Ridges that are tried: the standard deviation of each weight, over the one at which it alone would move the keypoints by as much as they
/// are away.
const RIDGES: [f64; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];
/// Bounds of a weight, over its standard deviation: beyond that the ridge has it back.
const FAR_STD: f64 = 100.0;
/// A cause that could do less than this share of what the force does does not resemble it.
const RESEMBLED_SHARE: f64 = 0.3;
/// How many causes are listed that resemble it.
const MOST_RESEMBLED: usize = 3;
/// A joint that turns by less does not move \[rad\] or \[m\].
const STILL: f64 = 1e-9;

/// Curves over the rate, and points of each and of the one over the angle, choices; the half waves want ten points each.
const CURVES: usize = 3;
const RATES: usize = 41;
const ANGLES: usize = 121;

/// A joint, and the part of its phase plane that the runs go through.
struct Joint {
    name: String,
    is_slide: bool,
    angle: [f64; 2],
    rate: [f64; 2],
}

impl Joint {
    /// Middle and half width of the angles, and the greatest rate: units in which the runs keep to -1 to 1.
    fn units(&self) -> [f64; 3] {
        let ([low, high], [slowest, quickest]) = (self.angle, self.rate);
        let most = slowest.abs().max(quickest.abs());
        [rounded(0.5 * (low + high)), rounded(0.5 * (high - low)).max(STILL), rounded(most).max(STILL)]
    }

    /// The functions that the torque is made of, as expressions.
    fn functions(&self) -> Vec<String> {
        let [middle, half, most] = self.units();
        let (angle, rate) = (format!("((q - {}) / {half})", written(middle)), format!("(v / {most})"));
        let power = |of: &str, order: i32| match order {
            0 => None,
            1 => Some(of.to_owned()),
            _ => Some(format!("{of}^{order}")),
        };
        let mut list = Vec::new();
        for (a, b) in (0..=ORDER).flat_map(|a| (0..=ORDER - a).map(move |b| (a, b))) {
            let factors: Vec<String> = [power(&angle, a), power(&rate, b)].into_iter().flatten().collect();
            list.push(if factors.is_empty() { "1".into() } else { factors.join(" * ") });
        }
        list.extend(HALF_WAVES.map(|k| format!("cos({k} * pi / 2 * ({angle} + 1))")));
        list.push(format!("tanh(v / {})", rounded(TURNS_ROUND_SHARE * most)));
        list
    }

    fn cause_name(&self, model: &Model) -> String {
        let plain: String =
            self.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let taken = |name: &str| model.known_causes().any(|cause| cause.name() == name);
        let mut name = format!("unknown_force_{plain}");
        while taken(&name) {
            name.push('_');
        }
        name
    }

    /// The force with its weights free.
    fn cause(&self, model: &Model) -> OwnCause {
        let functions = self.functions();
        let term = |(place, function): (usize, &String)| format!("w{place} * {function}");
        let torque: Vec<String> = functions.iter().enumerate().map(term).collect();
        let unit = if self.is_slide { "N" } else { "N m" };
        OwnCause {
            name: self.cause_name(model),
            sentence: None,
            place: Place::Joint(self.name.clone()),
            terms: vec![(Acts::Torque, torque.join(" + "))],
            parameters: (0..functions.len())
                .map(|place| OwnParameter::size(&format!("w{place}"), unit, [-1e3, 1e3], 1e-5))
                .collect(),
        }
    }

    /// What the functions are at angle `q` and rate `v`.
    fn values(&self, q: f64, v: f64) -> Vec<f64> {
        let [middle, half, most] = self.units();
        let (angle, rate) = ((q - middle) / half, v / most);
        let products = (0..=ORDER).flat_map(|a| (0..=ORDER - a).map(move |b| angle.powi(a) * rate.powi(b)));
        let waves = HALF_WAVES.map(|k| (f64::from(k) * FRAC_PI_2 * (angle + 1.0)).cos());
        products.chain(waves).chain([(v / rounded(TURNS_ROUND_SHARE * most)).tanh()]).collect()
    }

    /// The force with these `weights` at angle `q` and rate `v`.
    fn force(&self, weights: &[f64], q: f64, v: f64) -> f64 {
        self.values(q, v).iter().zip(weights).map(|(x, w)| x * w).sum()
    }

    /// The force with these `weights` over the rate, at the least, the middle and the greatest angle.
    fn curves(&self, weights: &[f64]) -> Vec<ForceCurve> {
        let at = |angle: f64| {
            let rate = points(self.rate, RATES);
            let force = rate.iter().map(|&v| self.force(weights, angle, v)).collect();
            ForceCurve { angle, rate, force }
        };
        points(self.angle, CURVES).into_iter().map(at).collect()
    }

    /// The force with these `weights` at no rate.
    fn at_rest(&self, weights: &[f64]) -> RestCurve {
        let angle = points(self.angle, ANGLES);
        let force = angle.iter().map(|&q| self.force(weights, q, 0.0)).collect();
        RestCurve { angle, force }
    }

    /// The force with these `weights`, as an expression of q and v.
    fn torque(&self, weights: &[f64]) -> String {
        let mut text = String::new();
        for (weight, function) in weights.iter().zip(self.functions()) {
            let sign = match (text.is_empty(), *weight < 0.0) {
                (true, true) => "-",
                (true, false) => "",
                (false, true) => " - ",
                (false, false) => " + ",
            };
            let _ = write!(text, "{sign}{:.4e}", weight.abs());
            if function != "1" {
                let _ = write!(text, " * {function}");
            }
        }
        text
    }
}

/// So many numbers, evenly from the least to the greatest.
fn points([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    (0..count).map(|k| low + k as f64 / (count - 1) as f64 * (high - low)).collect()
}

/// To two digits: what the phase plane is divided by needs no more, and the same mechanism gives the same expression again.
fn rounded(x: f64) -> f64 {
    format!("{x:.1e}").parse().unwrap_or(x)
}

fn written(x: f64) -> String {
    if x < 0.0 { format!("({x})") } else { x.to_string() }
}

/// The force that `base` lacks, where one helps on runs that it was not fitted to; `known` are the causes that may be.
pub(super) fn unknown_force(
    experiment: &Experiment,
    base: &State<'_>,
    known: &[Cause],
    floor: &Floor,
    counts: &mut Counts,
) -> Option<UnknownForce> {
    if base.linear.is_empty() || base.terms.len() < 2 || counts.is_stopped() {
        return None;
    }
    // noise has no force behind it, whatever foretells a little of it
    if goodness_of_fit(base, floor).z < BEYOND_NOISE_Z {
        return None;
    }
    let joints = moving(base);
    let first = base.parameters.len();
    let mut state = base.clone();
    for joint in &joints {
        let cause = state.model.define_cause(&joint.cause(&state.model)).ok()?;
        let term = Term::all(cause, &state.model, 1, 1.0, &[]).into_iter().next()?;
        state = state.with(&term);
    }
    if !state.stay(counts) {
        return None;
    }
    let state = fitted(state, first, base, counts)?;
    let heldout = gain::gain(experiment, base, &state, floor, counts)?;
    if heldout.may_be_none() {
        return None;
    }
    let weights = &state.point.values[first..];
    let each = weights.len() / joints.len().max(1);
    let of_joint = |(joint, weights): (&Joint, &[f64])| JointForce {
        joint: joint.name.clone(),
        torque: joint.torque(weights),
        unit: if joint.is_slide { "N" } else { "N m" }.into(),
        angle: joint.angle,
        rate: joint.rate,
        curves: joint.curves(weights),
        at_rest: joint.at_rest(weights),
    };
    Some(UnknownForce {
        joints: joints.iter().zip(weights.chunks(each.max(1))).map(of_joint).collect(),
        resembles: resembled(base, &state, known, counts),
        heldout,
    })
}

/// The joints that something may turn, with what of their phase planes the runs go through.
fn moving(base: &State<'_>) -> Vec<Joint> {
    let model = base.calibrated();
    let hinges = model.joints.iter().filter(|joint| joint.kind.nq() == 1);
    let mut list: Vec<Joint> = hinges
        .clone()
        .map(|joint| Joint {
            name: joint.name.clone(),
            is_slide: joint.kind == sim::model::JointKind::Slide,
            angle: [f64::INFINITY, f64::NEG_INFINITY],
            rate: [f64::INFINITY, f64::NEG_INFINITY],
        })
        .collect();
    for (term, offsets) in base.terms.iter().zip(&base.point.offsets) {
        let instants = term.rehearsal.run.trajectory.time_s.len();
        let Ok(rollout) = term.rehearsal.rolled(&model, offsets, instants) else { continue };
        let frozen = crate::initial::prescribed_dofs(&model, term.rehearsal.run);
        for (joint, own) in list.iter_mut().zip(hinges.clone()) {
            // a joint that follows its command exactly feels no force
            if frozen[own.dof_address] {
                continue;
            }
            let widen = |range: &mut [f64; 2], x: f64| *range = [range[0].min(x), range[1].max(x)];
            let rows = rollout.qpos.chunks(model.nq()).zip(rollout.qvel.chunks(model.nv()));
            for (qpos, qvel) in rows {
                widen(&mut joint.angle, qpos[own.qpos_address]);
                widen(&mut joint.rate, qvel[own.dof_address]);
            }
        }
    }
    list.retain(|joint| joint.angle[1] - joint.angle[0] > STILL);
    list
}

/// `state`, whose weights begin at number `first`, at its optimum with the best ridge; `None` where `base` alone foretells left-out runs
/// as well.
fn fitted<'a>(
    mut state: State<'a>,
    first: usize,
    base: &State<'a>,
    counts: &mut Counts,
) -> Option<State<'a>> {
    let columns = first..state.parameters.len();
    let length = |column: usize| {
        state.linear.iter().map(|run| run.jacobian.column(column).norm_squared()).sum::<f64>().sqrt()
    };
    // a weight at which it alone would move the keypoints by as much as they are away
    let whole: Vec<f64> = columns.clone().map(|column| base.cost.sqrt() / length(column)).collect();
    if !whole.iter().all(|std| std.is_finite() && *std > 0.0) {
        return None;
    }
    let mut with = |ridge: f64| {
        for (column, whole) in columns.clone().zip(&whole) {
            let parameter = &mut state.parameters.free[column];
            let (mean, std) = (Finite::new(0.0)?, Positive::new(ridge * whole)?);
            parameter.prior = Some(Prior { mean, std });
            parameter.scale = crate::parameters::Scale::new(-FAR_STD * std.get(), FAR_STD * std.get());
        }
        Some(state.clone())
    };
    let tried: Vec<(f64, State<'a>)> = RIDGES
        .iter()
        .filter_map(|&ridge| {
            let state = with(ridge)?;
            Some((crossed_cost(&state)?, state))
        })
        .collect();
    let (cost, mut best) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    if cost >= crossed_cost(base)? {
        return None;
    }
    best.descend(counts).then_some(best)
}

/// The causes of `known` that could do a good part of what the force does to the keypoints.
fn resembled(base: &State<'_>, forced: &State<'_>, known: &[Cause], counts: &Counts) -> Vec<Resembled> {
    let terms: Vec<Term> =
        known.iter().flat_map(|cause| Term::all(*cause, &base.model, 1, 1.0, &[])).collect();
    let scores = Scores::new(base, &terms, counts);
    let changes: Vec<_> = forced
        .linear
        .iter()
        .zip(&base.linear)
        .map(|(after, before)| &after.residuals - &before.residuals)
        .collect();
    let shares = scores.shares(&scores.nuisances.left_of(changes.iter()));
    let mut list: Vec<Resembled> = Vec::new();
    for (term, share) in terms.iter().zip(shares).filter(|(_, share)| *share >= RESEMBLED_SHARE) {
        let label =
            term.element().map_or(term.info().name.to_owned(), |of| format!("{}/{of}", term.info().name));
        match list.iter_mut().find(|other| other.name == label) {
            Some(other) => other.share = other.share.max(share),
            None => list.push(Resembled { name: label, share }),
        }
    }
    list.sort_by(|a, b| b.share.total_cmp(&a.share));
    list.truncate(MOST_RESEMBLED);
    list
}
