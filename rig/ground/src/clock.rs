//! The host's monotonic clock, and lines that put other clocks on it.
//!
//! A ping leaves at t₀, the board stamps it with its tick c, the answer is back at t₃. All that is certain is that c
//! lies between t₀ and t₃, less the time that its bytes spend on a [`Wire`] of known speed; the midpoint is the best estimate, wrong by at
//! most half of the rest. [`ClockFit`] fits a line to many such estimates, with more weight on the quicker round trips.

use std::sync::{Arc, OnceLock};

use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};

/// An instant on the host's CLOCK_MONOTONIC, in nanoseconds: the clock of V4L2 stamps and of every process
/// on this machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct MonotonicNs(pub u64);

impl MonotonicNs {
    /// Now.
    pub fn now() -> Self {
        let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        Self(t.tv_sec.unsigned_abs() * 1_000_000_000 + t.tv_nsec.unsigned_abs())
    }

    /// Seconds from `origin` to this instant; negative before it.
    pub fn seconds_since(self, origin: Self) -> f64 {
        self.0.wrapping_sub(origin.0).cast_signed() as f64 * 1e-9
    }

    /// This instant moved by `seconds`, which may be negative.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.wrapping_add_signed((seconds * 1e9).round() as i64))
    }
}

/// The present on the wall clock, which may be set, and on the boot clock, which runs evenly, also while the machine sleeps.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// The wall clock.
    pub wall: Timestamp,
    /// Time since the machine was started (CLOCK_BOOTTIME).
    pub boot: SignedDuration,
}

impl Now {
    /// Reads both clocks of the machine.
    pub fn read() -> Self {
        let boot = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
        Self { wall: Timestamp::now(), boot: SignedDuration::new(boot.tv_sec, boot.tv_nsec as i32) }
    }

    /// The boot time `boot` on the wall clock as it is set now.
    pub fn wall_at(&self, boot: SignedDuration) -> Timestamp {
        self.wall.saturating_sub(self.boot.saturating_sub(boot)).unwrap_or(self.wall)
    }
}

/// Maps instants of a recorded run to the present run: as long after its start as they were after the recorded one's.
#[derive(Debug, Clone)]
pub struct ReplayClock {
    origin: MonotonicNs,
    start: Arc<OnceLock<MonotonicNs>>,
}

impl ReplayClock {
    /// A clock for the run that began at `origin`, replayed in one that begins at `start`; where `start` is not set by the first use, it is
    /// set to that moment.
    pub fn new(origin: MonotonicNs, start: Arc<OnceLock<MonotonicNs>>) -> Self {
        Self { origin, start }
    }

    /// The instant `then` of the recorded run, in the present one.
    pub fn to_present(&self, then: MonotonicNs) -> MonotonicNs {
        let start = self.start.get_or_init(MonotonicNs::now);
        MonotonicNs(start.0.wrapping_add(then.0.wrapping_sub(self.origin.0)))
    }
}

/// Continues a wrapping 32-bit tick to 64 bits.
#[derive(Debug, Clone, Copy, Default)]
pub struct TickExtender(Option<u64>);

impl TickExtender {
    /// The 64-bit tick nearest to the last one whose lower half is `tick`. It may lie before the last one.
    pub fn extend(&mut self, tick: u32) -> u64 {
        let extended = match self.0 {
            None => u64::from(tick),
            Some(last) => last.saturating_add_signed(tick.wrapping_sub(last as u32).cast_signed().into()),
        };
        self.0 = Some(extended);
        extended
    }
}

/// One clock ping, as recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ping {
    /// When the host sent it.
    pub sent: MonotonicNs,
    /// Board's tick at receipt, extended to 64 bit \[µs\].
    pub board_tick_us: u64,
    /// When the answer came.
    pub received: MonotonicNs,
}

impl Ping {
    fn round_trip_s(&self) -> f64 {
        self.received.seconds_since(self.sent)
    }
}

/// How long the bytes of a ping and of its answer take on the line, where it has a known baud rate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wire {
    /// From the ping's first byte to its last, at which the board looks at its clock \[s\].
    pub to_s: f64,
    /// From the answer's first byte to its last \[s\].
    pub back_s: f64,
}

