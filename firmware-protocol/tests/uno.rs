//! The Uno's firmware in an emulator, asserted on the pulses at its pins.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;
mod emulator;

use firmware_protocol::channel::{ChannelConfig, SafeState};
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::{Event, Refusal};
use firmware_protocol::units::{Channel, DurationMs, DurationUs, PulseWidthUs};

use bench::dice::Dice;
use emulator::*;

/// A session in which the host may be silent for two seconds.
fn ready(built: &Built) -> Emulator {
    let mut emulator = Emulator::new(built, &[]);
    emulator.say(Command::Hello);
    patience(&mut emulator, 2000);
    emulator
}

fn patience(emulator: &mut Emulator, ms: u16) {
    emulator.must(Command::Timing { dead_man: DurationMs(ms), telemetry: DurationMs(0) });
}

fn widths_us(pulses: &[Pulse]) -> Vec<u64> {
    pulses.iter().map(|p| p.width / CYCLES_PER_US).collect()
}

/// Every pulse exact to the cycle in length, the first of them apart, and 20 ms from one to the next.
fn assert_steady(emulator: &Emulator, pin: &str, width_us: u64) {
    let pulses = emulator.pulses(pin);
    assert!(pulses.len() >= 2, "{pin}: {pulses:?}");
    for pair in pulses.windows(2) {
        assert_eq!(pair[1].rise - pair[0].rise, FRAME, "{pin}");
    }
    for pulse in pulses {
        assert_eq!(pulse.width, width_us * CYCLES_PER_US, "{pin} at cycle {}", pulse.rise);
    }
}

#[test]
fn widths_are_exact_on_all_channels() {
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    for channel in 0..8 {
        emulator.attach(wide_servo(channel, SafeState::Detach), 1500);
    }
    // Neighbours share a port and a slot: the distance of their ends goes through all that one interrupt writes, and
    // beyond.
    let together = (0..=45).map(|gap| [1200 + gap, 1200]).chain((1..=45).map(|gap| [900, 900 + gap]));
    let extremes = [[500, 500], [2500, 2500], [500, 2500], [2500, 500], [501, 2499]];
    let mut measured = 0;
    for (number, [even, odd]) in extremes.into_iter().chain(together).enumerate() {
        for channel in 0..8 {
            emulator.jog(channel, if channel % 2 == 0 { even } else { odd }, 1);
        }
        emulator.run_ms(22);
        emulator.edges.clear();
        // While the line is busy in both directions: no interrupt may move an edge.
        let ping = emulator.next_packet(Command::Ping).encode();
        emulator.hand_over(&ping.repeat(1 + number % 3));
        emulator.run_us(44_000 + 137 * number as u64);
        for (pin, width) in SERVO_PINS.iter().zip([even, odd].into_iter().cycle()) {
            assert_steady(&emulator, pin, u64::from(width));
            measured += emulator.pulses(pin).len();
        }
    }
    println!("{measured} pulses exact to the cycle; {} bytes of stack free", emulator.stack_left());
}

#[test]
fn limits_that_the_pins_cannot_keep_are_refused() {
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    let servo = wide_servo(3, SafeState::Hold);
    let short = ChannelConfig { min_pulse: PulseWidthUs(99), ..servo };
    let long = ChannelConfig { max_pulse: PulseWidthUs(4901), ..servo };
    for (config, refusal, limit) in
        [(short, Refusal::PulseTooShort, 100), (long, Refusal::PulseTooLong, 4900)]
    {
        let ack = emulator.ack(Command::Configure(config));
        assert_eq!((ack.refusal, ack.limit), (refusal, limit));
    }
    // At the edge of what they can.
    let edge = ChannelConfig { min_pulse: PulseWidthUs(100), max_pulse: PulseWidthUs(4900), ..servo };
    for (channel, pulse) in [(2, 100), (3, 4900), (4, 4880), (5, 4900), (6, 100), (7, 101)] {
        emulator.attach(ChannelConfig { channel: Channel(channel), ..edge }, pulse);
    }
    emulator.run_ms(25);
    emulator.edges.clear();
    emulator.run_ms(100);
    for (channel, pulse) in [(2, 100), (3, 4900), (4, 4880), (5, 4900), (6, 100), (7, 101)] {
        let pulses = emulator.pulses(SERVO_PINS[channel]);
        assert!(pulses.len() >= 4);
        assert!(pulses.iter().all(|p| p.width == pulse * CYCLES_PER_US), "{channel}: {pulses:?}");
    }
}

