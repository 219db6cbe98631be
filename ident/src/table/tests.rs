use std::path::Path;

use proptest::prelude::*;
use sim::{Command, Trajectory};

use super::*;

fn trajectory(text: &str) -> Result<Trajectory, String> {
    parse_trajectory(text, Path::new("t.csv")).map_err(|error| error.to_string())
}

fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan())
}

fn flat(trajectory: &Trajectory) -> Vec<f64> {
    trajectory.position_m.iter().flatten().copied().collect()
}

#[test]
fn absent_axes_gaps_and_uneven_times_are_read() {
    let read = trajectory(
        "time_s,P1_x_m,P1_z_m,P2_z_m,P1_std_m,P1_pose_std_m\n0,0.1,,0.3,0.001,2e-4\n0.5,0.2,-0.1,,,\n",
    )
    .unwrap();
    assert_eq!(read.keypoints, ["P1", "P2"]);
    assert_eq!(read.time_s, [0.0, 0.5]);
    let nan = f64::NAN;
    assert!(same(&flat(&read), &[0.1, nan, nan, nan, nan, 0.3, 0.2, nan, -0.1, nan, nan, nan]));
    assert!(same(&read.std_m.unwrap(), &[0.001, nan, nan, nan]));
    assert!(same(&read.pose_std_m.unwrap(), &[2e-4, nan, nan, nan]));
}

#[test]
fn byte_order_mark_and_windows_line_ends_are_read() {
    let read = trajectory("\u{feff}time_s,P1_x_m\r\n0, 0.25\r\n").unwrap();
    assert_eq!(read.at(0, 0)[0], 0.25);
}

#[test]
fn a_spreadsheets_table_is_the_same_trajectory() {
    let wanted = trajectory("time_s,P1_x_m\n0.0,0.25\n0.5,\n").unwrap();
    let read = trajectory("# by a spreadsheet\ntime_s;P1_x_m\r\n0,0;0,25\r\n0,5;\r\n").unwrap();
    assert_eq!(read.time_s, wanted.time_s);
    assert!(same(&flat(&read), &flat(&wanted)));
    let refused =
        trajectory("# by a spreadsheet\r\n\r\ntime_s;P1_x_m\r\n0,0;0,25\r\n0,5;no\r\n").unwrap_err();
    assert!(refused.contains("line 5, column P1_x_m: `no`"), "{refused}");
}

#[test]
fn what_is_wrong_with_a_trajectory_is_said_with_its_place() {
    for (text, wanted) in [
        ("", "the first column is ``; it must be `time_s`"),
        ("t,P1_x_m\n", "the first column is `t`; it must be `time_s`"),
        ("time_s\n0\n", "no keypoint columns"),
        ("time_s,P1_x\n", "line 1: unknown column `P1_x`; wanted are <keypoint>_x_m"),
        ("time_s,P1_x_m,P1_x_m\n", "column 3 repeats `P1_x_m`"),
        ("time_s,P1_std_m\n", "`P1_std_m` has no position beside it"),
        ("time_s,P1_x_m\n0,1\n1\n", "t.csv, line 3: 1 cells under a header of 2"),
        ("time_s,P1_x_m\n0,NaN\n", "t.csv, line 2, column P1_x_m: `NaN` is not a finite number of metres"),
        ("time_s,P1_x_m\n0,1\n1,inf\n", "t.csv, line 3, column P1_x_m: `inf` is not a finite number"),
        ("time_s,P1_x_m\n0,0.1 m\n", "`0.1 m` is not a finite number of metres"),
        ("time_s,P1_x_m\n,0.1\n", "line 2, column time_s: `` is not a finite number of seconds"),
        (
            "time_s,P1_x_m\n0,1\n0,1\n",
            "t.csv, line 3, column time_s: 0 does not come after 0 of the row above",
        ),
        ("time_s,P1_x_m,P1_std_m\n0,1,0\n", "column P1_std_m: `0` is not a finite number of metres above 0"),
    ] {
        let message = trajectory(text).unwrap_err();
        assert!(message.contains(wanted), "{text:?}: {message}");
    }
}

#[test]
fn what_is_wrong_with_a_command_is_said_with_its_place() {
    for (text, wanted) in [
        ("time_s\n0\n", "no actuator columns"),
        ("time_s,servo\n", "unknown column `servo`; wanted are <actuator>_rad"),
        ("time_s,servo_rad\n", "no rows below the header; a command needs at least one"),
        (
            "time_s,servo_rad\n0,\n",
            "line 2, column servo_rad: `` is not a finite angle in radians; a command has no gaps",
        ),
        ("time_s,servo_rad,servo_measured_rad\n0,1,nan\n", "column servo_measured_rad: `nan`"),
        ("time_s,servo_rad\n1,0\n0.5,0\n", "line 3, column time_s: 0.5 does not come after 1"),
    ] {
        let message = parse_servo(text, Path::new("s.csv")).unwrap_err().to_string();
        assert!(message.contains(wanted), "{text:?}: {message}");
    }
}

