//! Connected parts of a mask, and which of them is the mechanism.

use super::mask::NEIGHBOURS;
use super::{Mask, Px};

/// One connected part (corners connect).
#[derive(Debug, Clone)]
pub struct Component {
    /// Its pixels, in its bounding rectangle.
    pub mask: Mask,
    /// Number of pixels.
    pub area: usize,
    /// Mean position \[px\].
    pub centroid: Px,
    /// It reaches the first or last row or column of the picture.
    pub cut: bool,
}

/// The parts of `mask` of at least `min_area` pixels, in the order of their first pixel.
///
/// `mask` covers the whole picture.
pub fn components(mask: &Mask, min_area: usize) -> Vec<Component> {
    let (w, h) = (mask.width, mask.height);
    let mut left = mask.bits.clone();
    let mut found = Vec::new();
    for start in 0..w * h {
        if !left[start] {
            continue;
        }
        left[start] = false;
        let mut pixels = vec![start];
        let mut next = 0;
        while next < pixels.len() {
            let (x, y) = (pixels[next] % w, pixels[next] / w);
            next += 1;
            for (dx, dy) in NEIGHBOURS {
                let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                    continue;
                };
                if nx < w && ny < h && left[ny * w + nx] {
                    left[ny * w + nx] = false;
                    pixels.push(ny * w + nx);
                }
            }
        }
        if pixels.len() >= min_area.max(1) {
            found.push(component(&pixels, w, h));
        }
    }
    found
}

fn component(pixels: &[usize], w: usize, h: usize) -> Component {
    let (mut x0, mut x1, mut y0, mut y1) = (w, 0, h, 0);
    let (mut sum_x, mut sum_y) = (0, 0);
    for &i in pixels {
        let (x, y) = (i % w, i / w);
        (x0, x1, y0, y1) = (x0.min(x), x1.max(x), y0.min(y), y1.max(y));
        (sum_x, sum_y) = (sum_x + x, sum_y + y);
    }
    let mut mask = Mask::empty(x0, y0, x1 + 1 - x0, y1 + 1 - y0);
    pixels.iter().for_each(|&i| mask.set((i % w) as isize, (i / w) as isize));
    let area = pixels.len();
    Component {
        mask,
        area,
        centroid: [sum_x as f64 / area as f64, sum_y as f64 / area as f64],
        cut: x0 == 0 || y0 == 0 || x1 + 1 == w || y1 + 1 == h,
    }
}

/// `mask` grown by `reach` pixels each way (a square), within a picture of `width` by `height`.
pub fn dilated(mask: &Mask, reach: usize, width: usize, height: usize) -> Mask {
    let left = mask.left.saturating_sub(reach);
    let top = mask.top.saturating_sub(reach);
    let right = (mask.left + mask.width + reach).min(width);
    let bottom = (mask.top + mask.height + reach).min(height);
    let mut out = Mask::empty(left, top, right - left, bottom - top);
    let reach = reach as isize;
    for (column, row) in mask.pixels() {
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                out.set(column as isize + dx, row as isize + dy);
            }
        }
    }
    out
}

/// Which of `parts` is the mechanism: the largest, for its distance from where it was `last`; one the picture's
/// border cuts only where `base_px` (within `reach_px`) says that the mechanism leaves the picture, or when
/// there is no other. With a base, a part that comes near it goes before any other.
pub fn choose(parts: &[Component], base_px: Option<Px>, reach_px: f64, last: Option<Px>) -> Option<usize> {
    let at_base = |part: &Component| {
        base_px.is_some_and(|base| {
            part.mask.pixels().any(|(x, y)| (x as f64 - base[0]).hypot(y as f64 - base[1]) <= reach_px)
        })
    };
    let rank = |part: &Component| {
        let near = at_base(part);
        let size = (part.area as f64).sqrt();
        let moved = last.map_or(0.0, |l| (part.centroid[0] - l[0]).hypot(part.centroid[1] - l[1]));
        (near || !part.cut, near, part.area as f64 / (1.0 + moved / size))
    };
    let ranks: Vec<_> = parts.iter().map(rank).collect();
    (0..parts.len()).max_by(|&a, &b| {
        let ordering = ranks[a].partial_cmp(&ranks[b]).unwrap_or(std::cmp::Ordering::Equal);
        ordering.then(b.cmp(&a))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Vec<Component> {
        let mut mask = Mask::empty(0, 0, 60, 40);
        mask.draw_disc([20.0, 20.0], 6.0);
        mask.draw_disc([45.0, 20.0], 5.0);
        mask.draw_disc([0.0, 5.0], 12.0);
        components(&mask, 10)
    }

    #[test]
    fn parts_know_their_size_place_and_whether_they_are_cut() {
        let parts = picture();
        assert_eq!(parts.len(), 3);
        assert!(parts[0].cut && !parts[1].cut);
        assert_eq!(parts[1].centroid, [20.0, 20.0]);
    }

    #[test]
    fn largest_whole_part_wins_unless_base_or_last_place_say_otherwise() {
        let parts = picture();
        assert_eq!(choose(&parts, None, 3.0, None), Some(1));
        assert_eq!(choose(&parts, None, 3.0, Some([46.0, 20.0])), Some(2));
        assert_eq!(choose(&parts, Some([0.0, 5.0]), 3.0, None), Some(0));
        assert_eq!(choose(&[], None, 3.0, None), None);
    }
}