/// Least squares line through (x, y): intercept and slope.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
    (my - slope * mx, slope)
}

#[test]
fn strokes_are_two_to_one_at_the_pin() {
    /// Strokes: 600 ms up, 300 ms down.
    const SLOW_US: u32 = 600_000;
    const FAST_US: u32 = 300_000;
    const TOLERANCE_MS: f64 = 0.1;
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    let (low, high) = (700, 2300);
    emulator.attach(wide_servo(0, SafeState::Hold), low);
    emulator.run_ms(30);
    let cycles = 4;
    emulator.must(Command::Track {
        channel: Channel(0),
        start_pulse: PulseWidthUs(low),
        segments: 2 * cycles as u16,
    });
    let strokes = [(SLOW_US, high), (FAST_US, low)];
    let strokes = strokes.map(|(us, end)| Segment { duration: DurationUs(us), end_pulse: PulseWidthUs(end) });
    let segments = Segments::new(&strokes.repeat(cycles)).unwrap();
    emulator.must(Command::Segments { channel: Channel(0), first: 0, segments });
    let origin = emulator.tick_origin();
    let start = emulator.tick().plus(DurationUs(50_000));
    emulator.must(Command::Arm { start, segments: 2 * cycles as u16 });
    emulator.edges.clear();
    emulator.pass_ms(4_000);

    // Times at which the pulse turned, from where the lines through the strokes' pulses meet.
    let began = (origin + u64::from(start.0) * CYCLES_PER_US) as f64;
    let pulses: Vec<_> = emulator
        .pulses("D2")
        .iter()
        .map(|p| {
            let ms = (p.rise as f64 - began) / CYCLES_PER_MS as f64;
            (ms, p.width as f64 / CYCLES_PER_US as f64)
        })
        .collect();
    let (slow, fast) = (f64::from(SLOW_US) / 1000.0, f64::from(FAST_US) / 1000.0);
    let lines: Vec<_> = (0..2 * cycles)
        .map(|stroke| {
            let from = (slow + fast) * (stroke / 2) as f64 + if stroke % 2 == 0 { 0.0 } else { slow };
            let to = from + if stroke % 2 == 0 { slow } else { fast };
            // A turn between update and pulse is not of this stroke.
            let inside = pulses.iter().copied().filter(|(ms, _)| (from + 5.0..to - 5.0).contains(ms));
            line(&inside.collect::<Vec<_>>())
        })
        .collect();
    let turns: Vec<_> = lines.windows(2).map(|l| (l[0].0 - l[1].0) / (l[1].1 - l[0].1)).collect();
    let mut worst: f64 = 0.0;
    for (number, stroke) in turns.windows(2).enumerate() {
        let length = stroke[1] - stroke[0];
        let commanded = if number % 2 == 0 { fast } else { slow };
        worst = worst.max((length - commanded).abs());
    }
    println!("turns at {turns:.3?} ms; worst stroke off by {worst:.3} ms");
    assert_eq!(turns.len(), 2 * cycles - 1);
    assert!(turns.iter().all(|turn| turn.is_finite()), "{turns:?}");
    assert!(worst < TOLERANCE_MS, "a stroke is off by {worst} ms");
    // Not only among themselves: to the board's own clock. An update is up to 1 ms old when a pulse shows it.
    assert!((turns[0] - slow).abs() < 1.1, "{turns:?}");
}

