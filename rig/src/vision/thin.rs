//! From a silhouette to its medial path: thinning, then the longest way along what is left.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::mask::NEIGHBOURS;
use super::{Mask, Px};

/// The one pixel wide skeleton of `mask`, connected like it.
///
/// # Source
/// Zhang and Suen, "A fast parallel algorithm for thinning digital patterns", CACM 27 (1984) 236-239.
pub fn thinned(mask: &Mask) -> Mask {
    // One empty pixel all round, also where the silhouette reaches the picture's edge.
    let width = mask.width + 2;
    let mut on = vec![false; width * (mask.height + 2)];
    let inner = |i: usize| (i / mask.width + 1) * width + i % mask.width + 1;
    let set: Vec<usize> = (0..mask.bits.len()).filter(|&i| mask.bits[i]).collect();
    set.iter().for_each(|&i| on[inner(i)] = true);
    let mut alive: Vec<usize> = set.into_iter().map(inner).collect();
    let mut gone = Vec::new();
    loop {
        let before = alive.len();
        for second in [false, true] {
            gone.clear();
            gone.extend(alive.iter().copied().filter(|&i| removes(&on, width, i, second)));
            gone.iter().for_each(|&i| on[i] = false);
            alive.retain(|&i| on[i]);
        }
        if alive.len() == before {
            break;
        }
    }
    let mut out = Mask::empty(mask.left, mask.top, mask.width, mask.height);
    alive.iter().for_each(|&i| out.bits[(i / width - 1) * mask.width + i % width - 1] = true);
    out
}

/// Whether Zhang and Suen's pass removes this pixel.
fn removes(on: &[bool], width: usize, i: usize, second: bool) -> bool {
    let (up, down) = (i - width, i + width);
    // North, then clockwise: p2..p9 of the paper.
    let p = [on[up], on[up + 1], on[i + 1], on[down + 1], on[down], on[down - 1], on[i - 1], on[up - 1]];
    let count = p.iter().filter(|&&bit| bit).count();
    if !(2..=6).contains(&count) {
        return false;
    }
    let (north, east, south, west) = (p[0], p[2], p[4], p[6]);
    let open = if second { !(north && west && (east || south)) } else { !(east && south && (north || west)) };
    open && (0..8).filter(|&i| !p[i] && p[(i + 1) % 8]).count() == 1
}

/// The longest of the shortest ways between two pixels of `skeleton`, as pixel centres \[px\]: side branches
/// drop out. Empty when the skeleton is.
///
/// Of a skeleton with loops it is a long way, not always the longest.
pub fn longest_path(skeleton: &Mask) -> Vec<Px> {
    let Some((x, y)) = skeleton.pixels().next() else { return Vec::new() };
    let start = (y - skeleton.top) * skeleton.width + x - skeleton.left;
    let (one_end, _) = farthest(skeleton, start);
    let (other_end, came_from) = farthest(skeleton, one_end);
    let mut path = Vec::new();
    let mut at = other_end;
    loop {
        path.push([
            (skeleton.left + at % skeleton.width) as f64,
            (skeleton.top + at / skeleton.width) as f64,
        ]);
        if at == one_end {
            return path;
        }
        at = came_from[at];
    }
}

/// Dijkstra over the skeleton's pixels: the farthest one from `start`, and where each was reached from.
fn farthest(skeleton: &Mask, start: usize) -> (usize, Vec<usize>) {
    // 7/5 is the root of 2 to 1 %, in whole numbers: no tie is ever broken by rounding.
    const STRAIGHT: u32 = 5;
    const DIAGONAL: u32 = 7;
    let (w, h) = (skeleton.width, skeleton.height);
    let mut distance = vec![u32::MAX; w * h];
    let mut came_from = vec![start; w * h];
    let mut queue = BinaryHeap::from([(Reverse(0), start)]);
    distance[start] = 0;
    let mut last = start;
    while let Some((Reverse(d), at)) = queue.pop() {
        if d > distance[at] {
            continue;
        }
        last = at;
        for (dx, dy) in NEIGHBOURS {
            let (Some(x), Some(y)) = ((at % w).checked_add_signed(dx), (at / w).checked_add_signed(dy))
            else {
                continue;
            };
            if x >= w || y >= h || !skeleton.bits[y * w + x] {
                continue;
            }
            let further = d + if dx == 0 || dy == 0 { STRAIGHT } else { DIAGONAL };
            if further < distance[y * w + x] {
                distance[y * w + x] = further;
                came_from[y * w + x] = at;
                queue.push((Reverse(further), y * w + x));
            }
        }
    }
    (last, came_from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar() -> Mask {
        let mut mask = Mask::empty(0, 0, 80, 40);
        for y in 10..21 {
            for x in 5..70 {
                mask.set(x, y);
            }
        }
        mask
    }

    #[test]
    fn bar_thins_to_a_line_along_its_middle() {
        let path = longest_path(&thinned(&bar()));
        let middle: Vec<&Px> = path.iter().filter(|p| (20.0..55.0).contains(&p[0])).collect();
        assert!(middle.len() >= 35);
        assert!(middle.iter().all(|p| (p[1] - 15.0).abs() <= 1.0), "{middle:?}");
    }

    #[test]
    fn side_branch_drops_out_of_the_longest_path() {
        let mut mask = bar();
        for y in 21..30 {
            for x in 35..39 {
                mask.set(x, y);
            }
        }
        let path = longest_path(&thinned(&mask));
        assert!(path.iter().all(|p| p[1] < 21.0), "{path:?}");
        assert!(path.len() > 50);
    }

    #[test]
    fn silhouette_at_the_edge_of_the_picture_thins_like_any_other() {
        let mut mask = Mask::empty(0, 0, 30, 7);
        mask.bits.fill(true);
        let path = longest_path(&thinned(&mask));
        assert!(path.len() > 18 && path.iter().all(|p| (p[1] - 3.0).abs() < 3.0), "{path:?}");
    }
}
