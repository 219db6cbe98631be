//! Commands on their way to the drives.

use super::*;
use crate::causes::{CommandPath, Following};
use crate::scalar::Scalar;

/// What the servo of the driven chain gets, by `law` in tiny steps from the state at rest.
fn stepped(command: &Command, end_s: f64, mut law: impl FnMut(f64, f64, f64) -> f64) -> f64 {
    const STEPS: u32 = 400_000;
    let h = end_s / f64::from(STEPS);
    (1..=STEPS).fold(command.at(0, 0.0), |y, step| law(y, command.at(0, f64::from(step) * h), h))
}

/// One link with a drive of the given law on its hinge.
fn driven_link(drive: &str) -> Model {
    let text = format!(
        r#"<mujoco><compiler angle="radian"/><worldbody><body><joint name="q" axis="0 -1 0"/>
        <geom type="box" size="0.005 0.003 0.015" density="1200"/></body></worldbody>
        <actuator>{drive}</actuator></mujoco>"#
    );
    Model::from_mjcf(&text).unwrap()
}

/// What the drive exerts on its link at `q` and `w` where the command is `told`.
fn exerted(drive: &str, values: &[(&str, f64)], [q, w, told]: [f64; 3]) -> f64 {
    let model = with(&driven_link(drive), values);
    let state = State { qpos: vec![q], qvel: vec![w] };
    Simulator::new(&model, &RolloutOptions::default()).unwrap().forces(&state, &[told]).actuator[0]
}

#[test]
fn a_motor_and_its_gear_exert_their_closed_forms() {
    let servo = r#"<position name="servo" joint="q" kp="2" kv="0.01"/>"#;
    let ceiling = [("back_emf/stall", 0.5), ("back_emf/braking", 0.04)];
    // within its supply, and held back by it to either side
    assert_close(
        exerted(servo, &ceiling, [0.1, 3.0, 0.2]),
        2.0 * 0.1 - 0.01 * 3.0 - 0.04 * 3.0,
        1e-12,
        "told little",
    );
    assert_close(exerted(servo, &ceiling, [0.1, 3.0, 1.2]), 0.5 - 0.04 * 3.0, 1e-12, "told much");
    assert_close(exerted(servo, &ceiling, [0.1, -3.0, -1.2]), -0.5 + 0.04 * 3.0, 1e-12, "told much less");
    // a supply that gives way: told half of the stall torque, a quarter of a third of it is lost, and of the braking too
    let soft = [("back_emf/stall", 0.5), ("back_emf/braking", 0.04), ("back_emf/supply", 1.0 / 3.0)];
    let given = 1.0 / (1.0 + 0.25 / 3.0);
    let expected = (0.25 - 0.04 * 3.0) * given;
    // 0.25 N m by the angle beside what the servo's own damping takes
    assert_close(exerted(servo, &soft, [0.1, 3.0, 0.24]), expected, 1e-12, "soft supply");
    // a duty cycle: gain times command, at most the stall torque
    let motor = r#"<motor name="motor" joint="q" gear="0.5"/>"#;
    let braking = [("back_emf/braking", 0.04)];
    assert_close(exerted(motor, &braking, [0.0, 2.0, 0.6]), 0.3 - 0.04 * 2.0, 1e-12, "duty");

    let band = [("dead_band/half_width", 0.03)];
    assert_eq!(exerted(servo, &band, [0.1, 0.0, 0.12]), 0.0);
    assert_close(exerted(servo, &band, [0.1, 0.0, 0.2]), 2.0 * 0.07, 1e-12, "beyond the dead band");
    assert_close(exerted(servo, &band, [0.1, 0.0, 0.0]), -2.0 * 0.07, 1e-12, "beyond it to the other side");
    assert_close(exerted(motor, &[("drive_offset/motor", 0.02)], [0.1, 0.0, 0.1]), 0.07, 1e-12, "offset");
    // a servo that pushed beside its command would hold another angle, which is joint_zero's
    let mut held = driven_link(servo);
    held.add_cause("drive_offset").unwrap();
    assert!(held.causes()[0].names().is_empty());

    // 2 N m/rad times 0.1 rad, of which the gear takes a tenth upwards and gives back a fifth less downwards
    let gear = [("gear_friction/driving", 0.1), ("gear_friction/driven", 0.2), ("gear_friction/rate", 0.4)];
    let plain = r#"<position name="servo" joint="q" kp="2"/>"#;
    let turned = |w: f64| w / w.hypot(0.4);
    assert_close(exerted(plain, &gear, [0.0, 3.0, 0.1]), 0.2 - 0.1 * 0.2 * turned(3.0), 1e-12, "driving");
    assert_close(exerted(plain, &gear, [0.0, -3.0, 0.1]), 0.2 + 0.2 * 0.2 * turned(3.0), 1e-12, "driven");
}

