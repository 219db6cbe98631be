//! A fit of the first part of a run while the rest is still filmed: the fit of the whole begins with what it came to.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ident::experiment::Experiment;
use ident::fit::{Flow, Observer, Progress, WarmStart, first_answer};

use crate::showing::Showing;

/// A fit under way beside the filming.
#[derive(Debug)]
pub(super) struct EarlyFit {
    unwanted: Arc<AtomicBool>,
    thread: JoinHandle<Option<(WarmStart, Duration)>>,
}

impl EarlyFit {
    /// Begins to fit `experiment` on as many threads of its own as the caller's pool has, and as quiet: they inherit its niceness.
    /// How it goes is shown by `showing`.
    pub(super) fn begin(experiment: Experiment, showing: Showing) -> Self {
        let threads = rayon::current_num_threads();
        let unwanted = Arc::new(AtomicBool::new(false));
        let mut until = Until { unwanted: Arc::clone(&unwanted), showing };
        let thread = std::thread::spawn(move || {
            let began = Instant::now();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
            // whatever is wrong with the data, the fit of the whole will say
            let (fitted, _) = pool.install(|| first_answer(&experiment, None, &mut until)).ok()?;
            Some((WarmStart::of(&fitted), began.elapsed()))
        });
        Self { unwanted, thread }
    }

    /// Whether it has ended.
    pub(super) fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    /// What it came to, and how long that took, if it is done. Nobody waits for it: the fit of the whole can do without.
    pub(super) fn result(self) -> Option<(WarmStart, Duration)> {
        if self.is_done() {
            return self.thread.join().ok().flatten();
        }
        self.unwanted.store(true, Ordering::Relaxed);
        None
    }
}

struct Until {
    unwanted: Arc<AtomicBool>,
    showing: Showing,
}

impl Observer for Until {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        self.showing.fit("first fit, while filming", progress);
        if self.unwanted.load(Ordering::Relaxed) { Flow::Stop } else { Flow::Continue }
    }
}
