//! Drives with motors and gears, from what servos tell of themselves: data of a generator with a motor's equations of its own.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use ident::experiment::Experiment;
use ident::fit::fit;

/// What the generator turns: a bar with a weight, and how its drive is (chosen, about those of a small bus servo).
const TURNED_INERTIA_KG_M2: f64 = 5e-3;
const WEIGHT_TORQUE_NM: f64 = 0.48;
const BRAKING_NM_S: f64 = 0.03;
const FRICTION_TORQUE_NM: f64 = 0.02;
const FRICTION_RATE_RAD_S: f64 = 0.05;
const DRIVING_FRICTION_SHARE: f64 = 0.1;
const DRIVEN_FRICTION_SHARE: f64 = 0.6;
/// A gear that locks itself, and the rate over which its friction turns round.
const LOCKING_FRICTION_SHARE: f64 = 3.0;
const LOCKING_RATE_RAD_S: f64 = 0.01;
const STEP_S: f64 = 2e-5;

const MODEL: &str = r#"<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody><body name="arm">
  <joint name="horn" axis="0 -1 0"/><inertial pos="0 0 -0.1" mass="0.489297" diaginertia="1.07e-4 1.07e-4 1.07e-4"/>
  <site name="P1" pos="0 0 -0.1"/></body></worldbody>
  <actuator>DRIVE</actuator></mujoco>"#;

/// Angles of the joint every 5 ms to the steps of an encoder with 4096 a turn, where the motor exerts `push` at time, angle and
/// whether it is on is what `is_on` says.
fn recorded(end_s: f64, push: impl Fn(f64, f64) -> f64, is_on: impl Fn(f64) -> bool) -> Vec<(f64, f64)> {
    let steps_of_encoder = |q: f64| (q * 4096.0 / TAU).round() * TAU / 4096.0;
    turned(end_s, [DRIVEN_FRICTION_SHARE, FRICTION_RATE_RAD_S], push, is_on, steps_of_encoder)
}

/// The same as `read` from the angle, with a gear that rubs by the share `driven` where the weight turns it, over `rate_rad_s`.
fn turned(
    end_s: f64,
    [driven, rate_rad_s]: [f64; 2],
    push: impl Fn(f64, f64) -> f64,
    is_on: impl Fn(f64) -> bool,
    mut read: impl FnMut(f64) -> f64,
) -> Vec<(f64, f64)> {
    let (mut q, mut v) = (0.0_f64, 0.0_f64);
    let mut rows = Vec::new();
    for step in 0..=(end_s / STEP_S) as usize {
        let t = step as f64 * STEP_S;
        if step % 250 == 0 {
            rows.push((t, read(q)));
        }
        let on = f64::from(u8::from(is_on(t)));
        let motor = on * (push(t, q) - BRAKING_NM_S * v);
        let share = if motor * v > 0.0 { DRIVING_FRICTION_SHARE } else { driven };
        let rubs = (FRICTION_TORQUE_NM + share * motor.abs()) * v / v.hypot(rate_rad_s);
        v += STEP_S / TURNED_INERTIA_KG_M2 * (motor - rubs - WEIGHT_TORQUE_NM * q.sin());
        q += STEP_S * v;
    }
    rows
}

/// Goals of a servo, new every 20 ms.
fn goal(t: f64) -> f64 {
    let t = (t / 0.02).floor() * 0.02;
    if t < 0.1 { 0.0 } else { 0.9 * (3.0 * (t - 0.1)).sin() + 0.4 * (7.0 * (t - 0.1)).sin() }
}

/// A servo table in steps, with what the servo measured.
fn table(rows: &[(f64, f64)], told: impl Fn(f64) -> f64, unit: &str, is_on: impl Fn(f64) -> bool) -> String {
    let mut text = format!("# hold = steps\ntime_s,servo_{unit},servo_on,servo_measured_rad\n");
    for &(t, q) in rows {
        // the commands are new where the rows are, a hair before by the clock
        writeln!(text, "{t},{},{},{q}", told(t + 1e-9), u8::from(is_on(t + 1e-9))).unwrap();
    }
    text
}

