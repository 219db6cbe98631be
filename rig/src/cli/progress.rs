//! Progress on standard error: a bar on a terminal, nothing in a pipe.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ident::diagnose;
use ident::fit::{Flow, Observer, Progress as FitProgress};
use indicatif::{ProgressBar, ProgressStyle};

use analysis::Progress;
use analysis::showing::Showing;
use app::Watcher;
use app::hand_in;

/// A progress bar that the application reports to; silent where standard error is no terminal.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    interrupted: Arc<AtomicBool>,
    /// Whether a daemon writes the output of this process to a job's log.
    in_job: bool,
    /// Publishes the progress for the daemon's page.
    showing: Showing,
}

impl Bar {
    /// An empty bar. When `interrupted` becomes true, a fit ends with the best it has found so far.
    pub fn new(interrupted: Arc<AtomicBool>) -> Self {
        // indicatif draws to standard error, and only on a terminal.
        Self {
            bar: ProgressBar::no_length(),
            interrupted,
            in_job: hand_in::is_job(),
            showing: hand_in::showing(),
        }
    }
}

impl Watcher for Bar {
    fn status(&mut self, text: String) {
        self.bar.set_style(ProgressStyle::default_spinner());
        self.bar.set_message(text);
        self.bar.tick();
    }

    /// On a terminal, and in the log of a job.
    fn event(&mut self, text: &str) {
        if self.in_job { super::say(text) } else { self.bar.println(text) }
    }

    /// In a pipe too.
    fn alert(&mut self, text: &str) {
        if self.bar.is_hidden() { super::say(text) } else { self.bar.println(text) }
    }

    fn clear(&mut self) {
        self.bar.finish_and_clear();
        self.bar.reset();
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        self.showing.end();
    }
}

impl Progress for Bar {
    fn begin(&mut self, name: &str, steps: Option<u64>) {
        let style = match steps {
            Some(_) => ProgressStyle::with_template("{msg:<28} {wide_bar} {pos}/{len} {eta}"),
            None => ProgressStyle::with_template("{spinner} {msg}"),
        };
        self.bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        self.bar.set_length(steps.unwrap_or(0));
        self.bar.set_position(0);
        self.bar.set_message(name.to_owned());
        self.showing.stage(name, steps);
    }

    fn step(&mut self, done: u64) {
        self.bar.set_position(done);
        self.showing.step(done);
    }

    fn showing(&self) -> Showing {
        self.showing.clone()
    }
}

impl Observer for Bar {
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    fn progress(&mut self, progress: &FitProgress<'_>) -> Flow {
        self.showing.fit("fit", progress);
        self.bar.set_length(progress.max_evaluations);
        self.bar.set_position(progress.evaluations);
        self.bar.set_message(format!("fit: {} {:.3} mm rms", progress.phase, progress.loss_m2.sqrt() * 1e3));
        if self.interrupted.load(Ordering::Relaxed) { Flow::Stop } else { Flow::Continue }
    }
}

impl diagnose::Observer for Bar {
    fn stage(&mut self, stage: &str) -> bool {
        self.showing.stage(&format!("diagnosis: {stage}"), None);
        self.status(format!("diagnosis: {stage}"));
        !self.interrupted.load(Ordering::Relaxed)
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }
}
