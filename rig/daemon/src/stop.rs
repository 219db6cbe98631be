//! How a stop request reaches the process that moves the rig: by a signal through a descriptor that is kept open, without store, disk or
//! long-held lock. Then the hold is written by the request; if the disk does not take it at once, the daemon's loop tries again. The
//! rig is held from the request on, whether the hold is written or not.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ground::hold::{Hold, HoldError, Latch};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// Stops the process that moves the rig, and writes the hold.
#[derive(Debug, Default)]
pub(super) struct Stop {
    latch: Latch,
    motion_process: Mutex<Option<OwnedFd>>,
    /// Whether the job that could move the rig is at rest: then its computation need not end.
    at_rest: AtomicBool,
    requested: Mutex<Option<(Hold, Instant)>>,
}

impl Stop {
    /// Of what `latch` holds.
    pub(super) fn new(latch: Latch) -> Self {
        Self { latch, ..Self::default() }
    }

    fn motion_process(&self) -> MutexGuard<'_, Option<OwnedFd>> {
        self.motion_process.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the process that moves the rig from now on; `None`: no process does.
    pub(super) fn set_motion_process(&self, process: Option<Pid>) {
        *self.motion_process() = process.and_then(|process| pidfd_open(process, PidfdFlags::empty()).ok());
    }

    /// Sets whether that process is at rest.
    pub(super) fn set_at_rest(&self, at_rest: bool) {
        self.at_rest.store(at_rest, Ordering::Relaxed);
    }

    /// Holds the rig from now on, and signals the process that moves it.
    pub(super) fn request(&self, hold: Hold) {
        set(&self.requested).get_or_insert((hold, Instant::now()));
        if !self.at_rest.load(Ordering::Relaxed)
            && let Some(mover) = &*self.motion_process()
        {
            // one that has ended meanwhile needs no signal
            let _ = pidfd_send_signal(mover, Signal::TERM);
        }
    }

    /// Sets name and reason of a requested hold that is not written yet.
    pub(super) fn explain(&self, by: Option<&str>, why: Option<&str>) {
        if let Some((hold, _)) = &mut *set(&self.requested) {
            let named = Hold::now(by.unwrap_or(&hold.by), why.unwrap_or(&hold.why));
            (hold.by, hold.why) = (named.by, named.why);
        }
    }

    /// Writes the hold that was asked for as long ago, if it is not written yet; it may take as long as the disk takes.
    ///
    /// # Errors
    /// [`HoldError`]: the rig is held by this process alone, and the next call tries again.
    pub(super) fn write(&self, age: Duration) -> Result<(), HoldError> {
        let requested = set(&self.requested).clone();
        let Some((hold, at)) = requested.filter(|(_, at)| at.elapsed() >= age) else { return Ok(()) };
        self.latch.hold(&hold)?;
        let mut requested = set(&self.requested);
        if requested.as_ref().is_some_and(|(_, now)| *now == at) {
            *requested = None;
        }
        Ok(())
    }

    /// Drops the requested hold: a person has released the rig.
    pub(super) fn forget(&self) {
        *set(&self.requested) = None;
    }

    /// Whether a requested hold is not written yet.
    pub(super) fn is_asked(&self) -> bool {
        set(&self.requested).is_some()
    }

    /// Why nothing may move, if so.
    pub(super) fn held(&self) -> Option<Hold> {
        let requested = set(&self.requested).as_ref().map(|(hold, _)| hold.clone());
        requested.or_else(|| self.latch.held())
    }

    /// Who ended the last hold, where that is known.
    pub(super) fn released_by(&self) -> Option<String> {
        self.latch.released().map(|(_, by)| by)
    }
}

fn set(asked: &Mutex<Option<(Hold, Instant)>>) -> MutexGuard<'_, Option<(Hold, Instant)>> {
    asked.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_moves_is_told_and_the_first_reason_holds_until_it_is_written_and_after() {
        let folder = tempfile::tempdir().unwrap();
        let stop = Stop::new(Latch::of(Some(folder.path()), None));
        let mut sleeps = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        stop.set_motion_process(Some(Pid::from_child(&sleeps)));
        stop.set_at_rest(true);
        stop.request(Hold::now("a page", "a hand in the tank"));
        std::thread::sleep(std::time::Duration::from_millis(50));
        assert!(sleeps.try_wait().unwrap().is_none(), "what is at rest goes on computing");
        stop.set_at_rest(false);
        stop.request(Hold::now("another page", "later"));
        assert!(!sleeps.wait().unwrap().success(), "it was ended");
        assert_eq!(stop.held().unwrap().by, "a page");
        stop.write(Duration::ZERO).unwrap();
        assert_eq!(Latch::of(Some(folder.path()), None).held().unwrap().by, "a page");
        stop.set_motion_process(None);
        stop.request(Hold::now("a page", "nothing moves"));
        stop.write(Duration::ZERO).unwrap();
        assert_eq!(stop.held().unwrap().why, "a hand in the tank");
    }

    #[test]
    fn what_the_disk_refuses_holds_all_the_same_and_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("runs");
        let stop = Stop::new(Latch::of(Some(&missing), None));
        stop.request(Hold::now("a page", "the disk is gone"));
        assert!(stop.write(Duration::ZERO).is_err() && stop.held().is_some());
        std::fs::create_dir(&missing).unwrap();
        stop.write(Duration::ZERO).unwrap();
        assert!(Latch::of(Some(&missing), None).held().is_some());
    }
}
