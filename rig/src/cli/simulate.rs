//! `rig simulate`: moves a model from a given state and writes what it does.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::anyhow;
use ident::fit::FirstTouch;
use sim::causes::Kind;
use sim::math::Vec3;
use sim::{
    BasePath, Command, ContactWatch, Integrator, JointKind, Model, Rollout, RolloutError, RolloutOptions,
    rollout,
};

use super::{Failure, Outcome};
use record::outputs::Outputs;

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
    /// Where the base goes over time (base.csv: time_s,x_m,z_m,angle_rad), with all that the model fastens to the world; left out, it stands
    #[arg(long, value_name = "FILE")]
    base: Option<PathBuf>,
    /// How long to simulate [s]
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
    duration_s: f64,
    /// Time step [s]; left out: the model's own
    #[arg(long, allow_negative_numbers = true)]
    timestep_s: Option<f64>,
    /// Integrator; left out: the model's own
    #[arg(long, value_enum)]
    integrator: Option<IntegratorName>,
    /// Our own steps, as long as keypoints stay within this of the exact motion [m]; not with --timestep-s or --integrator
    #[arg(long, value_name = "M", conflicts_with_all = ["timestep_s", "integrator", "hold_command"])]
    accuracy_m: Option<f64>,
    /// Hold the command over each step, as MuJoCo does, instead of sampling it at Runge-Kutta's stages
    #[arg(long)]
    hold_command: bool,
    /// Joints of position actuators follow their commands exactly
    #[arg(long)]
    prescribed: bool,
    /// Time between rows [s]
    #[arg(long, default_value_t = 0.01, allow_negative_numbers = true)]
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

/// Rows of a simulation at most: a mistake in `--every-s` should not fill the disk. Chosen.
const OUTPUT_ROWS_MAX: f64 = 1e7;

/// Carries out `rig simulate`.
///
/// # Errors
/// [`Failure::Input`] for a model, command or option that does not fit, [`Failure::Data`] when the motion diverges.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let read = [Some(&args.model), args.servo.as_ref(), args.base.as_ref()];
    let out = Outputs::reading(read.into_iter().flatten().cloned()).file(&args.out)?;
    let model = app::read_model(&args.model)?;
    let mut state = model.rest_state();
    replace("--qpos", &mut state.qpos, args.qpos.as_deref(), &model, JointKind::nq)?;
    replace("--qvel", &mut state.qvel, args.qvel.as_deref(), &model, JointKind::nv)?;
    let command = match &args.servo {
        Some(path) => ident::table::read_command(path).map_err(Failure::input)?,
        None => Command::default(),
    };
    let base = args.base.as_deref().map(ident::table::read_base).transpose().map_err(Failure::input)?;
    if let Some(&last_s) = base.as_ref().and_then(|base| base.time_s().last())
        && last_s < args.duration_s
    {
        return Err(Failure::Input(anyhow!(
            "the base's path ends at {last_s} s, before --duration-s {}; add rows, or simulate for less",
            args.duration_s
        )));
    }
    let options = RolloutOptions {
        integrator: args.integrator.map(Integrator::from),
        timestep_s: args.timestep_s,
        hold_command: args.hold_command,
        prescribed: args.prescribed,
        base: base.map(Arc::new),
        start_s: 0.0,
        steps: None,
    };
    let times = sample_times(args)?;
    let base = options.base.clone();
    let simulated = match args.accuracy_m {
        Some(accuracy_m) if !(accuracy_m.is_finite() && accuracy_m > 0.0) => {
            return Err(Failure::Input(anyhow!(
                "--accuracy-m is {accuracy_m}: it must be finite and above 0"
            )));
        }
        Some(accuracy_m) => {
            sim::plan(&model, &state, &command, &times, &options, accuracy_m).and_then(|plan| {
                let (method, steps, error_m) = (plan.steps.method, plan.steps.ends_s.len(), plan.error_m);
                tracing::info!(?method, steps, error_m, "planned");
                rollout(
                    &model,
                    &state,
                    &command,
                    &times,
                    &RolloutOptions { steps: Some(plan.steps), ..options },
                )
            })
        }
        None => rollout(&model, &state, &command, &times, &options),
    };
    let run = simulated.map_err(|error| match error {
        RolloutError::UnknownActuator { .. } => {
            let servo = args.servo.as_deref().unwrap_or(&args.model);
            Failure::Input(anyhow!(error).context(format!("commands of {}", servo.display())))
        }
        _ => Failure::from(error),
    })?;
    if let Some(touch) = ContactWatch::unsimulated(&model).and_then(|mut watch| watch.first_touch(&run)) {
        tracing::warn!("{}", FirstTouch::from(touch));
    }
    out.write(table(&model, &run, base.as_deref()).as_bytes()).map_err(Failure::input)?;
    let text = format!("{}\n", args.out.display());
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

