//! `rig simulate`: moves a model from a given state and writes what it does.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use sim::{Command, Integrator, Model, Rollout, RolloutError, RolloutOptions, rollout};

use super::{Failure, Outcome};

/// Simulates a model and writes its coordinates, velocities and sites over time.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The model, as MJCF
    model: PathBuf,
    /// Initial coordinates [rad, m], separated by commas; left out: the model's reference
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', allow_hyphen_values = true)]
    qpos: Option<Vec<f64>>,
    /// Initial velocities [rad/s, m/s], separated by commas; left out: at rest
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', allow_hyphen_values = true)]
    qvel: Option<Vec<f64>>,
    /// Commanded angles over time (servo.csv)
    #[arg(long, value_name = "FILE")]
    servo: Option<PathBuf>,
    /// How long to simulate [s]
    #[arg(long, default_value_t = 10.0)]
    duration_s: f64,
    /// Time step [s]; left out: the model's own
    #[arg(long)]
    timestep_s: Option<f64>,
    /// Integrator; left out: the model's own
    #[arg(long, value_enum)]
    integrator: Option<IntegratorName>,
    /// Hold the command over each step, as MuJoCo does, instead of sampling it at Runge-Kutta's stages
    #[arg(long)]
    hold_command: bool,
    /// Joints of position actuators follow their commands exactly
    #[arg(long)]
    prescribed: bool,
    /// Time between rows [s]
    #[arg(long, default_value_t = 0.01)]
    every_s: f64,
    /// Where to write the rows
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// The integrators by name.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
enum IntegratorName {
    /// Semi-implicit Euler, joint damping implicit
    Euler,
    /// All forces but the bias implicit in velocity
    Implicitfast,
    /// Runge-Kutta of fourth order
    Rk4,
}

impl From<IntegratorName> for Integrator {
    fn from(name: IntegratorName) -> Self {
        match name {
            IntegratorName::Euler => Self::Euler,
            IntegratorName::Implicitfast => Self::ImplicitFast,
            IntegratorName::Rk4 => Self::Rk4,
        }
    }
}

/// Most rows one run may have: a slip in `--every-s` should not fill the disk.
const MOST_ROWS: f64 = 1e7;

/// Carries out `rig simulate`.
///
/// # Errors
/// [`Failure::Input`] for a model, command or option that does not fit, [`Failure::Data`] when the motion diverges.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let text = std::fs::read_to_string(&args.model)
        .with_context(|| format!("reading {}", args.model.display()))
        .map_err(Failure::Input)?;
    let model = Model::from_mjcf(&text)
        .with_context(|| format!("reading model {}", args.model.display()))
        .map_err(Failure::Input)?;
    if let [first, ..] = model.possible_contacts() {
        let [a, b] = &first.geoms;
        tracing::warn!(
            pairs = model.possible_contacts().len(),
            "contact is not simulated: geoms such as `{a}` and `{b}` pass through each other"
        );
    }
    let mut state = model.rest_state();
    if let Some(qpos) = &args.qpos {
        state.qpos.clone_from(qpos);
    }
    if let Some(qvel) = &args.qvel {
        state.qvel.clone_from(qvel);
    }
    let command = match &args.servo {
        Some(path) => ident::table::read_command(path).map_err(Failure::input)?,
        None => Command::default(),
    };
    let options = RolloutOptions {
        integrator: args.integrator.map(Integrator::from),
        timestep_s: args.timestep_s,
        hold_command: args.hold_command,
        prescribed: args.prescribed,
        start_s: 0.0,
    };
    let run =
        rollout(&model, &state, &command, &sample_times(args)?, &options).map_err(|error| match error {
            RolloutError::Diverged { .. } => Failure::data(error),
            _ => Failure::input(error),
        })?;
    std::fs::write(&args.out, table(&model, &run))
        .with_context(|| format!("writing {}", args.out.display()))
        .map_err(Failure::Input)?;
    let text = format!("{}\n", args.out.display());
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

