//! Silhouettes: which pixels of a rectangle of the picture belong to something.

use serde::{Deserialize, Serialize};

use super::pixel_runs::{Run, connected, runs};
use camera::calibration::Px;

/// A rectangle of the picture with one bit a pixel. Outside it everything is background.
///
/// Stored as the lengths of its runs, see [`StoredMask`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "StoredMask", try_from = "StoredMask")]
pub struct Mask {
    /// Column of the rectangle's left edge in the picture \[px\].
    pub left: usize,
    /// Row of its top edge \[px\].
    pub top: usize,
    /// Width \[px\].
    pub width: usize,
    /// Height \[px\].
    pub height: usize,
    /// Row after row, shape (height, width).
    pub bits: Vec<bool>,
}

/// A [`Mask`] as it is stored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredMask {
    /// Column of the rectangle's left edge in the picture \[px\].
    pub left: usize,
    /// Row of its top edge \[px\].
    pub top: usize,
    /// Width \[px\].
    pub width: usize,
    /// Height \[px\].
    pub height: usize,
    /// How many pixels are outside, then inside, then outside and so on, row after row \[px\].
    pub runs: Vec<usize>,
}

/// Why a stored mask is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("mask of {width}x{height} px at column {left}, row {top}: {what}")]
pub struct StoredMaskError {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    what: String,
}

impl Mask {
    /// An empty mask of the given place and size.
    pub fn empty(left: usize, top: usize, width: usize, height: usize) -> Self {
        Self { left, top, width, height, bits: vec![false; width * height] }
    }

    /// Whether the picture's pixel is inside; false outside the rectangle.
    pub fn at(&self, column: isize, row: isize) -> bool {
        let (x, y) = (column - self.left as isize, row - self.top as isize);
        x >= 0
            && y >= 0
            && x < self.width as isize
            && y < self.height as isize
            && self.bits[y as usize * self.width + x as usize]
    }

    /// Sets the picture's pixel when it lies in the rectangle.
    pub fn set(&mut self, column: isize, row: isize) {
        let (x, y) = (column - self.left as isize, row - self.top as isize);
        if x >= 0 && y >= 0 && x < self.width as isize && y < self.height as isize {
            self.bits[y as usize * self.width + x as usize] = true;
        }
    }

    /// The picture's row `row` of the rectangle, from column [`Self::left`] on; empty outside it.
    pub fn row(&self, row: usize) -> &[bool] {
        match row.checked_sub(self.top) {
            Some(y) if y < self.height => &self.bits[y * self.width..(y + 1) * self.width],
            _ => &[],
        }
    }

    /// Number of pixels inside.
    pub fn area(&self) -> usize {
        self.bits.iter().filter(|&&bit| bit).count()
    }

