//! Flicker: how the light of the pictures swings over time.

use std::f64::consts::TAU;

use serde::Serialize;

/// A swing of the pictures' light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Flicker {
    /// How often it swings, as the camera sees it \[Hz\]: a lamp that swings faster than half the camera's rate looks slower than it is.
    pub hz: f64,
    /// How far it swings to either side of the mean \[%\].
    pub percent: f64,
    /// The lamp on the mains that would look like that \[Hz\]: 100 or 120.
    pub lamp_hz: Option<f64>,
}

/// Samples that are needed at least. Chosen.
pub const MIN_SAMPLES: usize = 24;
/// Frequencies tested per resolvable frequency of the window. Chosen.
const FREQUENCY_OVERSAMPLING: f64 = 4.0;
/// Probability that noise alone gives a swing this large; above it there is no flicker. Chosen.
const FALSE_ALARM_PROBABILITY: f64 = 1e-3;
/// Flicker frequencies of lamps, twice those of the mains \[Hz\].
const LAMP_FLICKER_HZ: [f64; 2] = [100.0, 120.0];

/// The largest swing of mean grey levels at times that rise \[s\]; none where there is none beyond noise.
///
/// A constant and a sinusoid are fitted by least squares at each frequency between one swing over the whole stretch and half the
/// images' rate: times need not be even.
pub fn flicker(samples: &[(f64, f64)]) -> Option<Flicker> {
    let count = samples.len();
    let span_s = samples.last()?.0 - samples.first()?.0;
    let mean = samples.iter().map(|(_, grey)| grey).sum::<f64>() / count as f64;
    let spread: f64 = samples.iter().map(|(_, grey)| (grey - mean).powi(2)).sum();
    let is_positive = |value: f64| value.is_finite() && value > 0.0;
    if count < MIN_SAMPLES || ![span_s, mean, spread].into_iter().all(is_positive) {
        return None;
    }
    let fps = (count - 1) as f64 / span_s;
    let step_hz = 1.0 / (FREQUENCY_OVERSAMPLING * span_s);
    let tested = ((fps / 2.0) / step_hz).floor() as usize;
    let swings = (FREQUENCY_OVERSAMPLING as usize..=tested).map(|k| {
        let hz = k as f64 * step_hz;
        let (power, amplitude) = swing(samples, hz);
        (power, amplitude, hz)
    });
    let (power, amplitude, hz) = swings.max_by(|a, b| a.0.total_cmp(&b.0))?;
    // The chance that noise leaves no more than this of its spread at one frequency, for each that can be told apart.
    let left = (1.0 - power / spread).max(0.0);
    let chance = left.powf((count as f64 - 3.0) / 2.0) * tested as f64;
    let near = |lamp: &f64| (aliased_hz(*lamp, fps) - hz).abs() < 1.0 / span_s + 1e-3 * lamp;
    (chance < FALSE_ALARM_PROBABILITY).then(|| Flicker {
        hz,
        percent: 100.0 * amplitude / mean,
        lamp_hz: LAMP_FLICKER_HZ.iter().copied().find(near),
    })
}

/// What a swing of `hz` looks like to a camera of `fps` images a second \[Hz\].
pub fn aliased_hz(hz: f64, fps: f64) -> f64 {
    (hz - fps * (hz / fps).round()).abs()
}

/// How much of the samples' squared spread a sinusoid of `hz` takes away, and its amplitude.
fn swing(samples: &[(f64, f64)], hz: f64) -> (f64, f64) {
    let start_s = samples[0].0;
    let n = samples.len() as f64;
    // Normal equations of 1, sin and cos; the first is eliminated by taking all about their means.
    let (mut s, mut c, mut y) = (0.0, 0.0, 0.0);
    let (mut ss, mut sc, mut cc, mut sy, mut cy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (time_s, grey) in samples {
        let (sin, cos) = (TAU * hz * (time_s - start_s)).sin_cos();
        (s, c, y) = (s + sin, c + cos, y + grey);
        (ss, sc, cc) = (ss + sin * sin, sc + sin * cos, cc + cos * cos);
        (sy, cy) = (sy + sin * grey, cy + cos * grey);
    }
    (ss, sc, cc) = (ss - s * s / n, sc - s * c / n, cc - c * c / n);
    (sy, cy) = (sy - s * y / n, cy - c * y / n);
    let determinant = ss * cc - sc * sc;
    // At half the rate one of the two is seen nowhere.
    if determinant <= 1e-9 * n * n {
        return (0.0, 0.0);
    }
    let a = (cc * sy - sc * cy) / determinant;
    let b = (ss * cy - sc * sy) / determinant;
    (a * sy + b * cy, a.hypot(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two seconds of means around 80 at `fps`, swinging by 2 grey levels at `hz`, with noise of `noise` to either side.
    fn samples(fps: f64, hz: f64, noise: f64) -> Vec<(f64, f64)> {
        let mut state = 9_u32;
        (0..(2.0 * fps) as usize)
            .map(|k| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let time_s = k as f64 / fps;
                let random = f64::from(state >> 8) / f64::from(1 << 23) - 1.0;
                (time_s, 80.0 + 2.0 * (TAU * hz * time_s + 0.7).sin() + noise * random)
            })
            .collect()
    }

    #[test]
    fn swing_is_told_with_its_rate_and_size_noise_or_not() {
        for (fps, hz) in [(100.0, 20.0), (60.0, 7.3), (200.0, 3.0), (30.0, 13.0)] {
            for noise in [0.0, 1.0] {
                let found = flicker(&samples(fps, hz, noise)).unwrap();
                assert!((found.hz - hz).abs() < 0.2, "{hz} Hz at {fps}/s: {found:?}");
                assert!((found.percent - 2.5).abs() < 0.3, "{hz} Hz at {fps}/s: {found:?}");
            }
        }
    }

    #[test]
    fn lamp_on_the_mains_is_known_by_what_it_looks_like() {
        assert_eq!(aliased_hz(100.0, 60.0), 20.0);
        assert_eq!(aliased_hz(120.0, 100.0), 20.0);
        assert_eq!(aliased_hz(100.0, 250.0), 100.0);
        assert!(aliased_hz(100.0, 50.0).abs() < 1e-12);
        let lamp = |fps: f64, hz| flicker(&samples(fps, hz, 0.1)).unwrap().lamp_hz;
        assert_eq!(lamp(60.0, 100.0), Some(100.0));
        assert_eq!(lamp(100.0, 120.0), Some(120.0));
        assert_eq!(lamp(100.0, 33.0), None);
    }

    #[test]
    fn lost_images_do_not_disturb_and_noise_alone_is_no_flicker() {
        let mut gaps = samples(100.0, 20.0, 0.0);
        gaps.retain(|(time_s, _)| (time_s * 37.0).sin() > -0.5);
        let found = flicker(&gaps).unwrap();
        assert!((found.hz - 20.0).abs() < 0.2 && (found.percent - 2.5).abs() < 0.1, "{found:?}");
        assert_eq!(flicker(&samples(100.0, 0.0, 1.0)), None);
        let flat: Vec<(f64, f64)> = (0..200).map(|k| (f64::from(k) / 100.0, 80.0)).collect();
        assert_eq!(flicker(&flat), None);
        assert_eq!(flicker(&flat[..3]), None);
        assert_eq!(flicker(&[]), None);
        let dark: Vec<(f64, f64)> = (0..200).map(|k| (0.0, f64::from(k % 2))).collect();
        assert_eq!(flicker(&dark), None);
    }
}
