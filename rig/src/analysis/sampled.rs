//! Which images the empty tank is learned from.

use std::ops::Range;

use crate::vision::extractor::LEARN_FROM;

/// An even sample of the `usable` images to learn the empty tank from: of those whose place among all images received, their
/// `index`, is in `range`, or of all where none is.
pub(super) fn sampled<'a, T>(
    usable: &'a [T],
    index: impl Fn(&T) -> u64,
    range: Option<&Range<u64>>,
) -> Vec<&'a T> {
    let within = range.map(|range| usable.iter().filter(|image| range.contains(&index(image))).collect());
    let within = within.filter(|within: &Vec<&T>| !within.is_empty());
    let within = within.unwrap_or_else(|| usable.iter().collect());
    let stride = within.len().div_ceil(LEARN_FROM).max(1);
    within.into_iter().step_by(stride).collect()
}
