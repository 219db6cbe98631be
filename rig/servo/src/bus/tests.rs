//! Host and emulated servos over a real pseudo-terminal, in real time.

use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

use super::emulated::EmulatedBusBoard;
use super::*;
use crate::config::SafeState;
use crate::fixtures::{BUS, parse};
use crate::travel::Travel;
use crate::{BoardKind, PulseProfile, PulseTrack, ServoEvent};
use ground::clock::MonotonicNs;

/// The dead-man where a silence is to be noticed; elsewhere a busy machine may be silent for longer.
const DEAD_MAN_MS: u16 = 500;

/// ID and position \[counts\], none without torque, as the emulated bus reported them.
type Log = Arc<Mutex<Vec<(u8, Option<f64>)>>>;

#[derive(Clone, Default)]
struct Recorder(Log);

impl PulseSink for Recorder {
    fn pulse(&mut self, _: u8, _: Option<u16>, _: MonotonicNs) {}

    fn position(&mut self, channel: u8, position_counts: Option<f64>, _: MonotonicNs) {
        self.0.lock().unwrap().push((channel, position_counts));
    }
}

impl Recorder {
    /// Where servo `id` is: none without torque.
    fn powered_position(&self, id: u8) -> Option<f64> {
        let reported = self.0.lock().unwrap();
        reported.iter().rev().find(|(other, _)| *other == id).and_then(|(_, position)| *position)
    }
}

/// `servos` of a kind, with IDs from 1 on.
fn config(kind: BoardKind, servos: u8) -> ServoConfig {
    let mut config = parse(BUS).unwrap();
    config.kind = kind;
    config.accept_no_watchdog = (kind == BoardKind::Feetech).then_some(true);
    (config.dead_man_ms, config.max_late_ms) = (2000, Some(2000));
    let first = config.channels[0].clone();
    for id in 2..=servos {
        let mut channel = first.clone();
        (channel.id, channel.name, channel.actuator) = (id, format!("servo {id}"), None);
        config.channels.push(channel);
    }
    config
}

fn open_bus(
    config: &ServoConfig,
    faults: &[(f64, BusFault)],
) -> (EmulatedBusBoard, Recorder, Arc<OnceLock<MonotonicNs>>) {
    let recorder = Recorder::default();
    let mut options = BusOptions::of(config).unwrap();
    options.faults = faults.to_vec();
    let run_start = Arc::clone(&options.run_start);
    let board = EmulatedBusBoard::open(config, options, Box::new(recorder.clone())).unwrap();
    (board, recorder, run_start)
}

fn strokes(cycles: u32) -> PulseProfile {
    let mut segments = vec![(100_000, 2148)];
    for _ in 1..cycles {
        segments.extend([(100_000, 1948), (200_000, 2148)]);
    }
    segments.extend([(100_000, 1948), (100_000, 2048)]);
    PulseProfile { tracks: vec![PulseTrack { channel: 1, start_pulse: 2048, segments }] }
}