#[test]
fn a_loop_of_second_order_obeys_its_equation_and_overshoots_as_it_must() {
    let command = zigzag();
    for (time, ratio) in [(0.03, 0.2), (0.02, 0.7), (0.02, 1.0), (0.02, 1.0 + 1e-9), (0.01, 1.7)] {
        let values = [("servo_loop/time", time), ("servo_loop/damping_ratio", ratio)];
        let path = CommandPath::new(&with(&chain("active"), &values), &command);
        for time_s in [0.02, 0.13, 0.22, 0.37, 0.51, 0.7, 1.2] {
            let mut rate = 0.0;
            let expected = stepped(&command, time_s, |y, u, h| {
                rate += ((u - y) / (time * time) - 2.0 * ratio / time * rate) * h;
                y + rate * h
            });
            let ours = path.at(0, time_s);
            assert!((ours - expected).abs() < 1e-4, "{time} s, {ratio}, at {time_s} s: {ours} {expected}");
        }
    }
    // a step, as rows at one time: half a period later it is beyond its end by exp(-pi z / sqrt(1 - z^2))
    let step = Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.0, 0.5, 0.5],
        angle_rad: vec![0.0, 0.0, 1.0],
    };
    let (time, ratio) = (0.02_f64, 0.3_f64);
    let values = [("servo_loop/time", time), ("servo_loop/damping_ratio", ratio)];
    let path = CommandPath::new(&with(&chain("active"), &values), &step);
    let root = (1.0 - ratio * ratio).sqrt();
    let peak = 1.0 + (-std::f64::consts::PI * ratio / root).exp();
    assert_close(path.at(0, 0.5 + std::f64::consts::PI * time / root), peak, 1e-9, "overshoot");
    assert_eq!(path.at(0, 0.5), 0.0);
}

#[test]
fn held_steps_are_answered_in_closed_form() {
    // rows at one time: from 0.1 s on 0.4, from 0.15 s on 0.2
    let steps = Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.0, 0.1, 0.1, 0.15, 0.15, 0.3],
        angle_rad: vec![0.0, 0.0, 0.4, 0.4, 0.2, 0.2],
    };
    let plain = CommandPath::new(&chain("active"), &steps);
    assert_eq!([0.05, 0.1, 0.1499, 0.15, 0.9].map(|t| plain.at(0, t)), [0.0, 0.4, 0.4, 0.2, 0.2]);
    assert_eq!([0.05, 0.1, 0.1499, 0.15, 0.9].map(|t| steps.at(0, t)), [0.0, 0.4, 0.4, 0.2, 0.2]);
    let lag = 0.02_f64;
    let answer = |t: f64| {
        let up = if t > 0.1 { 1.0 - (-(t - 0.1) / lag).exp() } else { 0.0 };
        let down = if t > 0.15 { 1.0 - (-(t - 0.15) / lag).exp() } else { 0.0 };
        0.4 * up - 0.2 * down
    };
    for delay in [0.0, 0.0137] {
        let values = [("servo_lag/time", lag), ("servo_delay/delay", delay)];
        let path = CommandPath::new(&with(&chain("active"), &values), &steps);
        for t in [0.05, 0.1, 0.11, 0.15, 0.1637, 0.17, 0.29, 0.3, 0.5] {
            assert!((path.at(0, t) - answer(t - delay)).abs() < 1e-14, "{t} s");
        }
        // by its delay it changes as it moves, the other way
        let mut lifted = with(&chain("active"), &values).map(crate::dual::Dual::<f64, 1>::from_f64);
        lifted.set_parameter("servo_delay/delay", crate::dual::Dual::variable(delay, 0)).unwrap();
        let slope = CommandPath::new(&lifted, &steps).at(0, 0.17).partials[0];
        let rate = (answer(0.17 - delay + 1e-6) - answer(0.17 - delay - 1e-6)) / 2e-6;
        assert!((slope + rate).abs() < 1e-6 * rate.abs(), "{slope} {rate}");
    }
}

