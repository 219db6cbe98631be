//! The board's behaviour, in virtual ticks.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;

use firmware_protocol::board::DEFAULT_DEAD_MAN;
use firmware_protocol::channel::{ChannelConfig, SafeState};
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::{Event, Fault, Occurrence, Refusal, State};
use firmware_protocol::units::{Channel, DurationMs, DurationUs, PulseWidthUs, RateUsPerS, Sequence, Ticks};
use proptest::prelude::*;

use bench::*;

/// Up slowly at 1 µs/ms, back at 2 µs/ms, `cycles` times, around the centre: whole microseconds at every update, so
/// that a turn shows at its very tick.
fn two_to_one(cycles: usize) -> Vec<(u32, u16)> {
    let mut segments = vec![(500_000, 2000)];
    for _ in 1..cycles {
        segments.extend([(500_000, 1000), (1_000_000, 2000)]);
    }
    segments.extend([(500_000, 1000), (500_000, 1500)]);
    segments
}

#[test]
fn slow_stroke_lasts_exactly_twice_the_fast_one_on_the_pin() {
    let mut setup = Setup::ready(SafeState::Hold);
    let start = setup.arm(&two_to_one(4));
    setup.bench.pulses.clear();
    let events = setup.pass(7000);

    let at = |value: u16| -> Vec<i32> {
        let found = setup.bench.pulses.iter().filter(|p| p.1 == Some(value));
        found.map(|p| Ticks(p.2).since(start)).collect()
    };
    let (tops, bottoms) = (at(2000), at(1000));
    assert_eq!(tops, [500_000, 2_000_000, 3_500_000, 5_000_000]);
    assert_eq!(bottoms, [1_000_000, 2_500_000, 4_000_000, 5_500_000]);
    for cycle in 1..4 {
        assert_eq!(tops[cycle] - bottoms[cycle - 1], 2 * (bottoms[cycle] - tops[cycle]));
    }
    let finished = start.plus(DurationUs(6_000_000));
    assert!(events.contains(&Event::Happened {
        occurrence: Occurrence::Finished,
        fault: Fault::None,
        at: finished
    }));
    assert_eq!((setup.board.state(), setup.board.pulse(SERVO)), (State::Idle, Some(CENTRE)));
}

#[test]
fn late_calls_change_no_pulse_and_no_tick() {
    let pulses = |step_us: u32| {
        let mut setup = Setup::ready(SafeState::Hold);
        setup.must(Command::Timing { dead_man: DurationMs(2000), telemetry: DurationMs(0) });
        setup.arm(&[(300_000, 1700), (150_000, 1500)]);
        for _ in 0..(600_000 / step_us) {
            setup.silence(DurationUs(step_us));
        }
        setup.bench.pulses
    };
    let fine = pulses(100);
    assert!(fine.len() > 300);
    assert_eq!(fine, pulses(600_000));
}

#[test]
fn resent_command_is_carried_out_once_and_answered_alike() {
    let mut setup = Setup::ready(SafeState::Hold);
    setup.must(Command::Track { channel: SERVO, start_pulse: CENTRE, segments: 2 });
    let part =
        Segments::new(&[Segment { duration: DurationUs(100_000), end_pulse: PulseWidthUs(1600) }]).unwrap();
    let packet =
        Command::Segments { channel: SERVO, first: 0, segments: part }.encode(Sequence(900)).encode();
    let first = setup.feed(&packet);
    assert_eq!(setup.feed(&packet), first);
    assert_eq!(setup.feed(&packet), first);
    // Carried out again, the segment would be out of order; carried out twice, the next would be.
    let again = Command::Segments { channel: SERVO, first: 1, segments: part };
    setup.must(again);
    assert_eq!(setup.refused(Command::Clear).0, Refusal::None);

    let bad = Command::Jog { channel: Channel(9), pulse: CENTRE, duration: DurationUs(0) };
    let packet = bad.encode(Sequence(901)).encode();
    assert_eq!(setup.feed(&packet), setup.feed(&packet));
}