fn experiment(drive: &str, runs: &[(&str, String)], fit: &str) -> Experiment {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.xml"), MODEL.replace("DRIVE", drive)).unwrap();
    let mut text = format!("model = \"arm.xml\"\nnoise_m = 6e-5\n[fit]\nmethod = \"least-squares\"\n{fit}\n");
    for (place, (keys, table)) in runs.iter().enumerate() {
        std::fs::write(folder.path().join(format!("{place}.csv")), table).unwrap();
        write!(text, "[[run]]\nid = \"{place}\"\nkind = \"driven\"\nservo = \"{place}.csv\"\n{keys}\n")
            .unwrap();
    }
    let path = folder.path().join("e.toml");
    std::fs::write(&path, text).unwrap();
    Experiment::read(&path).unwrap()
}

#[test]
fn gain_braking_and_gear_come_out_of_two_gains_and_a_fall() {
    let is_on = |t: f64| t < 2.5;
    let run = |gain: f64| {
        let rows = recorded(4.0, |t, q| gain * 0.2 * (goal(t) - q), is_on);
        (format!("times = {{ \"servo/gain\" = {gain} }}"), table(&rows, goal, "rad", is_on))
    };
    let runs = [run(1.0), run(4.0)];
    let runs: Vec<(&str, String)> = runs.iter().map(|(keys, table)| (keys.as_str(), table.clone())).collect();
    let drive = r#"<position name="servo" joint="horn" kp="0.3"/>"#;
    let parameters = r#"parameters = ["servo/gain", "back_emf/braking", "coulomb_friction/torque", "gear_friction/driving", "gear_friction/driven"]
        fixed = ["gear_friction/rate"]
        [fit.bounds]
        "coulomb_friction/torque" = [0.0, 0.2]
        "back_emf/braking" = [0.0, 0.5]"#;
    let mut experiment = experiment(drive, &runs, parameters);
    experiment.model.set_parameter("gear_friction/rate", FRICTION_RATE_RAD_S).unwrap();
    let fitted = fit(&experiment, &mut ()).unwrap().fit;
    for (name, truth, off) in [
        ("servo/gain", 0.2, 0.002),
        ("back_emf/braking", BRAKING_NM_S, 0.002),
        ("coulomb_friction/torque", FRICTION_TORQUE_NM, 0.002),
        ("gear_friction/driving", DRIVING_FRICTION_SHARE, 0.02),
        ("gear_friction/driven", DRIVEN_FRICTION_SHARE, 0.05),
    ] {
        let found = fitted.parameters.iter().find(|parameter| parameter.name == name).unwrap();
        assert!((found.value - truth).abs() < off, "{name}: {} +- {}, {truth}", found.value, found.std);
    }
    // the steps of the encoder, as a pointer's way, and no more
    let floor_m = 0.125 * TAU / 4096.0 / 12_f64.sqrt();
    let error_m = fitted.runs.iter().map(|run| run.keypoints[0].rms_error_m).fold(0.0, f64::max);
    assert!(error_m < 2.0 * floor_m, "{error_m:e} {floor_m:e}");
}

/// Explicit steps chatter where the gear locks, and derivatives with them: the intervals that follow used to be off by up to seventy of themselves.
#[test]
fn intervals_hold_where_the_gear_locks() {
    /// Standard deviation of the angles \[rad\], as an encoder's of 4096 a turn (chosen).
    const ANGLE_STD_RAD: f64 = 5e-4;
    let is_on = |t: f64| t < 2.5;
    let run = |gain: f64| {
        let mut state = gain.to_bits();
        // evenly distributed, of a generator of one line
        let noisy = |q: f64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            q + ANGLE_STD_RAD * 12_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
        };
        let gear = [LOCKING_FRICTION_SHARE, LOCKING_RATE_RAD_S];
        let rows = turned(4.0, gear, |t, q| gain * 0.2 * (goal(t) - q), is_on, noisy);
        (format!("times = {{ \"servo/gain\" = {gain} }}"), table(&rows, goal, "rad", is_on))
    };
    let runs = [run(1.0), run(4.0)];
    let runs: Vec<(&str, String)> = runs.iter().map(|(keys, table)| (keys.as_str(), table.clone())).collect();
    let drive = r#"<position name="servo" joint="horn" kp="0.3"/>"#;
    let parameters = r#"parameters = ["servo/gain", "back_emf/braking", "coulomb_friction/torque", "gear_friction/driving", "gear_friction/driven"]
        fixed = ["gear_friction/rate", "coulomb_friction/rate"]
        [fit.bounds]
        "coulomb_friction/torque" = [0.0, 0.2]
        "back_emf/braking" = [0.0, 0.5]"#;
    let mut experiment = experiment(drive, &runs, parameters);
    experiment.model.set_parameter("gear_friction/rate", LOCKING_RATE_RAD_S).unwrap();
    experiment.model.set_parameter("coulomb_friction/rate", LOCKING_RATE_RAD_S).unwrap();
    let fitted = fit(&experiment, &mut ()).unwrap().fit;
    for (name, truth) in [
        ("servo/gain", 0.2),
        ("back_emf/braking", BRAKING_NM_S),
        ("coulomb_friction/torque", FRICTION_TORQUE_NM),
        ("gear_friction/driving", DRIVING_FRICTION_SHARE),
        ("gear_friction/driven", LOCKING_FRICTION_SHARE),
    ] {
        let found = fitted.parameters.iter().find(|parameter| parameter.name == name).unwrap();
        println!("{name}: {} +- {}, {truth}", found.value, found.std);
        assert!((found.value - truth).abs() < 4.0 * found.std, "{name}: {} +- {}", found.value, found.std);
    }
}