#[test]
fn sync_led_tells_the_tick() {
    use firmware_protocol::sync_led;
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    for wait_ms in [0, 700, 9_000] {
        emulator.pass_ms(wait_ms);
        let origin = emulator.tick_origin();
        let from = emulator.now_us;
        emulator.pass_ms(2_400);
        // As a camera at 60 images/s sees it: lit or not, each 16.7 ms.
        let lit_at = |us: u64| {
            let before = emulator.edges.iter().rfind(|e| e.pin == SYNC_LED_PIN && e.cycle <= us * 16);
            before.is_some_and(|edge| edge.high)
        };
        let images: Vec<_> = (from..emulator.now_us).step_by(16_667).map(|us| (us, lit_at(us))).collect();
        // Slots begin where the first change was seen.
        let change = images.windows(2).find(|pair| pair[0].1 != pair[1].1).unwrap()[1].0;
        let slot = u64::from(sync_led::SLOT.0);
        let observed = (0..u64::from(sync_led::WINDOW))
            .map(|n| u16::from(lit_at(change + slot / 2 + n * slot)) << n)
            .sum::<u16>();
        let began = u64::from(sync_led::began(observed).unwrap().0);
        let off_us = (change - origin / CYCLES_PER_US).abs_diff(began);
        assert!(off_us < 17_000, "the LED says {began}, {off_us} us off");
        // Each edge against the formula.
        for edge in emulator.edges.iter().filter(|edge| edge.pin == SYNC_LED_PIN && edge.cycle > from * 16) {
            let tick = (edge.cycle - origin) / CYCLES_PER_US;
            let slot_began = (tick + 100) / slot * slot;
            assert!(tick.abs_diff(slot_began) < 60, "an edge at tick {tick}");
            let at = firmware_protocol::units::Ticks(slot_began as u32);
            assert_eq!(sync_led::lit(at), edge.high, "at tick {tick}");
        }
    }
}

#[test]
fn boot_id_differs_after_each_start() {
    let Some(built) = built() else { return };
    let file = built.elf.with_file_name("eeprom");
    let _ = std::fs::remove_file(&file);
    let mut ids = Vec::new();
    for _ in 0..2 {
        let mut emulator = Emulator::new(built, &["--eeprom", file.to_str().unwrap()]);
        for _ in 0..3 {
            let Event::Hello(identity) = emulator.say(Command::Hello) else { panic!("no hello") };
            assert_eq!((identity.channels, identity.max_segments), (8, 64));
            ids.push(identity.boot_id);
            // By the reset button, or by the host that opens the port.
            emulator.order("reset 2");
            emulator.run_ms(40);
        }
        emulator.power_off();
    }
    let mut different = ids.clone();
    different.sort_unstable();
    different.dedup();
    assert_eq!(different.len(), ids.len(), "{ids:?}");
}

#[test]
fn release_and_lamp_follow_their_channels() {
    use firmware_protocol::channel::ChannelKind;
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    for (channel, kind, pin, on, off) in
        [(5, ChannelKind::Release, HOLD_PIN, 1000, 2000), (6, ChannelKind::SyncLed, LAMP_PIN, 2000, 1000)]
    {
        let config = ChannelConfig { kind, ..wide_servo(channel, SafeState::Detach) };
        let level = |emulator: &Emulator| {
            emulator.edges.iter().rfind(|edge| edge.pin == pin).is_some_and(|edge| edge.high)
        };
        assert!(!level(&emulator));
        emulator.attach(config, on);
        assert!(level(&emulator), "{pin}");
        emulator.jog(channel, off, 1);
        assert!(!level(&emulator), "{pin}");
        emulator.jog(channel, on, 1);
        assert!(level(&emulator), "{pin}");
        emulator.must(Command::EStop);
        assert!(!level(&emulator), "{pin}");
        emulator.must(Command::Acknowledge(firmware_protocol::event::Fault::EStop));
    }
}

