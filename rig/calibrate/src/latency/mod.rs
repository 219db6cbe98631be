//! How late a camera's stamps are, from a film of the board's sync LED.
//!
//! The LED's pattern follows the board's clock, which pings tie to the host's. Whatever the film is later than the pattern its stamps are
//! late by: not only on the host's clock but against the servo's pulses, which the same board times by the same clock. An error of that
//! tie is in both and cancels.

mod delay;
mod film;
mod light;
pub mod link;

pub use film::Film;

use std::fmt;

use camera::calibration::Px;
use ground::clock::ClockFit;

/// Latency of a camera, from a film of the sync LED.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Latency {
    /// How much later than true mid-exposure the images' times are \[s\]; below 0: earlier.
    pub late_s: f64,
    /// Its standard deviation \[s\].
    pub std_s: f64,
    /// Standard deviation of single stamps \[s\].
    pub jitter_s: f64,
    /// Exposure time, as the light of images in which the LED turned tells \[s\].
    pub exposure_s: f64,
    /// Number of images used.
    pub images: usize,
    /// Time from the first to the last image \[s\].
    pub span_s: f64,
    /// How often the LED turned on or off in that time.
    pub turns: usize,
    /// Place of the LED in the picture \[px\].
    pub place_px: Px,
    /// How much brighter it is when lit \[grey levels\], averaged over that place.
    pub contrast_grey: f64,
}

/// Why a film gives no latency.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// Images of another size.
    #[error("an image is {got_px:?} px, the first ones were {wanted_px:?} px")]
    Size {
        /// Width and height of the first image.
        wanted_px: [u32; 2],
        /// Width and height of this one.
        got_px: [u32; 2],
    },
    /// The film has too few images or is too short.
    #[error(
        "{images} usable images over {span_s:.1} s are too few: film the sync LED for {FILM_MIN_S} s or longer"
    )]
    TooShort {
        /// Number of usable images.
        images: usize,
        /// Time from the first to the last of them \[s\].
        span_s: f64,
    },
    /// The board's clock is not known.
    #[error(
        "no clock ping was answered while the LED was filmed, so that its pattern is not known: check the board's cable"
    )]
    NoClock,
    /// Nothing in the picture follows the pattern.
    #[error(
        "no place in the picture follows the sync LED's pattern (the best, at column {:.0}, row {:.0}, by {:.0} % of what it does): put the \
         LED on the board's sync channel into the picture, at least {BLOCK_PX} px wide and not washed out, and keep the light and the exposure as they are",
        place_px[0], place_px[1], 100.0 * correlation.max(0.0)
    )]
    NoLed {
        /// Place of the best correlation \[px\].
        place_px: Px,
        /// Correlation there.
        correlation: f64,
    },
    /// The picture follows the pattern at two times alike.
    #[error(
        "the LED's pattern fits the film at {first_s:.3} s and at {second_s:.3} s alike: film it for longer"
    )]
    TwoTimes {
        /// One latency that fits \[s\].
        first_s: f64,
        /// Another one that fits \[s\].
        second_s: f64,
    },
}

/// Side of the squares over which the picture is averaged \[px\] (chosen).
const BLOCK_PX: usize = 8;
/// Shortest film \[s\] (chosen): the LED may stay as it is for a second.
const FILM_MIN_S: f64 = 3.0;
/// Fewest images of a film (chosen).
const IMAGES_MIN: usize = 40;

impl Film {
    /// The camera's latency, from the film and the board's `clock` and the exposure that the config states, if any \[s\].
    ///
    /// # Errors
    /// [`LatencyError`].
    pub fn latency(&self, clock: &ClockFit, exposure_s: Option<f64>) -> Result<Latency, LatencyError> {
        let (images, span_s) = (self.images(), self.span_s());
        if images < IMAGES_MIN || span_s < FILM_MIN_S {
            return Err(LatencyError::TooShort { images, span_s });
        }
        let light = self.light(clock);
        let period_s = self.period_s();
        let led = self.find(&light, exposure_s.unwrap_or(period_s / 2.0))?;
        let delay = delay::delay(&led, &light, period_s, exposure_s);
        Ok(Latency {
            late_s: delay.mean_s,
            std_s: delay.std_s,
            jitter_s: delay.jitter_s,
            exposure_s: delay.exposure_s,
            images,
            span_s,
            turns: light.turns_s(0.0, span_s).count(),
            place_px: led.place_px,
            contrast_grey: led.contrast_grey,
        })
    }
}

impl fmt::Display for Latency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [column, row] = self.place_px;
        write!(
            f,
            "sync LED at column {column:.0}, row {row:.0}, {:.0} grey levels brighter when lit; {} turns in {} images of {:.1} s\n\
             images' times are {:.2} ms late, 1 sigma {:.2} ms; single stamps scatter by {:.2} ms; exposure {:.2} ms",
            self.contrast_grey,
            self.turns,
            self.images,
            self.span_s,
            self.late_s * 1e3,
            self.std_s * 1e3,
            self.jitter_s * 1e3,
            self.exposure_s * 1e3
        )
    }
}

#[cfg(test)]
mod tests;
