//! From a silhouette to its medial path: thinning, then the longest way along what is left.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::Mask;
use camera::calibration::Px;

/// The four neighbours that share an edge, then the four that share a corner.
const NEIGHBOURS: [(isize, isize); 8] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

/// The skeleton of `mask`, connected like it: one pixel wide, two where it is slanted.
///
/// # Source
/// Zhang and Suen, "A fast parallel algorithm for thinning digital patterns", CACM 27 (1984) 236-239. It takes slanted lines two
/// pixels wide away from their ends on: what is no thicker is thinned with the condition of Lü and Wang's comment on it, CACM
/// 29 (1986) 239-242, which alone would leave branches into the corners of square ends.
pub fn thinned(mask: &Mask) -> Mask {
    // One empty pixel all round, also where the silhouette reaches the picture's edge.
    let width = mask.width + 2;
    let mut on = vec![false; width * (mask.height + 2)];
    for (row, inner) in mask.bits.chunks_exact(mask.width.max(1)).zip(on.chunks_exact_mut(width).skip(1)) {
        inner[1..=mask.width].copy_from_slice(row);
    }
    let mut neighbours = vec![0u8; on.len()];
    for i in (width..on.len() - width).filter(|&i| on[i]) {
        for (k, beside) in around(width, i).into_iter().enumerate() {
            neighbours[i] |= u8::from(on[beside]) << k;
        }
    }
    // Only pixels that lack a neighbour can go: those are listed, each once.
    let mut rim: Vec<usize> = (0..on.len()).filter(|&i| on[i] && neighbours[i] != u8::MAX).collect();
    let mut inner = on.iter().filter(|on| **on).count() - rim.len();
    let mut gone = Vec::new();
    loop {
        let mut changed = false;
        let passes = if inner > 0 { &REMOVED } else { &REMOVED_FROM_THIN };
        for pass in passes {
            gone.clear();
            rim.retain(|&i| {
                let goes = pass[usize::from(neighbours[i])];
                if goes {
                    gone.push(i);
                }
                !goes
            });
            changed |= !gone.is_empty();
            gone.iter().for_each(|&i| on[i] = false);
            for &i in &gone {
                for (k, beside) in around(width, i).into_iter().enumerate() {
                    if on[beside] && neighbours[beside] == u8::MAX {
                        rim.push(beside);
                        inner -= 1;
                    }
                    // Seen from there, this pixel lies the opposite way.
                    neighbours[beside] &= !(1 << ((k + 4) % 8));
                }
            }
        }
        if !changed {
            break;
        }
    }
    let mut out = Mask::empty(mask.left, mask.top, mask.width, mask.height);
    for (row, inner) in out.bits.chunks_exact_mut(mask.width.max(1)).zip(on.chunks_exact(width).skip(1)) {
        row.copy_from_slice(&inner[1..=mask.width]);
    }
    out
}

/// The neighbours of pixel `i`: north, then clockwise, p2..p9 of the paper.
#[inline]
fn around(width: usize, i: usize) -> [usize; 8] {
    let (up, down) = (i - width, i + width);
    [up, up + 1, i + 1, down + 1, down, down - 1, i - 1, up - 1]
}

/// Which neighbourhoods, one bit for each neighbour in the order of [`around`], Zhang and Suen's first and second
/// pass remove a pixel from.
static REMOVED: [[bool; 256]; 2] = [removed(false, 2), removed(true, 2)];

/// The same once there is nothing but rim.
static REMOVED_FROM_THIN: [[bool; 256]; 2] = [removed(false, 3), removed(true, 3)];

/// At `least` so many neighbours leave a pixel to be removed.
const fn removed(second: bool, least: u32) -> [bool; 256] {
    let mut table = [false; 256];
    let mut bits = 0;
    while bits < 256 {
        let p = bits as u8;
        let (north, east, south, west) = (p & 1 != 0, p & 4 != 0, p & 16 != 0, p & 64 != 0);
        let open =
            if second { !(north && west && (east || south)) } else { !(east && south && (north || west)) };
        let begins = (!p & p.rotate_right(1)).count_ones();
        table[bits] = p.count_ones() >= least && p.count_ones() <= 6 && open && begins == 1;
        bits += 1;
    }
    table
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
    const STRAIGHT_STEP: u32 = 5;
    const DIAGONAL_STEP: u32 = 7;
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
            let further = d + if dx == 0 || dy == 0 { STRAIGHT_STEP } else { DIAGONAL_STEP };
            if further < distance[y * w + x] {
                distance[y * w + x] = further;
                came_from[y * w + x] = at;
                queue.push((Reverse(further), y * w + x));
            }
        }
    }
    (last, came_from)
}

/// Distance of each pixel of `path`, inside `mask`, to the nearest pixel outside \[px\]; what lies outside the
/// mask's rectangle does not count.
pub fn radii(mask: &Mask, path: &[Px]) -> Vec<f64> {
    let (w, h) = (mask.width, mask.height);
    // Distance to the nearest pixel outside in the same column: first upward, then either way.
    let far = w + h;
    let mut column = vec![far; w * h];
    for y in 0..h {
        for x in 0..w {
            let above = if y > 0 { column[(y - 1) * w + x] } else { far };
            column[y * w + x] = if mask.bits[y * w + x] { (above + 1).min(far) } else { 0 };
        }
    }
    for y in (0..h.saturating_sub(1)).rev() {
        for x in 0..w {
            column[y * w + x] = column[y * w + x].min(column[(y + 1) * w + x] + 1);
        }
    }
    let radius = |p: &Px| {
        let (x, y) = (p[0] as usize - mask.left, p[1] as usize - mask.top);
        let row = &column[y * w..(y + 1) * w];
        let mut nearest = row[x] * row[x];
        let mut across = 1;
        while across < w && across * across < nearest {
            for beside in [x.checked_sub(across), Some(x + across).filter(|&x| x < w)].into_iter().flatten() {
                nearest = nearest.min(across * across + row[beside] * row[beside]);
            }
            across += 1;
        }
        nearest
    };
    path.iter().map(|p| ((radius(p) as f64).sqrt() - 0.5).max(0.5)).collect()
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
    fn slanted_bar_keeps_its_length() {
        for step in 0..180 {
            let (sin, cos) = (0.25 * f64::from(step) + 22.5).to_radians().sin_cos();
            let mut mask = Mask::empty(0, 0, 200, 200);
            for y in 0..200_isize {
                for x in 0..200_isize {
                    let (x_px, y_px) = (x as f64 - 100.0, y as f64 - 99.5);
                    let (along, across) = (cos * x_px + sin * y_px, cos * y_px - sin * x_px);
                    if along.abs() < 80.0 && across.abs() < 10.0 {
                        mask.set(x, y);
                    }
                }
            }
            let path = longest_path(&thinned(&mask));
            let (first, last) = (path[0], path[path.len() - 1]);
            let length = (last[0] - first[0]).hypot(last[1] - first[1]);
            // it stops about a half width short of either end
            assert!(length > 135.0, "{step}: {length}");
        }
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
