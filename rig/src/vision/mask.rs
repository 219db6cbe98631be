//! Silhouettes: which pixels of a rectangle of the picture belong to something.

use super::Px;

/// A rectangle of the picture with one bit a pixel. Outside it everything is background.
#[derive(Debug, Clone, PartialEq, Eq)]
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

/// The four neighbours that share an edge, then the four that share a corner.
pub(super) const NEIGHBOURS: [(isize, isize); 8] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

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

    /// Number of pixels inside.
    pub fn area(&self) -> usize {
        self.bits.iter().filter(|&&bit| bit).count()
    }

    /// Pixels inside, as picture `(column, row)`, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let place = |i: usize| (self.left + i % self.width, self.top + i / self.width);
        self.bits.iter().enumerate().filter(|(_, bit)| **bit).map(move |(i, _)| place(i))
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

    /// The same pixels in a rectangle with `margin` empty pixels all round, cut at the picture's left and top.
    pub fn padded(&self, margin: usize) -> Self {
        let (left, top) = (self.left.saturating_sub(margin), self.top.saturating_sub(margin));
        let width = self.left + self.width + margin - left;
        let height = self.top + self.height + margin - top;
        let mut out = Self::empty(left, top, width, height);
        for (column, row) in self.pixels() {
            out.set(column as isize, row as isize);
        }
        out
    }

    /// Fills every hole of at most `largest` pixels and returns the size of the largest one left open.
    ///
    /// A hole is background that no path of edge-sharing pixels connects with the outside.
    pub fn fill_holes(&mut self, largest: usize) -> usize {
        let (w, h) = (self.width, self.height);
        let mut seen = self.bits.clone();
        let mut open = 0;
        for start in 0..w * h {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let (mut region, mut outside) = (vec![start], false);
            let mut next = 0;
            while next < region.len() {
                let (x, y) = (region[next] % w, region[next] / w);
                next += 1;
                outside |= x == 0 || y == 0 || x + 1 == w || y + 1 == h;
                for (dx, dy) in &NEIGHBOURS[..4] {
                    let (Some(nx), Some(ny)) = (x.checked_add_signed(*dx), y.checked_add_signed(*dy)) else {
                        continue;
                    };
                    if nx < w && ny < h && !seen[ny * w + nx] {
                        seen[ny * w + nx] = true;
                        region.push(ny * w + nx);
                    }
                }
            }
            if outside {
                continue;
            }
            if region.len() <= largest {
                region.iter().for_each(|&i| self.bits[i] = true);
            } else {
                open = open.max(region.len());
            }
        }
        open
    }

    /// Pixels inside both, over pixels inside either; 1 when both are empty.
    pub fn overlap(&self, other: &Self) -> f64 {
        let both = self.pixels().filter(|&(x, y)| other.at(x as isize, y as isize)).count();
        let either = self.area() + other.area() - both;
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }

    /// Sets every pixel whose centre is within `radius` \[px\] of `centre`.
    pub fn draw_disc(&mut self, centre: Px, radius: f64) {
        let reach = |c: f64| ((c - radius).ceil() as isize, (c + radius).floor() as isize);
        let ((x0, x1), (y0, y1)) = (reach(centre[0]), reach(centre[1]));
        for y in y0..=y1 {
            let across = radius * radius - (y as f64 - centre[1]).powi(2);
            for x in x0..=x1 {
                if (x as f64 - centre[0]).powi(2) <= across {
                    self.set(x, y);
                }
            }
        }
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
    fn overlap_is_one_with_itself_and_zero_with_what_lies_apart() {
        let mask = ring();
        assert_eq!(mask.overlap(&mask.padded(2)), 1.0);
        let apart = Mask { left: 50, ..mask.clone() };
        assert_eq!(mask.overlap(&apart), 0.0);
        assert_eq!(mask.centroid().unwrap(), [7.0, 8.0]);
    }
}
