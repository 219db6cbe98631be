//! A film by the mean brightness of small squares, and the place in it that follows the sync LED.

use image::GrayImage;

use super::light::Light;
use super::{BLOCK_PX, LatencyError};
use camera::calibration::Px;
use ground::clock::{ClockFit, MonotonicNs};

/// Range of latencies that are sought \[s\] (chosen).
const LATENESS_RANGE_S: [f64; 2] = [-0.2, 0.5];
/// Number of squares that are searched, those that change most (chosen).
const BLOCKS_MAX: usize = 400;
/// Smallest correlation with the pattern at which a square shows the LED (chosen).
const CORRELATION_MIN: f64 = 0.7;
/// Another latency is a rival when its correlation exceeds this share of the best one (chosen).
const RIVAL_CORRELATION_SHARE_MIN: f64 = 0.9;
/// Squares whose correlation exceeds this share of the best one are part of the LED (chosen).
const LED_CORRELATION_SHARE_MIN: f64 = 0.9;
/// The squares of an LED lie within this many of the best one (chosen): light reflected elsewhere follows it too, and may be slower.
const LED_DISTANCE_MAX_BLOCKS: usize = 4;

/// Images of a film, each as the mean grey of its squares of 8 pixels.
#[derive(Debug, Clone, Default)]
pub struct Film {
    size_px: [u32; 2],
    /// Images' times as they are to be calibrated: mid-exposure by what stamps and config claim.
    times: Vec<MonotonicNs>,
    /// Shape (images, squares), squares row by row.
    greys: Vec<f32>,
}

/// Brightness and place of the LED in a film.
pub(super) struct LedSignal {
    /// Times of the images \[s\] after the first.
    pub(super) times_s: Vec<f64>,
    /// Brightness of the LED in each image: 0 dark, 1 lit.
    pub(super) brightness: Vec<f64>,
    /// Standard deviation of that where it is dark or lit for all of the exposure.
    pub(super) noise: f64,
    /// Latency of the images' times, to within half a period \[s\].
    pub(super) late_s: f64,
    pub(super) place_px: Px,
    pub(super) contrast_grey: f64,
}

impl Film {
    /// Adds the next image.
    ///
    /// # Errors
    /// [`LatencyError::Size`].
    pub fn take(&mut self, picture: &GrayImage, time: MonotonicNs) -> Result<(), LatencyError> {
        let size_px: [u32; 2] = picture.dimensions().into();
        if self.times.is_empty() {
            self.size_px = size_px;
        } else if self.size_px != size_px {
            return Err(LatencyError::Size { wanted_px: self.size_px, got_px: size_px });
        }
        let columns = self.columns();
        let width = size_px[0] as usize;
        for rows in picture.as_raw().chunks_exact(width * BLOCK_PX) {
            let mut sums = vec![0_u32; columns];
            for row in rows.chunks_exact(width) {
                for (sum, block) in sums.iter_mut().zip(row.chunks_exact(BLOCK_PX)) {
                    *sum += block.iter().map(|&grey| u32::from(grey)).sum::<u32>();
                }
            }
            self.greys.extend(sums.iter().map(|&sum| sum as f32 / (BLOCK_PX * BLOCK_PX) as f32));
        }
        self.times.push(time);
        Ok(())
    }

    /// Number of images.
    pub fn images(&self) -> usize {
        self.times.len()
    }

    /// From the first to the last image \[s\].
    pub fn span_s(&self) -> f64 {
        self.times.first().zip(self.times.last()).map_or(0.0, |(first, last)| last.seconds_since(*first))
    }

    /// Memory of the film's brightness values \[bytes\].
    pub fn bytes(&self) -> usize {
        self.greys.len() * size_of::<f32>()
    }