fn poll_until<T>(
    board: &mut dyn ServoBoard,
    mut found: impl FnMut(Result<ServoEvent, ServoError>) -> Option<T>,
) -> T {
    let deadline = Instant::now() + Duration::from_secs(10);
    while Instant::now() < deadline {
        let events: Vec<_> = match board.poll() {
            Ok(events) => events.into_iter().map(Ok).collect(),
            Err(error) => vec![Err(error)],
        };
        for event in events {
            if let Some(found) = found(event) {
                return found;
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("not within 10 s");
}

/// Waits until `holds` is true, on a machine that may be busy.
fn eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(5);
    while !holds() {
        assert!(Instant::now() < deadline, "not within 5 s: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn notes(board: &mut dyn ServoBoard) -> String {
    let events = board.poll().unwrap();
    let text = events.into_iter().filter_map(|event| match event {
        ServoEvent::Note { text } => Some(text),
        _ => None,
    });
    text.collect::<Vec<_>>().join("\n")
}

#[test]
fn profile_is_streamed_and_the_measured_angle_follows_it_on_either_bus() {
    for kind in [BoardKind::Dynamixel, BoardKind::Feetech] {
        let (mut board, recorder, _) = open_bus(&config(kind, 1), &[]);
        assert_eq!(recorder.powered_position(1), None, "no torque before the first move");
        board.jog(1, 2048, 0.0).unwrap();
        let start = MonotonicNs::now().plus_seconds(0.2);
        board.arm(&strokes(3), start).unwrap();
        let (mut measured, mut started, mut finished_at) = (Vec::new(), None, None);
        let finished = poll_until(&mut board, |event| {
            match event.unwrap() {
                ServoEvent::Position { channel: 1, count, sent, received } => {
                    assert!(received > sent);
                    measured.push((sent.seconds_since(start), count));
                }
                ServoEvent::Started { board_tick_us } => started = Some(board_tick_us),
                ServoEvent::Finished { board_tick_us } => finished_at = Some(board_tick_us),
                ServoEvent::Note { text } if text.starts_with("stream of ") => {
                    println!("{text}");
                    return finished_at;
                }
                _ => {}
            }
            None
        });
        assert_eq!(started, Some(start.0 / 1000));
        assert_eq!(finished - started.unwrap(), 900_000);
        // 1 and 2 counts/ms, measured 20 ms late: the lag of the emulated servo.
        let profile = strokes(3);
        let corners: Vec<_> = profile.tracks[0].corners().collect();
        let commanded = |t: f64| {
            let us = (t * 1e6).clamp(0.0, 899_999.0);
            let next = corners.partition_point(|&(corner, _)| corner as f64 <= us);
            let ((t0, c0), (t1, c1)) = (corners[next - 1], corners[next]);
            f64::from(c0) + (f64::from(c1) - f64::from(c0)) * (us - t0 as f64) / (t1 - t0) as f64
        };
        let on_the_way: Vec<_> = measured.iter().filter(|(t, _)| (0.0..0.9).contains(t)).collect();
        assert!(on_the_way.len() > 20, "{} angles", on_the_way.len());
        let error = |lag_s: f64| {
            let squares =
                on_the_way.iter().map(|(t, count)| (f64::from(*count) - commanded(t - lag_s)).powi(2));
            (squares.sum::<f64>() / on_the_way.len() as f64).sqrt()
        };
        // A busy machine is late, and so is then the servo; no later than that it follows.
        assert!(error(0.02) < 0.5 * error(-0.08) && error(0.02) < 40.0, "{} counts", error(0.02));
        assert_eq!(board.stop(), StopOutcome::Acknowledged);
        eventually("limp", || recorder.powered_position(1).is_none());
        let refused = board.jog(1, 2048, 1.0).unwrap_err().to_string();
        assert!(refused.contains("it was stopped; open the bus again"), "{refused}");
    }
}

#[test]
fn every_fault_of_a_bus_ends_in_the_safe_state_and_names_the_servo() {
    use BoardKind::{Dynamixel, Feetech};
    use BusFault::{Garbage, ServoBlocked, ServoOff, ServoOverload, ServoReset, ServoWrongId};
    let silent = "no answer from servo 1 (`base`) for";
    let cases = [
        (Dynamixel, ServoReset, "servo 1 (`base`) has lost its torque: it restarted", true),
        (Dynamixel, ServoOverload, "overload", true),
        (Feetech, ServoOverload, "overload", true),
        (Dynamixel, ServoBlocked, "further from its commanded position than max_error_rad", true),
        (Dynamixel, ServoWrongId, silent, false),
        (Dynamixel, ServoOff, silent, false),
        (Feetech, Garbage, silent, false),
    ];
    // All at once they would be late for each other.
    for some in cases.chunks(2) {
        std::thread::scope(|scope| {
            for &(kind, fault, says, answers) in some {
                scope.spawn(move || ends_in_the_safe_state(kind, fault, says, answers));
            }
        });
    }
}

/// Plays `fault`, whose reason must say `says`; the first servo still `answers` afterwards, or it does not.
fn ends_in_the_safe_state(kind: BoardKind, fault: BusFault, says: &str, answers: bool) {
    let dead_man_ms = if answers { 2000 } else { DEAD_MAN_MS };
    let mut config = ServoConfig { dead_man_ms, ..config(kind, 2) };
    if let Travel::Counts(travel) = &mut config.channels[0].travel {
        travel.max_error_rad = ground::strict::Positive::literal(0.05);
    }
    let (mut board, recorder, run_start) = open_bus(&config, &[(0.2, fault)]);
    board.jog(1, 2048, 0.0).unwrap();
    board.arm(&strokes(20), MonotonicNs::now().plus_seconds(0.1)).unwrap();
    run_start.set(MonotonicNs::now()).unwrap();
    let error = poll_until(&mut board, Result::err).to_string();
    println!("{fault:?}: {error}");
    assert!(error.contains(says), "{fault:?}: {error}");
    if fault == BusFault::ServoOff {
        assert!(!error.contains("servo 2"), "the other one answers: {error}");
    }
    // Whoever still hears lets go, without the owner's doing anything.
    eventually("limp", || {
        recorder.powered_position(2).is_none() && (!answers || recorder.powered_position(1).is_none())
    });
    let stopped = board.stop();
    assert_eq!(stopped == StopOutcome::Acknowledged, answers, "{fault:?}");
    assert!(board.poll().is_ok(), "said once");
    let refused = board.jog(2, 2048, 1.0).unwrap_err().to_string();
    assert!(refused.contains("open the bus again"), "{refused}");
}

#[test]
fn servos_that_hear_nothing_any_more_are_stopped_by_their_watchdogs() {
    for fault in [BusFault::Off, BusFault::Stuck] {
        let config = ServoConfig { dead_man_ms: DEAD_MAN_MS, ..config(BoardKind::Dynamixel, 1) };
        let (mut board, recorder, run_start) = open_bus(&config, &[(0.35, fault)]);
        board.jog(1, 2048, 0.0).unwrap();
        run_start.set(MonotonicNs::now()).unwrap();
        // Far away, slowly: it would move on for seconds.
        board.jog(1, 2600, 8.0).unwrap();
        let error = poll_until(&mut board, Result::err);
        assert!(matches!(error, ServoError::Lost { .. }), "{error}");
        println!("{error}");
        assert_eq!(board.stop(), StopOutcome::LeftToDeadMan);
        std::thread::sleep(Duration::from_millis(u64::from(DEAD_MAN_MS) + 200));
        let stopped = recorder.powered_position(1).expect("a watchdog stops, it does not let go");
        std::thread::sleep(Duration::from_millis(100));
        assert_eq!(recorder.powered_position(1), Some(stopped));
        assert!(stopped < 2300.0, "{stopped}");
    }
}

#[test]
fn what_a_host_that_died_left_behind_is_ended_with_a_note() {
    let config = ServoConfig { dead_man_ms: DEAD_MAN_MS, ..config(BoardKind::Dynamixel, 1) };
    let recorder = Recorder::default();
    let bus = EmulatedBus::start(BusOptions::of(&config).unwrap(), Box::new(recorder.clone())).unwrap();
    let port = bus.port().to_str().unwrap();
    let mut died = Servos::open(port, &config).unwrap();
    died.check().unwrap();
    died.engage().unwrap();
    drop(died);
    std::thread::sleep(Duration::from_millis(u64::from(DEAD_MAN_MS) + 100));
    assert!(recorder.powered_position(1).is_some());
    let how = query_status(port, &config).unwrap().join("\n");
    assert_eq!(how, "servo 1 (`base`): model 1020, torque on, at 2048 counts, 12.0 V, 31 °C");
    let mut board = BusBoard::open(port, &ServoConfig { dead_man_ms: 2000, ..config }).unwrap();
    let notes = notes(&mut board);
    assert!(notes.contains("still had torque") && notes.contains("stopped by its watchdog"), "{notes}");
    // And it moves again on a command.
    board.jog(1, 2100, 0.1).unwrap();
    eventually("moved", || recorder.powered_position(1).is_some_and(|counts| (counts - 2100.0).abs() < 1.0));
    drop(board);
    eventually("let go by the drop", || recorder.powered_position(1).is_none());
}

#[test]
fn stop_leaves_each_servo_in_its_own_safe_state() {
    let mut config = config(BoardKind::Dynamixel, 3);
    for (channel, state) in
        config.channels.iter_mut().zip([SafeState::Detach, SafeState::Hold, SafeState::Park])
    {
        channel.safe_state = state;
    }
    let (mut board, recorder, _) = open_bus(&config, &[]);
    for id in 1..=3 {
        board.jog(id, 2148, 0.2).unwrap();
    }
    let near =
        |id, wanted: f64| recorder.powered_position(id).is_some_and(|counts| (counts - wanted).abs() < 1.0);
    eventually("moved", || (1..=3).all(|id| near(id, 2148.0)));
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
    eventually("limp", || recorder.powered_position(1).is_none());
    eventually("parked", || near(3, 2048.0));
    assert!(near(2, 2148.0));
    drop(board);
    assert!(recorder.powered_position(2).is_some());
}

#[test]
fn servo_from_outside_is_stopped_whatever_it_is_doing() {
    for kind in [BoardKind::Dynamixel, BoardKind::Feetech] {
        let config = config(kind, 2);
        let recorder = Recorder::default();
        let bus = EmulatedBus::start(BusOptions::of(&config).unwrap(), Box::new(recorder.clone())).unwrap();
        let port = bus.port().to_str().unwrap();
        let mut servos = Servos::open(port, &config).unwrap();
        servos.check().unwrap();
        servos.engage().unwrap();
        servos.send_goals(&[(1, 2600), (2, 2600)]).unwrap();
        drop(servos);
        assert_eq!(emergency_stop(port, &config).unwrap(), StopOutcome::Acknowledged);
        eventually("limp", || {
            recorder.powered_position(1).is_none() && recorder.powered_position(2).is_none()
        });
    }
}

#[test]
fn bus_that_cannot_do_what_the_config_says_is_refused_by_the_servos_name() {
    let config = config(BoardKind::Dynamixel, 2);
    let why = |change: &dyn Fn(&mut BusOptions, &mut ServoConfig)| {
        let (mut config, mut options) = (config.clone(), BusOptions::of(&config).unwrap());
        change(&mut options, &mut config);
        let opened = EmulatedBusBoard::open(&config, options, Box::new(Recorder::default()));
        let jogged = opened.and_then(|mut board| board.jog(1, 2048, 1.0));
        jogged.unwrap_err().to_string()
    };
    let missing = why(&|options, _| options.servos.truncate(1));
    assert!(missing.contains("servo 2 (`servo 2`) does not answer at 115200 bit/s"), "{missing}");
    assert!(missing.contains("from the factory 57600"), "{missing}");
    let turned = why(&|options, _| options.servos[0].1 = 3000);
    assert!(
        turned.contains("servo 1 (`base`) stands at 3000 counts, outside its limits 1400 to 2700"),
        "{turned}"
    );
}

#[test]
fn stream_that_is_too_late_is_a_fault_that_says_how_late() {
    // Nobody is on time to the nanosecond.
    let config = ServoConfig { max_late_ms: Some(0), ..config(BoardKind::Dynamixel, 1) };
    let (mut board, recorder, _) = open_bus(&config, &[]);
    board.jog(1, 2148, 2.0).unwrap();
    let error = poll_until(&mut board, Result::err).to_string();
    assert!(error.contains("ms late, max_late_ms is 0") && error.contains("least slack"), "{error}");
    eventually("limp", || recorder.powered_position(1).is_none());
}
