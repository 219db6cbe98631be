//! Coefficients of the model as it stands that had bent to cover for a cause.

use super::result::Bent;
use crate::hypothesis::nuisances::{Nuisances, covariance};
use crate::hypothesis::state::State;

/// A coefficient that naming a cause moves by more than so many of its standard deviations had bent.
const BENT_Z: f64 = 2.0;

/// Baseline coefficients that differ between `before` and `after`.
pub(super) fn bent(before: &State<'_>, after: &State<'_>) -> Vec<Bent> {
    let Some(covariance) = covariance(after) else { return Vec::new() };
    // no number is known better than the model repeats the runs
    let left = after.count() as f64 - Nuisances::new(after).used();
    let level = (after.cost / left.max(1.0)).max(1.0);
    let mut list: Vec<(f64, Bent)> = (0..before.parameters.len())
        .map(|which| {
            let (a, b) = (before.point.values[which], after.point.values[which]);
            let std = (level * covariance[(which, which)]).sqrt();
            let name = before.parameters.free[which].name().to_owned();
            ((a - b).abs() / std, Bent { name, before: a, after: b, std })
        })
        .filter(|(moved, _)| *moved > BENT_Z)
        .collect();
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    list.into_iter().map(|(_, bent)| bent).collect()
}
