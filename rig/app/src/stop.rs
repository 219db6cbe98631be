//! Stopping a rig from outside whatever moves it, and letting it move again.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use firmware_protocol::event::{Fault, State, Status};
use rustix::process::{Pid, Signal, kill_process};

use super::{Failure, recover};
use config::RigConfig;
use ground::claim::{Claim, has_open, port_lock};
use ground::clock::MonotonicNs;
use ground::hold::{Hold, Latch};
use run::open;
use servo::motion::{Motion, Reporter, standing};
use servo::{ServoConfig, ServoError, StopOutcome, bus, serial};

/// Time for the process that drives the servo to stop it (about 0.1 s) and to release the port. Chosen.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which the port's lock is checked. Chosen.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Holds the rig with the board `servo`, sees that its servos are stopped, and says how. The rig is held whatever is said then.
///
/// # Errors
/// [`Failure::Hardware`] when no stop was confirmed.
pub fn stop(servo: Option<&ServoConfig>, runs_dir: Option<&Path>, hold: &Hold) -> Result<String, Failure> {
    let latch = Latch::of(runs_dir, servo.and_then(ServoConfig::outside_port));
    // a process that moves the rig sees the hold within milliseconds; no other one begins
    let held = latch.hold(hold);
    let stopped = match servo.and_then(|servo| Some((servo.outside_port()?, servo))) {
        Some((port, servo)) => stop_port(port, servo),
        None => wait_for_rest(runs_dir),
    };
    let outcome = stopped.map_err(Failure::Hardware)?;
    held.map_err(Failure::hardware)?;
    Ok(format!("{outcome}; the rig is held until `rig release CONFIG --by NAME`"))
}

fn stop_port(port: &str, servo: &ServoConfig) -> anyhow::Result<String> {
    let deadline = Instant::now() + STOP_TIMEOUT;
    let mut signalled = None;
    while let Some(holder) = Claim::holder(&port_lock(port)) {
        if Instant::now() > deadline {
            return Err(anyhow!(
                "process {holder} was told to stop and still holds {port}; cut the board's power if anything moves"
            ));
        }
        if signalled != Some(holder) {
            signalled = Some(holder);
            ask_to_end(holder, port);
        }
        std::thread::sleep(STOP_POLL_INTERVAL);
    }
    let outcome = if servo.is_bus() {
        bus::emergency_stop(port, servo)
    } else {
        serial::emergency_stop(port, servo.baud)
    };
    let outcome = match (outcome, signalled) {
        // the process of another user had the port, and has stopped the servos itself
        (Err(ServoError::Open { .. }), Some(holder)) => {
            return Ok(format!("process {holder} saw the hold, stopped what it moved and let go of {port}"));
        }
        (outcome, _) => outcome?,
    };
    match outcome {
        StopOutcome::Acknowledged => Ok(match signalled {
            Some(holder) => format!("process {holder} let go of {port}, and all there is stopped"),
            None => format!("all on {port} is stopped"),
        }),
        StopOutcome::LeftToDeadMan | StopOutcome::NotNeeded => Err(anyhow!(
            "{port} did not confirm the stop; a board's dead-man stops it; cut the power if anything still moves"
        )),
    }
}

/// Asks the process that has the port to end, too: one of another user's sees the hold, and ends by that.
fn ask_to_end(holder: u32, port: &str) {
    // everybody may write to the lock file, so check that this process really has it open
    if has_open(holder, &port_lock(port)) == Some(false) {
        return;
    }
    if let Some(process) = i32::try_from(holder).ok().and_then(Pid::from_raw) {
        let _ = kill_process(process, Signal::TERM);
    }
}

/// Waits until a mock within another process is at rest.
fn wait_for_rest(runs_dir: Option<&Path>) -> anyhow::Result<String> {
    let Some(runs_dir) = runs_dir else {
        return Err(anyhow!(
            "no board on a serial port, and no folder of runs is named: nothing to stop from outside; say --runs-dir"
        ));
    };
    let deadline = Instant::now() + STOP_TIMEOUT;
    while standing(runs_dir).motion != Motion::AtRest && Claim::holder(&recover::lock(runs_dir)).is_some() {
        if Instant::now() > deadline {
            return Err(anyhow!("{} still says that something moves", runs_dir.display()));
        }
        std::thread::sleep(STOP_POLL_INTERVAL);
    }
    Ok("nothing moves".into())
}

/// Resolves an unknown state of the servos of `config` after the process that moved them was killed: waits until their board reports that
/// it has stopped, and records that they are at rest. Without an answer the state stays unknown.
pub fn settle(config: &RigConfig, runs_dir: &Path) {
    if standing(runs_dir).motion == Motion::AtRest {
        return;
    }
    let at_rest = match config.servo.as_ref().and_then(|servo| Some((servo.outside_port()?, servo))) {
        // it was simulated within the process that was killed
        None => Claim::holder(&recover::lock(runs_dir)).is_none(),
        Some((port, servo)) => {
            let Ok(_claim) = Claim::take_port(port) else { return };
            is_at_rest(port, servo)
        }
    };
    if at_rest {
        Reporter::of(Some(runs_dir)).report(Motion::AtRest, MonotonicNs::now(), None);
    }
}

fn is_at_rest(port: &str, servo: &ServoConfig) -> bool {
    if servo.is_bus() {
        return matches!(bus::emergency_stop(port, servo), Ok(StopOutcome::Acknowledged));
    }
    // the dead-man takes its time
    let deadline = Instant::now() + STOP_TIMEOUT;
    while Instant::now() < deadline {
        match serial::query_status(port, servo.baud) {
            Ok(Status { state: State::Idle | State::Faulted, .. }) => return true,
            Ok(_) => std::thread::sleep(STOP_POLL_INTERVAL),
            Err(_) => return false,
        }
    }
    false
}

/// Lets the rig of `config` move again, in the name of `by`: its board's latch is acknowledged, then the hold ended. Says what was
/// released.
///
/// # Errors
/// [`Failure::Input`] for a name that is none; [`Failure::Hardware`] when the board does not answer or is latched all the same. The rig
/// is then still held.
pub fn release(config: &RigConfig, runs_dir: Option<&Path>, by: &str) -> Result<String, Failure> {
    let by = by.trim();
    if by.is_empty() {
        return Err(Failure::Input(anyhow!("a rig is released by a person: say who you are")));
    }
    let latch: Latch = open::latch(config, runs_dir);
    let servo = config.servo.as_ref().filter(|servo| !servo.is_bus());
    let latched = match servo.and_then(|servo| Some((servo.outside_port()?, servo.baud))) {
        None => None,
        Some((port, baud)) => {
            let _claim = Claim::take_port(port).map_err(Failure::hardware)?;
            match serial::release(port, baud) {
                Ok(Fault::None) => None,
                Ok(fault) => Some(fault),
                // a port that is not there moves nothing; when it is back, its board says by itself that it is stopped
                Err(ServoError::Open { .. }) if !Path::new(port).exists() => None,
                Err(error) => return Err(Failure::hardware(error)),
            }
        }
    };
    let held = latch.release(by).map_err(Failure::hardware)?;
    let board = latched.map(|fault| format!("the board's {fault} is acknowledged"));
    let hold = held.map(|hold| format!("no longer {hold}"));
    let said: Vec<String> = hold.into_iter().chain(board).collect();
    Ok(if said.is_empty() {
        "nothing was held".into()
    } else {
        format!("{}: released by {by}", said.join("; "))
    })
}
