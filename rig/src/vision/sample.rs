//! Reading grey values between pixels.

use super::Px;

/// `values`, shape (height, width), at `px`: bilinear between the four pixels around; 0 outside.
pub fn bilinear(values: &[f32], width: usize, height: usize, px: Px) -> f64 {
    let [x, y] = px;
    if !(x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64) {
        return 0.0;
    }
    let (column, row) =
        ((x as usize).min(width.saturating_sub(2)), (y as usize).min(height.saturating_sub(2)));
    let (u, v) = (x - column as f64, y - row as f64);
    let right = if column + 1 < width { 1 } else { 0 };
    let below = if row + 1 < height { width } else { 0 };
    let at = |i: usize| f64::from(values[i]);
    let i = row * width + column;
    let upper = at(i) + u * (at(i + right) - at(i));
    let lower = at(i + below) + u * (at(i + below + right) - at(i + below));
    upper + v * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_is_read_exactly_and_zero_outside() {
        let values: Vec<f32> = (0..12).map(|i| (i % 4) as f32 + 10.0 * (i / 4) as f32).collect();
        assert_eq!(bilinear(&values, 4, 3, [1.25, 0.5]), 6.25);
        assert_eq!(bilinear(&values, 4, 3, [3.0, 2.0]), 23.0);
        for outside in [[-0.1, 0.0], [3.1, 0.0], [0.0, 2.1], [f64::NAN, 0.0]] {
            assert_eq!(bilinear(&values, 4, 3, outside), 0.0);
        }
    }
}
