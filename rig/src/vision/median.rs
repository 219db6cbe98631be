//! The middle of some values.

/// The middle value; the slice is reordered. Callers pass at least one value.
pub(super) fn median<T: Copy + PartialOrd>(values: &mut [T]) -> T {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, |a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal)).1
}