#[test]
fn limits_are_checked_on_the_board() {
    let mut setup = Setup::ready(SafeState::Hold);
    let jog =
        |pulse, us| Command::Jog { channel: SERVO, pulse: PulseWidthUs(pulse), duration: DurationUs(us) };
    assert_eq!(setup.refused(jog(2001, 1_000_000)), (Refusal::PulseTooLong, 2000, 2001));
    assert_eq!(setup.refused(jog(999, 1_000_000)), (Refusal::PulseTooShort, 1000, 999));
    assert_eq!(setup.refused(jog(1700, 99_999)), (Refusal::RateTooHigh, 2000, 2001));
    setup.must(jog(1700, 100_000));
    setup.pass(100);

    let segment = |us, pulse| Segment { duration: DurationUs(us), end_pulse: PulseWidthUs(pulse) };
    setup.must(Command::Track { channel: SERVO, start_pulse: CENTRE, segments: 2 });
    // A refused packet leaves nothing behind, not even its good segments.
    let segments = Segments::new(&[segment(100_000, 1600), segment(10_000, 2000)]).unwrap();
    let upload = Command::Segments { channel: SERVO, first: 0, segments };
    assert_eq!(setup.refused(upload), (Refusal::RateTooHigh, 2000, 40_000));
    let segments = Segments::new(&[segment(100_000, 1600), segment(300_000, 2000)]).unwrap();
    setup.must(Command::Segments { channel: SERVO, first: 0, segments });
    let start = setup.now.plus(DurationUs(20_000));
    assert_eq!(setup.refused(Command::Arm { start, segments: 2 }), (Refusal::NotAtStart, 1700, 1500));

    let bad = ChannelConfig { park_pulse: PulseWidthUs(3000), ..servo(SafeState::Park) };
    assert_eq!(setup.refused(Command::Configure(bad)).0, Refusal::BadLimits);
    let endless = ChannelConfig { max_rate: RateUsPerS(0), ..servo(SafeState::Park) };
    assert_eq!(setup.refused(Command::Configure(endless)).0, Refusal::BadLimits);
    let timing = Command::Timing { dead_man: DurationMs(2001), telemetry: DurationMs(0) };
    assert_eq!(setup.refused(timing), (Refusal::BadTiming, 2000, 2001));
}

#[test]
fn start_in_the_past_too_near_or_too_far_is_refused() {
    let mut setup = Setup::ready(SafeState::Hold);
    setup.upload(&[(100_000, 1600)]);
    let mut arm = |lead: i32| {
        let start = Ticks(setup.now.0.wrapping_add_signed(lead));
        setup.refused(Command::Arm { start, segments: 1 })
    };
    assert_eq!(arm(-1), (Refusal::Underflow, 5_000, 0));
    assert_eq!(arm(4_999), (Refusal::Underflow, 5_000, 4_999));
    assert_eq!(arm(60_000_001).0, Refusal::TooFar);
    assert_eq!(arm(5_000).0, Refusal::None);
}

#[test]
fn incomplete_or_disordered_profile_is_refused() {
    let mut setup = Setup::ready(SafeState::Hold);
    let one = Segments::new(&[Segment { duration: DurationUs(100_000), end_pulse: CENTRE }]).unwrap();
    let part = |first| Command::Segments { channel: SERVO, first, segments: one };
    assert_eq!(setup.refused(part(0)).0, Refusal::OutOfOrder);
    let track = |segments| Command::Track { channel: SERVO, start_pulse: CENTRE, segments };
    assert_eq!(setup.refused(track(65)), (Refusal::NoRoom, 64, 65));
    setup.must(track(2));
    assert_eq!(setup.refused(part(1)).0, Refusal::OutOfOrder);
    setup.must(part(0));
    let start = setup.now.plus(DurationUs(20_000));
    assert_eq!(setup.refused(Command::Arm { start, segments: 1 }).0, Refusal::Incomplete);
    setup.must(part(1));
    assert_eq!(setup.refused(part(2)).0, Refusal::NoRoom);
    assert_eq!(setup.refused(Command::Arm { start, segments: 1 }), (Refusal::Incomplete, 2, 1));
    setup.must(Command::Arm { start, segments: 2 });
}

