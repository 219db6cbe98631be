//! A servo's calibration, from the film of a staircase: one that is made now, or that of a recorded run.

use anyhow::anyhow;
use ident::table::{read_command, read_trajectory};
use sim::{Command, Model, RolloutOptions, Trajectory};

use super::{Failure, read_model};
use calibrate::servo::link::DrivenLink;
use calibrate::servo::report::{self, Origin};
use calibrate::servo::{Calibrated, Dynamics, Film, calibrate, calibrate_simulated};
use camera::calibration::View;
use config::{MotionKind, RigConfig};
use record::folder::{RunFolder, file};
use record::start_stop::Start;
use servo::calibration::ServoCalibration;
use servo::profile::ProfileConfig;
use servo::{ServoChannel, Unit};

/// The calibration of a servo from its film.
pub struct Found {
    /// The calibration without the dynamics that the model's own actuator has already.
    pub calibrated: Calibrated,
    /// Dynamics of the link as observed, with those of the model's actuator.
    pub observed: Dynamics,
    /// The calibration as written to a file.
    pub calibration: ServoCalibration,
}

/// The channel of `config` called `name`, or the only one that drives the model.
///
/// # Errors
/// [`Failure::Input`] where there is none, or where it is not one to be calibrated.
pub fn channel<'a>(
    config: &'a RigConfig,
    name: Option<&str>,
) -> Result<(&'a ServoChannel, &'a str), Failure> {
    let refuse = |why: String| Err(Failure::Input(anyhow!(why)));
    let Some(servo) = &config.servo else { return refuse("the config has no table [servo]".into()) };
    if config.run.kind != MotionKind::Driven {
        return refuse("a servo is calibrated with the config of a driven run, this one is of a drop".into());
    }
    let driven: Vec<(&ServoChannel, &str)> = servo.driven().collect();
    let names = || driven.iter().map(|(channel, _)| channel.name.as_str()).collect::<Vec<_>>().join(", ");
    let found = match name {
        Some(name) => driven.iter().find(|(channel, _)| channel.name == name),
        None if driven.len() == 1 => driven.first(),
        None => None,
    };
    match found {
        None => refuse(format!("--channel must be one that drives an actuator of the model: {}", names())),
        Some((channel, _)) if channel.travel.unit() != Unit::PulseUs => refuse(format!(
            "channel {}: a servo on a bus tells its angle itself, there is no pulse to calibrate",
            channel.name
        )),
        Some(&found) => Ok(found),
    }
}

impl Found {
    /// What `run`, which was extracted, says of the channel called `name`, or of the only one.
    ///
    /// # Errors
    /// [`Failure::Input`] where there are no tables, [`Failure::Data`] where they do not tell.
    pub fn of(run: &RunFolder, name: Option<&str>) -> Result<Self, Failure> {
        let Start { config, id, clock, prescribed, model, .. } = run.start();
        let config = RigConfig::parse(config, &run.file(file::START)).map_err(Failure::input)?;
        let (channel, actuator) = channel(&config, name)?;
        if !run.file(file::TRAJECTORY).is_file() {
            let path = run.path().display();
            return Err(Failure::Input(anyhow!(
                "run {path} has no {}: extract it first, `rig replay {path} --out DIR`, and calibrate from DIR",
                file::TRAJECTORY
            )));
        }
        let trajectory = read_trajectory(&run.file(file::TRAJECTORY)).map_err(Failure::input)?;
        let command = read_command(&run.file(file::SERVO)).map_err(Failure::input)?;
        let mirrored = config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored);
        let commanded_pulses = commanded_pulses(&command, actuator, channel, mirrored).ok_or_else(|| {
            Failure::Input(anyhow!("{} has no column {actuator}_rad", run.file(file::SERVO).display()))
        })?;
        let model = read_model(&run.file(model))?;
        let axes = View::of(&trajectory).seen_axes().map(|(axis, _)| axis);
        let link = DrivenLink::of(&model, actuator, axes).map_err(Failure::input)?;
        let film = |trajectory: &Trajectory| {
            let (time_s, angle_rad) = link.angles(trajectory)?;
            Ok(Film { command: commanded_pulses.clone(), time_s, angle_rad })
        };
        let calibrated = film(&trajectory).and_then(|film| calibrate(&film)).map_err(Failure::data)?;
        let simulated = (!prescribed)
            .then(|| simulated(&model, actuator, &calibrated, &commanded_pulses, &trajectory.time_s));
        // a model whose actuator does not move has no dynamics to subtract
        let of_model =
            simulated.flatten().and_then(|trajectory| calibrate_simulated(&film(&trajectory).ok()?).ok());
        let origin = Origin { date: clock.utc.clone(), channel: channel.name.clone(), run: id.to_string() };
        let observed = calibrated.dynamics.clone();
        let calibrated =
            of_model.map_or_else(|| calibrated.clone(), |of_model| calibrated.without(&of_model));
        let calibration = report::file(&calibrated, &origin)
            .ok_or_else(|| Failure::Data(anyhow!("run {}: a figure is no number", run.path().display())))?;
        Ok(Self { calibrated, observed, calibration })
    }
}

/// Times \[s\] and pulses \[µs\] commanded to `channel`, where `command` has its `actuator`.
fn commanded_pulses(
    command: &Command,
    actuator: &str,
    channel: &ServoChannel,
    mirrored: bool,
) -> Option<Vec<(f64, f64)>> {
    let column = command.actuators.iter().position(|name| name == actuator)?;
    let width = command.actuators.len();
    let angles = command.angle_rad.iter().skip(column).step_by(width);
    let pulse_us = |angle: &f64| {
        let pulse_us = channel.setpoint(*angle, mirrored);
        // whole, but for what the way to an angle and back has left of it
        let whole = pulse_us.round();
        if (pulse_us - whole).abs() < 1e-6 { whole } else { pulse_us }
    };
    Some(command.time_s.iter().copied().zip(angles.map(pulse_us)).collect())
}

/// The trajectory of the model with its own actuator under these pulses, converted by the calibrated table; none where the simulation fails.
fn simulated(
    model: &Model,
    actuator: &str,
    calibrated: &Calibrated,
    commanded_pulses: &[(f64, f64)],
    time_s: &[f64],
) -> Option<Trajectory> {
    let (rows_s, angle_rad) = commanded_pulses
        .iter()
        .map(|&(time_s, pulse_us)| (time_s, calibrated.levels.angle_rad(pulse_us)))
        .unzip();
    let command = Command { actuators: vec![actuator.to_owned()], time_s: rows_s, angle_rad };
    let rollout = sim::rollout(model, &model.rest_state(), &command, time_s, &RolloutOptions::default());
    rollout.ok().map(|rollout| rollout.trajectory())
}
