//! Scheduling priorities where processors are short: first the threads that keep a servo in time, then those that take and record images,
//! then those that compute.

#![allow(clippy::disallowed_methods, reason = "a switch of the system")]

use rustix::io::Errno;
use rustix::process::{nice, setpriority_process};
use thread_priority::unix::{set_thread_priority_and_policy, thread_native_id};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
};

/// How urgent the work of a thread is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Urgency {
    /// Threads that a servo waits for.
    Servo,
    /// Threads that receive and record images, which come at their own rate; a few can be buffered.
    Pictures,
    /// Computations, which only people wait for.
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

/// Priority of the servo's threads among the real-time ones, 1 to 99, chosen: the kernel's own for interrupts have 50.
const SERVO_PRIORITY: u8 = 10;
/// Niceness of the servo's threads, chosen; each step of niceness changes the share of the processor by a quarter.
const SERVO_NICENESS: i32 = -10;
/// Niceness of the threads for images, chosen.
const PICTURES_NICENESS: i32 = 4;
/// Niceness of computations: with the highest, a thread for images has 28 times the share. With 10, where it has 4 times, sixteen fits on
/// two processors kept such threads waiting for up to 30 ms (measured).
const COMPUTING_NICENESS: i32 = 19;

impl Urgency {
    /// Sets the priority of the calling thread and of those that it starts from now on. Where the system refuses it, for lack of the right
    /// (`LimitRTPRIO=` and `LimitNICE=` of a service, `rtprio` and `nice` in limits.conf), the priority stays as it was.
    pub fn take(self) {
        let _ = match self {
            // where it may not go before all others, it has more of the processor than the rest; both are of the calling thread alone
            Self::Servo => before_all_others().or_else(|_| setpriority_process(None, SERVO_NICENESS)),
            Self::Pictures => nice(PICTURES_NICENESS).map(drop),
            Self::Computing => nice(COMPUTING_NICENESS).map(drop),
        };
    }

    /// The niceness with which a process for such work starts.
    pub fn niceness(self) -> i32 {
        match self {
            Self::Servo => SERVO_NICENESS,
            Self::Pictures => PICTURES_NICENESS,
            Self::Computing => COMPUTING_NICENESS,
        }
    }
}

/// Lets the calling thread run as soon as it has something to do ([`SCHED_FIFO`]). Shares of the processor are no promise of that: with half
/// a processor in use by another session, servo threads at the lowest niceness waited for a second (`docs/threads.md`).
///
/// [`SCHED_FIFO`]: https://man7.org/linux/man-pages/man7/sched.7.html
fn before_all_others() -> Result<(), Errno> {
    let first_come = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let priority = ThreadPriorityValue::try_from(SERVO_PRIORITY).map_err(|_| Errno::INVAL)?;
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), first_come)
        .map_err(|_| Errno::PERM)
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