/// Puts a board into each state that can be reached.
fn in_state(state: State, safe_state: SafeState) -> Setup {
    let mut setup = Setup::ready(safe_state);
    match state {
        State::Idle => {}
        State::Jogging => {
            setup.must(Command::Jog {
                channel: SERVO,
                pulse: PulseWidthUs(1900),
                duration: DurationUs(5_000_000),
            });
        }
        State::Armed => {
            setup.upload(&two_to_one(9));
            let start = setup.now.plus(DurationUs(10_000_000));
            setup.must(Command::Arm { start, segments: two_to_one(9).len() as u16 });
        }
        State::Running => {
            setup.arm(&two_to_one(9));
            setup.pass(300);
        }
        State::Faulted => {
            setup.must(Command::EStop);
        }
    }
    assert_eq!(setup.board.state(), state);
    setup
}

#[test]
fn dead_man_acts_at_its_tick_from_every_state() {
    for &state in State::ALL {
        let mut setup = in_state(state, SafeState::Detach);
        let last_packet = setup.now;
        setup.silence(DurationUs(249_999));
        assert_eq!(setup.board.state(), state, "a tick early");
        let events = setup.silence(DurationUs(1));
        assert_eq!((setup.board.state(), setup.board.pulse(SERVO)), (State::Faulted, None), "{state}");
        if state != State::Faulted {
            assert_eq!(setup.board.fault(), Fault::DeadMan);
            let at = last_packet.plus(DEFAULT_DEAD_MAN.into());
            let fault = Event::Happened { occurrence: Occurrence::Faulted, fault: Fault::DeadMan, at };
            assert!(events.contains(&fault), "{state}: {events:?}");
        }
        // Latched: nothing moves until the fault is acknowledged by a host that knows which.
        setup.say(Command::Hello);
        let fault = setup.board.fault();
        let jog = Command::Jog { channel: SERVO, pulse: CENTRE, duration: DurationUs(0) };
        assert_eq!(setup.refused(jog), (Refusal::Latched, 0, fault.code().into()));
        assert_eq!(setup.refused(Command::Acknowledge(Fault::Overload)).0, Refusal::OtherFault);
        setup.must(Command::Acknowledge(fault));
        setup.must(jog);
    }
}

#[test]
fn garbage_and_damaged_packets_do_not_feed_the_dead_man() {
    let mut setup = in_state(State::Running, SafeState::Hold);
    let mut line = Command::Ping.encode(Sequence(1)).encode().to_vec();
    line[3] ^= 1;
    for _ in 0..6 {
        setup.silence(DurationUs(50_000));
        assert!(setup.feed(&line).is_empty() && setup.feed(&[0x55; 300]).is_empty());
    }
    assert_eq!(setup.board.fault(), Fault::DeadMan);
}

#[test]
fn safe_states_detach_hold_and_park() {
    for (safe_state, pulse) in
        [(SafeState::Detach, None), (SafeState::Hold, Some(1780)), (SafeState::Park, Some(1400))]
    {
        let mut setup = in_state(State::Running, safe_state);
        let before = setup.board.pulse(SERVO).unwrap();
        setup.bench.pulses.clear();
        setup.must(Command::EStop);
        let stopped = setup.now;
        setup.pass(500);
        assert_eq!(setup.board.pulse(SERVO), pulse.map(PulseWidthUs));
        assert_eq!(setup.board.state(), State::Faulted);
        if safe_state == SafeState::Park {
            let last = setup.bench.pulses.last().unwrap();
            let took = Ticks(last.2).since(stopped).unsigned_abs();
            assert!(RateUsPerS(2000).allows(before, PulseWidthUs(1400), DurationUs(took)), "{took} µs");
        }
    }
}

