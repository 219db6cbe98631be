//! How much an image's parts differ, and what of that is noise.

use ground::statistics::MEDIAN_TO_SIGMA;
use image::GrayImage;

use crate::rejection::Rejection;

/// Multiple of the noise that no background pixel reaches.
pub(super) const NOISE_REACH: f32 = 4.0;
/// Contrast below which nothing is told apart even without noise \[grey levels\]: compression leaves as much.
pub(super) const LEAST_CONTRAST: f32 = 6.0;
/// Largest share of an image that a mechanism may cover.
const MOST_COVER: f64 = 0.5;

/// What the mechanism differs by: the median of what exceeds half of itself, found by iteration.
pub(super) fn level(values: &[f32], noise: f32, min_area_px: f64) -> Result<f32, Rejection> {
    const ROUNDS: usize = 12;
    let least = (NOISE_REACH * noise).max(LEAST_CONTRAST);
    let mut histogram = [0usize; 256];
    for block in values.chunks(64) {
        // Most of a picture is background: it is passed over a block at a time.
        if block.iter().fold(false, |any, &v| any | (v > least)) {
            block.iter().filter(|&&v| v > least).for_each(|&v| histogram[v as usize & 255] += 1);
        }
    }
    let mut threshold = least;
    for _ in 0..ROUNDS {
        let from = threshold as usize;
        let count: usize = histogram[from..].iter().sum();
        if (count as f64) < min_area_px {
            return Err(Rejection::NoContrast { least, area_px: count });
        }
        if count as f64 > MOST_COVER * values.len() as f64 {
            return Err(Rejection::NoContrast { least: threshold, area_px: count });
        }
        let mut passed = 0;
        let middle = (from..256).find(|&v| {
            passed += histogram[v];
            2 * passed >= count
        });
        let next = (middle.unwrap_or(255) as f32 / 2.0).max(least);
        if (next - threshold).abs() < 0.5 {
            break;
        }
        threshold = next;
    }
    Ok(2.0 * threshold)
}

/// Noise of one pixel \[grey levels\], from the differences of neighbours; at least that of quantisation.
pub(super) fn noise(image: &GrayImage) -> f32 {
    /// The root undoes the sum of two noises.
    const DIFFERENCE_TO_SIGMA: f32 = MEDIAN_TO_SIGMA as f32 / std::f32::consts::SQRT_2;
    const QUANTISATION_GREY: f32 = 0.3;
    /// Most cameras' noise is below this.
    const USUAL_NOISE_GREY: usize = 15;
    let total = (image.width() as usize).saturating_sub(1) * image.height() as usize;
    // The median by halving its range: counting what is below a limit is quicker than a histogram. `below`
    // and `up_to` are how many differ by less than `least`, and by no more than `most`.
    let (mut least, mut below) = (0, 0);
    let (mut most, mut up_to) = (USUAL_NOISE_GREY, smaller_steps(image, USUAL_NOISE_GREY + 1));
    if 2 * up_to < total.max(1) {
        (least, below, most, up_to) = (USUAL_NOISE_GREY + 1, up_to, 255, total);
    }
    while least < most {
        let middle = (least + most) / 2;
        let count = smaller_steps(image, middle + 1);
        if 2 * count >= total.max(1) {
            (most, up_to) = (middle, count);
        } else {
            (least, below) = (middle + 1, count);
        }
    }
    // Sizes are rounded: the median lies inside this one, in proportion.
    let inside = (total as f32 / 2.0 - below as f32) / (up_to - below).max(1) as f32;
    ((least as f32 - 0.5 + inside).max(0.0) * DIFFERENCE_TO_SIGMA).max(QUANTISATION_GREY)
}

/// How many neighbours in a row differ by less than `limit` grey levels.
fn smaller_steps(image: &GrayImage, limit: usize) -> usize {
    /// No more than a byte can count, in whole registers.
    const BLOCK_PX: usize = 240;
    let Some(most) = limit.checked_sub(1) else { return 0 };
    let most = most.min(255) as u8;
    let mut count = 0;
    for row in image.as_raw().chunks_exact(image.width().max(1) as usize) {
        for (left, right) in row.chunks(BLOCK_PX).zip(row[1..].chunks(BLOCK_PX)) {
            let small = left
                .iter()
                .zip(right)
                .map(|(a, b)| u8::from((*a).max(*b).wrapping_sub((*a).min(*b)) <= most));
            count += usize::from(small.fold(0u8, u8::wrapping_add));
        }
    }
    count
}
