//! A decoder's answer: how likely each cell is the mechanism's, and the silhouette that comes of it.

use super::array::Array;
use super::preprocess::{SIDE, View};
use crate::Mask;
use crate::pixel_runs::{Run, connected, runs};
use crate::spline::distance;
use crate::thin::radii;

/// Log odds over the encoder's picture, above 0 where the mechanism is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Logits {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Shape (height, width).
    pub(super) values: Vec<f32>,
}

/// Holes of so many cells or fewer are filled.
pub(super) const LARGEST_HOLE: usize = 8;
/// What a filled cell is set to: just inside.
const FILLED: f32 = 0.1;
/// A place is well inside where it is so deep, beside the deepest.
const DEEP_SHARE: f64 = 0.9;

impl Logits {
    /// The last two sizes of `array` are rows and columns; of what is before them, the part with number `place` is taken, or nothing
    /// where there are fewer.
    pub(super) fn of(array: &Array, place: usize) -> Self {
        let [height, width] = match array.shape[..] {
            [.., height, width] => [height, width],
            _ => [0, 0],
        };
        let size = width * height;
        match array.values.get(place * size..(place + 1) * size) {
            Some(values) => Self { width, height, values: values.to_vec() },
            None => Self { width: 0, height: 0, values: Vec::new() },
        }
    }

    /// Fills small holes, and specks of background that touch the border.
    pub(super) fn fill_holes(&mut self, largest: usize) {
        let outside: Vec<bool> = self.values.iter().map(|value| *value <= 0.0).collect();
        let regions = connected(&runs(&outside, self.width, true), true);
        for region in regions.iter().filter(|region| region.iter().map(Run::len).sum::<usize>() <= largest) {
            for run in region {
                self.values[run.row * self.width + run.from..run.row * self.width + run.to].fill(FILLED);
            }
        }
    }

    /// Where it is above 0, in the pictures' own pixels; bilinear between the cells' middles.
    pub(super) fn mask(&self, view: &View) -> Mask {
        let crop = view.crop;
        let mut mask =
            Mask::empty(crop.left as usize, crop.top as usize, crop.width as usize, crop.height as usize);
        if self.values.is_empty() {
            return mask;
        }
        let places = |pixels: usize, cells: usize| -> Vec<(usize, usize, f32)> {
            let at = |i: usize| {
                let at = (i as f64 + 0.5) * cells as f64 / pixels as f64 - 0.5;
                let at = at.clamp(0.0, (cells - 1) as f64);
                (at as usize, (at as usize + 1).min(cells - 1), at.fract() as f32)
            };
            (0..pixels).map(at).collect()
        };
        let columns = places(mask.width, self.width);
        let rows = mask.bits.chunks_exact_mut(mask.width.max(1));
        for (bits, (above, below, down)) in rows.zip(places(mask.height, self.height)) {
            let row = |y: usize| &self.values[y * self.width..(y + 1) * self.width];
            let (above, below) = (row(above), row(below));
            for (bit, &(left, right, across)) in bits.iter_mut().zip(&columns) {
                let upper = above[left] + across * (above[right] - above[left]);
                let lower = below[left] + across * (below[right] - below[left]);
                *bit = upper + down * (lower - upper) > 0.0;
            }
        }
        mask.framed(0)
    }

    /// Where it is above 0, in cells.
    fn cells(&self) -> Mask {
        let bits = self.values.iter().map(|value| *value > 0.0).collect();
        Mask { left: 0, top: 0, width: self.width, height: self.height, bits }
    }

    /// A place well inside the largest part, near that part's middle, in the encoder's picture \[px\]; none where nothing is above 0.
    pub(super) fn inside(&self) -> Option<[f32; 2]> {
        let parts = crate::component::components(&self.cells(), 1);
        let largest = parts.into_iter().max_by_key(|part| part.area)?;
        // Depth is told from what is outside: there must be some all round.
        let mask = largest.mask.framed(1);
        let cells: Vec<[f64; 2]> = mask.pixels().map(|(x, y)| [x as f64, y as f64]).collect();
        let depths = radii(&mask, &cells);
        let deepest = depths.iter().copied().fold(0.0, f64::max);
        let deep = cells.iter().zip(&depths).filter(|(_, depth)| **depth >= DEEP_SHARE * deepest);
        let [x, y] = deep
            .map(|(cell, _)| *cell)
            .min_by(|a, b| distance(*a, largest.centroid).total_cmp(&distance(*b, largest.centroid)))?;
        let there = |at: f64, cells: usize| ((at + 0.5) * SIDE as f64 / cells as f64) as f32;
        Some([there(x, self.width), there(y, self.height)])
    }

