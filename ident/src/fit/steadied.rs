//! Steps that are short enough for derivatives where friction locks a joint.
//!
//! Steps are planned for the model that a fit begins with. Where friction is greater at its end, a joint that is locked creeps, and does so
//! stiffly: explicit steps chatter about rest. The motion is nearly right then, but each turn of the chatter multiplies what a parameter does to
//! it, and what follows from such derivatives, intervals above all, says nothing. So derivatives at the end are compared with those in steps half as
//! long; where they differ, the descent goes on in shorter steps, and what is not to be had in the shortest is not said.

use super::counts::Counts;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::{Linear, Point, Problem};

/// Into how many parts steps are divided, one after the other (chosen): sixteen take the stiffest gear of a hobby servo.
const PARTS: [usize; 2] = [4, 16];
/// Derivatives that change by less than this share of themselves in steps half as long are those of the motion (chosen): an interval is good to a
/// tenth at best, and chatter makes them differ by factors.
const CHANGE_SHARE_MAX: f64 = 0.3;
/// Parameters of friction that creeps stiffly near rest; what the others do near rest does not grow.
const CREEPING: [&str; 3] = ["coulomb_friction/rate", "gear_friction/rate", "load_friction/rate"];

/// What steps do for the derivatives.
pub(super) enum Steadied<'a> {
    /// They do as they are.
    AsPlanned,
    /// Shorter ones do, in which the fit ends here.
    Shorter(Objective<'a>, Point),
    /// None that were tried do, for these parameters, shape (P).
    Never(Vec<bool>),
}

/// Whether the steps of `objective` are short enough for derivatives at `point`, and what are; `None` where nobody waits for it.
pub(super) fn steadied<'a>(
    objective: &Objective<'a>,
    point: &Point,
    counts: &mut Counts,
) -> Option<Steadied<'a>> {
    let model = objective.problem.model;
    if point.values.is_empty() || !CREEPING.iter().any(|name| model.parameter(name).is_ok()) {
        return Some(Steadied::AsPlanned);
    }
    let mut unsteady = unsteady(objective, point, counts)?;
    if !unsteady.contains(&true) {
        return Some(Steadied::AsPlanned);
    }
    let mut from = point.clone();
    for parts in PARTS {
        let shorter = in_parts(objective, parts);
        let mut descent = Descent::new(from.clone(), None);
        descent.run(&shorter, Freedom::Everything, counts);
        if counts.is_stopped() {
            return None;
        }
        if descent.cost.is_none() {
            continue;
        }
        from = descent.point;
        unsteady = self::unsteady(&shorter, &from, counts)?;
        if !unsteady.contains(&true) {
            return Some(Steadied::Shorter(shorter, from));
        }
    }
    Some(Steadied::Never(unsteady))
}

/// `objective` with each step of its runs in so many `parts`.
fn in_parts<'a>(objective: &Objective<'a>, parts: usize) -> Objective<'a> {
    let mut terms = objective.problem.terms.clone();
    terms.iter_mut().for_each(|term| term.rehearsal = term.rehearsal.clone().in_parts(parts));
    Objective { problem: Problem { terms, ..objective.problem }, ..objective.clone() }
}

/// Which parameters do something else in steps half as long, shape (P); `None` where they cannot be simulated.
fn unsteady(objective: &Objective<'_>, point: &Point, counts: &mut Counts) -> Option<Vec<bool>> {
    let linear = objective.problem.linearise(point, true, &mut counts.apart())?;
    let halves = in_parts(objective, 2).problem.linearise(point, true, &mut counts.apart());
    let Some(halves) = halves else {
        return (!counts.is_stopped()).then(|| vec![true; point.values.len()]);
    };
    let square = |of: &dyn Fn(&Linear, &Linear) -> f64| -> f64 {
        linear.iter().zip(&halves).map(|(linear, halves)| of(linear, halves)).sum()
    };
    let is_unsteady = |column: usize| {
        let change = square(&|linear, halves| {
            (linear.jacobian.column(column) - halves.jacobian.column(column)).norm_squared()
        });
        let size = square(&|_, halves| halves.jacobian.column(column).norm_squared());
        // what is no number is no derivative either
        change.is_nan() || change > CHANGE_SHARE_MAX.powi(2) * size
    };
    Some((0..point.values.len()).map(is_unsteady).collect())
}
