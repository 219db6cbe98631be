//! Films drawn here, image by image: the LED's light is asked of the board's tick every 20 µs of the exposure.

use image::{GrayImage, Luma};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use firmware_protocol::sync_led;
use firmware_protocol::units::Ticks;

use super::{Film, Latency, LatencyError};
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};

const START: MonotonicNs = MonotonicNs(5_000_000_000_000);
/// The tick wraps 4 s after the start.
const FIRST_TICK: u64 = (1 << 32) - 4_000_000;
const LED_PX: [u32; 2] = [21, 11];

/// How a film is made.
#[derive(Clone, Copy)]
struct Take {
    late_s: f64,
    jitter_s: f64,
    fps: f64,
    exposure_s: f64,
    drift_ppm: f64,
    noise_grey: f64,
    span_s: f64,
    seed: u64,
}

const TAKE: Take = Take {
    late_s: 0.023,
    jitter_s: 0.001,
    fps: 100.0,
    exposure_s: 0.004,
    drift_ppm: 200.0,
    noise_grey: 2.0,
    span_s: 10.0,
    seed: 1,
};

impl Take {
    fn tick(&self, at: MonotonicNs) -> u64 {
        FIRST_TICK + (at.seconds_since(START) * (1e6 + self.drift_ppm)).round() as u64
    }

    /// Pings a second before the film and while it lasts, each way taking 0.1 to 0.4 ms.
    fn clock(&self) -> ClockFit {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let pings: Vec<Ping> = (0..(20.0 * (self.span_s + 1.0)) as usize)
            .map(|k| {
                let sent = START.plus_seconds(0.05 * k as f64);
                let read = sent.plus_seconds(random.random_range(1e-4..4e-4));
                let received = read.plus_seconds(random.random_range(1e-4..4e-4));
                Ping { sent, board_tick_us: self.tick(read), received }
            })
            .collect();
        ClockFit::new(&pings, Wire::NONE).unwrap()
    }

    fn film(&self, with_led: bool) -> Film {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed + 1000);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut film = Film::default();
        let slot = u64::from(sync_led::SLOT.0);
        let slots = (0..400).map(|k| sync_led::lit(Ticks((FIRST_TICK / slot * slot + k * slot) as u32)));
        let slots: Vec<bool> = slots.collect();
        for k in 0..(self.span_s * self.fps) as usize {
            let middle = START.plus_seconds(1.0 + k as f64 / self.fps);
            let looks = (self.exposure_s / 2e-5) as usize;
            let lit = |look: usize| {
                let at = middle.plus_seconds((look as f64 / looks as f64 - 0.5) * self.exposure_s);
                f64::from(u8::from(slots[((self.tick(at) - FIRST_TICK / slot * slot) / slot) as usize]))
            };
            let share = (0..looks).map(lit).sum::<f64>() / looks as f64;
            let picture = GrayImage::from_fn(64, 48, |x, y| {
                let radius = f64::from(x.abs_diff(LED_PX[0])).hypot(f64::from(y.abs_diff(LED_PX[1])));
                let grey = if with_led && radius < 6.0 { 40.0 + 120.0 * share } else { 90.0 };
                Luma([(grey + self.noise_grey * normal()).round().clamp(0.0, 255.0) as u8])
            });
            film.take(&picture, middle.plus_seconds(self.late_s + self.jitter_s * normal())).unwrap();
        }
        film
    }

    fn latency(&self, stated: bool) -> Result<Latency, LatencyError> {
        self.film(true).latency(&self.clock(), stated.then_some(self.exposure_s))
    }
}

#[test]
fn lateness_is_found_to_a_fraction_of_a_millisecond_whatever_the_camera() {
    let cameras = [
        TAKE,
        Take { late_s: -0.0002, jitter_s: 0.0, ..TAKE },
        Take { late_s: 0.0571, fps: 30.0, exposure_s: 0.002, ..TAKE },
        Take { late_s: 0.150, fps: 60.0, exposure_s: 0.016, noise_grey: 6.0, ..TAKE },
        Take { late_s: -0.0163, jitter_s: 0.003, drift_ppm: -200.0, ..TAKE },
    ];
    for (camera, stated) in cameras.iter().flat_map(|camera| [(camera, true), (camera, false)]) {
        let found = camera.latency(stated).unwrap();
        let off_ms = (found.late_s - camera.late_s) * 1e3;
        println!("late {:.1} ms, stated {stated}: off by {off_ms:.3}, {found}", camera.late_s * 1e3);
        assert!(off_ms.abs() < 0.6 && found.std_s < 0.4e-3, "{off_ms} ms, {found}");
        // The clock's own way there and back may differ by 0.1 ms, which the film cannot know of.
        assert!(off_ms.abs() < 4.0 * found.std_s * 1e3 + 0.15, "{off_ms} ms, {found}");
        let at = [found.place_px[0] - f64::from(LED_PX[0]), found.place_px[1] - f64::from(LED_PX[1])];
        assert!(at[0].hypot(at[1]) < 4.0, "{at:?}");
        assert!((20.0..120.0).contains(&found.contrast_grey) && found.turns > 30, "{found}");
    }
}

#[test]
fn stated_deviation_is_that_of_many_films() {
    let takes = 16;
    let off = |seed| {
        let take = Take { seed, span_s: 5.0, ..TAKE };
        let found = take.latency(true).unwrap();
        ((found.late_s - take.late_s) / found.std_s).powi(2)
    };
    let square = (0..takes).map(off).sum::<f64>() / f64::from(takes as u32);
    // A mean of 16 squares scatters by 0.35; clocks add to it what the pings leave open.
    assert!((0.3..2.5).contains(&square), "{square}");
}

#[test]
fn exposure_and_scatter_of_the_stamps_show_as_well() {
    let found = Take { jitter_s: 0.0008, exposure_s: 0.006, ..TAKE }.latency(false).unwrap();
    assert!((found.exposure_s / 0.006 - 1.0).abs() < 0.3, "{found}");
    assert!((0.0004..0.0016).contains(&found.jitter_s), "{found}");
}

#[test]
fn film_without_the_led_or_too_short_says_so() {
    let without = TAKE.film(false).latency(&TAKE.clock(), None);
    assert!(matches!(without, Err(LatencyError::NoLed { .. })), "{without:?}");
    let short = Take { span_s: 2.0, ..TAKE }.latency(true);
    assert!(matches!(short, Err(LatencyError::TooShort { .. })), "{short:?}");
    // The LED of another board, whose clock is elsewhere.
    let other = Take { seed: 2, ..TAKE };
    let mut film = Film::default();
    film.take(&GrayImage::new(64, 48), START).unwrap();
    assert!(matches!(film.take(&GrayImage::new(32, 48), START), Err(LatencyError::Size { .. })));
    let shifted = ClockFit::new(
        &[Ping { sent: START, board_tick_us: 77_000_000, received: START.plus_seconds(1e-4) }],
        Wire::NONE,
    );
    let foreign = other.film(true).latency(&shifted.unwrap(), None);
    assert!(matches!(foreign, Err(LatencyError::NoLed { .. })), "{foreign:?}");
}