#[test]
fn detached_channel_is_not_parked_with_a_jump() {
    let mut setup = Setup::new();
    setup.say(Command::Hello);
    setup.must(Command::Configure(servo(SafeState::Park)));
    setup.must(Command::EStop);
    setup.pass(500);
    assert_eq!(setup.bench.pulses, []);
}

#[test]
fn abort_keeps_the_pulse_and_forgets_the_profile() {
    let mut setup = in_state(State::Running, SafeState::Detach);
    setup.must(Command::Abort);
    let pulse = setup.board.pulse(SERVO);
    setup.pass(1000);
    assert_eq!((setup.board.state(), setup.board.pulse(SERVO)), (State::Idle, pulse));
    let start = setup.now.plus(DurationUs(20_000));
    assert_eq!(setup.refused(Command::Arm { start, segments: 1 }).0, Refusal::Incomplete);
}

#[test]
fn another_hello_never_leaves_a_profile_alive() {
    for state in [State::Armed, State::Running] {
        let mut setup = in_state(state, SafeState::Hold);
        setup.say(Command::Hello);
        assert_eq!(setup.board.fault(), Fault::HostRestarted);
    }
    let mut setup = in_state(State::Idle, SafeState::Hold);
    setup.upload(&[(100_000, 1600)]);
    setup.say(Command::Hello);
    assert_eq!(setup.board.state(), State::Idle);
    let start = setup.now.plus(DurationUs(20_000));
    assert_eq!(setup.refused(Command::Arm { start, segments: 1 }).0, Refusal::Incomplete);
}

#[test]
fn goodbye_ends_without_a_fault() {
    let mut setup = in_state(State::Idle, SafeState::Park);
    setup.must(Command::Goodbye);
    setup.silence(DurationUs(10_000_000));
    assert_eq!((setup.board.state(), setup.board.fault()), (State::Idle, Fault::None));
    assert_eq!(setup.board.pulse(SERVO), Some(PulseWidthUs(1400)));
    assert_eq!(setup.refused(Command::Abort).0, Refusal::NoSession);
    let mut setup = in_state(State::Running, SafeState::Park);
    assert_eq!(setup.refused(Command::Goodbye).0, Refusal::Busy);
}

#[test]
fn status_and_e_stop_work_for_a_host_of_another_version() {
    let mut setup = in_state(State::Running, SafeState::Detach);
    let mut foreign = |command: Command| {
        let mut packet = command.encode(Sequence(77));
        packet.version = 9;
        setup.feed(&packet.encode()).pop().unwrap()
    };
    let version = |ack: Event| matches!(ack, Event::Ack(ack) if (ack.refusal, ack.limit, ack.got) == (Refusal::Version, 1, 9));
    assert!(version(foreign(Command::Abort)) && version(foreign(Command::Ping)));
    assert!(matches!(foreign(Command::Hello), Event::Hello(identity) if identity.boot_id == 0x1234_5678));
    assert!(matches!(foreign(Command::Status), Event::Status(status) if status.state == State::Running));
    assert!(matches!(foreign(Command::EStop), Event::Ack(ack) if ack.refusal == Refusal::None));
    assert_eq!((setup.board.fault(), setup.board.pulse(SERVO)), (Fault::EStop, None));
}

#[test]
fn command_cut_at_any_byte_changes_nothing() {
    let jog = Command::Jog { channel: SERVO, pulse: PulseWidthUs(1900), duration: DurationUs(300_000) };
    let line = jog.encode(Sequence(500)).encode();
    for cut in 0..line.len() - 1 {
        let mut setup = Setup::ready(SafeState::Hold);
        setup.feed(&line[..cut]);
        setup.pass(1000);
        assert_eq!(setup.board.pulse(SERVO), Some(CENTRE), "cut at {cut}");
    }
}

