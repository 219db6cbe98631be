//! `rig status`: what is going on: who holds the port, how the board is, how the last run went.

use std::path::PathBuf;

use super::{Failure, Outcome};
use config::RigConfig;
use ground::claim::{Claim, port_lock};
use record::folder::{self, Listed};
use run::open;
use servo::bus;
use servo::motion::standing;
use servo::serial::query_status;
use store::runs::status;

/// Arguments of `rig status`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config
    pub config: PathBuf,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
}

/// Looks, and changes nothing; a board that another rig drives is not disturbed.
///
/// # Errors
/// [`Failure::Input`] for an unusable config, [`Failure::Hardware`] when a free board does not answer.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let latch = open::latch(&config, Some(&args.runs_dir));
    let mut lines = vec![match latch.held() {
        Some(hold) => format!("hold          {hold}; `rig release CONFIG --by NAME` ends that"),
        None => "hold          none".into(),
    }];
    lines.push(format!("servos        {}", standing(&args.runs_dir)));
    lines.push(match Claim::holder(&args.runs_dir.join(".lock")) {
        Some(pid) => format!("runs folder   {}, in use by process {pid}", args.runs_dir.display()),
        None => format!("runs folder   {}, free", args.runs_dir.display()),
    });
    if let Some(Listed { id, folder }) =
        folder::list(&args.runs_dir).ok().and_then(|runs| runs.into_iter().last())
    {
        let how = folder.as_ref().map_or("unreadable", status);
        lines.push(format!("last run      {id}, {how}"));
    }
    let servo = config.servo.as_ref();
    match servo.and_then(|servo| Some((servo.outside_port()?, servo))) {
        None => lines.push("servo board   none on a serial port".into()),
        Some((port, servo)) => match Claim::holder(&port_lock(port)) {
            Some(pid) => lines.push(format!("servo board   {port}, driven by process {pid}")),
            None if servo.is_bus() => {
                let servos = bus::query_status(port, servo).map_err(Failure::hardware)?;
                lines.extend(servos.into_iter().map(|how| format!("servo         {port}: {how}")));
            }
            None => {
                let status = query_status(port, servo.baud).map_err(Failure::hardware)?;
                lines.push(format!(
                    "servo board   {port}: {:?}, latched fault: {:?}, boot id {:08x}",
                    status.state, status.fault, status.boot_id
                ));
            }
        },
    }
    Ok(Outcome { text: lines.join("\n"), ..Outcome::default() })
}