    /// Median time between images \[s\].
    pub(super) fn period_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.times.windows(2).map(|pair| pair[1].seconds_since(pair[0])).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or_default()
    }

    /// The LED's light while it was filmed, with room for every lateness looked for; times count from the first image.
    pub(super) fn light(&self, clock: &ClockFit) -> Light {
        let ends = self.times.first().zip(self.times.last());
        let (first, last) = ends.map_or((MonotonicNs(0), MonotonicNs(0)), |(first, last)| (*first, *last));
        let margin_s = 2.0 * LATENESS_RANGE_S[1];
        Light::new(clock, first, first.plus_seconds(-margin_s), last.plus_seconds(margin_s))
    }

    /// The LED: the place whose brightness follows `light`, for exposures of about `exposure_s` \[s\].
    pub(super) fn find(&self, light: &Light, exposure_s: f64) -> Result<LedSignal, LatencyError> {
        let times_s: Vec<f64> = self.times.iter().map(|time| time.seconds_since(self.times[0])).collect();
        let changing = self.changing();
        let step_s = (self.period_s() / 2.0).min(0.004);
        let count = ((LATENESS_RANGE_S[1] - LATENESS_RANGE_S[0]) / step_s) as usize + 1;
        let expected = |late_s: f64| -> Vec<f64> {
            times_s.iter().map(|time_s| light.share(time_s - late_s, exposure_s)).collect()
        };
        // The best square at each lateness.
        let matches: Vec<Match> = (0..count)
            .map(|k| {
                let late_s = LATENESS_RANGE_S[0] + k as f64 * step_s;
                let mut pattern = expected(late_s);
                normalize(&mut pattern);
                let follows = changing.iter().map(|(square, series)| (dot(&pattern, series), *square));
                let (correlation, square) = follows
                    .fold((f64::NEG_INFINITY, 0), |best, next| if next.0 > best.0 { next } else { best });
                Match { late_s, correlation, square }
            })
            .collect();
        let best = matches.iter().fold(
            Match { correlation: f64::NEG_INFINITY, ..Match::default() },
            |best, next| {
                if next.correlation > best.correlation { *next } else { best }
            },
        );
        if best.correlation < CORRELATION_MIN {
            return Err(LatencyError::NoLed {
                place_px: self.place_px(best.square),
                correlation: best.correlation,
            });
        }
        // Next to the best time all fit a little; a whole slot away nothing should.
        let slot_s = f64::from(firmware_protocol::sync_led::SLOT.0) * 1e-6;
        let rival = matches.iter().find(|other| {
            (other.late_s - best.late_s).abs() > slot_s
                && other.correlation > RIVAL_CORRELATION_SHARE_MIN * best.correlation
        });
        if let Some(rival) = rival {
            return Err(LatencyError::TwoTimes { first_s: best.late_s, second_s: rival.late_s });
        }
        let shares = expected(best.late_s);
        let mut pattern = shares.clone();
        normalize(&mut pattern);
        let part = changing.iter().filter(|(square, series)| {
            let near = self
                .row_and_column(*square)
                .iter()
                .zip(self.row_and_column(best.square))
                .all(|(a, b)| a.abs_diff(b) <= LED_DISTANCE_MAX_BLOCKS);
            near && dot(&pattern, series) > LED_CORRELATION_SHARE_MIN * best.correlation
        });
        let squares: Vec<usize> = part.map(|(square, _)| *square).collect();
        Ok(self.led_signal(&squares, times_s, &shares, best.late_s))
    }

    /// The LED that covers `squares`, lit for `shares` of the images when they are `late_s` late.
    fn led_signal(&self, squares: &[usize], times_s: Vec<f64>, shares: &[f64], late_s: f64) -> LedSignal {
        let count = squares.len().max(1) as f64;
        let mean = |image: usize| {
            squares.iter().map(|&square| f64::from(self.grey(image, square))).sum::<f64>() / count
        };
        let greys: Vec<f64> = (0..self.images()).map(mean).collect();
        // Medians of what is surely dark and surely lit: images near a turn are neither by an unknown share.
        let level = |wanted: f64| {
            let certain = (1..shares.len() - 1)
                .filter(|&k| shares[k - 1..=k + 1].iter().all(|share| (share - wanted).abs() < 1e-9));
            let mut greys: Vec<f64> = certain.map(|k| greys[k]).collect();
            greys.sort_by(f64::total_cmp);
            let middle = greys.get(greys.len() / 2).copied();
            let mut off: Vec<f64> =
                greys.iter().map(|grey| (grey - middle.unwrap_or_default()).abs()).collect();
            off.sort_by(f64::total_cmp);
            (middle, off.get(off.len() / 2).copied().unwrap_or_default())
        };
        let ((dark, dark_off), (lit, lit_off)) = (level(0.0), level(1.0));
        let (dark, lit) = (dark.unwrap_or_default(), lit.unwrap_or(1.0));
        let contrast_grey = lit - dark;
        // A median of absolute deviations is 0.6745 standard deviations of what is normal.
        let noise = dark_off.max(lit_off) / 0.6745 / contrast_grey.abs().max(1e-9);
        let mut place_px = [0.0; 2];
        for &square in squares {
            let at = self.place_px(square);
            place_px = [place_px[0] + at[0] / count, place_px[1] + at[1] / count];
        }
        LedSignal {
            times_s,
            brightness: greys.iter().map(|grey| (grey - dark) / contrast_grey).collect(),
            noise: noise.max(NOISE_MIN_CONTRAST_SHARE),
            late_s,
            place_px,
            contrast_grey,
        }
    }

    /// The squares that change most, each with its brightness over time, of mean 0 and length 1.
    fn changing(&self) -> Vec<(usize, Vec<f64>)> {
        let squares = self.columns() * self.rows();
        let (mut sums, mut squared) = (vec![0.0_f64; squares], vec![0.0_f64; squares]);
        for image in self.greys.chunks_exact(squares.max(1)) {
            for ((sum, square), &grey) in sums.iter_mut().zip(&mut squared).zip(image) {
                *sum += f64::from(grey);
                *square += f64::from(grey) * f64::from(grey);
            }
        }
        let count = self.images() as f64;
        let variance = |square: &usize| squared[*square] / count - (sums[*square] / count).powi(2);
        let mut order: Vec<usize> = (0..squares).collect();
        order.sort_by(|a, b| variance(b).total_cmp(&variance(a)));
        order.truncate(BLOCKS_MAX);
        let series = |square: usize| {
            let mut series: Vec<f64> =
                (0..self.images()).map(|image| self.grey(image, square).into()).collect();
            normalize(&mut series);
            (square, series)
        };
        order.into_iter().map(series).collect()
    }

    fn grey(&self, image: usize, square: usize) -> f32 {
        self.greys[image * self.columns() * self.rows() + square]
    }

    fn columns(&self) -> usize {
        self.size_px[0] as usize / BLOCK_PX
    }

    fn rows(&self) -> usize {
        self.size_px[1] as usize / BLOCK_PX
    }

    fn row_and_column(&self, square: usize) -> [usize; 2] {
        [square / self.columns().max(1), square % self.columns().max(1)]
    }

    /// Middle of a square.
    fn place_px(&self, square: usize) -> Px {
        let [row, column] =
            self.row_and_column(square).map(|place| (place as f64 + 0.5) * BLOCK_PX as f64 - 0.5);
        [column, row]
    }
}

/// Smallest noise that is assumed \[share of the contrast\] (chosen): grey levels are rounded.
const NOISE_MIN_CONTRAST_SHARE: f64 = 2e-3;

/// The square that follows the pattern best at one latency.
#[derive(Debug, Clone, Copy, Default)]
struct Match {
    late_s: f64,
    correlation: f64,
    square: usize,
}

/// Takes the mean off and makes the length 1; all 0 where nothing changes.
fn normalize(series: &mut [f64]) {
    let mean = series.iter().sum::<f64>() / series.len().max(1) as f64;
    series.iter_mut().for_each(|value| *value -= mean);
    let length = dot(series, series).sqrt();
    if length > 0.0 {
        series.iter_mut().for_each(|value| *value /= length);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