/// Rows at uneven times, two of them alike.
fn zigzag() -> Command {
    Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.05, 0.2, 0.31, 0.5, 0.52, 0.9],
        angle_rad: vec![0.1, 0.5, -0.3, 0.4, 0.4, 0.0],
    }
}

#[test]
fn drives_obey_their_laws_on_any_command() {
    let command = zigzag();
    let model = chain("active");
    let path = |values: &[(&str, f64)]| CommandPath::new(&with(&model, values), &command);
    let limited = path(&[("servo_rate_limit/share", 1.0), ("servo_rate_limit/rate", 3.0)]);
    let lagging = path(&[("servo_lag/time", 0.03)]);
    // what sags bends between rows, which the limit behind takes as straight: by 1e-5 rad where rows are 10 ms apart
    let rows: Vec<f64> = (5..=130).map(|k| 0.01 * f64::from(k)).collect();
    let angle_rad = rows.iter().map(|&t| command.at(0, t)).collect();
    let dense = Command { time_s: rows, angle_rad, ..command.clone() };
    let sagging = [("servo_sag/rate", 0.2), ("servo_rate_limit/share", 1.0), ("servo_rate_limit/rate", 3.0)];
    let sagging = CommandPath::new(&with(&model, &sagging), &dense);
    let loose = path(&[("backlash/half_width", 0.05)]);
    let all = path(&[
        ("servo_rate_limit/share", 1.0),
        ("servo_rate_limit/rate", 3.0),
        ("servo_lag/time", 0.03),
        ("servo_gain/scale", 0.1),
        ("servo_delay/delay", 0.04),
    ]);
    let limit = |y: f64, u: f64, h: f64| y + (u - y).clamp(-3.0 * h, 3.0 * h);
    let lag = |y: f64, u: f64, h: f64| y + (u - y) * h / 0.03;
    for time_s in [0.02, 0.13, 0.22, 0.3, 0.37, 0.48, 0.51, 0.7, 1.2] {
        let cases = [
            ("rate", limited.at(0, time_s), stepped(&command, time_s, limit)),
            ("lag", lagging.at(0, time_s), stepped(&command, time_s, lag)),
            ("play", loose.at(0, time_s), stepped(&command, time_s, |y, u, _| y.clamp(u - 0.05, u + 0.05))),
        ];
        for (what, ours, expected) in cases {
            // first order in steps of some microseconds
            assert!((ours - expected).abs() < 1e-4, "{what} at {time_s} s: {ours} {expected}");
        }
        let mut now = 0.0;
        let sagged = stepped(&command, time_s, |y, u, h| {
            now += h;
            limit(y, (1.0 - 0.2 * now) * u, h)
        });
        // before its first row a command stands still, and with it what has become of it
        assert!(time_s < 0.05 || (sagging.at(0, time_s) - sagged).abs() < 1e-4, "sag at {time_s} s");
        let alone = path(&[("servo_sag/rate", 0.2)]).at(0, time_s);
        assert!((alone - (1.0 - 0.2 * time_s.max(0.05)) * command.at(0, time_s)).abs() < 1e-12, "{time_s} s");
        let mut limited = 1.1 * command.at(0, 0.0);
        let expected = if time_s < 0.04 {
            limited
        } else {
            let scaled =
                Command { angle_rad: command.angle_rad.iter().map(|a| 1.1 * a).collect(), ..command.clone() };
            stepped(&scaled, time_s - 0.04, |y, u, h| {
                limited = limit(limited, u, h);
                lag(y, limited, h)
            })
        };
        assert!((all.at(0, time_s) - expected).abs() < 1e-4, "all at {time_s} s");
    }
    // rows that come in one by one make the same path
    let first = Command { time_s: vec![0.05], angle_rad: vec![0.1], ..command.clone() };
    let mut growing = CommandPath::new(&with(&model, &[("servo_lag/time", 0.03)]), &first);
    for (&time_s, &angle) in command.time_s.iter().zip(&command.angle_rad).skip(1) {
        growing.push(time_s, &[angle]);
    }
    assert_eq!(growing.at(0, 0.7), lagging.at(0, 0.7));
}