#[test]
fn telemetry_tells_pulses_at_even_ticks() {
    let mut setup = Setup::ready(SafeState::Hold);
    setup.must(Command::Timing { dead_man: DurationMs(250), telemetry: DurationMs(20) });
    setup.must(Command::Jog { channel: SERVO, pulse: PulseWidthUs(1600), duration: DurationUs(100_000) });
    let begun = setup.now;
    let reported: Vec<(i32, u16)> = setup
        .pass(150)
        .into_iter()
        .filter_map(|event| match event {
            Event::Telemetry(t) => Some((t.at.since(begun), t.pulses()[0].unwrap().0)),
            _ => None,
        })
        .collect();
    assert_eq!(
        reported[..6],
        [(20_000, 1520), (40_000, 1540), (60_000, 1560), (80_000, 1580), (100_000, 1600), (120_000, 1600)]
    );
}

#[test]
fn jog_beside_an_uploaded_profile_ends_where_it_was_sent() {
    let mut setup = Setup::ready(SafeState::Hold);
    let segment = Segment { duration: DurationUs(22_000), end_pulse: PulseWidthUs(1216) };
    setup.must(Command::Track { channel: SERVO, start_pulse: PulseWidthUs(1260), segments: 1 });
    setup.must(Command::Segments { channel: SERVO, first: 0, segments: Segments::new(&[segment]).unwrap() });
    setup.must(Command::Jog { channel: SERVO, pulse: PulseWidthUs(1407), duration: DurationUs(60_000) });
    setup.silence(DurationUs(100_000));
    assert_eq!((setup.board.state(), setup.board.pulse(SERVO)), (State::Idle, Some(PulseWidthUs(1407))));
}

#[test]
fn hardware_fault_stops_and_the_first_reason_stays() {
    let mut setup = in_state(State::Running, SafeState::Detach);
    setup.board.trip(Fault::Overload, setup.now, &mut setup.bench);
    setup.must(Command::EStop);
    assert_eq!((setup.board.fault(), setup.board.pulse(SERVO)), (Fault::Overload, None));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever a host says or stammers, no servo pulse leaves its limits or outruns its rate, and a host that falls
    /// silent leaves the board stopped.
    #[test]
    fn no_conversation_breaks_limits_or_defeats_the_dead_man(
        says in prop::collection::vec(
            (0..9u8, 900..2100u16, 0..400_000u32, 0..120_000u32, prop::collection::vec(any::<u8>(), 0..20)),
            1..60,
        )
    ) {
        let mut setup = Setup::ready(SafeState::Hold);
        for (what, pulse, duration, wait, garbage) in says {
            let segment = Segment { duration: DurationUs(duration), end_pulse: PulseWidthUs(pulse) };
            let command = match what {
                0 => Command::Jog { channel: SERVO, pulse: PulseWidthUs(pulse), duration: DurationUs(duration) },
                1 => Command::Track { channel: SERVO, start_pulse: PulseWidthUs(pulse), segments: 1 },
                2 => Command::Segments { channel: SERVO, first: 0, segments: Segments::new(&[segment]).unwrap() },
                3 => Command::Arm { start: setup.now.plus(DurationUs(duration)), segments: 1 },
                4 => Command::Abort,
                5 => Command::EStop,
                6 => Command::Acknowledge(setup.board.fault()),
                7 => Command::Hello,
                _ => Command::Goodbye,
            };
            setup.feed(&garbage);
            setup.say(command);
            setup.silence(DurationUs(wait));
        }
        setup.silence(DurationUs(3_000_000));
        prop_assert!(matches!(setup.board.state(), State::Idle | State::Faulted));
        let mut last: Option<(u16, u32)> = None;
        for (_, pulse, at) in setup.bench.pulses {
            let Some(pulse) = pulse else { last = None; continue };
            prop_assert!((1000..=2000).contains(&pulse));
            if let Some((before, then)) = last {
                // Both pulses are rounded: one microsecond more than the rate allows.
                let us = Ticks(at).since(Ticks(then)).unsigned_abs();
                let most = u64::from(us) * 2000 / 1_000_000 + 1;
                prop_assert!(u64::from(pulse.abs_diff(before)) <= most, "{before} to {pulse} in {us} µs");
            }
            last = Some((pulse, at));
        }
    }
}