#[test]
fn no_garbage_moves_a_pin() {
    let Some(built) = built() else { return };
    let mut emulator = Emulator::new(built, &[]);
    let mut dice = Dice(0x5eed_0003);
    let jog = Command::Jog { channel: Channel(1), pulse: PulseWidthUs(2400), duration: DurationUs(1) };
    let whole = emulator.next_packet(jog).encode();
    let flood = |emulator: &mut Emulator, dice: &mut Dice| {
        let noise: Vec<u8> = (0..600).map(|_| dice.below(256) as u8).collect();
        emulator.hand_over(&noise);
        emulator.hand_over(&[0; 200]);
        emulator.hand_over(&[0x55, 0].repeat(150));
        emulator.hand_over(&[0x55; 300]);
        emulator.hand_over(&[0]);
        for cut in 1..whole.len() - 1 {
            emulator.hand_over(&whole[..cut]);
            emulator.hand_over(&[0]);
        }
        for bit in 8..8 * (whole.len() - 1) {
            let mut damaged = whole.to_vec();
            damaged[bit / 8] ^= 1 << (bit % 8);
            emulator.hand_over(&damaged);
        }
    };
    // No host yet: no pin moves, and an undamaged jog is refused.
    flood(&mut emulator, &mut dice);
    assert_eq!(emulator.ack(jog).refusal, Refusal::NoSession);
    assert!(emulator.edges.iter().all(|edge| edge.pin == SYNC_LED_PIN), "{:?}", emulator.edges);

    emulator.say(Command::Hello);
    for channel in 0..2 {
        emulator.attach(wide_servo(channel, SafeState::Hold), 1234);
    }
    emulator.run_ms(25);
    emulator.edges.clear();
    flood(&mut emulator, &mut dice);
    for pin in &SERVO_PINS[..2] {
        let pulses = emulator.pulses(pin);
        assert!(pulses.len() > 15, "{}", pulses.len());
        assert!(pulses.iter().all(|p| p.width == 1234 * CYCLES_PER_US), "{pin}: {:?}", widths_us(&pulses));
    }
    assert!(emulator.edges.iter().all(|edge| ["D2", "D3", SYNC_LED_PIN].contains(&edge.pin.as_str())));
    // The next whole packet is received.
    assert!(matches!(emulator.say(Command::Status), Event::Status(_)));
}

#[test]
fn tick_is_right_where_its_timer_wraps() {
    /// The timer that the tick is made of wraps so often.
    const WRAP_US: u64 = 4096;
    /// From when the emulator says that a byte was read to when the firmware takes the time.
    const STAMP_US: u64 = 5;
    let Some(built) = built() else { return };
    let mut emulator = Emulator::new(built, &[]);
    let origin = emulator.tick_origin();
    // How long after it is sent the last byte of a ping is read.
    let sent_us = emulator.now_us;
    let read = emulator.tick_origin().abs_diff(origin);
    assert!(read <= STAMP_US * CYCLES_PER_US);
    let takes_us = emulator.taken.last().unwrap().0 / CYCLES_PER_US - sent_us;
    let mut wraps = 0;
    for step in 0..60 {
        // So that it is read from 15 us before a wrap to 15 us after, in half microseconds and in any phase of the cycle.
        let tick_us = emulator.now_us - origin / CYCLES_PER_US;
        let aim = (tick_us / WRAP_US + 3) * WRAP_US + step / 2 - 15;
        emulator.run_us(aim - tick_us - takes_us);
        let found = emulator.tick_origin();
        let off = found.abs_diff(origin);
        assert!(off <= STAMP_US * CYCLES_PER_US, "step {step}: the tick is {off} cycles off");
        wraps += u64::from((emulator.taken.last().unwrap().0 - origin) / CYCLES_PER_US % WRAP_US < 20);
    }
    assert!(wraps > 10, "{wraps} pings came just after a wrap");
}

