//! The Uno's firmware in an emulator: what its pins do when host, line or firmware fail.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;
mod emulator;

use firmware_protocol::channel::{ChannelConfig, SafeState};
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::{Event, Fault, State};
use firmware_protocol::packet::Packet;
use firmware_protocol::units::{Channel, DurationMs, DurationUs, PulseWidthUs, RateUsPerS};

use bench::dice::Dice;
use emulator::*;

/// Servos 0, 1 and 6, each with another safe state.
const SAFE: [(u8, SafeState); 3] = [(0, SafeState::Detach), (1, SafeState::Hold), (6, SafeState::Park)];
const PARK_US: u64 = 1400;

fn three_servos(emulator: &mut Emulator) {
    emulator.say(Command::Hello);
    for (channel, safe_state) in SAFE {
        let config = ChannelConfig { max_rate: RateUsPerS(1_000_000), ..wide_servo(channel, safe_state) };
        emulator.attach(config, 1000);
    }
}

/// A profile of one slow stroke on all three, running.
fn run_profile(emulator: &mut Emulator) {
    let line = Segment { duration: DurationUs(8_000_000), end_pulse: PulseWidthUs(2000) };
    for (channel, _) in SAFE {
        let channel = Channel(channel);
        let start_pulse = PulseWidthUs(1000);
        emulator.must(Command::Track { channel, start_pulse, segments: 1 });
        emulator.must(Command::Segments { channel, first: 0, segments: Segments::new(&[line]).unwrap() });
    }
    let start = emulator.tick().plus(DurationUs(30_000));
    emulator.must(Command::Arm { start, segments: 3 });
    emulator.pass_ms(500);
}

fn status(emulator: &mut Emulator) -> (State, Fault) {
    match emulator.say(Command::Status) {
        Event::Status(status) => (status.state, status.fault),
        other => panic!("{other:?}"),
    }
}

/// That from `limit_ms` after `cycle` on every servo is in its safe state; says how long after it the detached one's last pulse ended [ms].
fn assert_safe_after(emulator: &Emulator, cycle: u64, limit_ms: u64) -> f64 {
    let limit = cycle + limit_ms * CYCLES_PER_MS;
    let after = |pin: &str| -> Vec<Pulse> {
        emulator.pulses(pin).into_iter().filter(|pulse| pulse.rise >= limit).collect()
    };
    let pin = |index: usize| SERVO_PINS[usize::from(SAFE[index].0)];
    assert!(emulator.now_us * CYCLES_PER_US > limit + 5 * FRAME, "too short a record");
    // Detached: no pulse after the limit, nor the rest of one.
    let detached = emulator.edges.iter().rfind(|edge| edge.pin == pin(0)).unwrap();
    assert!(!detached.high && detached.cycle < limit, "{detached:?} after {cycle}");
    let (held, parked) = (after(pin(1)), after(pin(2)));
    assert!(held.len() >= 4 && held.iter().all(|p| p.width == held[0].width), "{held:?}");
    assert!(held[0].width > 1000 * CYCLES_PER_US, "it never moved");
    assert!(
        parked.len() >= 4 && parked.iter().all(|p| p.width == PARK_US * CYCLES_PER_US),
        "{parked:?} after {cycle}"
    );
    (detached.cycle as f64 - cycle as f64) / CYCLES_PER_MS as f64
}

#[test]
fn dead_man_makes_pins_safe_within_300_ms() {
    let Some(built) = built() else { return };
    for (round, noise) in [false, true].into_iter().enumerate() {
        let mut emulator = Emulator::new(built, &[]);
        three_servos(&mut emulator);
        emulator.must(Command::Timing { dead_man: DurationMs(250), telemetry: DurationMs(20) });
        run_profile(&mut emulator);
        emulator.run_us(3_700 * round as u64);
        let ping = emulator.next_packet(Command::Ping);
        let last = emulator.hand_over(&ping.encode());
        // What is no packet is no host.
        let mut dice = Dice(0x5eed_0001);
        while emulator.now_us * CYCLES_PER_US < last + 420 * CYCLES_PER_MS {
            if noise {
                emulator.hand_over(&[dice.below(256) as u8, dice.below(256) as u8, 0]);
            } else {
                emulator.run_ms(20);
            }
        }
        let ms = assert_safe_after(&emulator, last, 300);
        // Nor before its time.
        assert!(ms > 250.0 - 20.0, "{ms} ms");
        println!("last edge {ms:.2} ms after the last packet; {} bytes of stack free", emulator.stack_left());
        assert_eq!(status(&mut emulator), (State::Faulted, Fault::DeadMan));
    }
}