/// Replaces the numbers of a state by those of `option`, one per coordinate of each joint.
fn replace(
    option: &str,
    state: &mut Vec<f64>,
    wanted: Option<&[f64]>,
    model: &Model,
    size: fn(JointKind) -> usize,
) -> Result<(), Failure> {
    let Some(wanted) = wanted else { return Ok(()) };
    if let Some(value) = wanted.iter().find(|value| !value.is_finite()) {
        return Err(Failure::Input(anyhow!("{option}: {value} is not a finite number")));
    }
    if wanted.len() != state.len() {
        let joints: Vec<String> =
            model.joints.iter().map(|joint| format!("{} ({})", joint.name, size(joint.kind))).collect();
        return Err(Failure::Input(anyhow!(
            "{option} gives {} numbers, the model has {}: {}; give one for each",
            wanted.len(),
            state.len(),
            joints.join(", ")
        )));
    }
    *state = wanted.to_vec();
    Ok(())
}

fn sample_times(args: &Args) -> Result<Vec<f64>, Failure> {
    let timestep_s = args.timestep_s.unwrap_or(args.every_s);
    for (option, value) in
        [("--duration-s", args.duration_s), ("--every-s", args.every_s), ("--timestep-s", timestep_s)]
    {
        if !(value.is_finite() && value > 0.0) {
            return Err(Failure::Input(anyhow!("{option} {value} must be finite and above 0")));
        }
    }
    // the last row is at the duration, where that is a whole number of rows but for rounding
    let rows = (args.duration_s / args.every_s + 1e-6).floor();
    if rows > OUTPUT_ROWS_MAX {
        return Err(Failure::Input(anyhow!(
            "{rows} rows exceed the limit of {OUTPUT_ROWS_MAX}; raise --every-s"
        )));
    }
    Ok((0..=rows as u64).map(|row| row as f64 * args.every_s).collect())
}

