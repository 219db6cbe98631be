//! Every board that is opened is behind this: a hold reaches whatever it does, within the time of two looks at its owner's thread, and
//! what it does is told to everybody ([`motion`](super::motion)).

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::motion::{Gauge, Reporter};
use super::{BoardInfo, PulseProfile, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;
use ground::hold::{Hold, Latch};

/// The latch is looked at so often.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// What the board does is told at every so many looks.
const LOOKS_PER_REPORT: u32 = 5;
/// A stop signals first and is written then: a board that nobody says has ended by itself is not taken for one that nobody stopped for so
/// long.
const AFTERTHOUGHT: Duration = Duration::from_millis(100);

/// A board behind a latch: stops and refuses orders while the rig is held, and reports what its servos do.
pub struct HeldBoard {
    board: Box<dyn ServoBoard>,
    latch: Latch,
    watch: Watch,
    stopped: Option<(Instant, StopOutcome)>,
    left: bool,
    /// The hold was said to the owner.
    said: bool,
}

impl HeldBoard {
    /// Opens a board with `open` unless it is held by `latch`, and says in `runs_dir` what it does.
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
        Ok(Self { board, latch, watch, stopped: None, left: false, said: false })
    }

    fn at_rest(&mut self, outcome: StopOutcome) -> StopOutcome {
        self.stopped = Some((Instant::now(), outcome));
        self.watch.gauge().stop(outcome);
        self.watch.wake();
        outcome
    }

    /// Nothing is ordered of a board that is held.
    fn check(&self) -> Result<(), ServoError> {
        self.latch.held().map_or(Ok(()), |hold| Err(ServoError::Held(hold)))
    }
}

/// Who stops a board at its own switch stops the rig.
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
        self.watch.gauge().order(start);
        self.board.arm(profile, start)
    }

    fn jog(&mut self, channel: u8, pulse: u16, duration_s: f64) -> Result<(), ServoError> {
        self.check()?;
        self.watch.gauge().order(MonotonicNs::now().plus_seconds(duration_s));
        self.board.jog(channel, pulse, duration_s)
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        if let Some(hold) = self.watch.held().filter(|_| !self.said) {
            self.said = true;
            // before anybody is told
            self.stop();
            return Err(ServoError::Held(hold));
        }
        let told = self.board.poll();
        let now = MonotonicNs::now();
        match &told {
            Ok(events) => {
                let mut gauge = self.watch.gauge();
                events.iter().for_each(|event| gauge.hear(event, now));
            }
            Err(_) => self.watch.gauge().lose(),
        }
        told.map_err(|error| held_by_board(error, &self.latch))
    }

    fn stop(&mut self) -> StopOutcome {
        // what has answered is safe; what has not is asked again
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
        // whatever ended in a panic, or has not answered, stays stopped
        if let (Some((at, StopOutcome::Acknowledged)), false) =
            (self.stopped, self.left || std::thread::panicking())
        {
            std::thread::sleep(AFTERTHOUGHT.saturating_sub(at.elapsed()));
            self.leave();
        }
        if self.stopped.is_none() {
            self.watch.gauge().stop(StopOutcome::NotNeeded);
        }
    }
}

/// Looks at the latch and tells what the board does, on a thread of its own: a disk that hangs holds up no servo.
struct Watch {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    held: Mutex<Option<Hold>>,
    is_held: AtomicBool,
    quit: AtomicBool,
    gauge: Mutex<Gauge>,
}

impl Watch {
    fn start(latch: Latch, reporter: Reporter) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            held: Mutex::new(None),
            is_held: false.into(),
            quit: false.into(),
            gauge: Mutex::new(Gauge::new(MonotonicNs::now())),
        });
        let own = Arc::clone(&shared);
        let work = move || {
            let mut looks = 0;
            loop {
                let quits = own.quit.load(Ordering::Acquire);
                if !own.is_held.load(Ordering::Acquire)
                    && let Some(hold) = latch.held()
                {
                    *lock(&own.held) = Some(hold);
                    own.is_held.store(true, Ordering::Release);
                }
                if quits || looks % LOOKS_PER_REPORT == 0 {
                    let (motion, since) = lock(&own.gauge).motion(MonotonicNs::now());
                    reporter.tell(motion, since, None);
                }
                if quits {
                    return;
                }
                looks += 1;
                std::thread::park_timeout(LOOK_EVERY);
            }
        };
        let thread = std::thread::Builder::new().name("hold".into()).spawn(work)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    fn held(&self) -> Option<Hold> {
        self.shared.is_held.load(Ordering::Acquire).then(|| lock(&self.shared.held).clone()).flatten()
    }

    fn gauge(&self) -> MutexGuard<'_, Gauge> {
        lock(&self.shared.gauge)
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