#[test]
fn a_servo_that_looks_now_and_then_goes_in_steps() {
    let command = zigzag();
    let (period, first, turn) = (0.021, 0.3, 0.004);
    let values = [("share", 1.0), ("period", period), ("first", first), ("turn", turn)];
    let values = values.map(|(name, value)| (format!("servo_refresh/{name}"), value));
    let values: Vec<(&str, f64)> = values.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let path = CommandPath::new(&with(&chain("active"), &values), &command);
    let seen = |k: f64| command.at(0, (k + first) * period);
    for k in 3..50 {
        let k = f64::from(k);
        // half the way while it turns, there when it has turned, there still before the next look
        for (after_s, part) in [(0.5 * turn, 0.5), (turn, 1.0), (period - 1e-6, 1.0)] {
            let expected = seen(k - 1.0) + part * (seen(k) - seen(k - 1.0));
            let ours = path.at(0, (k + first) * period + after_s);
            assert!((ours - expected).abs() < 1e-12, "{after_s} s after look {k}: {ours} {expected}");
        }
    }
    // rows that come in one by one make the same path
    let row = |k: usize| Command {
        time_s: vec![command.time_s[k]],
        angle_rad: vec![command.angle_rad[k]],
        ..command.clone()
    };
    let mut growing = CommandPath::new(&with(&chain("active"), &values), &row(0));
    (1..6).for_each(|k| growing.push(command.time_s[k], &row(k).angle_rad));
    assert_eq!(growing.at(0, 0.7), path.at(0, 0.7));
}

#[test]
fn how_a_drive_followed_says_when_it_looks() {
    let time_s: Vec<f64> = (0..300).map(|k| 0.01 * f64::from(k)).collect();
    let swung = |t: f64| 0.8 * (5.0 * t).sin();
    let command = Command {
        actuators: vec!["servo".into()],
        angle_rad: time_s.iter().map(|&t| swung(t)).collect(),
        time_s: time_s.clone(),
    };
    // periods beside the images' own, twice as many looks as images among them
    for (period, first) in [(0.0231, 0.4), (0.0173, 0.9), (0.0121, 0.1), (0.0062, 0.6)] {
        let ahead_rad = time_s
            .iter()
            .map(|&t| {
                let look = ((t / period - first).floor() + first) * period;
                let [before, seen] = [look - period, look].map(|look| command.at(0, look));
                // three fifths of the time it turns, as a motor does
                let way = ((t - look) / (0.6 * period)).min(1.0);
                let turned = before + way * way * (3.0 - 2.0 * way) * (seen - before);
                // an offset, lateness, and noise that no period explains
                let late = command.at(0, t - 0.005) - command.at(0, t);
                turned - command.at(0, t) + late + 0.01 + 2e-3 * (1e4 * t * t).sin()
            })
            .collect();
        let following = Following {
            command: std::borrow::Cow::Borrowed(&command),
            column: 0,
            time_s: time_s.clone(),
            ahead_rad,
        };
        let start = "servo_refresh".parse::<Cause>().unwrap().start(&[following]);
        let [("period", found), ("first", at), ("turn", _)] = start[..] else { panic!("{start:?}") };
        // to an eighth of a period at the end
        assert!((found / period - 1.0).abs() * 3.0 / period < 0.125, "{period}: {found}");
        let apart = (at - first - (at - first).round()).abs();
        assert!(apart < 0.15, "{period}: {at}, {first}");
    }
}
