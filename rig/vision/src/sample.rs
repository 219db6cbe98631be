//! Reading grey values between pixels.

use camera::calibration::Px;

/// `values`, shape (height, width), at `px`: bilinear between the four pixels around; 0 outside.
#[inline]
pub fn bilinear(values: &[f32], width: usize, height: usize, px: Px) -> f64 {
    let [x, y] = px;
    if !(x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64) {
        return 0.0;
    }
    // Pictures are far smaller than 2^31 pixels a side, and this conversion is the quicker one.
    let (column, row) = (x as i32, y as i32);
    let (u, v) = (x - f64::from(column), y - f64::from(row));
    let i = row as usize * width + column as usize;
    // On the last column or row what lies beyond has no weight.
    let right = usize::from(column as usize + 1 < width);
    let below = if (row as usize) + 1 < height { width } else { 0 };
    let across = |row: &[f32]| {
        let (a, b) = (f64::from(row[0]), f64::from(row[right]));
        a + u * (b - a)
    };
    let (upper, lower) = (across(&values[i..=i + right]), across(&values[i + below..=i + below + right]));
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
