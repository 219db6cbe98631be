//! `rig estop`: stops the servo now. Beside a running rig it tells that one, which holds the port.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process};

use super::{Failure, Outcome};
use crate::claim::{Claim, has_open, port_lock};
use crate::config::RigConfig;
use crate::servo::StopOutcome;
use crate::servo::bus;
use crate::servo::serial::emergency_stop;

/// Arguments of `rig estop`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config that names the port
    pub config: PathBuf,
}

/// A running rig stops its servo within 0.1 s and lets go of the port soon after.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(5);

/// Stops the servo.
///
/// # Errors
/// [`Failure::Hardware`] when no stop was confirmed; [`Failure::Input`] when the config has no board on a port.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let servo = config.servo.as_ref();
    let port = servo.and_then(|servo| Some((servo.outside_port()?, servo)));
    let (port, servo) = port.ok_or_else(|| {
        Failure::Input(anyhow!(
            "{}: no board on a serial port: nothing to stop from outside",
            args.config.display()
        ))
    })?;
    if let Some(holder) = Claim::holder(&port_lock(port)) {
        return tell(holder, port);
    }
    if servo.is_bus() {
        return match bus::emergency_stop(port, servo).map_err(Failure::hardware)? {
            StopOutcome::Acknowledged => Ok(said(format!("the servos on {port} are in their safe state"))),
            StopOutcome::LeftToDeadMan | StopOutcome::NotNeeded => Err(Failure::Hardware(anyhow!(
                "not every servo on {port} confirmed the stop; cut their power if anything still moves"
            ))),
        };
    }
    let outcome = emergency_stop(port, servo.baud).map_err(Failure::hardware)?;
    match outcome {
        StopOutcome::Acknowledged => Ok(said(format!("the board on {port} stopped"))),
        StopOutcome::LeftToDeadMan | StopOutcome::NotNeeded => Err(Failure::Hardware(anyhow!(
            "the board on {port} did not answer; its dead-man stops it; cut its power if anything still moves"
        ))),
    }
}

fn tell(holder: u32, port: &str) -> Result<Outcome, Failure> {
    let process = i32::try_from(holder).ok().and_then(Pid::from_raw);
    let process = process.ok_or_else(|| Failure::Internal(anyhow!("process id {holder} is none")))?;
    if has_open(holder, &port_lock(port)) == Some(false) {
        return Err(Failure::Hardware(anyhow!(
            "{port} is held, but not by process {holder}, as its lock file has it; cut the board's power if anything moves"
        )));
    }
    kill_process(process, Signal::TERM).map_err(|error| {
        let remedy = match error {
            Errno::PERM => "it is another user's: try again with sudo",
            _ => "cut the board's power if anything moves",
        };
        Failure::Hardware(anyhow!("telling process {holder}, which holds {port}: {error}; {remedy}"))
    })?;
    let deadline = Instant::now() + RELEASE_TIMEOUT;
    while Claim::holder(&port_lock(port)) == Some(holder) {
        if Instant::now() > deadline {
            return Err(Failure::Hardware(anyhow!(
                "process {holder} was told to stop and still holds {port}; cut the board's power if anything moves"
            )));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(said(format!("process {holder} stopped the board on {port}")))
}

fn said(text: String) -> Outcome {
    Outcome { text, ..Outcome::default() }
}