    /// Whether some cell within `reach` cells of the place `at` \[px of the encoder's picture\] is above 0.
    pub(super) fn near(&self, at: [f32; 2], reach: f32) -> bool {
        let cell = |at: f32, cells: usize| at * cells as f32 / SIDE as f32;
        let (x, y) = (cell(at[0], self.width), cell(at[1], self.height));
        self.values.iter().enumerate().any(|(i, value)| {
            let apart = [(i % self.width) as f32 + 0.5 - x, (i / self.width) as f32 + 0.5 - y];
            *value > 0.0 && apart[0].hypot(apart[1]) <= reach
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sam2::config::Crop;

    fn logits(width: usize, height: usize, at: impl Fn(usize, usize) -> f32) -> Logits {
        let values = (0..width * height).map(|i| at(i % width, i / width)).collect();
        Logits { width, height, values }
    }

    #[test]
    fn an_edge_between_cells_is_found_to_the_pixel_in_the_crop() {
        // Zero is passed at 20.25 cells from the left edge.
        let edge = logits(64, 64, |x, _| 20.25 - (x as f32 + 0.5));
        let crop = Crop { left: 100, top: 30, width: 512, height: 128 };
        let view = View::new((640, 480), Some(crop)).unwrap();
        let mask = edge.mask(&view);
        assert_eq!((mask.left, mask.top, mask.height), (100, 30, 128));
        // 8 px a cell; a pixel is inside when its middle is.
        assert_eq!(mask.width, 162);
        assert!(mask.bits.iter().all(|bit| *bit));
    }

    #[test]
    fn small_holes_are_filled_and_larger_ones_are_not() {
        let ring = |hole: usize| {
            logits(32, 32, move |x, y| if (10..10 + hole).contains(&x) && y == 9 { -3.0 } else { 5.0 })
        };
        for (hole, filled) in [(1, true), (8, true), (9, false)] {
            let mut logits = ring(hole);
            logits.fill_holes(LARGEST_HOLE);
            let inside = logits.values.iter().filter(|value| **value > 0.0).count();
            assert_eq!(inside == 32 * 32, filled, "{hole}");
        }
        // Corners join: two holes of eight that touch at a corner are one of sixteen.
        let mut corner = logits(32, 32, |x, y| {
            if (y == 9 && (2..10).contains(&x)) || (y == 10 && (10..18).contains(&x)) { -1.0 } else { 1.0 }
        });
        corner.fill_holes(LARGEST_HOLE);
        assert_eq!(corner.values.iter().filter(|value| **value <= 0.0).count(), 16);
    }

    #[test]
    fn a_place_inside_a_bent_arm_is_inside() {
        let bent = |x: usize, y: usize| (x == 40 || x == 41 || y == 60 || y == 61) && x >= 40 && y <= 61;
        let arm = logits(256, 256, |x, y| if bent(x, y) { 1.0 } else { -1.0 });
        let [x, y] = arm.inside().unwrap();
        assert!(bent((x / 4.0) as usize, (y / 4.0) as usize), "{x} {y}");
        assert!(arm.near([x, y], 1.0) && !arm.near([40.0, 900.0], 8.0));
        assert_eq!(logits(8, 8, |_, _| -1.0).inside(), None);
        // Of a bar 11 cells wide, the middle row: cell 105, whose middle is at 422.
        let bar =
            logits(
                256,
                256,
                |x, y| if (20..220).contains(&x) && (100..111).contains(&y) { 1.0 } else { -1.0 },
            );
        let [x, y] = bar.inside().unwrap();
        assert!((x - 480.0).abs() <= 4.0 && (y - 422.0).abs() <= 2.0, "{x} {y}");
    }
}
