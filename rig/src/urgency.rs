//! Who has the processor first where there is not enough of it: what keeps a servo in time, then what takes and keeps pictures, then what
//! only computes.

use rustix::process::{getpid, getsid, nice, setpriority_process};

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
    if getsid(None).is_ok_and(|session| session == getpid()) {
        // a kernel that does not schedule by sessions has no such file
        let _ = std::fs::write("/proc/self/autogroup", SESSION_NICENESS);
    }
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
