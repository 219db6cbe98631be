//! A fit of the first part of a run while the rest is still filmed: the fit of the whole begins with what it came to.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ident::experiment::Experiment;
use ident::fit::{Flow, Observer, Progress, WarmStart, first_answer};

use crate::showing::Showing;

/// A fit that runs during the filming.
#[derive(Debug)]
pub(super) struct EarlyFit {
    cancelled: Arc<AtomicBool>,
    thread: JoinHandle<Option<(WarmStart, Duration)>>,
}

impl EarlyFit {
    /// Begins to fit `experiment` on as many threads of its own as the caller's pool has, and as quiet: they inherit its niceness.
    /// Its progress is published by `showing`.
    pub(super) fn begin(experiment: Experiment, showing: Showing) -> Self {
        let threads = rayon::current_num_threads();
        let cancelled = Arc::new(AtomicBool::new(false));
        let mut observer = EarlyFitObserver { cancelled: Arc::clone(&cancelled), showing };
        let thread = std::thread::spawn(move || {
            let began = Instant::now();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
            // whatever is wrong with the data, the fit of the whole will say
            let (fitted, _) = pool.install(|| first_answer(&experiment, None, &mut observer)).ok()?;
            Some((WarmStart::of(&fitted), began.elapsed()))
        });
        Self { cancelled, thread }
    }

    /// Whether it has ended.
    pub(super) fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    /// Its result and duration, if it is done; otherwise it is cancelled, and the fit of the whole run begins without it.
    pub(super) fn result(self) -> Option<(WarmStart, Duration)> {
        if self.is_done() {
            return self.thread.join().ok().flatten();
        }
        self.cancelled.store(true, Ordering::Relaxed);
        None
    }
}

struct EarlyFitObserver {
    cancelled: Arc<AtomicBool>,
    showing: Showing,
}

impl Observer for EarlyFitObserver {
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.cancelled)
    }

    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        self.showing.fit("first fit, while filming", progress);
        if self.cancelled.load(Ordering::Relaxed) { Flow::Stop } else { Flow::Continue }
    }
}
