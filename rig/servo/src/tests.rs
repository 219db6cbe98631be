//! Host and mock board over a real pseudo-terminal, in real time.

use std::io::Write as _;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

use firmware_protocol::command::Command;
use firmware_protocol::event::Fault;
use firmware_protocol::units::Sequence;

use super::motion::{Motion, standing};
use super::*;
use crate::fixtures::example;
use crate::profile::Profile;
use crate::{PulseProfile, PulseTrack};
use ground::clock::{ClockFit, Wire};
use ground::hold::{Hold, Latch};

/// Longest time of a quick answer while other tests keep all cores busy, chosen.
const BUSY_MACHINE_LIMIT: Duration = Duration::from_secs(2);

type Log = Arc<Mutex<Vec<(u8, Option<u16>, MonotonicNs)>>>;

#[derive(Clone, Default)]
struct Recorder(Log);

impl PulseSink for Recorder {
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs) {
        self.0.lock().unwrap().push((channel, pulse_us, at));
    }
}

impl Recorder {
    fn last(&self) -> Option<(u8, Option<u16>, MonotonicNs)> {
        self.0.lock().unwrap().last().copied()
    }
}

fn options(faults: &[(f64, BoardFault)]) -> MockOptions {
    let run_start = Arc::new(OnceLock::new());
    run_start.set(MonotonicNs::now()).unwrap();
    MockOptions { faults: faults.to_vec(), run_start, boot_id: 7, drift_ppm: 80.0, ..MockOptions::default() }
}

/// A mock board with the example's channel at its centre, whose fault begins `after_s` from now.
fn ready(fault: Option<(f64, BoardFault)>, dead_man_ms: u16) -> (MockServo, Recorder) {
    let recorder = Recorder::default();
    let config = ServoConfig { dead_man_ms, ..example() };
    let options = options(&[]);
    let (run_start, faults) = (Arc::new(OnceLock::new()), fault.into_iter().collect());
    let options = MockOptions { run_start: Arc::clone(&run_start), faults, ..options };
    let mut board = MockServo::open(&config, options, Box::new(recorder.clone())).unwrap();
    board.jog(0, 1500, 0.0).unwrap();
    run_start.set(MonotonicNs::now()).unwrap();
    (board, recorder)
}

/// Whole microseconds at each update: 1 µs/ms up, 2 µs/ms down.
fn two_to_one(cycles: usize) -> PulseProfile {
    let mut segments = vec![(100_000, 1600)];
    for _ in 1..cycles {
        segments.extend([(100_000, 1400), (200_000, 1600)]);
    }
    segments.extend([(100_000, 1400), (100_000, 1500)]);
    PulseProfile { tracks: vec![PulseTrack { channel: 0, start_pulse: 1500, segments }] }
}