impl Wire {
    /// A line that passes bytes on at once: USB all the way, a pseudo-terminal.
    pub const NONE: Self = Self { to_s: 0.0, back_s: 0.0 };

    fn round_trip_s(self) -> f64 {
        self.to_s + self.back_s
    }
}

/// Jitter of the fastest round trips \[s\], 1 sigma. Guessed: a tick is 1 µs, USB packets are 125 µs apart.
const ROUND_TRIP_JITTER_S: f64 = 20e-6;
/// Relative error of a board's clock rate, 1 sigma, as a prior; chosen for the ceramic resonators of small boards.
const DRIFT_PRIOR_STD: f64 = 5e-3;
/// A ping is dropped when its residual exceeds this many of its standard deviations, chosen.
const OUTLIER_SIGMAS: f64 = 5.0;
/// Most rounds of dropping outliers and fitting again, chosen: it converges in fewer, or the data are no line.
const MAX_OUTLIER_ROUNDS: usize = 20;

/// A line between a board's ticks and the host's clock, with its uncertainty. A pure function of the pings: recorded
/// ones give the same line again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClockFit {
    origin: MonotonicNs,
    origin_tick_us: u64,
    /// Weighted mean time of the pings \[s\] after `origin`.
    mean_s: f64,
    /// Board time minus host time there, both after the origin \[s\].
    offset_s: f64,
    /// Board's clock against the host's: 1e-6 is a microsecond per second fast.
    drift: f64,
    variance_offset_s2: f64,
    variance_drift: f64,
    /// Shortest measured round trip \[s\].
    pub round_trip_min_s: f64,
    /// Part of it that the bytes spent on the wire \[s\].
    pub wire_s: f64,
    /// Number of pings that the line was fitted to.
    pub used: usize,
    /// Number of pings dropped as outliers.
    pub dropped: usize,
    /// Pings that the line contradicts: their tick cannot lie between sending and answer. Any is a sign of a clock
    /// that jumped.
    pub contradicted: usize,
}

impl ClockFit {
    /// Fits the line to pings over `wire`. None without a ping. A round trip quicker than the wire shows that there is none: a baud rate
    /// means nothing to a board with a USB port of its own.
    ///
    /// Weighted regression of y = board − host over t with w = 1/(s₀² + ((rtt − rtt_min)/2)²) and a weak prior on the
    /// drift, so that one ping suffices; pings beyond 5 of their own sigma are dropped and the line is fitted again.
    ///
    /// # Source
    /// The weights are the midpoint's error bound, as NTP uses it (RFC 5905, clock filter); the rule for outliers is
    /// that of Klipper's `clocksync.py`.
    pub fn new(pings: &[Ping], wire: Wire) -> Option<Self> {
        let shortest = pings.iter().map(Ping::round_trip_s).fold(f64::INFINITY, f64::min);
        let wire = if shortest < wire.round_trip_s() { Wire::NONE } else { wire };
        let pings: Vec<Ping> = pings
            .iter()
            .map(|ping| Ping {
                sent: ping.sent.plus_seconds(wire.to_s),
                received: ping.received.plus_seconds(-wire.back_s),
                ..*ping
            })
            .collect();
        let first = pings.first()?;
        let open_s = shortest - wire.round_trip_s();
        let samples: Vec<OffsetSample> =
            pings.iter().map(|ping| OffsetSample::new(ping, first, open_s)).collect();

        let mut used = vec![true; samples.len()];
        let mut line = Line::through(&samples, &used);
        for _ in 0..MAX_OUTLIER_ROUNDS {
            let keeps: Vec<bool> = samples.iter().map(|g| line.residual_s(g).abs() <= g.limit_s()).collect();
            if keeps == used || keeps.iter().filter(|&&keep| keep).count() < 2 {
                break;
            }
            used = keeps;
            line = Line::through(&samples, &used);
        }

        let count = used.iter().filter(|&&u| u).count();
        let mut fit = Self {
            origin: first.sent,
            origin_tick_us: first.board_tick_us,
            mean_s: line.mean_s,
            offset_s: line.offset_s,
            drift: line.drift,
            variance_offset_s2: line.variance_offset_s2,
            variance_drift: line.variance_drift,
            round_trip_min_s: shortest,
            wire_s: wire.round_trip_s(),
            used: count,
            dropped: samples.len() - count,
            contradicted: 0,
        };
        let possible = |ping: &Ping| {
            let at = fit.host(ping.board_tick_us);
            let slack_s = 3.0 * fit.statistical_sigma_s(at) + 2e-6;
            at >= ping.sent.plus_seconds(-slack_s) && at <= ping.received.plus_seconds(slack_s)
        };
        fit.contradicted = pings.iter().filter(|ping| !possible(ping)).count();
        Some(fit)
    }

