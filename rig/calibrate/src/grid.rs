//! Single corners put in order: rows and columns, grown from a first square.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;

use nalgebra::Vector2;

use super::saddle::Saddle;
use camera::calibration::Px;

/// Corners by their place on the board; which of them is [0, 0] and which way the axes point is arbitrary. Seen from the front: the
/// second axis is a quarter turn counter-clockwise of the first.
pub(super) type Grid = BTreeMap<[i32; 2], Saddle>;

/// How far a neighbour may be from where it is expected, as a share of the distance between neighbours.
const NEIGHBOUR_OFFSET_SHARE_MAX: f64 = 0.3;
/// How well the brightness must be opposite or the same, as the cosine of the phases' difference.
const PHASE_COSINE_MIN: f64 = 0.6;
/// How far a first neighbour may be off the direction of the edge \[rad\].
const EDGE_DIRECTION_ERROR_MAX_RAD: f64 = 0.45;
/// A neighbour in one direction is at most so much farther than in the other.
const SPACING_RATIO_MAX: f64 = 2.0;
/// First corners that are tried.
const SEED_CORNERS_MAX: usize = 60;
/// Missing corners in a row that growing reaches across.
const GAP_CORNERS_MAX: i32 = 2;

/// Steps to the four neighbours of a corner.
const NEIGHBOUR_STEPS: [[i32; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

/// The largest grid among `saddles`, at most `wanted` corners of it being of interest.
pub(super) fn largest(saddles: &[Saddle], wanted: usize) -> Grid {
    let mut best = Grid::new();
    let mut taken = vec![false; saddles.len()];
    let mut seeds = 0;
    for first in 0..saddles.len() {
        if taken[first] || seeds == SEED_CORNERS_MAX {
            continue;
        }
        let Some(seed) = seed(saddles, first) else { continue };
        seeds += 1;
        let (grid, members) = grown(saddles, seed);
        members.into_iter().for_each(|i| taken[i] = true);
        if grid.len() > best.len() {
            best = grid;
        }
        if best.len() >= wanted {
            break;
        }
    }
    best
}

/// Four corners of a square, the first of them `first`.
fn seed(saddles: &[Saddle], first: usize) -> Option<BTreeMap<[i32; 2], usize>> {
    let start = &saddles[first];
    // One edge here, the other a quarter turn counter-clockwise as seen: rows grow downward.
    let along = start.phase / 2.0 + FRAC_PI_4;
    let across = along - 2.0 * FRAC_PI_4;
    let from = Vector2::from(start.at);
    let neighbour = |angle: f64| {
        let direction = Vector2::new(angle.cos(), angle.sin());
        let distance = |i: usize| -> Option<f64> {
            let off = Vector2::from(saddles[i].at) - from;
            let length = off.norm();
            let straight = length > 0.0 && off.dot(&direction) > length * EDGE_DIRECTION_ERROR_MAX_RAD.cos();
            (straight && start.likeness(&saddles[i]) < -PHASE_COSINE_MIN).then_some(length)
        };
        let found = (0..saddles.len()).filter_map(|i| Some((distance(i)?, i)));
        found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
    };
    for turn in [0.0, 4.0 * FRAC_PI_4] {
        let (Some(a), Some(b)) = (neighbour(along + turn), neighbour(across + turn)) else { continue };
        let (to_a, to_b) = (Vector2::from(saddles[a].at) - from, Vector2::from(saddles[b].at) - from);
        let (shorter, longer) = (to_a.norm().min(to_b.norm()), to_a.norm().max(to_b.norm()));
        if longer > SPACING_RATIO_MAX * shorter {
            continue;
        }
        let fits = |i: &usize| start.likeness(&saddles[*i]) > PHASE_COSINE_MIN;
        if let Some(c) =
            nearest(saddles, from + to_a + to_b, NEIGHBOUR_OFFSET_SHARE_MAX * shorter).filter(fits)
        {
            return Some(BTreeMap::from([([0, 0], first), ([1, 0], a), ([0, 1], b), ([1, 1], c)]));
        }
    }
    None
}

fn nearest(saddles: &[Saddle], to: Vector2<f64>, within: f64) -> Option<usize> {
    let distance = |i: usize| (Vector2::from(saddles[i].at) - to).norm();
    let found = (0..saddles.len()).map(|i| (distance(i), i)).filter(|(distance, _)| *distance < within);
    found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
}

fn grown(saddles: &[Saddle], mut places: BTreeMap<[i32; 2], usize>) -> (Grid, Vec<usize>) {
    let saddle = |places: &BTreeMap<[i32; 2], usize>| -> Grid {
        places.iter().map(|(&place, &i)| (place, saddles[i])).collect()
    };
    let first = saddles[places[&[0, 0]]];
    loop {
        let grid = saddle(&places);
        let before = places.len();
        for place in around(&grid) {
            let Some((expected, spacing)) = expected(&grid, place) else { continue };
            let Some(i) = nearest(saddles, expected.into(), NEIGHBOUR_OFFSET_SHARE_MAX * spacing) else {
                continue;
            };
            let like = first.likeness(&saddles[i]) * f64::from(1 - 2 * (place[0] + place[1]).rem_euclid(2));
            if like > PHASE_COSINE_MIN && !places.values().any(|&taken| taken == i) {
                places.insert(place, i);
            }
        }
        if places.len() == before {
            return (saddle(&places), places.into_values().collect());
        }
    }
}

/// Empty places beside the grid's corners.
pub(super) fn around(grid: &Grid) -> Vec<[i32; 2]> {
    let steps_from = |place: &[i32; 2]| {
        let [i, j] = *place;
        (1..=GAP_CORNERS_MAX)
            .flat_map(move |gap| NEIGHBOUR_STEPS.map(|[di, dj]| [i + gap * di, j + gap * dj]))
    };
    let mut places: Vec<_> = grid.keys().flat_map(steps_from).filter(|p| !grid.contains_key(p)).collect();
    places.sort_unstable();
    places.dedup();
    places
}

/// Where the corner of `place` is to be expected from those around it, and the distance between neighbours there \[px\].
pub(super) fn expected(grid: &Grid, place: [i32; 2]) -> Option<(Px, f64)> {
    let at = |i: i32, j: i32| grid.get(&[place[0] + i, place[1] + j]).map(|saddle| Vector2::from(saddle.at));
    let (mut sum, mut count, mut spacing) = (Vector2::zeros(), 0.0, f64::INFINITY);
    let mut add = |expected: Vector2<f64>, side: f64, weight: f64| {
        sum += weight * expected;
        count += weight;
        spacing = spacing.min(side);
    };
    for [i, j] in NEIGHBOUR_STEPS {
        // A line goes on as it has come: bent, where three are known.
        if let (Some(a), Some(b)) = (at(i, j), at(2 * i, 2 * j)) {
            match at(3 * i, 3 * j) {
                Some(c) => add(3.0 * a - 3.0 * b + c, (a - b).norm(), 1.0),
                None => add(2.0 * a - b, (a - b).norm(), 1.0),
            }
        } else if let (None, Some(b), Some(c)) = (at(i, j), at(2 * i, 2 * j), at(3 * i, 3 * j)) {
            add(3.0 * b - 2.0 * c, (b - c).norm(), 0.3);
        }
        // The fourth corner of a square.
        let [k, l] = [-j, i];
        if let (Some(a), Some(b), Some(c)) = (at(i, j), at(k, l), at(i + k, j + l)) {
            add(a + b - c, (a - c).norm().min((b - c).norm()), 1.0);
        }
    }
    (count > 0.0).then(|| ((sum / count).into(), spacing))
}

/// The part of `grid` that a board of so many corners covers, and how many corners lie outside.
pub(super) fn on_board(grid: &Grid, corners: [usize; 2]) -> (Grid, usize) {
    let range = |axis: usize| {
        let places = grid.keys().map(|place| place[axis]);
        (places.clone().min().unwrap_or(0), places.max().unwrap_or(0))
    };
    let (across, down) = (range(0), range(1));
    let mut best: Option<(usize, [i32; 2], [i32; 2])> = None;
    for [columns, rows] in [corners, [corners[1], corners[0]]].map(|sides| sides.map(|side| side as i32)) {
        for i in across.0..=(across.1 - columns + 1).max(across.0) {
            for j in down.0..=(down.1 - rows + 1).max(down.0) {
                let inside = |place: &&[i32; 2]| covers([i, j], [columns, rows], place);
                let count = grid.keys().filter(inside).count();
                if best.is_none_or(|(most, ..)| count > most) {
                    best = Some((count, [i, j], [columns, rows]));
                }
            }
        }
    }
    let Some((count, corner, sides)) = best else { return (Grid::new(), 0) };
    let part = grid.iter().filter(|(place, _)| covers(corner, sides, place));
    (part.map(|(place, saddle)| (*place, *saddle)).collect(), grid.len() - count)
}

fn covers(corner: [i32; 2], sides: [i32; 2], place: &[i32; 2]) -> bool {
    (0..2).all(|axis| (corner[axis]..corner[axis] + sides[axis]).contains(&place[axis]))
}