fn sample_times(args: &Args) -> Result<Vec<f64>, Failure> {
    for (option, value) in [("--duration-s", args.duration_s), ("--every-s", args.every_s)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Failure::Input(anyhow!("{option} {value} must be finite and above 0")));
        }
    }
    // the last row is at the duration, where that is a whole number of rows but for rounding
    let rows = (args.duration_s / args.every_s + 1e-6).floor();
    if rows > MOST_ROWS {
        return Err(Failure::Input(anyhow!("{rows} rows exceed the limit of {MOST_ROWS}; raise --every-s")));
    }
    Ok((0..=rows as u64).map(|row| row as f64 * args.every_s).collect())
}

/// The rows as CSV: time, coordinates, velocities, every site, all of one instant.
fn table(model: &Model, run: &Rollout<f64>) -> String {
    let (nq, nv) = (model.nq(), model.nv());
    let mut out = String::from("time_s");
    for index in 0..nq {
        let _ = write!(out, ",q{index}");
    }
    for index in 0..nv {
        let _ = write!(out, ",v{index}");
    }
    for site in &model.sites {
        let _ = write!(out, ",{0}_x_m,{0}_y_m,{0}_z_m", site.name);
    }
    out.push('\n');
    for (instant, time_s) in run.time_s.iter().enumerate() {
        let qpos = &run.qpos[instant * nq..(instant + 1) * nq];
        let qvel = &run.qvel[instant * nv..(instant + 1) * nv];
        // nine decimals of a second hide that k * 0.01 is not quite what it says
        let _ = write!(out, "{}", (time_s * 1e9).round() / 1e9);
        let sites = model.poses(qpos).site_pos;
        for value in qpos.iter().chain(qvel).chain(sites.iter().flat_map(|at| &at.0)) {
            let _ = write!(out, ",{value}");
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const PENDULUM: &str = r#"<mujoco><option timestep="0.001" integrator="RK4"/><worldbody><body>
        <joint name="q" axis="0 -1 0"/><geom type="sphere" size="0.01" pos="0 0 -0.1"/>
        <site name="P1" pos="0 0 -0.1"/></body></worldbody></mujoco>"#;

    fn args(folder: &std::path::Path, model: &str) -> Args {
        std::fs::write(folder.join("model.xml"), model).unwrap();
        Args {
            model: folder.join("model.xml"),
            qpos: Some(vec![0.5]),
            qvel: None,
            servo: None,
            duration_s: 0.1,
            timestep_s: None,
            integrator: None,
            hold_command: false,
            prescribed: false,
            every_s: 0.02,
            out: folder.join("out.csv"),
        }
    }

    #[test]
    fn rows_state_time_coordinates_velocities_and_sites_of_one_instant() {
        let folder = tempfile::tempdir().unwrap();
        let args = args(folder.path(), PENDULUM);
        assert_eq!(run(&args).unwrap().out.as_ref(), Some(&args.out));
        let text = std::fs::read_to_string(&args.out).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("time_s,q0,v0,P1_x_m,P1_y_m,P1_z_m"));
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]);
        for row in &rows {
            assert!(
                (row[3] - 0.1 * row[1].sin()).abs() < 1e-12 && (row[5] + 0.1 * row[1].cos()).abs() < 1e-12
            );
        }
    }

    #[test]
    fn wrong_input_is_exit_code_2_and_divergence_4() {
        let folder = tempfile::tempdir().unwrap();
        let mut wrong = args(folder.path(), PENDULUM);
        wrong.qpos = Some(vec![0.5, 0.1]);
        assert_eq!(run(&wrong).unwrap_err().exit_code(), 2);
        wrong.qpos = Some(vec![0.5]);
        wrong.every_s = 0.0;
        assert_eq!(run(&wrong).unwrap_err().exit_code(), 2);
        let stiff = PENDULUM.replace("axis=", "stiffness=\"1e9\" axis=");
        assert_eq!(run(&args(folder.path(), &stiff)).unwrap_err().exit_code(), 4);
    }
}