    /// When the board's clock shows `tick_us`.
    pub fn host(&self, tick_us: u64) -> MonotonicNs {
        let board_s = tick_us.wrapping_sub(self.origin_tick_us).cast_signed() as f64 * 1e-6;
        // board = t + offset + drift (t − mean), solved for t.
        let t = (board_s - self.offset_s + self.drift * self.mean_s) / (1.0 + self.drift);
        self.origin.plus_seconds(t)
    }

    /// What the board's clock shows at `at` \[µs\], to the nearest tick.
    pub fn board_tick_us(&self, at: MonotonicNs) -> u64 {
        let board_s = at.seconds_since(self.origin) + self.gained_s(at);
        self.origin_tick_us.wrapping_add_signed((board_s * 1e6).round() as i64)
    }

    /// Standard deviation of [`ClockFit::host`] near `at` \[s\]: that of the line, and that of the one thing midpoints
    /// cannot show, the way there being shorter or longer than the way back (uniform within half the shortest trip, without the wire).
    pub fn sigma_s(&self, at: MonotonicNs) -> f64 {
        let asymmetry_s = (self.round_trip_min_s - self.wire_s) / 2.0 / 3f64.sqrt();
        self.statistical_sigma_s(at).hypot(asymmetry_s)
    }

    /// What the board's clock has gained on the host's from the first ping to `at` \[s\].
    pub fn gained_s(&self, at: MonotonicNs) -> f64 {
        self.offset_s + self.drift * (at.seconds_since(self.origin) - self.mean_s)
    }

    /// Board's clock against the host's \[parts per million\], positive when it is fast.
    pub fn drift_ppm(&self) -> f64 {
        self.drift * 1e6
    }

    fn statistical_sigma_s(&self, at: MonotonicNs) -> f64 {
        let t = at.seconds_since(self.origin) - self.mean_s;
        (self.variance_offset_s2 + self.variance_drift * t * t).sqrt()
    }
}

/// The clock offset as one ping gives it: the midpoint between sending and answer.
struct OffsetSample {
    /// Midpoint \[s\] after the first ping's sending.
    time_s: f64,
    /// Board minus host \[s\].
    offset_s: f64,
    variance_s2: f64,
}

impl OffsetSample {
    fn new(ping: &Ping, first: &Ping, shortest_s: f64) -> Self {
        let round_trip_s = ping.round_trip_s();
        let time_s = ping.sent.seconds_since(first.sent) + round_trip_s / 2.0;
        let board_s = ping.board_tick_us.wrapping_sub(first.board_tick_us).cast_signed() as f64 * 1e-6;
        let excess_s = (round_trip_s - shortest_s) / 2.0;
        Self {
            time_s,
            offset_s: board_s - time_s,
            variance_s2: ROUND_TRIP_JITTER_S * ROUND_TRIP_JITTER_S + excess_s * excess_s,
        }
    }

    fn limit_s(&self) -> f64 {
        OUTLIER_SIGMAS * self.variance_s2.sqrt()
    }
}

struct Line {
    mean_s: f64,
    offset_s: f64,
    drift: f64,
    variance_offset_s2: f64,
    variance_drift: f64,
}