    /// Pixels inside, as picture `(column, row)`, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let rows = self.bits.chunks_exact(self.width.max(1)).zip(self.top..);
        rows.flat_map(|(bits, row)| {
            bits.iter().zip(self.left..).filter(|(bit, _)| **bit).map(move |(_, column)| (column, row))
        })
    }

    /// The whole picture of the given size, 255 inside.
    pub fn picture(&self, width: u32, height: u32) -> image::GrayImage {
        image::GrayImage::from_fn(width, height, |column, row| {
            image::Luma([if self.at(column as isize, row as isize) { 255 } else { 0 }])
        })
    }

    /// Mean position \[px\]; `None` when empty.
    pub fn centroid(&self) -> Option<Px> {
        let (mut n, mut sum) = (0.0, [0.0, 0.0]);
        for (column, row) in self.pixels() {
            n += 1.0;
            sum = [sum[0] + column as f64, sum[1] + row as f64];
        }
        (n > 0.0).then(|| [sum[0] / n, sum[1] / n])
    }

    /// The same pixels in the smallest rectangle that holds them, grown by `margin` empty pixels all round, cut at
    /// the picture's left and top. An empty mask keeps its rectangle.
    pub fn framed(&self, margin: usize) -> Self {
        let set = runs(&self.bits, self.width, true);
        let (Some(first), Some(last)) = (set.first(), set.last()) else { return self.clone() };
        let from = set.iter().map(|run| run.from).min().unwrap_or(0);
        let to = set.iter().map(|run| run.to).max().unwrap_or(0);
        let (left, top) =
            ((self.left + from).saturating_sub(margin), (self.top + first.row).saturating_sub(margin));
        let (right, bottom) = (self.left + to + margin, self.top + last.row + 1 + margin);
        let mut out = Self::empty(left, top, right - left, bottom - top);
        for run in set {
            let start = (self.top + run.row - top) * out.width + self.left + run.from - left;
            out.bits[start..start + run.len()].fill(true);
        }
        out
    }

    /// The same grown by `reach` pixels each way (a square), with a frame of empty pixels around it, cut at the
    /// picture's left and top.
    pub fn grown(&self, reach: usize) -> Self {
        let mut out = self.framed(reach + 1);
        let (right, bottom) = (out.left + out.width, out.top + out.height);
        for run in runs(&self.bits, self.width, true) {
            let (row, from, to) = (self.top + run.row, self.left + run.from, self.left + run.to);
            let columns = from.saturating_sub(reach) - out.left..(to + reach).min(right) - out.left;
            for row in row.saturating_sub(reach)..(row + reach + 1).min(bottom) {
                let start = (row - out.top) * out.width;
                out.bits[start + columns.start..start + columns.end].fill(true);
            }
        }
        out
    }

    /// The same as a mask of a whole picture of `width` by `height` pixels.
    pub fn over(&self, width: usize, height: usize) -> Self {
        let mut out = Self::empty(0, 0, width, height);
        for (x, y) in self.pixels().filter(|&(x, y)| x < width && y < height) {
            out.bits[y * width + x] = true;
        }
        out
    }

    /// The same without the pixels of `other`.
    pub fn without(mut self, other: &Self) -> Self {
        let (left, top, width) = (self.left, self.top, self.width.max(1));
        for (i, bit) in self.bits.iter_mut().enumerate().filter(|(_, bit)| **bit) {
            *bit = !other.at((left + i % width) as isize, (top + i / width) as isize);
        }
        self
    }

    /// Fills every hole of at most `largest` pixels and returns the size of the largest one left open.
    ///
    /// A hole is background that no path of edge-sharing pixels connects with the outside.
    pub fn fill_holes(&mut self, largest: usize) -> usize {
        let mut open = 0;
        for region in connected(&runs(&self.bits, self.width, false), false) {
            let outside = |run: &Run| {
                run.row == 0 || run.row + 1 == self.height || run.from == 0 || run.to == self.width
            };
            if region.iter().any(outside) {
                continue;
            }
            let size = region.iter().map(Run::len).sum();
            if size > largest {
                open = open.max(size);
                continue;
            }
            for run in region {
                let row = run.row * self.width;
                self.bits[row + run.from..row + run.to].fill(true);
            }
        }
        open
    }

    /// Pixels inside both, over pixels inside either; 1 when both are empty.
    pub fn overlap(&self, other: &Self) -> f64 {
        let both = self.shared(other);
        let either = self.area() + other.area() - both;
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }

    /// Number of pixels inside both.
    pub fn shared(&self, other: &Self) -> usize {
        let left = self.left.max(other.left);
        if left >= (self.left + self.width).min(other.left + other.width) {
            return 0;
        }
        let in_row = |row: usize| {
            let (mine, theirs) = (&self.row(row)[left - self.left..], &other.row(row)[left - other.left..]);
            mine.iter().zip(theirs).filter(|(a, b)| **a && **b).count()
        };
        let rows = self.top.max(other.top)..(self.top + self.height).min(other.top + other.height);
        rows.map(in_row).sum()
    }

    /// Sets every pixel whose centre is within `radius` \[px\] of `centre`.
    pub fn draw_disc(&mut self, centre: Px, radius: f64) {
        let rows = (centre[1] - radius).ceil().max(self.top as f64) as usize
            ..=(centre[1] + radius).floor().min((self.top + self.height) as f64 - 1.0).max(-1.0) as usize;
        for y in rows {
            let across = radius * radius - (y as f64 - centre[1]).powi(2);
            if across >= 0.0 {
                self.draw_run(y, centre[0] - across.sqrt(), centre[0] + across.sqrt());
            }
        }
    }

    /// Sets every pixel of the picture's row `row` whose centre is between columns `from` and `to`.
    fn draw_run(&mut self, row: usize, from: f64, to: f64) {
        let column = |c: f64| (c - self.left as f64).clamp(0.0, self.width as f64) as usize;
        let (from, to) = (column(from.ceil()), column(to.floor() + 1.0));
        if from < to && row >= self.top && row < self.top + self.height {
            let start = (row - self.top) * self.width;
            self.bits[start + from..start + to].fill(true);
        }
    }
}

