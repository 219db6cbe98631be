//! What a picture says of focus, light and exposure.

use image::GrayImage;
use serde::Serialize;

/// Shares of a picture's pixels that are as light and as dark as can be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Saturation {
    /// As light: what they really are is lost.
    pub light_share: f64,
    /// As dark.
    pub dark_share: f64,
}

/// Grey levels of a picture, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct GreyRange {
    /// One pixel in a hundred is darker.
    pub low: u8,
    /// The middle one.
    pub middle: u8,
    /// One pixel in a hundred is lighter.
    pub high: u8,
}

/// How many pixels have each grey level.
fn histogram(image: &GrayImage) -> [u64; 256] {
    let mut counts = [0; 256];
    image.as_raw().iter().for_each(|&grey| counts[usize::from(grey)] += 1);
    counts
}

/// See [`Saturation`]; none of an empty picture.
pub fn saturation(image: &GrayImage) -> Option<Saturation> {
    let counts = histogram(image);
    let all = image.as_raw().len();
    let share = |count: u64| count as f64 / all as f64;
    (all > 0).then(|| Saturation { light_share: share(counts[255]), dark_share: share(counts[0]) })
}

/// See [`GreyRange`]; none of an empty picture.
pub fn grey_range(image: &GrayImage) -> Option<GreyRange> {
    let counts = histogram(image);
    let all = image.as_raw().len() as u64;
    let level = |below: u64| {
        let mut counted = 0;
        counts.iter().zip(0..=u8::MAX).find_map(|(count, level)| {
            counted += count;
            (counted > below).then_some(level)
        })
    };
    Some(GreyRange { low: level(all / 100)?, middle: level(all / 2)?, high: level(all - all.div_ceil(100))? })
}

/// Mean grey level; none of an empty picture.
pub fn mean_grey(image: &GrayImage) -> Option<f64> {
    let sum: u64 = image.as_raw().iter().map(|&grey| u64::from(grey)).sum();
    (!image.as_raw().is_empty()).then(|| sum as f64 / image.as_raw().len() as f64)
}

/// The width is measured on the steepest pixels: this share of the picture, and at least this many. Chosen.
const EDGE_PIXELS_SHARE: f64 = 1e-3;
const MIN_EDGE_PIXELS: usize = 20;
/// Distance around a steep pixel in which the grey levels of both sides are searched \[px\]; wider edges count as this wide. Chosen.
const EDGE_SEARCH_RADIUS_PX: u32 = 12;
/// Lower steps count as noise \[grey levels\]. Chosen.
const MIN_STEP_GREY_LEVELS: f64 = 16.0;