#[test]
fn tick_wraps_without_a_gap() {
    use firmware_protocol::sync_led;
    use firmware_protocol::units::Ticks;
    // Begins one slot of the sync LED before the tick wraps, after 71.6 minutes.
    let Some(built) = build("wrap", &["-DFIRST_WRAPS=0xffff0"]) else { return };
    let mut emulator = Emulator::new(&built, &[]);
    let tick = |emulator: &mut Emulator| {
        let Event::Pong { at, .. } = emulator.say(Command::Ping) else { panic!("no pong") };
        (emulator.taken.last().unwrap().0, at)
    };
    let (before_cycle, before) = tick(&mut emulator);
    emulator.say(Command::Hello);
    emulator.attach(wide_servo(0, SafeState::Hold), 1000);
    emulator.jog(0, 2000, 200_000);
    emulator.pass_ms(1_500);
    let (after_cycle, after) = tick(&mut emulator);
    assert!(before.0 > u32::MAX - 60_000 && after.0 < 2_000_000, "{before} {after}");
    assert!((after.since(before) as u64 * CYCLES_PER_US).abs_diff(after_cycle - before_cycle) < 100);
    // The jog went on across it.
    let pulses = emulator.pulses("D2");
    assert!(
        pulses.windows(2).all(|pair| pair[0].width <= pair[1].width && pair[1].rise - pair[0].rise == FRAME)
    );
    assert_eq!(pulses.last().unwrap().width, 2000 * CYCLES_PER_US);
    // And the pattern began again.
    let edges: Vec<_> = emulator.edges.iter().filter(|edge| edge.pin == SYNC_LED_PIN).collect();
    for pair in edges.windows(2) {
        let middle = (pair[0].cycle + pair[1].cycle) / 2;
        let at = Ticks(after.0.wrapping_sub(((after_cycle - middle) / CYCLES_PER_US) as u32));
        assert_eq!(sync_led::lit(at), pair[0].high, "at {at}");
    }
    assert!(edges.len() >= 3);
}

#[test]
fn byte_at_the_worst_moment_moves_no_edge() {
    /// The byte comes so long before an edge, whose interrupt comes 15 us before it; its own lasts less than 8 us.
    const BEFORE_US: std::ops::Range<u64> = 8..24;
    let Some(built) = built() else { return };
    let mut emulator = ready(built);
    for (channel, pulse) in [(0, 700), (1, 900)] {
        emulator.attach(wide_servo(channel, SafeState::Hold), pulse);
    }
    emulator.run_ms(45);
    let rise = emulator.pulses("D3").last().unwrap().rise;
    let sent_us = emulator.now_us;
    emulator.say(Command::Ping);
    let takes_us = emulator.taken.last().unwrap().0 / CYCLES_PER_US - sent_us;
    // What ends a packet takes the byte's interrupt longest, and what begins the pulses of a pair the edge's.
    let phases = (0..8).map(|phase| (0, 2 * phase)).chain([(700, 0), (900, 0)]);
    for ((edge_us, cycles), before_us) in phases.flat_map(|at| BEFORE_US.map(move |b| (at, b))) {
        let frames = (emulator.now_us * CYCLES_PER_US - rise) / FRAME + 2;
        let edge = (rise + frames * FRAME) / CYCLES_PER_US + edge_us;
        let aim = edge - before_us - takes_us;
        emulator.edges.clear();
        emulator.run_us_and_cycles(aim - emulator.now_us, cycles);
        emulator.say(Command::Ping);
        emulator.run_ms(6);
        for (pin, width) in [("D2", 700), ("D3", 900)] {
            for pulse in emulator.pulses(pin) {
                assert_eq!((pulse.rise - rise) % FRAME, 0, "{pin}, a byte {before_us} us before");
                assert_eq!(pulse.width, width * CYCLES_PER_US, "{pin}, a byte {before_us} us before");
            }
        }
    }
}