impl Line {
    fn through(samples: &[OffsetSample], used: &[bool]) -> Self {
        let used =
            || samples.iter().zip(used).filter(|(_, used)| **used).map(|(g, _)| (g, 1.0 / g.variance_s2));
        let weight: f64 = used().map(|(_, w)| w).sum();
        let mean_s = used().map(|(g, w)| w * g.time_s).sum::<f64>() / weight;
        let offset_s = used().map(|(g, w)| w * g.offset_s).sum::<f64>() / weight;
        let prior = 1.0 / (DRIFT_PRIOR_STD * DRIFT_PRIOR_STD);
        let spread: f64 = used().map(|(g, w)| w * (g.time_s - mean_s).powi(2)).sum::<f64>() + prior;
        let drift =
            used().map(|(g, w)| w * (g.time_s - mean_s) * (g.offset_s - offset_s)).sum::<f64>() / spread;
        let mut line =
            Self { mean_s, offset_s, drift, variance_offset_s2: 1.0 / weight, variance_drift: 1.0 / spread };
        // The assumed variances may be too small: where the scatter is greater, the uncertainty is scaled up to it.
        let count = used().count() as f64;
        let scatter: f64 = used().map(|(g, w)| w * line.residual_s(g).powi(2)).sum();
        let inflation = (scatter / (count - 2.0).max(1.0)).max(1.0);
        line.variance_offset_s2 *= inflation;
        line.variance_drift *= inflation;
        line
    }

    fn residual_s(&self, sample: &OffsetSample) -> f64 {
        sample.offset_s - self.offset_s - self.drift * (sample.time_s - self.mean_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const DRIFT_PPM: f64 = 50.0;
    const START: MonotonicNs = MonotonicNs(1_000_000_000_000);

    /// The simulated board's tick at a host instant \[µs\].
    fn tick(at: MonotonicNs) -> u64 {
        (4_294_000_000.0 + at.seconds_since(START) * (1e6 + DRIFT_PPM)).round() as u64
    }

    /// Pings each 50 ms whose two ways take `base_s` plus an exponential delay of mean `jitter_s` each.
    fn pings(seconds: f64, base_s: (f64, f64), jitter_s: f64, seed: u64) -> Vec<Ping> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..(seconds / 0.05) as usize)
            .map(|k| {
                let mut delay = |base: f64| base - jitter_s * (1.0 - rng.random::<f64>()).ln();
                let sent = START.plus_seconds(k as f64 * 0.05);
                let at = sent.plus_seconds(delay(base_s.0));
                Ping { sent, board_tick_us: tick(at), received: at.plus_seconds(delay(base_s.1)) }
            })
            .collect()
    }

    fn error_s(fit: &ClockFit, at_s: f64) -> f64 {
        let at = START.plus_seconds(at_s);
        fit.host(tick(at)).seconds_since(at)
    }

    #[test]
    fn drift_of_50_ppm_is_found_and_the_error_is_as_stated() {
        let mut worst: f64 = 0.0;
        for seed in 0..20 {
            let fit = ClockFit::new(&pings(30.0, (100e-6, 100e-6), 100e-6, seed), Wire::NONE).unwrap();
            assert!((fit.drift_ppm() - DRIFT_PPM).abs() < 3.0, "{} ppm", fit.drift_ppm());
            for at_s in [0.0, 15.0, 30.0] {
                let (error, sigma) = (error_s(&fit, at_s), fit.sigma_s(START.plus_seconds(at_s)));
                assert!(error.abs() < 4.0 * sigma, "{error} s at {at_s} s, sigma {sigma}");
                worst = worst.max(error.abs());
            }
            assert_eq!(fit.contradicted, 0);
        }
        println!("worst clock error with 0.1 ms jitter each way, 30 s: {:.1} µs", worst * 1e6);
        // Unfitted, 50 ppm are 1500 µs after 30 s.
        assert!(worst < 50e-6);
    }