#[test]
fn measured_angles_stand_beside_their_command_only() {
    let text = "time_s,arm_rad,arm_measured_rad,tail_measured_rad\n0,1,,3\n";
    let ServoTable { command, measured, .. } = parse_servo(text, Path::new("s.csv")).unwrap();
    assert_eq!(command.actuators, ["arm", "tail_measured"]);
    assert_eq!(command.angle_rad, [1.0, 3.0]);
    let arm = MeasuredAngles { actuator: "arm".into(), ..MeasuredAngles::default() };
    assert_eq!(measured, [arm]);
    let text = "time_s,arm_rad,arm_measured_rad\n0,1,\n0.5,2,1.5\n";
    let ServoTable { measured, .. } = parse_servo(text, Path::new("s.csv")).unwrap();
    assert_eq!((&measured[0].time_s[..], &measured[0].angle_rad[..]), (&[0.5][..], &[1.5][..]));
}

#[test]
fn motors_are_pushed_switched_off_and_told_in_steps() {
    let text = "# hold = steps\ntime_s,arm_Nm,arm_on,arm_load,arm_measured_rad,fin_duty\n0,0.1,1,3,0,0.5\n1,0.2,0,4,0.1,0.6\n";
    let table = parse_servo(text, Path::new("s.csv")).unwrap();
    assert_eq!(
        (&table.command.actuators[..], &table.units[..]),
        (&["arm".into(), "fin".into()][..], &["Nm", "duty"][..])
    );
    assert_eq!(table.command.time_s, [0.0, 1.0, 1.0]);
    assert_eq!([0.0, 0.9, 1.0].map(|t| table.command.at(1, t)), [0.5, 0.5, 0.6]);
    assert!(table.command.at(0, 0.9) == 0.1 && table.command.at(0, 1.0).is_nan());
    assert_eq!(table.measured[0].angle_rad, [0.0, 0.1]);
    for (text, wanted) in [
        ("time_s,arm_Nm,arm_on\n0,1,0.5\n", "column arm_on: `0.5` is not 1 where the drive is on"),
        ("time_s,arm_Nm,arm_rad\n0,1,1\n", "`arm` is commanded in rad and in another unit"),
        ("time_s,arm_lb\n0,1\n", "unknown column `arm_lb`"),
    ] {
        let message = parse_servo(text, Path::new("s.csv")).unwrap_err().to_string();
        assert!(message.contains(wanted), "{text:?}: {message}");
    }
}

#[test]
fn held_and_idle_commands_survive_writing_and_reading() {
    let rows = Command {
        actuators: vec!["a".into()],
        time_s: vec![0.0, 0.5, 2.0],
        angle_rad: vec![0.1, f64::NAN, 0.3],
    };
    for command in [rows.clone(), rows.held()] {
        let read = parse_servo(&servo_text(&command, &[]), Path::new("s.csv")).unwrap().command;
        assert_eq!(read.time_s, command.time_s);
        assert!(same(&read.angle_rad, &command.angle_rad), "{read:?}");
    }
}

#[test]
fn missing_file_is_named() {
    let error = read_trajectory(Path::new("no-such.csv")).unwrap_err();
    assert_eq!(error.to_string(), "reading table no-such.csv");
}

#[test]
fn command_survives_writing_and_reading_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("servo.csv");
    let command = Command {
        actuators: vec!["a".into(), "b".into()],
        time_s: vec![0.0, 0.1 + 0.2, 1e9 / 3.0],
        angle_rad: vec![0.1, -0.0, 1.0 / 3.0, f64::MIN_POSITIVE, 1e-300, -2.5e17],
    };
    write_command(&path, &command).unwrap();
    let read = read_command(&path).unwrap();
    assert_eq!(read.actuators, command.actuators);
    assert!(same(&read.time_s, &command.time_s) && same(&read.angle_rad, &command.angle_rad));
}

#[test]
fn measured_angles_have_rows_of_their_own_and_change_no_command() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("servo.csv");
    let command = Command {
        actuators: vec!["a".into(), "b".into()],
        time_s: vec![1.0, 2.0],
        angle_rad: vec![0.0, 5.0, 1.0, 5.0],
    };
    let angles = |actuator: &str, time_s: &[f64], angle_rad: &[f64]| MeasuredAngles {
        actuator: actuator.into(),
        time_s: time_s.into(),
        angle_rad: angle_rad.into(),
    };
    let measured =
        [angles("a", &[0.5, 1.25, 2.0, f64::NAN], &[-0.1, 0.2, 0.9, 1.0]), angles("c", &[1.5], &[7.0])];
    write_servo(&path, &command, &measured).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let wanted = "time_s,a_rad,b_rad,a_measured_rad\n0.5,0,5,-0.1\n1,0,5,\n1.25,0.25,5,0.2\n2,1,5,0.9\n";
    assert_eq!(text, wanted);
    let read = read_command(&path).unwrap();
    for k in 0..30 {
        let time_s = 0.1 * f64::from(k);
        assert_eq!(read.at(0, time_s), command.at(0, time_s));
    }
    assert_eq!(read.first_motion_s(), Some(1.0));
}

