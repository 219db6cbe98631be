//! Who has the processor first where there is not enough of it: what keeps a servo in time, then what takes and keeps pictures, then what
//! only computes.

#![allow(clippy::disallowed_methods, reason = "a switch of the system")]

use rustix::process::{nice, setpriority_process};

/// How urgent the work of a thread is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Urgency {
    /// A servo waits for it.
    Servo,
    /// Pictures come whether it is ready or not; there is room for some.
    Pictures,
    /// Nobody waits for it but people.
    Computing,
}

/// The niceness of a session's threads together, against others and the kernel's own: a quarter of the usual weight.
const SESSION_NICENESS: &str = "6";

/// Lets the kernel's own threads come before this program and its jobs, where it has a session of its own, as a service has. They carry
/// the bytes of serial ports, and where sessions share the processors ([`sched(7)`]) what computes at the highest niceness keeps them
/// waiting for a second all the same: a servo's answers then come too late. In a session that others are in, a shell's, nothing is changed.
///
/// [`sched(7)`]: https://man7.org/linux/man-pages/man7/sched.7.html
pub fn give_way_to_the_kernel() {
    if std::fs::read_to_string("/proc/self/stat").is_ok_and(|stat| leads_its_session(&stat) == Some(true)) {
        // a kernel that does not schedule by sessions has no such file
        let _ = std::fs::write("/proc/self/autogroup", SESSION_NICENESS);
    }
}

/// Whether the process that [`/proc/pid/stat`] tells of leads its session. In a container it may be in one begun outside, which has the
/// number 0 there: `getsid` of a library that counts from 1 is no help.
///
/// [`/proc/pid/stat`]: https://man7.org/linux/man-pages/man5/proc_pid_stat.5.html
fn leads_its_session(stat: &str) -> Option<bool> {
    // `pid (name) state parent group session`; a name may have blanks and brackets
    let (before, after) = stat.rsplit_once(')')?;
    let process = before.split_whitespace().next()?;
    Some(after.split_whitespace().nth(3)? == process)
}

/// As `nice` counts: each step is worth a quarter more or less of the processor.
const SERVO_NICENESS: i32 = -10;
const PICTURES_NICENESS: i32 = 4;
const COMPUTING_NICENESS: i32 = 10;

impl Urgency {
    /// Gives the calling thread, and those that it starts from now on, their place in the scheduler's order. Where the system refuses, as
    /// it does to put anybody without the right to it (`LimitNICE=` of a service, `nice` in limits.conf) before others, it stays where it is.
    pub fn take(self) {
        let _ = match self {
            // of the calling thread alone, on Linux
            Self::Servo => setpriority_process(None, SERVO_NICENESS),
            Self::Pictures => nice(PICTURES_NICENESS).map(drop),
            Self::Computing => nice(COMPUTING_NICENESS).map(drop),
        };
    }

    /// The niceness that a process of such work starts with.
    pub fn niceness(self) -> i32 {
        match self {
            Self::Servo => SERVO_NICENESS,
            Self::Pictures => PICTURES_NICENESS,
            Self::Computing => COMPUTING_NICENESS,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_leads_its_session_is_told_from_a_shells_and_a_containers() {
        for (stat, leads) in [
            ("4242 (rig) S 1 4242 4242 0 -1 4194304", Some(true)),
            ("4242 (rig) S 17 4242 17 34816 4242 4194304", Some(false)),
            ("7 (a name) with 1 (2) S 0 0 0 0 -1 4194304", Some(false)),
            ("", None),
        ] {
            assert_eq!(leads_its_session(stat), leads, "{stat}");
        }
    }
}