#[test]
fn e_stop_makes_pins_safe_within_20_ms() {
    let Some(built) = built() else { return };
    let mut worst = f64::NEG_INFINITY;
    // At many phases of the frame, alone and behind other packets.
    for phase in 0..12 {
        let mut emulator = Emulator::new(built, &[]);
        three_servos(&mut emulator);
        emulator.must(Command::Timing { dead_man: DurationMs(250), telemetry: DurationMs(20) });
        run_profile(&mut emulator);
        emulator.run_us(1_700 * phase);
        let mut bytes = Vec::new();
        for _ in 0..phase % 3 {
            bytes.extend_from_slice(&emulator.next_packet(Command::Describe(Channel(0))).encode());
        }
        bytes.extend_from_slice(&emulator.next_packet(Command::EStop).encode());
        let last = emulator.hand_over(&bytes);
        emulator.run_ms(140);
        worst = worst.max(assert_safe_after(&emulator, last, 20));
        assert_eq!(status(&mut emulator), (State::Faulted, Fault::EStop));
    }
    println!("last edge of a detached servo {worst:.2} ms after the e-stop");
}

#[test]
fn hung_firmware_is_reset_and_ends_safe() {
    let Some(built) = built() else { return };
    // With interrupts on pulses go on until the watchdog acts; with interrupts off they stop at once. An old bootloader
    // clears the reset's cause: with interrupts off, the firmware cannot find it by itself either.
    let (new, old) = (&["--optiboot", "8"][..], &["--optiboot", "4"][..]);
    for (how, arguments, fault) in [
        ("hang", &[][..], Fault::Watchdog),
        ("hang-deaf", &[], Fault::Watchdog),
        ("hang", new, Fault::Watchdog),
        ("hang-deaf", new, Fault::Watchdog),
        ("hang", old, Fault::Watchdog),
        ("hang-deaf", old, Fault::None),
    ] {
        let mut emulator = Emulator::new(built, arguments);
        three_servos(&mut emulator);
        let Event::Hello(before) = emulator.say(Command::Hello) else { panic!("no hello") };
        run_profile(&mut emulator);
        let (hung_us, starts) = (emulator.now_us, emulator.resets.len());
        emulator.order(how);
        // The host goes on talking: that feeds no watchdog.
        let ping = emulator.next_packet(Command::Ping).encode();
        for _ in 0..8 {
            emulator.send(&ping);
            emulator.run_ms(100);
        }
        assert_eq!(emulator.resets.len(), starts + 1, "{how}");
        let after_ms = (emulator.resets[starts] - hung_us * CYCLES_PER_US) as f64 / CYCLES_PER_MS as f64;
        assert!((450.0..560.0).contains(&after_ms), "{how}: reset after {after_ms} ms");
        println!("{how} {arguments:?}: reset after {after_ms:.1} ms");

        let reset = emulator.resets[starts];
        let moves = emulator.edges.iter().filter(|edge| SERVO_PINS.contains(&edge.pin.as_str()));
        let late: Vec<_> =
            moves.filter(|edge| edge.cycle > reset || (edge.high && edge.cycle == reset)).collect();
        assert!(late.is_empty(), "{how}: {late:?}");
        for pin in SERVO_PINS {
            let level = emulator.edges.iter().rfind(|edge| edge.pin == pin).is_some_and(|edge| edge.high);
            assert!(!level, "{how}: {pin} is high");
        }
        let state = if fault == Fault::None { State::Idle } else { State::Faulted };
        assert_eq!(status(&mut emulator), (state, fault), "{how} {arguments:?}");
        let Event::Hello(identity) = emulator.say(Command::Hello) else { panic!("no hello") };
        assert_ne!(identity.boot_id, before.boot_id, "{how}: the board does not tell of its reset");
    }
}

#[test]
fn start_tells_why_it_was_reset() {
    const EXTERNAL: u8 = 2;
    const BROWN_OUT: u8 = 4;
    const POWER_ON: u8 = 1;
    let Some(built) = built() else { return };
    const WATCHDOG: u8 = 8;
    for (arguments, tells) in [(&[][..], true), (&["--optiboot", "8"], true), (&["--optiboot", "4"], false)] {
        let mut emulator = Emulator::new(built, arguments);
        assert_eq!(status(&mut emulator), (State::Idle, Fault::None));
        for (flags, fault) in [
            (EXTERNAL, Fault::None),
            (BROWN_OUT, if tells { Fault::Supply } else { Fault::None }),
            (POWER_ON | BROWN_OUT, Fault::None),
            (WATCHDOG, if tells { Fault::Watchdog } else { Fault::None }),
            (EXTERNAL, Fault::None),
        ] {
            emulator.order(&format!("reset {flags}"));
            emulator.run_ms(40);
            assert_eq!(status(&mut emulator).1, fault, "{flags} {arguments:?}");
        }
    }
}

/// A pulse is what the crate's own board says for a time just before it: in the last `PULSE_AGE_LIMIT_MS`.
const PULSE_AGE_LIMIT_MS: u64 = 3;