fn cell() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -1e3..1e3f64, 1 => any::<f64>().prop_map(|x| if x.is_finite() { x } else { f64::NAN })]
}

proptest! {
    #[test]
    fn trajectory_survives_writing_and_reading_exactly(
        cells in prop::collection::vec((1e-9..1.0f64, cell(), cell(), cell(), 1e-9..1.0f64), 1..20),
        gap in 0..6usize,
    ) {
        let width = 2;
        let rows = cells.len() / width;
        let mut time = 0.0;
        let mut wanted = Trajectory {
            time_s: (0..rows).map(|row| { time += cells[row].0; time }).collect(),
            keypoints: vec!["P1".into(), "tip_a".into()],
            position_m: cells[..rows * width].iter().map(|c| [c.1, c.2, c.3]).collect(),
            std_m: Some(cells[..rows * width].iter().map(|c| c.4).collect()),
            pose_std_m: Some(cells[..rows * width].iter().map(|c| c.4 / 3.0).collect()),
        };
        // One axis of one keypoint was never observed.
        for row in 0..rows {
            wanted.position_m[row * width + gap / 3][gap % 3] = f64::NAN;
        }
        let read = trajectory(&trajectory_text(&wanted)).unwrap();
        prop_assert_eq!(&read.keypoints, &wanted.keypoints);
        prop_assert!(same(&read.time_s, &wanted.time_s));
        prop_assert!(same(&flat(&read), &flat(&wanted)));
        if rows > 0 {
            prop_assert!(same(&read.std_m.unwrap(), &wanted.std_m.unwrap()));
            prop_assert!(same(&read.pose_std_m.unwrap(), &wanted.pose_std_m.unwrap()));
        }
    }
}

#[test]
fn angles_of_encoders_stand_beside_keypoints_and_come_back_the_same() {
    let text = "time_s,P1_x_m,P1_z_m,q1_rad,q2_rad\n0,0.1,0.2,-3.5,\n0.5,0.3,,0.25,7.125\n";
    let read = parse_trajectory(text, Path::new("t.csv")).unwrap();
    assert_eq!(read.keypoints, ["P1", "q1_rad", "q2_rad"]);
    assert_eq!(read.at(0, 1)[0], -3.5 * sim::model::POINTER_M);
    assert!(read.at(0, 2)[0].is_nan() && read.at(0, 1)[2].is_nan());
    assert_eq!(trajectory_text(&read), text);
    let bad = parse_trajectory("time_s,q1_rad\n0,much\n", Path::new("t.csv")).unwrap_err().to_string();
    assert!(bad.contains("q1_rad") && bad.contains("radians"), "{bad}");
}

#[test]
fn a_base_is_read_by_its_titles_and_written_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("base.csv");
    let base = parse_base("time_s,angle_rad,x_m,z_m\n0,3.1,0.5,-1\n0.1,3.2,0.6,-1.1\n", &path).unwrap();
    assert_eq!((base.time_s(), base.poses()), (&[0.0, 0.1][..], &[[0.5, -1.0, 3.1], [0.6, -1.1, 3.2]][..]));
    write_base(&path, &base).unwrap();
    assert_eq!(read_base(&path).unwrap(), base);
}

#[test]
fn what_is_wrong_with_a_base_is_said_with_its_place() {
    for (text, reason) in [
        (
            "time_s,x_m,angle_rad\n0,0,0\n",
            "b.csv, line 1: column `z_m` is missing; a base's path has time_s, x_m, z_m and angle_rad",
        ),
        ("time_s,x_m,z_m,y_m,angle_rad\n0,0,0,0,0\n", "line 1: unknown column `y_m`"),
        ("time_s,x_m,z_m,angle_rad\n0,0,0,0\n0,0,0,0\n", "line 3, column time_s: 0 does not come after 0"),
        (
            "time_s,x_m,z_m,angle_rad\n0,0,,0\n",
            "line 2, column z_m: `` is not a finite number; a base's path has no gaps",
        ),
        (
            "time_s,x_m,z_m,angle_rad\n0,0,0,3.1\n1,0,0,-3.1\n",
            "line 3, column angle_rad: `-3.1` is not within half a turn",
        ),
        ("time_s,x_m,z_m,angle_rad\n", "no rows below the header"),
    ] {
        let message = parse_base(text, Path::new("b.csv")).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
}
