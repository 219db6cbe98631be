//! Who has the processor first where there is not enough of it: what keeps a servo in time, then what takes and keeps pictures, then what
//! only computes.

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
