//! How much of each pixel convex polygons cover, as a lens shows it.
//!
//! The union is sampled on eight sub-rows a pixel, exactly along each, then blurred: sub-pixel edges are where they should
//! be, also where polygons overlap or only touch.

use crate::calibration::Px;

/// Sub-rows per pixel row, chosen.
const SUB_ROWS: usize = 8;
/// The blur's kernel is cut off after this many sigmas, chosen.
const KERNEL_SIGMAS: f64 = 3.0;

/// How much of each pixel of a rectangle is covered, blurred.
pub struct Coverage {
    left: usize,
    top: usize,
    width: usize,
    cover: Vec<f32>,
}

impl Coverage {
    /// The union of convex `polygons`; `None` when nothing of it is in the picture.
    pub fn of(polygons: &[Vec<Px>], blur_px: f64, width: u32, height: u32) -> Option<Self> {
        let corners = || polygons.iter().flatten().filter(|p| p[0].is_finite() && p[1].is_finite());
        let margin = KERNEL_SIGMAS * blur_px + 1.0;
        let bound = |axis: usize, size: u32| {
            let low = corners().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - margin;
            let high = corners().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + margin;
            let (low, high) = (low.floor().max(0.0), high.ceil().min(f64::from(size) - 1.0));
            (low <= high).then_some((low as usize, high as usize))
        };
        let ((left, right), (top, bottom)) = (bound(0, width)?, bound(1, height)?);
        let (width, height) = (right + 1 - left, bottom + 1 - top);
        let mut coverage = Self { left, top, width, cover: vec![0.0; width * height] };
        let mut rows: Vec<Vec<(f64, f64)>> = vec![Vec::new(); height * SUB_ROWS];
        for polygon in polygons {
            coverage.cut(polygon, &mut rows);
        }
        for (i, spans) in rows.iter_mut().enumerate() {
            let row = i / SUB_ROWS * width;
            add_union(spans, &mut coverage.cover[row..row + width]);
        }
        coverage.blur(blur_px);
        Some(coverage)
    }

    /// Adds where each sub-row runs through `polygon`, in pixels from the rectangle's left edge.
    fn cut(&self, polygon: &[Px], rows: &mut [Vec<(f64, f64)>]) {
        let per = SUB_ROWS as f64;
        // Sub-row i runs at this height; the centre of the picture's first row is 0.
        let height = |i: usize| self.top as f64 - 0.5 + (i as f64 + 0.5) / per;
        let place = |y: f64| (y - self.top as f64 + 0.5) * per - 0.5;
        let lowest = polygon.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let highest = polygon.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        let first = place(lowest).ceil().max(0.0) as usize;
        let end = (place(highest).floor() + 1.0).clamp(0.0, rows.len() as f64) as usize;
        let mut spans = vec![(f64::INFINITY, f64::NEG_INFINITY); end.saturating_sub(first)];
        for (k, a) in polygon.iter().enumerate() {
            let b = polygon[(k + 1) % polygon.len()];
            let (low, high) = if a[1] <= b[1] { (*a, b) } else { (b, *a) };
            let from = place(low[1]).ceil().max(first as f64) as usize;
            let to = (place(high[1]).floor() + 1.0).clamp(0.0, end as f64) as usize;
            for i in from..to.max(from) {
                let share = (height(i) - low[1]) / (high[1] - low[1]).max(f64::MIN_POSITIVE);
                let x = low[0] + share * (high[0] - low[0]) - self.left as f64 + 0.5;
                let span = &mut spans[i - first];
                *span = (span.0.min(x), span.1.max(x));
            }
        }
        for (row, span) in rows[first.min(end)..end].iter_mut().zip(spans) {
            if span.0 < span.1 {
                row.push(span);
            }
        }
    }

    /// Blurs with a Gaussian kernel, along the rows and then along the columns.
    fn blur(&mut self, sigma: f64) {
        if sigma <= 0.0 {
            return;
        }
        let reach = (KERNEL_SIGMAS * sigma).ceil() as usize;
        let bell: Vec<f64> =
            (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
        let sum: f64 = bell.iter().sum();
        let bell: Vec<f32> = bell.iter().map(|weight| (weight / sum) as f32).collect();
        let (width, height) = (self.width, self.cover.len() / self.width);
        let mut across = vec![0.0f32; self.cover.len()];
        for (from, to) in self.cover.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
            for (k, weight) in bell.iter().enumerate() {
                // Column x takes from column x + k - reach, as far as the rectangle goes.
                let (skip, lead) = (k.saturating_sub(reach), reach.saturating_sub(k));
                let source = from.iter().skip(skip);
                to.iter_mut().skip(lead).zip(source).for_each(|(t, f)| *t += weight * f);
            }
        }
        self.cover.fill(0.0);
        for y in 0..height {
            let to = &mut self.cover[y * width..(y + 1) * width];
            for (k, weight) in bell.iter().enumerate() {
                let Some(row) = (y + k).checked_sub(reach).filter(|row| *row < height) else { continue };
                let from = &across[row * width..(row + 1) * width];
                to.iter_mut().zip(from).for_each(|(t, f)| *t += weight * f);
            }
        }
    }

    /// Column, row and cover of each pixel.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize, f32)> + '_ {
        let rows = self.cover.chunks_exact(self.width).enumerate();
        rows.flat_map(move |(y, row)| {
            row.iter().enumerate().map(move |(x, cover)| (self.left + x, self.top + y, *cover))
        })
    }
}

/// Adds one sub-row's share to the cover of a row of pixels: the union of `spans`, in pixels from the left.
fn add_union(spans: &mut [(f64, f64)], cover: &mut [f32]) {
    const ROW_SHARE: f64 = 1.0 / SUB_ROWS as f64;
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut done = 0.0f64;
    for &(from, to) in spans.iter() {
        let (from, to) = (from.max(done), to.min(cover.len() as f64));
        if from >= to {
            continue;
        }
        done = to;
        let (first, last) = (from as usize, (to.ceil() as usize).max(1) - 1);
        if first == last {
            cover[first] += (ROW_SHARE * (to - from)) as f32;
        } else {
            cover[first] += (ROW_SHARE * (first as f64 + 1.0 - from)) as f32;
            cover[first + 1..last].iter_mut().for_each(|pixel| *pixel += ROW_SHARE as f32);
            cover[last] += (ROW_SHARE * (to - last as f64)) as f32;
        }
    }
}
