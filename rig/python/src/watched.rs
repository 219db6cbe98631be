//! Work in the background: its progress told to Python, Ctrl-C told to it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use analysis::Progress;
use app::{Failure, Watcher};
use ident::diagnose;
use ident::fit::{Flow, Observer, Progress as FitProgress};
use pyo3::prelude::*;

use crate::errors::exception;

/// How often Python is asked whether somebody has pressed Ctrl-C (chosen: at once, to a hand).
const ASKED_EVERY: Duration = Duration::from_millis(50);

/// Where the work is: what it is at, how much of that is done, of how much where that is known.
type Told = (String, u64, Option<u64>);

/// Tells how the work goes.
pub(crate) struct Teller {
    sender: Sender<Told>,
    interrupted: Arc<AtomicBool>,
    at: Told,
}

impl Teller {
    fn tell(&self) {
        // nobody listens any more once the work has been given up
        let _ = self.sender.send(self.at.clone());
    }
}

/// Carries out `work` on another thread, and calls `tell` as it goes. On Ctrl-C, or where `tell` raises, the work is asked to end with what
/// it has; the exception follows when it has.
///
/// # Errors
/// The work's failure, or what interrupted it.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    tell: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&mut Teller) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let (sender, mut receiver) = channel();
    let mut teller = Teller { sender, interrupted: Arc::clone(&interrupted), at: (String::new(), 0, None) };
    std::thread::scope(|scope| {
        let worker = scope.spawn(move || work(&mut teller));
        let mut raised = None;
        while !worker.is_finished() {
            let told = py.detach(|| newest(&mut receiver));
            let asked = match (&raised, told, tell) {
                (None, Some(told), Some(tell)) => tell.call1(told).map(|_| ()),
                _ => Ok(()),
            };
            if let Err(error) = asked.and_then(|()| py.check_signals())
                && raised.is_none()
            {
                interrupted.store(true, Ordering::Relaxed);
                raised = Some(error);
            }
        }
        let result = py.detach(|| worker.join());
        match (raised, result) {
            (_, Err(panic)) => std::panic::resume_unwind(panic),
            (Some(error), _) => Err(error),
            (None, Ok(result)) => result.map_err(|failure| exception(py, &failure)),
        }
    })
}

/// The last of what has been told, if anything was within a while.
fn newest(receiver: &mut Receiver<Told>) -> Option<Told> {
    match receiver.recv_timeout(ASKED_EVERY) {
        Ok(told) => Some(receiver.try_iter().last().unwrap_or(told)),
        Err(RecvTimeoutError::Timeout) => None,
        Err(RecvTimeoutError::Disconnected) => {
            std::thread::sleep(Duration::from_millis(1));
            None
        }
    }
}

impl Watcher for Teller {
    fn status(&mut self, text: String) {
        self.at = (text, 0, None);
        self.tell();
    }

    fn event(&mut self, text: &str) {
        self.status(text.to_owned());
    }

    fn alert(&mut self, text: &str) {
        self.status(text.to_owned());
    }

    fn clear(&mut self) {}
}

impl Progress for Teller {
    fn begin(&mut self, name: &str, steps: Option<u64>) {
        self.at = (name.to_owned(), 0, steps);
        self.tell();
    }

    fn step(&mut self, done: u64) {
        self.at.1 = done;
        self.tell();
    }
}

impl Observer for Teller {
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    fn progress(&mut self, progress: &FitProgress<'_>) -> Flow {
        let rms_mm = progress.loss_m2.sqrt() * 1e3;
        let text = format!("fit: {} {rms_mm:.3} mm rms", progress.phase);
        self.at = (text, progress.evaluations, Some(progress.max_evaluations));
        self.tell();
        if self.interrupted.load(Ordering::Relaxed) { Flow::Stop } else { Flow::Continue }
    }
}

impl diagnose::Observer for Teller {
    fn stage(&mut self, stage: &str) -> bool {
        self.status(format!("diagnosis: {stage}"));
        !self.interrupted.load(Ordering::Relaxed)
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }
}