    #[test]
    fn late_samples_hardly_matter() {
        let clean = pings(30.0, (100e-6, 100e-6), 20e-6, 1);
        let mut late = clean.clone();
        // One answer in seven is held up by 16 ms, as by a USB bridge's latency timer; one board stamp is nonsense.
        for ping in late.iter_mut().step_by(7) {
            ping.received = ping.received.plus_seconds(16e-3);
        }
        late[100].board_tick_us += 5_000;
        let (clean, late) =
            (ClockFit::new(&clean, Wire::NONE).unwrap(), ClockFit::new(&late, Wire::NONE).unwrap());
        for at_s in [0.0, 30.0] {
            let difference = error_s(&late, at_s) - error_s(&clean, at_s);
            assert!(difference.abs() < 10e-6, "{difference} s");
        }
        assert!(late.dropped >= 1);
        assert_eq!(late.contradicted, 1);
    }

    #[test]
    fn asymmetry_biases_by_half_its_size_and_is_within_the_stated_sigma() {
        let fit = ClockFit::new(&pings(30.0, (100e-6, 900e-6), 20e-6, 2), Wire::NONE).unwrap();
        let bias = error_s(&fit, 15.0);
        // The answer's way is 0.8 ms longer: midpoints are 0.4 ms late.
        assert!((bias - 0.4e-3).abs() < 30e-6, "{bias} s");
        assert!(bias < 2.0 * fit.sigma_s(START.plus_seconds(15.0)));
    }

    #[test]
    fn bytes_on_a_wire_of_known_speed_leave_no_doubt() {
        // 1 ms there and 1.5 ms back, and USB on top
        let wire = Wire { to_s: 1e-3, back_s: 1.5e-3 };
        let pings = pings(30.0, (1.1e-3, 1.7e-3), 50e-6, 5);
        let [blind, fit] = [Wire::NONE, wire].map(|wire| ClockFit::new(&pings, wire).unwrap());
        let at = START.plus_seconds(15.0);
        assert!(blind.sigma_s(at) > 0.7e-3 && fit.sigma_s(at) < 0.15e-3, "{}", fit.sigma_s(at));
        assert!(error_s(&fit, 15.0).abs() < 2.0 * fit.sigma_s(at), "{}", error_s(&fit, 15.0));
        assert_eq!((fit.contradicted, fit.wire_s), (0, 2.5e-3));
        // round trips that no such wire allows
        let quick = self::pings(5.0, (200e-6, 200e-6), 50e-6, 6);
        assert_eq!(ClockFit::new(&quick, wire), ClockFit::new(&quick, Wire::NONE));
    }

    #[test]
    fn same_pings_give_the_same_line_and_one_is_enough() {
        let pings = pings(5.0, (100e-6, 100e-6), 100e-6, 3);
        let recorded: Vec<Ping> = serde_json::from_str(&serde_json::to_string(&pings).unwrap()).unwrap();
        assert_eq!(ClockFit::new(&pings, Wire::NONE), ClockFit::new(&recorded, Wire::NONE));

        let one = ClockFit::new(&pings[..1], Wire::NONE).unwrap();
        assert!(error_s(&one, 0.0).abs() < 1e-3);
        assert!(one.sigma_s(START.plus_seconds(10.0)) > one.sigma_s(START.plus_seconds(1.0)));
        assert!(ClockFit::new(&[], Wire::NONE).is_none());
    }

    #[test]
    fn mapping_there_and_back_is_the_same_tick() {
        let fit = ClockFit::new(&pings(5.0, (100e-6, 100e-6), 100e-6, 4), Wire::NONE).unwrap();
        for tick in [4_293_999_999, 4_294_967_296, 4_300_000_001] {
            assert_eq!(fit.board_tick_us(fit.host(tick)), tick);
        }
    }

    #[test]
    fn ticks_continue_over_the_wrap_in_both_directions() {
        let mut extender = TickExtender::default();
        assert_eq!(extender.extend(u32::MAX - 1), 0xffff_fffe);
        assert_eq!(extender.extend(5), 0x1_0000_0005);
        assert_eq!(extender.extend(u32::MAX), 0xffff_ffff);
        assert_eq!(extender.extend(0x7000_0000), 0x1_7000_0000);
        assert_eq!(extender.extend(0xd000_0000), 0x1_d000_0000);
        assert_eq!(extender.extend(1), 0x2_0000_0001);
    }
}