#[test]
fn a_motor_is_driven_by_its_duty_cycle() {
    let duty = |t: f64| {
        let t = (t / 0.02).floor() * 0.02;
        if t < 0.1 { 0.0 } else { 0.5 * (4.0 * (t - 0.1)).sin() }
    };
    let rows = recorded(4.0, |t, _| 0.7 * duty(t), |_| true);
    let runs = [("", table(&rows, duty, "duty", |_| true))];
    let drive = r#"<motor name="servo" joint="horn" gear="0.5"/>"#;
    let parameters = r#"parameters = ["servo/gain", "coulomb_friction/torque"]
        fixed = ["gear_friction/driving", "gear_friction/driven", "gear_friction/rate", "back_emf/braking"]
        [fit.bounds]
        "coulomb_friction/torque" = [0.0, 0.2]"#;
    let mut experiment = experiment(drive, &runs, parameters);
    for (name, value) in [
        ("gear_friction/rate", FRICTION_RATE_RAD_S),
        ("gear_friction/driving", DRIVING_FRICTION_SHARE),
        ("gear_friction/driven", DRIVEN_FRICTION_SHARE),
        ("back_emf/braking", BRAKING_NM_S),
    ] {
        experiment.model.set_parameter(name, value).unwrap();
    }
    let fitted = fit(&experiment, &mut ()).unwrap().fit;
    let value = |name: &str| fitted.parameters.iter().find(|parameter| parameter.name == name).unwrap().value;
    assert!((value("servo/gain") - 0.7).abs() < 0.005, "{}", value("servo/gain"));
    assert!((value("coulomb_friction/torque") - FRICTION_TORQUE_NM).abs() < 0.002);
}

#[test]
fn what_drives_wrongly_is_refused_with_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |table: &str, keys: &str| {
        std::fs::write(
            folder.path().join("arm.xml"),
            MODEL.replace("DRIVE", r#"<position name="servo" joint="horn" kp="0.3"/>"#),
        )
        .unwrap();
        std::fs::write(folder.path().join("0.csv"), table).unwrap();
        let text = format!(
            "model = \"arm.xml\"\n{keys}\n[[run]]\nid = \"a\"\nkind = \"driven\"\nservo = \"0.csv\"\n"
        );
        let path = folder.path().join("e.toml");
        std::fs::write(&path, text).unwrap();
        format!("{:?}", Experiment::read(&path).unwrap_err())
    };
    let rows = "0,0,1,0\n0.1,0,1,0\n0.2,1,0,0.1\n0.3,1,1,0.2\n";
    let torques = refusal(&format!("time_s,servo_Nm,servo_on,servo_measured_rad\n{rows}"), "");
    assert!(torques.contains("pushes `servo` in Nm") && torques.contains("<motor>"), "{torques}");
    let idle = refusal(&format!("time_s,servo_rad,servo_on,servo_measured_rad\n{rows}"), "prescribed = true");
    assert!(idle.contains("the servo is idle at times"), "{idle}");
    let unseen = refusal("time_s,servo_rad\n0,0\n0.1,0\n0.3,1\n", "");
    assert!(unseen.contains("`trajectory` is missing"), "{unseen}");
}
