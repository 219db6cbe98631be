//! Commands on their way to the drives.

use super::*;
use crate::causes::CommandPath;

/// What the servo of the driven chain gets, by `law` in tiny steps from the state at rest.
fn stepped(command: &Command, end_s: f64, mut law: impl FnMut(f64, f64, f64) -> f64) -> f64 {
    const STEPS: u32 = 400_000;
    let h = end_s / f64::from(STEPS);
    (1..=STEPS).fold(command.at(0, 0.0), |y, step| law(y, command.at(0, f64::from(step) * h), h))
}

#[test]
fn drives_obey_their_laws_on_any_command() {
    let command = Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.05, 0.2, 0.31, 0.5, 0.52, 0.9],
        angle_rad: vec![0.1, 0.5, -0.3, 0.4, 0.4, 0.0],
    };
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
