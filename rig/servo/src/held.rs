//! The wrapper of every board that is opened: a hold stops the board at the owner's next poll, and what the board does is reported for
//! other programs ([`motion`](super::motion)).

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::motion::{MotionTracker, Reporter};
use super::{BoardInfo, PulseProfile, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;
use ground::hold::{Hold, Latch};

/// Time between two looks at the latch, chosen.
const LATCH_LOOK_PERIOD: Duration = Duration::from_millis(20);
/// Looks at the latch per report of what the board does: ten reports a second.
const LATCH_LOOKS_PER_REPORT: u32 = 5;
/// Time from a stop until the board is released, chosen: a program that stops the rig signals first and writes the hold after, and the
/// board must not be released before that hold is seen.
const HOLD_WRITE_GRACE: Duration = Duration::from_millis(100);

/// A board behind a latch: stops and refuses orders while the rig is held, and reports what its servos do.
pub struct HeldBoard {
    board: Box<dyn ServoBoard>,
    latch: Latch,
    watch: Watch,
    stopped: Option<(Instant, StopOutcome)>,
    left: bool,
    /// The hold was returned to the owner.
    hold_reported: bool,
}

impl HeldBoard {
    /// Opens a board with `open` unless the rig is held by `latch`, and reports in `runs_dir` what the board does.
    ///
    /// # Errors
    /// [`ServoError::Held`], or as `open`. A board that was stopped by itself holds the rig.
    pub fn open(
        latch: Latch,
        runs_dir: Option<&Path>,
        open: impl FnOnce() -> Result<Box<dyn ServoBoard>, ServoError>,
    ) -> Result<Self, ServoError> {
        if let Some(hold) = latch.held() {
            return Err(ServoError::Held(hold));
        }
        let board = open().map_err(|error| held_by_board(error, &latch))?;
        let watch = Watch::start(latch.clone(), Reporter::of(runs_dir))
            .map_err(|error| ServoError::Open { port: board.info().name.clone(), why: error.to_string() })?;
        Ok(Self { board, latch, watch, stopped: None, left: false, hold_reported: false })
    }

    fn at_rest(&mut self, outcome: StopOutcome) -> StopOutcome {
        self.stopped = Some((Instant::now(), outcome));
        self.watch.tracker().stop(outcome);
        self.watch.wake();
        outcome
    }

    /// Refuses orders while the rig is held.
    fn check(&self) -> Result<(), ServoError> {
        self.latch.held().map_or(Ok(()), |hold| Err(ServoError::Held(hold)))
    }
}

/// A board that was stopped at its own switch holds the rig.
fn held_by_board(error: ServoError, latch: &Latch) -> ServoError {
    let ServoError::Stopped { port } = &error else { return error };
    let hold = Hold::now("the servo board", &format!("the emergency stop of the board on {port}"));
    if let Err(error) = latch.hold(&hold) {
        tracing::error!("{}", ground::error_chain::with_causes(&error));
    }
    ServoError::Held(hold)
}

impl ServoBoard for HeldBoard {
    fn info(&self) -> &BoardInfo {
        self.board.info()
    }

    fn arm(&mut self, profile: &PulseProfile, start: MonotonicNs) -> Result<(), ServoError> {
        self.check()?;
        self.watch.tracker().order(start);
        self.board.arm(profile, start)
    }

    fn jog(&mut self, channel: u8, pulse: u16, duration_s: f64) -> Result<(), ServoError> {
        self.check()?;
        self.watch.tracker().order(MonotonicNs::now().plus_seconds(duration_s));
        self.board.jog(channel, pulse, duration_s)
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        if let Some(hold) = self.watch.held().filter(|_| !self.hold_reported) {
            self.hold_reported = true;
            // stopped before the owner learns of it
            self.stop();
            return Err(ServoError::Held(hold));
        }
        let polled = self.board.poll();
        let now = MonotonicNs::now();
        match &polled {
            Ok(events) => {
                let mut tracker = self.watch.tracker();
                events.iter().for_each(|event| tracker.observe(event, now));
            }
            Err(_) => self.watch.tracker().mark_lost(),
        }
        polled.map_err(|error| held_by_board(error, &self.latch))
    }

    fn stop(&mut self) -> StopOutcome {
        // a board that has acknowledged is safe; one that has not is stopped again
        if let Some((_, outcome @ StopOutcome::Acknowledged)) = self.stopped {
            return outcome;
        }
        let outcome = self.board.stop();
        self.at_rest(outcome)
    }

    fn leave(&mut self) -> StopOutcome {
        if self.latch.held().is_some() {
            return self.stop();
        }
        self.left = true;
        let outcome = self.board.leave();
        self.at_rest(outcome)
    }
}

impl Drop for HeldBoard {
    fn drop(&mut self) {
        // after a panic, or without an acknowledgement, the board stays stopped
        if let (Some((at, StopOutcome::Acknowledged)), false) =
            (self.stopped, self.left || std::thread::panicking())
        {
            std::thread::sleep(HOLD_WRITE_GRACE.saturating_sub(at.elapsed()));
            self.leave();
        }
        if self.stopped.is_none() {
            self.watch.tracker().stop(StopOutcome::NotNeeded);
        }
    }
}

/// Looks at the latch and reports what the board does, on a thread of its own, so that a slow disk holds up no servo.
struct Watch {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    held: Mutex<Option<Hold>>,
    is_held: AtomicBool,
    quit: AtomicBool,
    tracker: Mutex<MotionTracker>,
}

impl Watch {
    fn start(latch: Latch, reporter: Reporter) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            held: Mutex::new(None),
            is_held: false.into(),
            quit: false.into(),
            tracker: Mutex::new(MotionTracker::new(MonotonicNs::now())),
        });
        let thread_shared = Arc::clone(&shared);
        let work = move || {
            let mut looks = 0;
            loop {
                let quits = thread_shared.quit.load(Ordering::Acquire);
                if !thread_shared.is_held.load(Ordering::Acquire)
                    && let Some(hold) = latch.held()
                {
                    *lock(&thread_shared.held) = Some(hold);
                    thread_shared.is_held.store(true, Ordering::Release);
                }
                if quits || looks % LATCH_LOOKS_PER_REPORT == 0 {
                    let (motion, since) = lock(&thread_shared.tracker).motion(MonotonicNs::now());
                    reporter.report(motion, since, None);
                }
                if quits {
                    return;
                }
                looks += 1;
                std::thread::park_timeout(LATCH_LOOK_PERIOD);
            }
        };
        let thread = std::thread::Builder::new().name("hold".into()).spawn(work)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    fn held(&self) -> Option<Hold> {
        self.shared.is_held.load(Ordering::Acquire).then(|| lock(&self.shared.held).clone()).flatten()
    }

    fn tracker(&self) -> MutexGuard<'_, MotionTracker> {
        lock(&self.shared.tracker)
    }

    fn wake(&self) {
        self.thread.iter().for_each(|thread| thread.thread().unpark());
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.shared.quit.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