/// The rows as CSV: time, coordinates, velocities, every site, all of one instant. Where the model carries causes in the
/// camera, keypoints are where it sees them.
fn table(model: &Model, run: &Rollout<f64>, base: Option<&BasePath>) -> String {
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
    let filmed = model.causes().iter().any(|carried| carried.cause().info().kind == Kind::Camera);
    let keypoints = if filmed { model.keypoint_sites() } else { Vec::new() };
    for (instant, time_s) in run.time_s.iter().enumerate() {
        let qpos = &run.qpos[instant * nq..(instant + 1) * nq];
        let qvel = &run.qvel[instant * nv..(instant + 1) * nv];
        // nine decimals of a second hide that k * 0.01 is not quite what it says
        let _ = write!(out, "{}", (time_s * 1e9).round() / 1e9);
        let mut sites = model.poses(qpos).site_pos;
        if let Some(base) = base.map(|base| base.at(*time_s)) {
            for site in &mut sites {
                *site = Vec3(base.place(site.0));
            }
        }
        for (keypoint, &site) in keypoints.iter().enumerate() {
            sites[site] = Vec3(run.position_m[instant * keypoints.len() + keypoint]);
        }
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
            base: None,
            duration_s: 0.1,
            timestep_s: None,
            integrator: None,
            accuracy_m: None,
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

    /// MuJoCo's own runs, next door in `sim`.
    fn golden(file: &str) -> PathBuf {
        [env!("CARGO_MANIFEST_DIR"), "..", "sim", "tests", "data", file].iter().collect()
    }

    fn columns(path: &std::path::Path) -> (Vec<String>, Vec<Vec<f64>>) {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let head =
            lines.next().unwrap().split(',').map(|name| name.trim_end_matches("_m").to_owned()).collect();
        (head, lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect())
    }

    #[test]
    fn chains_move_as_in_mujoco_over_the_whole_file() {
        // rounding grows in a swinging chain, here to 1e-14
        const SITE_M: f64 = 1e-10;
        let folder = tempfile::tempdir().unwrap();
        // the 2:1 stroke's corners: 0.6 rad at 0.5 s, -0.6 at 1 s, 0.6 at 2 s, ...
        let angle = |k: u32| match k % 3 {
            0 => "0",
            1 => "0.6",
            _ => "-0.6",
        };
        let rows: String = (0..=21).map(|k| format!("{},{}\n", 0.5 * f64::from(k), angle(k))).collect();
        std::fs::write(folder.path().join("servo.csv"), format!("time_s,servo_rad\n{rows}")).unwrap();
        let quarter = "1.570796326795".parse().unwrap();
        for (model, file, qpos, servo) in [
            ("chain_passive", "chain_passive_horizontal_euler.csv", vec![quarter, 0.0, 0.0], false),
            ("chain_passive", "chain_passive_right_angle_euler.csv", vec![quarter, -quarter, 0.0], false),
            ("chain_active", "chain_active_euler.csv", vec![0.0; 3], true),
        ] {
            let args = Args {
                model: golden(&format!("{model}.xml")),
                qpos: Some(qpos),
                servo: servo.then(|| folder.path().join("servo.csv")),
                duration_s: 10.0,
                ..args(folder.path(), PENDULUM)
            };
            run(&args).unwrap();
            let ((names, ours), (wanted, theirs)) = (columns(&args.out), columns(&golden(file)));
            assert_eq!(names[1..], wanted[1..]);
            // the golden file has every step of the first 0.1 s, then every 20 ms as ours
            let at = |time_s: f64| theirs.iter().find(|row| (row[0] - time_s).abs() < 1e-9).unwrap();
            let sites = wanted.iter().position(|name| name == "P1_x").unwrap();
            let differences = ours
                .iter()
                .flat_map(|row| row[sites..].iter().zip(&at(row[0])[sites..]).map(|(a, b)| (a - b).abs()));
            let worst = differences.fold(0.0, f64::max);
            println!("{file}: worst site coordinate {worst:.1e} m off over {} rows", ours.len());
            assert!(worst < SITE_M && ours.len() == 501, "{file}: {worst:e}");
        }
    }

    #[test]
    fn keypoints_are_where_a_camera_with_causes_sees_them() {
        let folder = tempfile::tempdir().unwrap();
        let turned = "<custom><numeric name=\"camera_rotation/angle\" data=\"0.1\"/></custom></mujoco>";
        let rows = |model: &str| -> Vec<Vec<f64>> {
            let args = args(folder.path(), model);
            run(&args).unwrap();
            let text = std::fs::read_to_string(&args.out).unwrap();
            text.lines()
                .skip(1)
                .map(|row| row.split(',').map(|cell| cell.parse().unwrap()).collect())
                .collect()
        };
        let (plain, seen) = (rows(PENDULUM), rows(&PENDULUM.replace("</mujoco>", turned)));
        assert_eq!(plain.len(), seen.len());
        for (plain, seen) in plain.iter().zip(&seen) {
            let ([.., x, _, z], [.., seen_x, _, seen_z]) = (&plain[..], &seen[..]) else { panic!() };
            assert_eq!(plain[..3], seen[..3], "the motion is the same");
            // Turned by 0.1 rad about the world's origin, the pendulum's hinge, whichever way: the same length, not the same place.
            assert!((x.hypot(*z) - seen_x.hypot(*seen_z)).abs() < 1e-9, "{plain:?} {seen:?}");
            let between = (x * seen_x + z * seen_z) / (x.hypot(*z) * seen_x.hypot(*seen_z));
            assert!((between.acos() - 0.1).abs() < 1e-6, "{between}");
        }
    }
}