#[test]
fn no_update_makes_a_glitch() {
    let Some(built) = built() else { return };
    let mut emulator = Emulator::new(built, &[]);
    let origin = emulator.tick_origin();
    let mut model = bench::Setup::of(emulator.board_config(), firmware_protocol::units::Ticks(0));
    // (cycle, channel, pulse) as the model has it, from the bytes and their times alone.
    let mut wanted: Vec<(u64, u8, u16)> = Vec::new();
    let mut dice = Dice(0x5eed_0002);
    let mut say = |emulator: &mut Emulator, packet: Packet, wait_us: u64| {
        let cycle = emulator.hand_over(&packet.encode());
        let tick = |cycle: u64| firmware_protocol::units::Ticks(((cycle - origin) / CYCLES_PER_US) as u32);
        let mut until = |model: &mut bench::Setup, at| {
            model.now = at;
            model.board.advance(at, &mut model.bench);
            for (channel, pulse, at) in model.bench.pulses.drain(..) {
                wanted.push((origin + u64::from(at) * CYCLES_PER_US, channel, pulse.unwrap_or(0)));
            }
        };
        until(&mut model, tick(cycle));
        model.feed(&packet.encode());
        emulator.run_us(wait_us);
        until(&mut model, tick(emulator.now_us * CYCLES_PER_US));
    };
    let hello = emulator.next_packet(Command::Hello);
    say(&mut emulator, hello, 5_000);
    for channel in 0..8 {
        let configure = Command::Configure(wide_servo(channel, SafeState::Hold));
        let jog =
            Command::Jog { channel: Channel(channel), pulse: PulseWidthUs(1500), duration: DurationUs(0) };
        for command in [configure, jog] {
            let packet = emulator.next_packet(command);
            say(&mut emulator, packet, 5_000);
        }
    }
    for _ in 0..400 {
        let (channel, pulse) = (Channel(dice.below(8) as u8), PulseWidthUs(500 + dice.below(2001) as u16));
        let duration = DurationUs(dice.pick(&[1, 1, 5_000, 30_000, 200_000, 900_000]));
        let packet = emulator.next_packet(Command::Jog { channel, pulse, duration });
        let wait_us = u64::from(dice.below(60_000));
        say(&mut emulator, packet, wait_us);
    }

    let (mut count, mut moved) = (0, 0);
    for (channel, pin) in (0..).zip(SERVO_PINS) {
        let pulses = emulator.pulses(pin);
        for pair in pulses.windows(2) {
            assert_eq!(pair[1].rise - pair[0].rise, FRAME, "{pin}");
            moved += u64::from(pair[0].width != pair[1].width);
        }
        let own: Vec<_> = wanted.iter().filter(|w| w.1 == channel).collect();
        for pulse in &pulses {
            assert_eq!(pulse.width % CYCLES_PER_US, 0, "{pin} at {}", pulse.rise);
            let (from, to) =
                (pulse.rise - PULSE_AGE_LIMIT_MS * CYCLES_PER_MS, pulse.rise + CYCLES_PER_MS / 10);
            // What it had at `from`, and all until the pulse began.
            let first = own.iter().rposition(|w| w.0 <= from).unwrap_or(0);
            let near: Vec<_> =
                own[first..].iter().take_while(|w| w.0 <= to).map(|w| u64::from(w.2)).collect();
            let (least, most) = (near.iter().min().unwrap() - 1, near.iter().max().unwrap() + 1);
            let width = pulse.width / CYCLES_PER_US;
            assert!((least..=most).contains(&width), "{pin} at {}: {width}, not of {near:?}", pulse.rise);
        }
        count += pulses.len();
    }
    println!(
        "{count} pulses, {moved} of them another than the one before; {} bytes of stack free",
        emulator.stack_left()
    );
    assert!(moved > 1_000);
}

#[test]
fn eight_moving_servos_leave_the_board_time() {
    /// The answer to a ping has this long to be whole; 16 bytes of it are 1.5 ms on the line.
    const ANSWER_MS: f64 = 5.0;
    let Some(built) = built() else { return };
    let mut emulator = Emulator::new(built, &[]);
    emulator.say(Command::Hello);
    for channel in 0..8 {
        emulator.attach(wide_servo(channel, SafeState::Hold), 500);
    }
    for channel in 0..8 {
        // 2 s: each update of each of them comes at a tick of its own.
        emulator.jog(channel, 2500, 2_000_000 + u32::from(channel));
    }
    let mut worst: f64 = 0.0;
    for _ in 0..60 {
        let Event::Pong { at, state, .. } = emulator.say(Command::Ping) else { panic!("no pong") };
        assert_eq!(state, State::Jogging, "at {at}");
        let (asked, answered) = (emulator.taken.last().unwrap().0, emulator.events.last().unwrap().0);
        worst = worst.max((answered - asked) as f64 / CYCLES_PER_MS as f64);
        emulator.run_us(11_300);
    }
    println!("a ping is answered within {worst:.2} ms while eight servos move");
    assert!(worst < ANSWER_MS, "{worst} ms");
    // Each pulse is the line's at most 2 ms before: 2 us of pulse.
    emulator.pass_ms(1_200);
    assert_eq!(status(&mut emulator), (State::Idle, Fault::None));
    for pin in SERVO_PINS {
        let pulses = emulator.pulses(pin);
        assert_eq!(pulses.last().unwrap().width, 2500 * CYCLES_PER_US, "{pin}");
        let steps = pulses.windows(2).map(|pair| (pair[1].width - pair[0].width) / CYCLES_PER_US);
        assert!(steps.clone().all(|step| step <= 22), "{pin}: {:?}", steps.max());
    }
}
