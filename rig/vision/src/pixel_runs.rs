//! Runs of equal bits along a picture's rows, and which of them are connected.

/// Neighbouring bits of one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// Row.
    pub(super) row: usize,
    /// First column.
    pub(super) from: usize,
    /// One past the last column.
    pub(super) to: usize,
}

impl Run {
    /// Number of pixels.
    pub(super) fn len(&self) -> usize {
        self.to - self.from
    }
}

/// The runs of `value` in `bits`, shape (height, `width`), in reading order.
pub(super) fn runs(bits: &[bool], width: usize, value: bool) -> Vec<Run> {
    let mut out = Vec::new();
    for (row, bits) in bits.chunks_exact(width.max(1)).enumerate() {
        let mut at = 0;
        while let Some(skip) = bits[at..].iter().position(|&bit| bit == value) {
            let from = at + skip;
            let to = bits[from..].iter().position(|&bit| bit != value).map_or(width, |n| from + n);
            out.push(Run { row, from, to });
            at = to;
        }
    }
    out
}

/// `runs`, which are in reading order, in groups that hang together by edges (and, with `corners`, by corners),
/// in the order of their first runs.
pub(super) fn connected(runs: &[Run], corners: bool) -> Vec<Vec<Run>> {
    let reach = usize::from(corners);
    let mut parent: Vec<usize> = (0..runs.len()).collect();
    let mut above = 0;
    for (i, run) in runs.iter().enumerate() {
        let too_early = |other: &Run| {
            other.row + 1 < run.row || (other.row + 1 == run.row && other.to + reach <= run.from)
        };
        while too_early(&runs[above]) {
            above += 1;
        }
        let touching = |other: &&Run| other.row + 1 == run.row && other.from < run.to + reach;
        for j in (above..).zip(runs[above..].iter().take_while(touching)).map(|(j, _)| j) {
            let (a, b) = (root(&mut parent, i), root(&mut parent, j));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut group = vec![usize::MAX; runs.len()];
    let mut groups: Vec<Vec<Run>> = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        let first = root(&mut parent, i);
        if first == i {
            group[i] = groups.len();
            groups.push(Vec::new());
        }
        groups[group[first]].push(*run);
    }
    groups
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups(picture: &[&str], corners: bool) -> Vec<usize> {
        let bits: Vec<bool> = picture.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect();
        let sizes = |group: &Vec<Run>| group.iter().map(Run::len).sum();
        connected(&runs(&bits, picture[0].len(), true), corners).iter().map(sizes).collect()
    }

    #[test]
    fn arms_that_meet_below_are_one_group_and_corners_connect_where_they_may() {
        let picture = ["#.#..#", "#.#..#", "###...", "...#.#", "......", "##...."];
        assert_eq!(groups(&picture, true), [8, 2, 1, 2]);
        assert_eq!(groups(&picture, false), [7, 2, 1, 1, 2]);
    }

    #[test]
    fn runs_cover_exactly_the_bits_of_their_value() {
        let bits = [true, false, true, true, false, false];
        let run = |row, from, to| Run { row, from, to };
        assert_eq!(runs(&bits, 3, true), [run(0, 0, 1), run(0, 2, 3), run(1, 0, 1)]);
        assert_eq!(runs(&bits, 3, false), [run(0, 1, 2), run(1, 1, 3)]);
    }
}
