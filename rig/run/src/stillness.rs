//! Measures how still the picture is, to detect still water and motion in the live images.

use image::GrayImage;

/// Only every n-th pixel of every n-th row is compared, chosen: a link is tens of pixels wide.
const SAMPLING_STRIDE_PX: usize = 3;
/// A pixel counts as changed when it differs by more than this \[grey levels of 255\], chosen: well above camera noise.
const CHANGED_PIXEL_MIN_DIFFERENCE: u8 = 40;

/// Share of the pixels that differ between two pictures of one size; 1 when the sizes differ.
pub fn changed_share(before: &GrayImage, now: &GrayImage) -> f64 {
    if before.dimensions() != now.dimensions() || now.width() == 0 {
        return 1.0;
    }
    let width = now.width() as usize;
    let rows = before.chunks_exact(width).zip(now.chunks_exact(width)).step_by(SAMPLING_STRIDE_PX);
    let (mut looked_at, mut changed) = (0u32, 0u32);
    for (old, new) in rows {
        for (old, new) in old.iter().zip(new).step_by(SAMPLING_STRIDE_PX) {
            looked_at += 1;
            changed += u32::from(old.abs_diff(*new) > CHANGED_PIXEL_MIN_DIFFERENCE);
        }
    }
    f64::from(changed) / f64::from(looked_at.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    fn bar_at(x: u32, noise: u8) -> GrayImage {
        GrayImage::from_fn(320, 240, |column, row| {
            let grey = if (x..x + 20).contains(&column) { 40 } else { 200 };
            Luma([grey + ((column * 7 + row * 13) % 5) as u8 * noise])
        })
    }

    #[test]
    fn noise_is_still_and_a_shifted_link_is_not() {
        assert_eq!(changed_share(&bar_at(100, 0), &bar_at(100, 5)), 0.0);
        assert!(changed_share(&bar_at(100, 1), &bar_at(104, 2)) > 0.02);
    }

    #[test]
    fn another_size_is_no_comparison() {
        assert_eq!(changed_share(&bar_at(0, 0), &GrayImage::new(4, 4)), 1.0);
    }
}
