//! Connected parts of a mask, and which of them is the mechanism.

use super::Mask;
use super::pixel_runs::{Run, connected, runs};
use super::spline::distance;
use camera::calibration::Px;

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
    let parts = connected(&runs(&mask.bits, mask.width, true), true);
    let large = parts.iter().filter(|part| part.iter().map(Run::len).sum::<usize>() >= min_area);
    large.map(|part| component(part, mask.width, mask.height)).collect()
}

fn component(part: &[Run], w: usize, h: usize) -> Component {
    let (mut x0, mut x1, mut y0, mut y1) = (w, 0, h, 0);
    let (mut area, mut sum_x, mut sum_y) = (0, 0, 0);
    for run in part {
        (x0, x1, y0, y1) = (x0.min(run.from), x1.max(run.to), y0.min(run.row), y1.max(run.row + 1));
        area += run.len();
        sum_x += run.len() * (run.from + run.to - 1) / 2;
        sum_y += run.len() * run.row;
    }
    let mut mask = Mask::empty(x0, y0, x1 - x0, y1 - y0);
    for run in part {
        let row = (run.row - y0) * mask.width;
        mask.bits[row + run.from - x0..row + run.to - x0].fill(true);
    }
    Component {
        mask,
        area,
        centroid: [sum_x as f64 / area as f64, sum_y as f64 / area as f64],
        cut: x0 == 0 || y0 == 0 || x1 == w || y1 == h,
    }
}

/// Which of `parts` of at least `least` pixels is the mechanism: the largest, for its distance from where it was
/// `last`; one the picture's border cuts only where `base_px` (within `reach_px`) says that the mechanism leaves
/// the picture, or when there is no other. With a base, a part that comes near it goes before any other.
pub fn choose(
    parts: &[Component],
    least: f64,
    base_px: Option<Px>,
    reach_px: f64,
    last: Option<Px>,
) -> Option<usize> {
    let near = |part: &Component, [x, y]: Px| {
        let rows = (y - reach_px).max(0.0) as usize..=(y + reach_px).max(0.0) as usize;
        rows.into_iter().any(|row| {
            let across = reach_px * reach_px - (row as f64 - y).powi(2);
            let mut columns = part.mask.row(row).iter().zip(part.mask.left..);
            columns.any(|(bit, column)| *bit && (column as f64 - x).powi(2) <= across)
        })
    };
    let rank = |part: &Component| {
        let near = base_px.is_some_and(|base| near(part, base));
        let size = (part.area as f64).sqrt();
        let moved = last.map_or(0.0, |last| distance(part.centroid, last));
        (near || !part.cut, near, part.area as f64 / (1.0 + moved / size))
    };
    let large = parts.iter().enumerate().filter(|(_, part)| part.area as f64 >= least);
    let ranks: Vec<_> = large.map(|(i, part)| (rank(part), i)).collect();
    let best = ranks.iter().max_by(|(a, i), (b, j)| {
        let ordering = a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal);
        ordering.then(j.cmp(i))
    });
    best.map(|(_, i)| *i)
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
        assert_eq!(choose(&parts, 0.0, None, 3.0, None), Some(1));
        assert_eq!(choose(&parts, 0.0, None, 3.0, Some([46.0, 20.0])), Some(2));
        assert_eq!(choose(&parts, 0.0, Some([0.0, 5.0]), 3.0, None), Some(0));
        assert_eq!(choose(&[], 0.0, None, 3.0, None), None);
    }
}