/// How wide the sharpest edges are \[px\]: the height of their step over their steepest rise between neighbours. An edge that is sharp to the
/// pixel has 2, one blurred by a Gaussian of sigma s about s times the square root of two pi. None where the picture shows no edge.
///
/// Noise makes edges look a little wider where it is far smaller than their step, as it must be to extract anything.
pub fn edge_width_px(image: &GrayImage) -> Option<f64> {
    let (width, height) = image.dimensions();
    if width < 3 || height < 3 {
        return None;
    }
    let raw = image.as_raw();
    let (w, h) = (width as usize, height as usize);
    let mut steep: Vec<(i32, usize)> = Vec::with_capacity((w - 2) * (h - 2));
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let at = y * w + x;
            let grey = |i: usize| i32::from(raw[i]);
            // Twice the rise per pixel, averaged over three rows or columns, which steadies it against noise: six times in all.
            let across: i32 = [at - w, at, at + w].iter().map(|&i| grey(i + 1) - grey(i - 1)).sum();
            let along: i32 = [at - 1, at, at + 1].iter().map(|&i| grey(i + w) - grey(i - w)).sum();
            steep.push((across * across + along * along, at));
        }
    }
    let count = ((EDGE_PIXELS_SHARE * steep.len() as f64) as usize).max(MIN_EDGE_PIXELS).min(steep.len());
    steep.select_nth_unstable_by(count - 1, |a, b| b.cmp(a));
    let mut widths: Vec<f64> = steep[..count]
        .iter()
        .filter_map(|&(squared, at)| {
            let rise = f64::from(squared).sqrt() / 6.0;
            let step = step(image, (at % w) as u32, (at / w) as u32);
            (step >= MIN_STEP_GREY_LEVELS && rise > 0.0).then(|| step / rise)
        })
        .collect();
    if widths.is_empty() || widths.len() < count / 2 {
        return None;
    }
    let middle = widths.len() / 2;
    Some(*widths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The difference between the lightest and the darkest pixel around one.
fn step(image: &GrayImage, x: u32, y: u32) -> f64 {
    let around = |c: u32, side: u32| {
        c.saturating_sub(EDGE_SEARCH_RADIUS_PX)..(c + EDGE_SEARCH_RADIUS_PX + 1).min(side)
    };
    let (mut least, mut most) = (u8::MAX, 0);
    for row in around(y, image.height()) {
        for column in around(x, image.width()) {
            let grey = image.get_pixel(column, row).0[0];
            (least, most) = (least.min(grey), most.max(grey));
        }
    }
    f64::from(most.saturating_sub(least))
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    /// A bar from column 60 to the right, blurred by a Gaussian of `sigma` pixels, 180 grey levels darker than what is left of it.
    fn blurred(sigma: f64) -> GrayImage {
        GrayImage::from_fn(120, 90, |x, _| {
            let at = f64::from(x) - 60.0;
            Luma([(30.0 + 180.0 * normal_cdf(-at / sigma)).round() as u8])
        })
    }

    /// Abramowitz and Stegun 26.2.17: within 8e-8.
    fn normal_cdf(x: f64) -> f64 {
        let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
        let terms = [0.319_381_53, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
        let series: f64 = terms.iter().rev().fold(0.0, |sum, term| (sum + term) * t);
        let upper = (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt() * series;
        if x > 0.0 { 1.0 - upper } else { upper }
    }

    #[test]
    fn edge_is_as_wide_as_its_blur_makes_it() {
        for sigma in [0.8, 1.5, 2.5, 4.0] {
            // The steepest rise over two pixels, as central differences see it.
            let wanted = 2.0 / (normal_cdf(1.0 / sigma) - normal_cdf(-1.0 / sigma));
            let got = edge_width_px(&blurred(sigma)).unwrap();
            assert!((got / wanted - 1.0).abs() < 0.03, "sigma {sigma}: {got:.3} px, wanted {wanted:.3}");
        }
        let sharp = GrayImage::from_fn(120, 90, |x, _| Luma([if x < 60 { 210 } else { 30 }]));
        assert!((edge_width_px(&sharp).unwrap() - 2.0).abs() < 1e-12);
        let across = image::imageops::rotate90(&blurred(1.5));
        assert_eq!(edge_width_px(&across), edge_width_px(&blurred(1.5)));
    }

    #[test]
    fn noise_widens_an_edge_little_and_a_picture_without_edges_has_none() {
        let mut state = 3_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as i32 % 9 - 4
        };
        let mut noisy = blurred(1.5);
        noisy.iter_mut().for_each(|grey| *grey = (i32::from(*grey) + noise()).clamp(0, 255) as u8);
        let (plain, got) = (edge_width_px(&blurred(1.5)).unwrap(), edge_width_px(&noisy).unwrap());
        assert!((got / plain - 1.0).abs() < 0.1, "{plain} {got}");
        let mut empty = GrayImage::from_pixel(120, 90, Luma([128]));
        assert_eq!(edge_width_px(&empty), None);
        empty.iter_mut().for_each(|grey| *grey = (i32::from(*grey) + noise()) as u8);
        assert_eq!(edge_width_px(&empty), None);
        for (width, height) in [(0, 0), (2, 9), (3, 3)] {
            assert_eq!(edge_width_px(&GrayImage::new(width, height)), None);
        }
    }

    #[test]
    fn saturated_shares_count_both_ends_and_nothing_between() {
        let image = GrayImage::from_fn(100, 10, |x, _| Luma([[0, 1, 254, 255][x as usize / 25]]));
        let found = saturation(&image).unwrap();
        assert_eq!(found, Saturation { light_share: 0.25, dark_share: 0.25 });
        assert_eq!(saturation(&GrayImage::new(0, 0)), None);
    }

    #[test]
    fn grey_range_leaves_out_a_hundredth_at_either_end() {
        // Levels 0 to 199, five pixels each.
        let image = GrayImage::from_fn(200, 5, |x, _| Luma([x as u8]));
        assert_eq!(grey_range(&image).unwrap(), GreyRange { low: 2, middle: 100, high: 198 });
        assert_eq!(mean_grey(&image), Some(99.5));
        let one = GrayImage::from_pixel(1, 1, Luma([7]));
        assert_eq!(grey_range(&one).unwrap(), GreyRange { low: 7, middle: 7, high: 7 });
        assert_eq!((grey_range(&GrayImage::new(0, 0)), mean_grey(&GrayImage::new(0, 0))), (None, None));
    }
}
