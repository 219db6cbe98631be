//! A disk that is full while a job ends.

use std::os::fd::{AsRawFd as _, OwnedFd};

use record::journal::{self, Journal};
use rustix::fs::{MemfdFlags, SealFlags};

use super::super::JOURNAL;
use super::*;

/// A journal that takes nothing, as on a full disk.
fn full(folder: &Path) -> (OwnedFd, Journal) {
    let file = rustix::fs::memfd_create("full", MemfdFlags::ALLOW_SEALING).unwrap();
    rustix::fs::fcntl_add_seals(&file, SealFlags::GROW).unwrap();
    let path = folder.join("full");
    std::os::unix::fs::symlink(format!("/proc/self/fd/{}", file.as_raw_fd()), &path).unwrap();
    let journal = Journal::open(&path, MonotonicNs::now()).unwrap();
    (file, journal)
}

/// The end of a job was once recorded and its alert not; tried again it was over already, each time, and the rig did nothing more.
#[test]
fn job_that_ends_on_a_full_disk_ends_once_and_the_next_one_begins() {
    let folder = tempfile::tempdir_in(quick_folder()).unwrap();
    let mut day = begun(folder.path(), &config());
    let steps = |day: &mut Day, count: usize| (0..count).for_each(|_| day.step().unwrap());
    day.act(&Act::Queue { motions: 1 });
    steps(&mut day, 30);
    assert!(day.world.borrow().moves(), "the job moves the rig");

    let (_file, full) = full(folder.path());
    day.rig.as_mut().unwrap().journal = full;
    day.act(&Act::KillJob);
    steps(&mut day, 30);
    assert!(day.rig.as_ref().unwrap().trouble.is_some(), "a full disk is told");

    let journal = folder.path().join(JOURNAL);
    day.rig.as_mut().unwrap().journal = Journal::open(&journal, MonotonicNs::now()).unwrap();
    day.act(&Act::Queue { motions: 1 });
    // a servo that was left is seen to every two seconds
    steps(&mut day, 300);
    assert_eq!(day.rig.as_ref().unwrap().trouble, None);
    let entries = journal::read(&journal).unwrap();
    let of = |event: &str, job: i64| {
        let is_it = |entry: &&journal::Entry| entry.event == event && entry.details["job"] == job;
        entries.iter().filter(is_it).count()
    };
    assert_eq!((of("job-ended", 1), of("alert", 1), of("job-ended", 2)), (1, 1, 1), "{entries:?}");
}