impl From<Mask> for StoredMask {
    fn from(mask: Mask) -> Self {
        // the first one is outside, if of no length
        let begins_inside = mask.bits.first().is_none_or(|&bit| bit);
        let lengths = mask.bits.chunk_by(|a, b| a == b).map(<[bool]>::len);
        let runs = begins_inside.then_some(0).into_iter().chain(lengths).collect();
        let Mask { left, top, width, height, .. } = mask;
        Self { left, top, width, height, runs }
    }
}

impl TryFrom<StoredMask> for Mask {
    type Error = StoredMaskError;

    fn try_from(stored: StoredMask) -> Result<Self, StoredMaskError> {
        /// No camera's pictures are larger; keeps damaged numbers from asking for all memory [px].
        const MOST_SIDE: usize = 1 << 14;
        let StoredMask { left, top, width, height, runs } = stored;
        let refuse = |what: String| Err(StoredMaskError { left, top, width, height, what });
        if [left, top, width, height].iter().any(|&side| side > MOST_SIDE) {
            return refuse(format!("no side may exceed {MOST_SIDE} px"));
        }
        let covered = runs.iter().try_fold(0usize, |sum, &run| sum.checked_add(run));
        if covered != Some(width * height) {
            return refuse(format!("its runs must cover {} px", width * height));
        }
        let mut mask = Self::empty(left, top, width, height);
        let mut start = 0;
        for (i, run) in runs.into_iter().enumerate() {
            mask.bits[start..start + run].fill(i % 2 == 1);
            start += run;
        }
        Ok(mask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring() -> Mask {
        let mut mask = Mask::empty(3, 4, 9, 9);
        mask.draw_disc([7.0, 8.0], 4.0);
        mask.bits[4 * 9 + 4] = false;
        mask
    }

    #[test]
    fn small_hole_is_filled_and_large_one_reported() {
        let mut mask = ring();
        let area = mask.area();
        assert_eq!(mask.clone().fill_holes(0), 1);
        assert_eq!(mask.fill_holes(1), 0);
        assert_eq!(mask.area(), area + 1);
    }

    #[test]
    fn stored_mask_comes_back_and_a_damaged_one_is_refused() {
        let mask = ring();
        let stored = StoredMask::from(mask.clone());
        assert_eq!(Mask::try_from(stored.clone()).unwrap(), mask);
        let full = Mask { bits: vec![true; 6], ..Mask::empty(1, 2, 3, 2) };
        assert_eq!(StoredMask::from(full.clone()).runs, [0, 6]);
        assert_eq!(Mask::try_from(StoredMask::from(full.clone())).unwrap(), full);
        for damaged in [
            StoredMask { runs: vec![81, 1], ..stored.clone() },
            StoredMask { runs: vec![usize::MAX, 82], ..stored.clone() },
            StoredMask { width: 1 << 40, ..stored },
        ] {
            assert!(Mask::try_from(damaged).unwrap_err().to_string().starts_with("mask of "));
        }
    }

    #[test]
    fn grown_mask_reaches_as_far_each_way_and_framed_one_is_as_small_as_can_be() {
        let mut mask = Mask::empty(2, 3, 20, 20);
        mask.set(10, 12);
        let grown = mask.grown(2);
        assert_eq!((grown.left, grown.top, grown.width, grown.height, grown.area()), (7, 9, 7, 7, 25));
        assert!(grown.at(8, 10) && grown.at(12, 14) && !grown.at(7, 12));
        assert_eq!(mask.framed(0), Mask { bits: vec![true], ..Mask::empty(10, 12, 1, 1) });
    }

    #[test]
    fn overlap_is_one_with_itself_and_zero_with_what_lies_apart() {
        let mask = ring();
        assert_eq!(mask.overlap(&mask.framed(2)), 1.0);
        let apart = Mask { left: 50, ..mask.clone() };
        assert_eq!(mask.overlap(&apart), 0.0);
        assert_eq!(mask.centroid().unwrap(), [7.0, 8.0]);
    }
}
