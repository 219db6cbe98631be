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
    let mut out = mask.padded(1);
    // A silhouette at the picture's edge cannot be padded there: its neighbours outside are background all the same.
    let (left, top, width) = (out.left as isize, out.top as isize, out.width);
    let mut alive: Vec<usize> = (0..out.bits.len()).filter(|&i| out.bits[i]).collect();
    loop {
        let before = alive.len();
        for second in [false, true] {
            let removable = |&i: &usize| {
                let (x, y) = (left + (i % width) as isize, top + (i / width) as isize);
                removes(&out, x, y, second)
            };
            let (gone, kept): (Vec<usize>, Vec<usize>) = alive.iter().partition(|i| removable(i));
            gone.iter().for_each(|&i| out.bits[i] = false);
            alive = kept;
        }
        if alive.len() == before {
            return out;
        }
    }
}

/// Whether Zhang and Suen's pass removes this pixel.
fn removes(mask: &Mask, x: isize, y: isize, second: bool) -> bool {
    // North, then clockwise: p2..p9 of the paper.
    const AROUND: [(isize, isize); 8] =
        [(0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1)];
    let p = AROUND.map(|(dx, dy)| mask.at(x + dx, y + dy));
    let count = p.iter().filter(|&&bit| bit).count();
    let rises = (0..8).filter(|&i| !p[i] && p[(i + 1) % 8]).count();
    let (north, east, south, west) = (p[0], p[2], p[4], p[6]);
    let open = if second {
        !(north && east && west) && !(north && south && west)
    } else {
        !(north && east && south) && !(east && south && west)
    };
    (2..=6).contains(&count) && rises == 1 && open
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
