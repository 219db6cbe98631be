//! A picture as numbers, smoothed.

use image::GrayImage;

use camera::calibration::Px;

/// Grey levels of a smoothed picture, shape (height, width).
#[derive(Debug, Clone)]
pub(super) struct Field {
    pub(super) width: usize,
    pub(super) height: usize,
    grey: Vec<f32>,
}

impl Field {
    /// The picture's grey levels as they are.
    pub(super) fn of(picture: &GrayImage) -> Self {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        Self { width, height, grey: picture.as_raw().iter().map(|&grey| f32::from(grey)).collect() }
    }

    /// Half as large: each number is the mean of four. Place `x` of it lies at `2 x + 0.5` of the larger one.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            (self.at(x, y) + self.at(x + 1, y) + self.at(x, y + 1) + self.at(x + 1, y + 1)) / 4.0
        };
        Self { width, height, grey: (0..width * height).map(mean).collect() }
    }

    /// Smoothed by a normal distribution of `sigma` \[px\]; beyond its border a picture goes on as it ends.
    pub(super) fn smoothed(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as usize;
        let mut kernel: Vec<f32> =
            (0..=2 * reach).map(|i| (-0.5 * ((i as f32 - reach as f32) / sigma).powi(2)).exp()).collect();
        let sum: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|weight| *weight /= sum);
        let across = convolve(&self.grey, self.width, &kernel);
        // Turned over, columns are rows.
        let down = convolve(&turned(&across, self.width), self.height, &kernel);
        Self { grey: turned(&down, self.height), ..*self }
    }

    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        self.grey[y * self.width + x]
    }

    /// Between the pixels; `None` outside.
    pub(super) fn between(&self, [x, y]: Px) -> Option<f32> {
        if !(x >= 0.0 && y >= 0.0 && x <= self.width as f64 - 1.0 && y <= self.height as f64 - 1.0) {
            return None;
        }
        let (column, row) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (fx, fy) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let upper = self.at(column, row) * (1.0 - fx) + self.at(column + 1, row) * fx;
        let lower = self.at(column, row + 1) * (1.0 - fx) + self.at(column + 1, row + 1) * fx;
        Some(upper * (1.0 - fy) + lower * fy)
    }

    /// Slope along the row and along the column \[1/px\], for pixels that are not at the border.
    pub(super) fn gradient(&self, x: usize, y: usize) -> [f64; 2] {
        let across = self.at(x + 1, y) - self.at(x - 1, y);
        let down = self.at(x, y + 1) - self.at(x, y - 1);
        [f64::from(across) / 2.0, f64::from(down) / 2.0]
    }

    /// How much the pixel is a saddle: minus the determinant of the second derivatives \[1/px⁴\], for pixels not at the border.
    pub(super) fn saddle(&self, x: usize, y: usize) -> f32 {
        let middle = 2.0 * self.at(x, y);
        let xx = self.at(x + 1, y) + self.at(x - 1, y) - middle;
        let yy = self.at(x, y + 1) + self.at(x, y - 1) - middle;
        let corners =
            self.at(x + 1, y + 1) + self.at(x - 1, y - 1) - self.at(x + 1, y - 1) - self.at(x - 1, y + 1);
        let xy = corners / 4.0;
        xy * xy - xx * yy
    }
}

/// Each row of `width` numbers under the kernel.
fn convolve(numbers: &[f32], width: usize, kernel: &[f32]) -> Vec<f32> {
    let reach = kernel.len() / 2;
    let mut out = Vec::with_capacity(numbers.len());
    let mut padded = vec![0.0; width + 2 * reach];
    for row in numbers.chunks_exact(width) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        out.extend(padded.windows(kernel.len()).map(|part| {
            let products = part.iter().zip(kernel).map(|(number, weight)| number * weight);
            products.sum::<f32>()
        }));
    }
    out
}

/// Rows to columns, of numbers in rows of `width`.
fn turned(numbers: &[f32], width: usize) -> Vec<f32> {
    let height = numbers.len() / width;
    let mut out = vec![0.0; numbers.len()];
    for (y, row) in numbers.chunks_exact(width).enumerate() {
        for (x, &number) in row.iter().enumerate() {
            out[x * height + y] = number;
        }
    }
    out
}
