//! `rig jog`: one servo by hand, slowly, for mounting and calibrating.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;

use super::{Failure, Outcome};
use app::{Interrupt, base, interruptible};
use config::RigConfig;
use run::open;
use servo::profile::ProfileConfig;
use servo::{ServoChannel, ServoEvent, StopOutcome, Unit};

/// Arguments of `rig jog`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config
    pub config: PathBuf,
    /// Name of the channel; may be left out where there is only one
    #[arg(long)]
    pub channel: Option<String>,
    /// Angle to go to (rad)
    #[arg(long, allow_negative_numbers = true, conflicts_with = "pulse_us")]
    pub angle_rad: Option<f64>,
    /// Pulse to go to (µs)
    #[arg(long)]
    pub pulse_us: Option<u16>,
    /// Position to go to, of a servo on a bus (counts)
    #[arg(long, conflicts_with_all = ["angle_rad", "pulse_us"])]
    pub count: Option<u16>,
    /// Duration of the motion (s)
    #[arg(long, default_value_t = 2.0)]
    pub duration_s: f64,
    /// How long to stay there before the channel goes to its safe state (s)
    #[arg(long, default_value_t = 1.0)]
    pub stay_s: f64,
    /// Folder of run folders, where a stop holds the rig and others see that it moves
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
}

/// Moves one channel, stays, and puts it in its safe state.
///
/// # Errors
/// [`Failure::Input`] for a channel or place that is not there, [`Failure::Hardware`] when the board refuses or fails.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let input = |why: String| Failure::Input(anyhow!(why));
    let servo = config.servo.as_ref().ok_or_else(|| input("the config has no table [servo]".into()))?;
    if ![args.duration_s, args.stay_s].iter().all(|s| s.is_finite() && (0.0..=600.0).contains(s)) {
        return Err(input("--duration-s and --stay-s must be between 0 and 600".into()));
    }
    let names = || servo.channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
    let channel = match &args.channel {
        Some(name) => servo.channels.iter().find(|channel| channel.name == *name),
        None if servo.channels.len() == 1 => servo.channels.first(),
        None => None,
    };
    let channel = channel.ok_or_else(|| input(format!("--channel must be one of: {}", names())))?;
    let mirrored = config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored);
    let (unit, range) = (channel.travel.unit(), channel.travel.range());
    let setpoint = match (args.pulse_us, args.count, args.angle_rad) {
        (Some(pulse_us), None, None) if unit == Unit::PulseUs => pulse_us,
        (None, Some(count), None) if unit == Unit::Counts => count,
        (None, None, Some(angle_rad)) => {
            let setpoint = channel.setpoint(angle_rad, mirrored).round();
            if !(f64::from(*range.start())..=f64::from(*range.end())).contains(&setpoint) {
                return Err(input(format!(
                    "{angle_rad} rad is a {} of {setpoint} {} on channel {}, which takes {} to {} {}",
                    unit.noun(),
                    unit.symbol(),
                    channel.name,
                    range.start(),
                    range.end(),
                    unit.symbol()
                )));
            }
            setpoint as u16
        }
        _ => {
            let option = if unit == Unit::Counts { "--count" } else { "--pulse-us" };
            return Err(input(format!(
                "say where to: --angle-rad or, for channel {}, {option}",
                channel.name
            )));
        }
    };
    interruptible(async |interrupt| move_to(args, &config, channel, setpoint, interrupt))
}

fn move_to(
    args: &Args,
    config: &RigConfig,
    channel: &ServoChannel,
    setpoint: u16,
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
    let (mut board, _port) =
        open::board(config, base(&args.config), Some(&args.runs_dir)).map_err(Failure::of_run)?;
    let mut measured = None;
    let moved = board.jog(channel.id, setpoint, args.duration_s).and_then(|()| {
        let until = std::time::Instant::now() + ground::strict::duration(args.duration_s + args.stay_s);
        while std::time::Instant::now() < until && !interrupt.is_raised() {
            for event in board.poll()? {
                if let ServoEvent::Position { channel: id, count, .. } = event
                    && id == channel.id
                {
                    measured = Some(count);
                }
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(())
    });
    let is_over = moved.is_ok() && !interrupt.is_raised();
    let stopped = if is_over { board.leave() } else { board.stop() };
    moved.map_err(|error| Failure::of_run(error.into()))?;
    if stopped == StopOutcome::LeftToDeadMan {
        return Err(Failure::Hardware(anyhow!("the board did not answer the stop; its dead-man stops it")));
    }
    let unit = channel.travel.unit().symbol();
    let text = match measured {
        Some(count) => format!("channel {} was told {setpoint} {unit} and stood at {count}", channel.name),
        None => format!("channel {} was at {setpoint} {unit}", channel.name),
    };
    Ok(Outcome { text, ..Outcome::default() })
}
