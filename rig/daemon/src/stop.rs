//! A stop's way from a request to whoever moves the rig: a signal through a descriptor that is kept ready, and nothing in between. No
//! store, no disk, no lock that anybody holds for longer than it takes to set a word. Then the hold is written, by whoever asks and, where
//! the disk does not take it at once, by the loop that looks after the rig, again and again; until then the rig is held all the same.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ground::hold::{Hold, HoldError, Latch};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// Stops whoever moves the rig, and writes the hold.
#[derive(Debug, Default)]
pub(super) struct Stop {
    latch: Latch,
    mover: Mutex<Option<OwnedFd>>,
    /// The job that could move the rig was seen to be at rest: what it computes need not end.
    rests: AtomicBool,
    asked: Mutex<Option<(Hold, Instant)>>,
}

impl Stop {
    /// Of what `latch` holds.
    pub(super) fn new(latch: Latch) -> Self {
        Self { latch, ..Self::default() }
    }

    fn mover(&self) -> MutexGuard<'_, Option<OwnedFd>> {
        self.mover.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// This process moves the rig from now on; none does.
    pub(super) fn moves(&self, process: Option<Pid>) {
        *self.mover() = process.and_then(|process| pidfd_open(process, PidfdFlags::empty()).ok());
    }

    /// Whether that process was just seen to be at rest.
    pub(super) fn rests(&self, rests: bool) {
        self.rests.store(rests, Ordering::Relaxed);
    }

    /// Holds the rig from now on and signals whoever moves it.
    pub(super) fn pull(&self, hold: Hold) {
        set(&self.asked).get_or_insert((hold, Instant::now()));
        if !self.rests.load(Ordering::Relaxed)
            && let Some(mover) = &*self.mover()
        {
            // one that has ended meanwhile needs no signal
            let _ = pidfd_send_signal(mover, Signal::TERM);
        }
    }

    /// Says of the hold that was asked for, and is not written yet, who asked for it and why.
    pub(super) fn explain(&self, by: Option<&str>, why: Option<&str>) {
        if let Some((hold, _)) = &mut *set(&self.asked) {
            let said = Hold::now(by.unwrap_or(&hold.by), why.unwrap_or(&hold.why));
            (hold.by, hold.why) = (said.by, said.why);
        }
    }

    /// Writes the hold that was asked for as long ago, if it is not written yet; it may take as long as the disk takes.
    ///
    /// # Errors
    /// [`HoldError`]: the rig is held by this process alone, and the next call tries again.
    pub(super) fn write(&self, age: Duration) -> Result<(), HoldError> {
        let asked = set(&self.asked).clone();
        let Some((hold, at)) = asked.filter(|(_, at)| at.elapsed() >= age) else { return Ok(()) };
        self.latch.hold(&hold)?;
        let mut asked = set(&self.asked);
        if asked.as_ref().is_some_and(|(_, now)| *now == at) {
            *asked = None;
        }
        Ok(())
    }

    /// The hold was ended by a person, whether it was written or not.
    pub(super) fn forget(&self) {
        *set(&self.asked) = None;
    }

    /// Whether a hold that was asked for is not written yet.
    pub(super) fn is_asked(&self) -> bool {
        set(&self.asked).is_some()
    }

    /// Why nothing may move, if so.
    pub(super) fn held(&self) -> Option<Hold> {
        let asked = set(&self.asked).as_ref().map(|(hold, _)| hold.clone());
        asked.or_else(|| self.latch.held())
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
        stop.moves(Some(Pid::from_child(&sleeps)));
        stop.rests(true);
        stop.pull(Hold::now("a page", "a hand in the tank"));
        std::thread::sleep(std::time::Duration::from_millis(50));
        assert!(sleeps.try_wait().unwrap().is_none(), "what is at rest goes on computing");
        stop.rests(false);
        stop.pull(Hold::now("another page", "later"));
        assert!(!sleeps.wait().unwrap().success(), "it was ended");
        assert_eq!(stop.held().unwrap().by, "a page");
        stop.write(Duration::ZERO).unwrap();
        assert_eq!(Latch::of(Some(folder.path()), None).held().unwrap().by, "a page");
        stop.moves(None);
        stop.pull(Hold::now("a page", "nothing moves"));
        stop.write(Duration::ZERO).unwrap();
        assert_eq!(stop.held().unwrap().why, "a hand in the tank");
    }

    #[test]
    fn what_the_disk_refuses_holds_all_the_same_and_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("runs");
        let stop = Stop::new(Latch::of(Some(&missing), None));
        stop.pull(Hold::now("a page", "the disk is gone"));
        assert!(stop.write(Duration::ZERO).is_err() && stop.held().is_some());
        std::fs::create_dir(&missing).unwrap();
        stop.write(Duration::ZERO).unwrap();
        assert!(Latch::of(Some(&missing), None).held().is_some());
    }
}
