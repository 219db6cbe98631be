//! Whether an image was exposed at all, or too much: a shutter or a lamp that failed, a flash.

use ground::statistics::median;
use image::GrayImage;

use super::rejection::Rejection;

/// How light an image is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Exposure {
    /// Grey level of the middle pixel \[of 255\].
    middle: f64,
    /// Share of the pixels that are as light as can be.
    saturated_share: f64,
}

/// Every so many-th pixel is looked at: of a picture's thousands, hundreds say enough.
const STRIDE_PX: usize = 101;
/// From here on a pixel is as light as can be \[grey levels\].
const SATURATED_GREY: u8 = 252;
/// Darker than this share of the usual is no flicker of a lamp any more.
const DARK_SHARE: f64 = 0.4;
/// A tank this dark is none that could be darker \[grey levels\].
const DARK_TANK_GREY: f64 = 12.0;
/// Larger than the usual by this much, the share of saturated pixels leaves nothing to measure.
const SATURATED_SHARE: f64 = 0.4;

impl Exposure {
    pub(super) fn of(image: &GrayImage) -> Self {
        let mut pixels: Vec<u8> = image.as_raw().iter().step_by(STRIDE_PX).copied().collect();
        let saturated = pixels.iter().filter(|grey| **grey >= SATURATED_GREY).count();
        Self {
            saturated_share: saturated as f64 / pixels.len().max(1) as f64,
            middle: f64::from(median(&mut pixels, u8::cmp).unwrap_or(0)),
        }
    }

    /// What is usual among `images`; none without any.
    pub(super) fn usual(images: &[&GrayImage]) -> Option<Self> {
        let all: Vec<Self> = images.iter().map(|image| Self::of(image)).collect();
        let of = |number: fn(&Self) -> f64| {
            median(&mut all.iter().map(number).collect::<Vec<f64>>(), f64::total_cmp)
        };
        Some(Self { middle: of(|one| one.middle)?, saturated_share: of(|one| one.saturated_share)? })
    }

    /// Compares with what is `usual`.
    ///
    /// # Errors
    /// [`Rejection::Dark`] and [`Rejection::Saturated`].
    pub(super) fn check(&self, usual: &Self) -> Result<(), Rejection> {
        if usual.middle > DARK_TANK_GREY && self.middle < DARK_SHARE * usual.middle {
            return Err(Rejection::Dark { grey: self.middle, usual: usual.middle });
        }
        if self.saturated_share > usual.saturated_share + SATURATED_SHARE {
            return Err(Rejection::Saturated { share: self.saturated_share });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    fn lit(light: f64) -> GrayImage {
        GrayImage::from_fn(320, 240, |x, y| {
            let grey = if (100..140).contains(&x) && y > 40 { 60.0 } else { 180.0 + f64::from((x + y) % 7) };
            Luma([(grey * light).min(255.0) as u8])
        })
    }

    #[test]
    fn black_and_burnt_out_images_are_told_and_flicker_is_not() {
        let usual = Exposure::usual(&[&lit(1.0), &lit(0.95), &lit(1.05)]).unwrap();
        let told = |light: f64| Exposure::of(&lit(light)).check(&usual);
        assert!(matches!(told(0.0), Err(Rejection::Dark { grey: 0.0, .. })));
        assert!(matches!(told(0.2), Err(Rejection::Dark { .. })));
        assert!(matches!(told(2.0), Err(Rejection::Saturated { .. })));
        for light in [0.7, 0.9, 1.1, 1.3] {
            assert_eq!(told(light), Ok(()), "{light}");
        }
    }
}
