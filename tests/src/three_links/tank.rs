//! The errors of a driven case against the tank's own model: what remains is the error of the keypoints and of the servo's command.

use std::path::Path;

use ident::table::{read_command, read_trajectory};
use sim::{Command, Integrator, Model, RolloutOptions, State, rollout};

use super::{Case, SERVO, TANK, TANK_MODEL};
use crate::verbs::Result;

/// The form in which the simulated servo gets its command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandForm {
    /// As the profile says, straight from corner to corner.
    Profile,
    /// In whole microseconds of pulse, looked at as often as the tank's servo does.
    Pulses,
}

/// Steps of the simulation \[s\], a tenth of the time between two looks of the servo.
const SIMULATION_STEP_S: f64 = 1e-4;
/// How long a pulse takes to change to the next in a table that knows no steps \[s\].
const STEP_EDGE_S: f64 = 1e-6;

/// Mean distance of P1, P2 and P3, as extracted into `folder`, from where the tank's own model has them once the servo moves \[mm\].
///
/// # Errors
/// Where `case` is not driven or not there.
pub fn errors_by_the_tank_mm(case: &Case, folder: &Path, form: CommandForm) -> Result<[f64; 3]> {
    let tank: toml::Table = TANK.parse()?;
    let servo: toml::Table = SERVO.parse()?;
    let number = |key: &str| servo[key].as_float().ok_or_else(|| format!("the servo has no `{key}`"));
    let mut model = Model::from_mjcf(TANK_MODEL)?;
    for (cause, values) in tank["causes"].as_table().into_iter().flatten() {
        model.add_cause(cause)?;
        for (name, value) in values.as_table().into_iter().flatten() {
            model.set_parameter(&format!("{cause}/{name}"), value.as_float().unwrap_or(0.0))?;
        }
    }
    model.add_cause("servo_lag")?;
    model.set_parameter("servo_lag/time", number("lag_s")?)?;

    let measured = read_trajectory(&folder.join(case.id).join("trajectory.csv"))?;
    let mut command = read_command(&folder.join(case.id).join("servo.csv"))?;
    let moves_s = command.first_motion_s().ok_or("the servo never moves")?;
    if form == CommandForm::Pulses {
        command = pulses(&command, number("us_per_rad")?, number("period_s")?);
    }
    let start = State { qpos: case.pose_rad.to_vec(), ..model.rest_state() };
    let options = RolloutOptions {
        integrator: Some(Integrator::Euler),
        timestep_s: Some(SIMULATION_STEP_S),
        ..RolloutOptions::default()
    };
    let simulated = rollout(&model, &start, &command, &measured.time_s, &options)?.trajectory();
    let error_mm = |name: &str| -> Option<f64> {
        let [measured_column, simulated_column] =
            [&measured, &simulated].map(|all| all.keypoints.iter().position(|keypoint| keypoint == name));
        let (measured_column, simulated_column) = (measured_column?, simulated_column?);
        // before, the chain settles into its pose
        let rows = (0..measured.time_s.len()).filter(|&row| measured.time_s[row] >= moves_s);
        let distances = rows.filter_map(|row| {
            let ([x, _, z], [a, _, c]) =
                (measured.at(row, measured_column), simulated.at(row, simulated_column));
            let distance = (x - a).hypot(z - c);
            distance.is_finite().then_some(distance)
        });
        let distances: Vec<f64> = distances.collect();
        Some(1e3 * distances.iter().sum::<f64>() / distances.len() as f64)
    };
    let errors = ["P1", "P2", "P3"].map(|name| error_mm(name).unwrap_or(f64::NAN));
    Ok(errors)
}

/// The command of a servo that reads its pulse every `period_s`, in pulses of whole microseconds.
fn pulses(command: &Command, us_per_rad: f64, period_s: f64) -> Command {
    let (Some(&from_s), Some(&to_s)) = (command.time_s.first(), command.time_s.last()) else {
        return command.clone();
    };
    let mut quantised =
        Command { actuators: command.actuators.clone(), time_s: Vec::new(), angle_rad: Vec::new() };
    for look in 0..=((to_s - from_s) / period_s).ceil() as usize {
        let time_s = from_s + look as f64 * period_s;
        let angle_rad = (command.at(0, time_s) * us_per_rad).round() / us_per_rad;
        let last_rad = quantised.angle_rad.last().copied();
        if last_rad == Some(angle_rad) {
            continue;
        }
        if let Some(last_rad) = last_rad {
            quantised.time_s.push(time_s - STEP_EDGE_S);
            quantised.angle_rad.push(last_rad);
        }
        quantised.time_s.push(time_s);
        quantised.angle_rad.push(angle_rad);
    }
    quantised
}
