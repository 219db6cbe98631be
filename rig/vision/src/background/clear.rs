//! What pixels show while the mechanism is elsewhere.

use ground::statistics::{MEDIAN_TO_SIGMA, median};
use image::GrayImage;

use super::Plane;
use super::levels::noise;

/// A pixel's clear view is looked for from this share of its sorted values on: mirrors and bubbles lie above.
const CLEAR_SHARE: f64 = 0.9;
/// Values this many sigmas below are still the clear view.
const CLEAR_SIGMAS: f32 = 6.0;

/// What each pixel shows while nothing dark (`sign` > 0) or bright covers it: the median of its values within
/// reach of its own clear end.
pub(super) fn clear_view(images: &[&GrayImage], sign: f32) -> Plane {
    const ROUNDS: usize = 3;
    let mut noises: Vec<f32> = images.iter().map(|image| noise(image)).collect();
    let noise = median(&mut noises, f32::total_cmp).unwrap_or(0.0);
    // A value that the mechanism's blurred edge shades while it rests there must stay out of reach, light that plays must not.
    let reach = CLEAR_SIGMAS * noise.max(play_of_light(images));
    let mut plane = Plane::of(images[0]);
    let mut values = vec![0u8; images.len()];
    for (i, grey) in plane.grey.iter_mut().enumerate() {
        for (value, image) in values.iter_mut().zip(images) {
            *value = image.as_raw()[i];
        }
        values.sort_unstable();
        if sign < 0.0 {
            values.reverse();
        }
        let mut clear = f32::from(values[((values.len() - 1) as f64 * CLEAR_SHARE).round() as usize]);
        // The clear end is a reflection now and then: from it down to where most clear values are.
        for _ in 0..ROUNDS {
            let first = values.partition_point(|&v| sign * (clear - f32::from(v)) > reach);
            let seen = &values[first..];
            clear = (f32::from(seen[(seen.len() - 1) / 2]) + f32::from(seen[seen.len() / 2])) / 2.0;
        }
        *grey = clear;
    }
    plane
}

/// How much a pixel of the empty tank changes from image to image, 1 sigma \[grey levels\]: most pixels are such.
fn play_of_light(images: &[&GrayImage]) -> f32 {
    /// Every so many-th pixel says enough.
    const STRIDE_PX: usize = 101;
    let middle = |mut values: Vec<f32>| median(&mut values, f32::total_cmp).unwrap_or(0.0);
    let pixels = images.iter().map(|image| image.as_raw().len()).min().unwrap_or(0);
    let of = |at: usize| {
        let values: Vec<f32> = images.iter().map(|image| f32::from(image.as_raw()[at])).collect();
        let usual = middle(values.clone());
        middle(values.into_iter().map(|value| (value - usual).abs()).collect())
    };
    MEDIAN_TO_SIGMA as f32 * middle((0..pixels).step_by(STRIDE_PX).map(of).collect())
}