fn poll_until<T>(
    board: &mut dyn ServoBoard,
    timeout: Duration,
    mut found: impl FnMut(Result<ServoEvent, ServoError>) -> Option<T>,
) -> T {
    let deadline = Instant::now() + timeout;
    while Instant::now() < deadline {
        match board.poll() {
            Ok(events) => {
                if let Some(found) = events.into_iter().find_map(|event| found(Ok(event))) {
                    return found;
                }
            }
            Err(error) => {
                if let Some(found) = found(Err(error)) {
                    return found;
                }
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("not within {timeout:?}");
}

fn first_error(board: &mut dyn ServoBoard) -> ServoError {
    poll_until(board, Duration::from_secs(5), Result::err)
}

#[test]
fn profile_is_played_with_exact_timing_over_a_real_port() {
    let (mut board, recorder) = ready(None, 2000);
    let profile = two_to_one(4);
    let start = MonotonicNs::now().plus_seconds(0.3);
    board.arm(&profile, start).unwrap();
    let (mut pings, mut started, mut reported) = (Vec::new(), None, Vec::new());
    let finished = poll_until(&mut board, Duration::from_secs(10), |event| {
        let event = event.unwrap();
        pings.extend(event.ping());
        match event {
            ServoEvent::Pulse { channel, board_tick_us, pulse_us } => {
                assert_eq!(channel, 0, "only channels in use are reported");
                reported.push((board_tick_us, pulse_us));
            }
            ServoEvent::Started { board_tick_us } => started = Some(board_tick_us),
            ServoEvent::Finished { board_tick_us } => return Some(board_tick_us),
            _ => {}
        }
        None
    });
    let started = started.expect("the start was reported");
    assert_eq!(finished - started, 1_200_000);

    let pulses = recorder.0.lock().unwrap();
    let at = |pulse| -> Vec<f64> {
        pulses.iter().filter(|p| p.1 == Some(pulse)).map(|p| p.2.seconds_since(start)).collect()
    };
    let (tops, bottoms) = (at(1600), at(1400));
    assert_eq!((tops.len(), bottoms.len()), (4, 4));
    for cycle in 1..4 {
        let (ccw, cw) = (tops[cycle] - bottoms[cycle - 1], bottoms[cycle] - tops[cycle]);
        // The mock's stamps are whole nanoseconds.
        assert!((ccw / cw - 2.0).abs() < 1e-7, "{ccw} s and {cw} s");
    }
    // The start the host asked for, against the mock's true clock.
    let clock = ClockFit::new(&pings, Wire::NONE).unwrap();
    let error_s = tops[0] - 0.1;
    let sigma_s = clock.sigma_s(start);
    println!(
        "start off by {:.1} µs; clock sigma {:.1} µs, shortest round trip {:.0} µs, drift {:.1} ppm (true 80), {} pings, {} dropped",
        error_s * 1e6,
        sigma_s * 1e6,
        clock.round_trip_min_s * 1e6,
        clock.drift_ppm(),
        clock.used,
        clock.dropped
    );
    assert!(error_s.abs() < 1e-3, "{error_s} s");
    // The pulses that telemetry reports lie on the profile.
    assert!(reported.len() > 40);
    for (tick, pulse) in reported.iter().filter(|(tick, _)| (started..finished).contains(tick)) {
        let us = tick - started;
        let corners: Vec<_> = profile.tracks[0].corners().collect();
        let next = corners.partition_point(|&(corner, _)| corner <= us).min(corners.len() - 1);
        let ((t0, p0), (t1, p1)) = (corners[next - 1], corners[next]);
        let expected = f64::from(p0) + (f64::from(p1) - f64::from(p0)) * (us - t0) as f64 / (t1 - t0) as f64;
        let difference = f64::from(pulse.unwrap()) - expected;
        // Updated each millisecond at 2 µs/ms at most.
        assert!(difference.abs() <= 2.5, "{difference} µs at {us} µs");
    }
    // Another session finds a board at rest, not a latched fault.
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
}

#[test]
fn e_stop_is_acknowledged_fast_and_the_pulses_end() {
    let (mut board, recorder) = ready(None, 2000);
    board.arm(&two_to_one(20), MonotonicNs::now().plus_seconds(0.1)).unwrap();
    poll_until(&mut board, Duration::from_secs(3), |event| {
        matches!(event.unwrap(), ServoEvent::Started { .. }).then_some(())
    });
    std::thread::sleep(Duration::from_millis(50));
    let asked = MonotonicNs::now();
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
    let took_s = MonotonicNs::now().seconds_since(asked);
    std::thread::sleep(Duration::from_millis(100));
    let last = recorder.last().unwrap();
    println!(
        "e-stop acknowledged after {:.1} ms, last pulse {:.1} ms after it",
        took_s * 1e3,
        last.2.seconds_since(asked) * 1e3
    );
    assert!(last.2.seconds_since(asked) < took_s);
    // The host's own stop is no trouble, and a second one is as good.
    assert!(board.poll().is_ok());
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
    let refused = board.jog(0, 1500, 1.0).unwrap_err().to_string();
    assert!(refused.contains("fault is latched"), "{refused}");
}

#[test]
fn board_that_vanishes_mid_profile_is_lost_at_once_and_stops_by_itself() {
    let (mut board, recorder) = ready(Some((0.5, BoardFault::Off)), 500);
    board.arm(&two_to_one(20), MonotonicNs::now().plus_seconds(0.2)).unwrap();
    let error = first_error(&mut board);
    let noticed = MonotonicNs::now();
    assert!(matches!(error, ServoError::Lost { .. }), "{error}");
    println!("{error}");
    let asked = Instant::now();
    assert_eq!(board.stop(), StopOutcome::LeftToDeadMan);
    assert!(asked.elapsed() < BUSY_MACHINE_LIMIT);
    assert!(board.poll().is_ok(), "said once");
    // The dead-man: the last pulse comes within its time of the loss.
    std::thread::sleep(Duration::from_millis(900));
    let last = recorder.last().unwrap();
    assert!(last.2.seconds_since(noticed) < 0.55, "{} s", last.2.seconds_since(noticed));
    assert!(matches!(board.jog(0, 1500, 1.0), Err(ServoError::Lost { .. })));
}

#[test]
fn stuck_board_is_lost_and_left_to_its_dead_man_quickly() {
    let (mut board, _) = ready(Some((0.2, BoardFault::Stuck)), 300);
    let error = first_error(&mut board);
    // after 0.3 s (the link's own tests say when); a busy machine looks later
    assert!(matches!(&error, ServoError::Lost { why, .. } if why.contains("nothing valid for")), "{error}");
    let asked = Instant::now();
    assert_eq!(board.stop(), StopOutcome::LeftToDeadMan);
    println!("{error}; left to the dead-man after {:?}", asked.elapsed());
    assert!(asked.elapsed() < BUSY_MACHINE_LIMIT);
    let notes = board.poll().unwrap();
    assert!(
        notes.iter().any(|e| matches!(e, ServoEvent::Note { text } if text.contains("dropping DTR failed")))
    );
}

#[test]
fn damaged_answers_are_told_from_silence() {
    let (mut board, _) = ready(Some((0.1, BoardFault::Garbage)), 300);
    let error = first_error(&mut board);
    let damaged = matches!(&error, ServoError::Lost { why, .. } if !why.contains("(0 damaged"));
    assert!(damaged, "{error}");
}

#[test]
fn restarted_board_is_told_by_its_boot_id() {
    let (mut board, recorder) = ready(Some((0.3, BoardFault::Reset)), 1000);
    board.arm(&two_to_one(20), MonotonicNs::now().plus_seconds(0.1)).unwrap();
    let error = first_error(&mut board);
    assert!(matches!(error, ServoError::Restarted { before: 7, after: 8, .. }), "{error}");
    assert_eq!(recorder.last().unwrap().1, None);
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
}

#[test]
fn slow_line_is_borne() {
    let (mut board, _) = ready(Some((0.0, BoardFault::Slow)), 2000);
    std::thread::sleep(Duration::from_millis(50));
    for pulse in [1510, 1520, 1530] {
        board.jog(0, pulse, 0.05).unwrap();
        std::thread::sleep(Duration::from_millis(60));
    }
    assert!(board.poll().is_ok());
}

/// A board whose answers come `late` until `quick_after`: the name of the port that it is behind.
fn behind_a_busy_line(
    mock: &MockBoard,
    late: Duration,
    quick_after: Duration,
    work: impl FnOnce(&str) + Send,
) {
    use rustix::fs::{Mode, OFlags, fcntl_setfl, open};
    let pty = rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR | rustix::pty::OpenptFlags::NOCTTY).unwrap();
    rustix::pty::grantpt(&pty).unwrap();
    rustix::pty::unlockpt(&pty).unwrap();
    fcntl_setfl(&pty, OFlags::NONBLOCK).unwrap();
    let name = rustix::pty::ptsname(&pty, Vec::new()).unwrap().into_string().unwrap();
    // Both ends stay open, or bytes of one that has closed would be an error.
    let _host_end = open(name.as_str(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
    let board = open(mock.port(), OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK, Mode::empty()).unwrap();
    let began = Instant::now();
    let over = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let line = scope.spawn(|| {
            let mut waiting = std::collections::VecDeque::new();
            let mut bytes = [0; 512];
            while !over.load(std::sync::atomic::Ordering::Relaxed) {
                if let Ok(length) = rustix::io::read(&pty, &mut bytes) {
                    rustix::io::write(&board, &bytes[..length]).unwrap();
                }
                if let Ok(length) = rustix::io::read(&board, &mut bytes) {
                    let late = if began.elapsed() < quick_after { late } else { Duration::ZERO };
                    waiting.push_back((Instant::now() + late, bytes[..length].to_vec()));
                }
                while waiting.front().is_some_and(|(due, _)| *due <= Instant::now()) {
                    let (_, bytes) = waiting.pop_front().unwrap();
                    rustix::io::write(&pty, &bytes).unwrap();
                }
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        work(&name);
        over.store(true, std::sync::atomic::Ordering::Relaxed);
        line.join().unwrap();
    });
}

#[test]
fn clock_of_a_busy_line_is_waited_for_and_a_bad_one_is_refused() {
    let armed = |quick_after| {
        let mock = MockBoard::start(options(&[]), Box::new(Recorder::default())).unwrap();
        let (mut armed, mut took) = (Ok(()), Duration::ZERO);
        behind_a_busy_line(&mock, Duration::from_millis(12), quick_after, |port| {
            let config = ServoConfig { dead_man_ms: 2000, ..example() };
            let asked = Instant::now();
            let mut board = SerialBoard::open(port, &config).unwrap();
            took = asked.elapsed();
            board.jog(0, 1500, 0.0).unwrap();
            armed = board.arm(&two_to_one(1), MonotonicNs::now().plus_seconds(0.5));
        });
        (armed.map_err(|error| error.to_string()), took)
    };
    // A burst of eight pings is over by then.
    let (busy, _) = armed(Duration::from_millis(600));
    assert_eq!(busy, Ok(()));
    let (bad, took) = armed(Duration::MAX);
    assert!(bad.as_ref().is_err_and(|why| why.contains("limit 1.0 ms; shortest round trip")), "{bad:?}");
    assert!(took > Duration::from_secs(2), "it was waited for {took:?} only");
}

#[test]
fn busy_missing_and_mute_ports_are_told_apart() {
    let config = example();
    let mock = MockBoard::start(options(&[]), Box::new(Recorder::default())).unwrap();
    let port = mock.port().to_str().unwrap();
    let first = SerialBoard::open(port, &config).unwrap();
    let busy = SerialBoard::open(port, &config).err().unwrap().to_string();
    assert!(busy.contains("in use by another program"), "{busy}");
    drop(first);
    let missing = SerialBoard::open("/dev/no-such-port", &config).err().unwrap().to_string();
    assert!(missing.contains("no such port"), "{missing}");

    let babble = open_beside(|board| {
        rustix::io::write(board, b"\x00\xf8\x00\xe0garbage\x00").unwrap();
    });
    assert!(babble.contains("wrong baud rate, or another device"), "{babble}");
}

/// Opens a port behind which `board` does but one thing; says why that failed.
fn open_beside(board: impl FnOnce(&std::os::fd::OwnedFd)) -> String {
    let pty = rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR).unwrap();
    rustix::pty::grantpt(&pty).unwrap();
    rustix::pty::unlockpt(&pty).unwrap();
    let name = rustix::pty::ptsname(&pty, Vec::new()).unwrap().into_string().unwrap();
    std::thread::scope(|scope| {
        let open = scope.spawn(|| SerialBoard::open(&name, &example()).err().unwrap().to_string());
        std::thread::sleep(Duration::from_millis(500));
        board(&pty);
        open.join().unwrap()
    })
}

#[test]
fn firmware_of_another_version_is_refused_with_both_versions() {
    use firmware_protocol::event::{Event, Identity};
    use firmware_protocol::packet::Decoder;
    use firmware_protocol::units::Name;
    let why = open_beside(|board| {
        let mut bytes = [0; 512];
        let length = rustix::io::read(board, &mut bytes).unwrap();
        let mut decoder = Decoder::default();
        let hello = bytes[..length].iter().filter_map(|&b| decoder.push(b)).last().unwrap().unwrap();
        let firmware = Name::new("old").unwrap();
        let identity = Identity { boot_id: 1, channels: 4, max_segments: 64, firmware };
        let mut answer = Event::Hello(identity).encode(hello.sequence);
        answer.version = 9;
        rustix::io::write(board, &answer.encode()).unwrap();
    });
    assert!(why.contains("firmware `old` speaks protocol version 9, this program 1; flash"), "{why}");
}

#[test]
fn fault_of_a_host_that_died_is_acknowledged_with_a_note_by_the_next() {
    let mock = MockBoard::start(options(&[]), Box::new(Recorder::default())).unwrap();
    let port = mock.port().to_str().unwrap();
    // it says hello, and nothing more
    let mut died = super::port::open(port, 115_200).unwrap();
    died.write_all(&Command::Hello.encode(Sequence(1)).encode()).unwrap();
    std::thread::sleep(Duration::from_millis(600));
    drop(died);
    assert_eq!(serial::query_status(port, 115_200).unwrap().fault, Fault::DeadMan);
    let mut board = SerialBoard::open(port, &example()).unwrap();
    let notes = board.poll().unwrap();
    let noted = |e: &ServoEvent| matches!(e, ServoEvent::Note { text } if text.contains("dead-man"));
    assert!(notes.iter().any(noted), "{notes:?}");
    drop(board);
    // A goodbye leaves no fault behind.
    std::thread::sleep(Duration::from_millis(1100));
    assert_eq!(serial::query_status(port, 115_200).unwrap().fault, Fault::None);
}

#[test]
fn emergency_stop_of_somebody_else_is_acknowledged_by_a_release_alone_and_ones_own_by_oneself() {
    let mock = MockBoard::start(options(&[]), Box::new(Recorder::default())).unwrap();
    let port = mock.port().to_str().unwrap();
    let fault = || serial::query_status(port, 115_200).unwrap().fault;
    assert_eq!(serial::emergency_stop(port, 115_200).unwrap(), StopOutcome::Acknowledged);
    let refused = SerialBoard::open(port, &example()).err().unwrap();
    assert!(matches!(&refused, ServoError::Stopped { .. }) && refused.to_string().contains("rig release"));
    assert_eq!(fault(), Fault::EStop, "looking at it has not acknowledged it");
    assert_eq!(serial::release(port, 115_200).unwrap(), Fault::EStop);
    assert_eq!((fault(), serial::release(port, 115_200).unwrap()), (Fault::None, Fault::None));

    let mut board = SerialBoard::open(port, &example()).unwrap();
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
    assert_eq!(board.leave(), StopOutcome::Acknowledged);
    assert!(board.poll().is_ok());
    drop(board);
    assert_eq!(fault(), Fault::None);
}

#[test]
fn hold_stops_a_board_in_motion_refuses_orders_and_outlives_it() {
    let folder = tempfile::tempdir().unwrap();
    let latch = Latch::of(Some(folder.path()), None);
    let recorder = Recorder::default();
    let open_board = || {
        let config = example();
        let mock = (options(&[]), Box::new(recorder.clone()) as Box<dyn PulseSink>);
        HeldBoard::open(latch.clone(), Some(folder.path()), || {
            open(Opening { config: &config, mock, bus: None, replay: None })
        })
    };
    let mut board = open_board().unwrap();
    board.jog(0, 1500, 0.0).unwrap();
    board.jog(0, 2000, 2.0).unwrap();
    let until = Instant::now() + Duration::from_millis(400);
    while Instant::now() < until {
        board.poll().unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(standing(folder.path()).motion, Motion::Moving);
    let stopped = MonotonicNs::now();
    // by whoever: a file is all it takes
    latch.hold(&Hold::now("another program", "a hand in the tank")).unwrap();
    let held = first_error(&mut board);
    assert!(matches!(&held, ServoError::Held(hold) if hold.by == "another program"), "{held}");
    std::thread::sleep(Duration::from_millis(100));
    let last = recorder.last().unwrap().2.seconds_since(stopped);
    println!("last pulse {:.1} ms after the hold", last * 1e3);
    assert!(last < 0.1, "{last} s");
    assert!(matches!(board.jog(0, 1500, 1.0), Err(ServoError::Held(_))));
    assert!(matches!(board.arm(&two_to_one(1), MonotonicNs::now()), Err(ServoError::Held(_))));
    assert_eq!(board.stop(), StopOutcome::Acknowledged);
    drop(board);
    assert_eq!(standing(folder.path()).motion, Motion::AtRest);
    assert!(matches!(open_board(), Err(ServoError::Held(_))), "the next one too");
    latch.release("Ada").unwrap();
    assert!(open_board().is_ok());
}

#[test]
fn board_refuses_what_its_limits_forbid_with_the_limit() {
    let (mut board, _) = ready(None, 2000);
    let text = board.jog(0, 2500, 1.0).unwrap_err().to_string();
    assert_eq!(
        text,
        "servo board refused jog: channel 0: pulse is longer than the channel's limit: 2500 µs, limit 2100 µs; ask for \
         less or change the channel's limits"
    );
    let late = board.arm(&two_to_one(1), MonotonicNs::now()).unwrap_err().to_string();
    assert!(late.contains("start tick is in the past or too near"), "{late}");
    let long = PulseProfile {
        tracks: vec![PulseTrack { channel: 0, start_pulse: 1500, segments: vec![(1000, 1500); 1025] }],
    };
    let long = board.arm(&long, MonotonicNs::now().plus_seconds(5.0)).unwrap_err().to_string();
    assert!(long.contains("1025 segments, and the board holds 1024"), "{long}");
    assert!(board.jog(0, 1500, f64::NAN).is_err());
}

fn opened(config: &ServoConfig) -> Box<dyn ServoBoard> {
    open(Opening { config, mock: (options(&[]), Box::new(Recorder::default())), bus: None, replay: None })
        .unwrap()
}

#[test]
fn config_opens_the_board_it_names() {
    let mut none = opened(&ServoConfig::none());
    assert_eq!(none.stop(), StopOutcome::NotNeeded);
    assert!(none.arm(&PulseProfile::default(), MonotonicNs::now()).is_err());
    let mut mock = opened(&example());
    assert_eq!((mock.info().boot_id, mock.info().channels), (7, 16));
    let text = "amplitude_rad = 0.3\nccw_s = 0.2\ncw_s = 0.1\ncycles = 1\n";
    let profile = ground::strict::parse(text, std::path::Path::new("rig.toml")).unwrap();
    let pulses = Profile::new(&profile).unwrap().pulses(&example()).unwrap();
    mock.jog(0, pulses.tracks[0].start_pulse, 0.0).unwrap();
    mock.arm(&pulses, MonotonicNs::now().plus_seconds(0.2)).unwrap();
}
