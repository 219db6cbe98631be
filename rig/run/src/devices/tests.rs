//! The device threads must end although nobody receives from them any more.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use tokio::sync::mpsc::{channel, unbounded_channel};

use super::*;
use camera::{CameraInfo, fixtures};
use servo::BoardInfo;

/// Events per poll, more than any queue between device and coordinator holds.
const FLOOD_EVENTS: usize = 5000;
/// Longest time that a thread may take to end, on a busy machine.
const THREAD_END_LIMIT: Duration = Duration::from_secs(5);

/// A board that refuses every motion, and reports a flood of pulses at each poll.
struct Refusing {
    info: BoardInfo,
    stopped: Arc<AtomicBool>,
}

impl ServoBoard for Refusing {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn arm(&mut self, _: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        Err(ServoError::Fault { reason: "a test".into() })
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Err(ServoError::Fault { reason: "a test".into() })
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        let pulse = |tick| ServoEvent::Pulse { channel: 0, board_tick_us: tick, pulse_us: None };
        Ok((0..FLOOD_EVENTS as u64).map(pulse).collect())
    }

    fn stop(&mut self) -> StopOutcome {
        self.stopped.store(true, Ordering::SeqCst);
        StopOutcome::Acknowledged
    }
}

#[test]
fn nobody_listening_holds_up_no_stop_and_no_word_of_the_board_is_lost() {
    let stopped = Arc::new(AtomicBool::new(false));
    let info = BoardInfo { name: "test".into(), protocol_version: 1, boot_id: 1, channels: 1 };
    let (signals, mut signalled) = unbounded_channel();
    let board = Refusing { info, stopped: Arc::clone(&stopped) };
    let mut servo = ServoThread::start(Box::new(board), signals);
    let profile = PulseProfile { tracks: Vec::new() };
    servo.arm(profile, MonotonicNs::now());
    // Long enough for several polls of the board, each of which brings more than a bounded queue would take.
    std::thread::sleep(10 * SERVO_POLL_PERIOD);
    let asked = Instant::now();
    assert_eq!(servo.stop(), StopOutcome::Acknowledged);
    assert!(asked.elapsed() < THREAD_END_LIMIT && stopped.load(Ordering::SeqCst), "{:?}", asked.elapsed());
    let (mut events, mut refused) = (0, 0);
    while let Ok(signal) = signalled.try_recv() {
        match signal {
            Signal::Servo(_) => events += 1,
            Signal::ServoFailed(_) => refused += 1,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!((refused, events % FLOOD_EVENTS), (1, 0));
    assert!(events >= 2 * FLOOD_EVENTS, "{events}");
}

/// A board whose poll panics.
struct Broken(BoardInfo);

impl ServoBoard for Broken {
    fn info(&self) -> &BoardInfo {
        &self.0
    }

    fn arm(&mut self, _: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        Ok(())
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Ok(())
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        panic!("a test")
    }

    fn stop(&mut self) -> StopOutcome {
        StopOutcome::Acknowledged
    }
}

#[test]
fn panic_of_the_boards_thread_is_told_and_leaves_the_servo_to_the_dead_man() {
    let info = BoardInfo { name: "test".into(), protocol_version: 1, boot_id: 1, channels: 1 };
    let (signals, mut signalled) = unbounded_channel();
    let mut servo = ServoThread::start(Box::new(Broken(info)), signals);
    assert!(matches!(signalled.blocking_recv(), Some(Signal::Panicked("servo"))));
    assert_eq!(servo.stop(), StopOutcome::LeftToDeadMan);
}

/// A camera that never runs out of images.
struct Endless(CameraInfo);

impl Camera for Endless {
    fn info(&self) -> &CameraInfo {
        &self.0
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn next_image(&mut self, _: Duration) -> Result<CameraImage, CameraError> {
        Ok(fixtures::image(0, MonotonicNs::now(), (2, 1)))
    }

    fn stop(&mut self) {}
}

#[test]
fn a_full_queue_of_images_holds_up_no_end_and_keeps_their_order() {
    let (signals, mut signalled) = unbounded_channel();
    let (updates, mut received) = channel(3);
    let camera =
        CameraThread::start(Box::new(Endless(fixtures::info((2, 1)))), THREAD_END_LIMIT, updates, signals)
            .unwrap();
    while received.len() < 3 {
        std::thread::yield_now();
    }
    let asked = Instant::now();
    drop(camera);
    assert!(asked.elapsed() < THREAD_END_LIMIT, "{:?}", asked.elapsed());
    let mut last = MonotonicNs(0);
    while let Ok(CameraUpdate::Image(image)) = received.try_recv() {
        assert!(image.stamp > last);
        last = image.stamp;
    }
    assert!(signalled.try_recv().is_err());
}
