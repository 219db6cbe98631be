//! The figures of one run, after the paper's Figs. 4 to 7.

use maud::{Markup, html};
use sim::model::{POINTER_M, encoded_joint};
use sim::{Command, Trajectory};

use super::chart::{Chart, KEYPOINTS, MEASURED, SIMULATED, Series};
use super::data::{RunFigures, ServoTrace};
use camera::calibration::View;

/// About this many poses are superimposed: more become a grey mass.
const DRAWN_POSES: usize = 45;
/// A keypoint that moves less than this in the simulation is fixed to the frame \[m\]. Chosen.
const FIXED_KEYPOINT_MOTION_M: f64 = 1e-6;
const WIDE_PX: (u32, u32) = (540, 190);
const SQUARE_PX: (u32, u32) = (420, 400);

/// Position of keypoint `keypoint` along `axis`, of which `unit_m` make one, over time.
fn track(trajectory: &Trajectory, keypoint: usize, axis: usize, unit_m: f64) -> Vec<(f64, f64)> {
    let position = |instant: usize| trajectory.at(instant, keypoint)[axis] / unit_m;
    trajectory.time_s.iter().enumerate().map(|(instant, &t)| (t, position(instant))).collect()
}

fn column(trajectory: &Trajectory, name: &str) -> Option<usize> {
    trajectory.keypoints.iter().position(|k| k == name)
}

/// Whether the model holds this keypoint in place: a pivot of the frame, whose track is noise.
fn is_fixed(simulated: &Trajectory, name: &str) -> bool {
    let Some(k) = column(simulated, name) else { return false };
    let mut positions = (0..simulated.time_s.len()).map(|instant| simulated.at(instant, k));
    let Some(first) = positions.next() else { return false };
    positions.all(|p| p.iter().zip(first).all(|(a, b)| (a - b).abs() < FIXED_KEYPOINT_MOTION_M))
}

/// Figs. d to f: each keypoint that moves over time, measured and simulated.
pub(super) fn over_time(run: &RunFigures) -> Markup {
    let moving =
        run.measured.keypoints.iter().enumerate().filter(|(_, name)| !is_fixed(&run.simulated, name));
    let axes = View::of(&run.measured).seen_axes();
    let panels = |name: &String| match encoded_joint(name) {
        Some(joint) => vec![(0, joint.to_owned(), "angle [rad]".to_owned(), POINTER_M)],
        None => axes
            .map(|(axis, letter)| (axis, format!("{name}, {letter}"), format!("{letter} [mm]"), 1e-3))
            .to_vec(),
    };
    let charts = moving.flat_map(|(k, name)| {
        panels(name).into_iter().map(move |(axis, title, y_label, unit_m)| {
            let measured = track(&run.measured, k, axis, unit_m);
            let mut series = vec![Series { width: 2.6, opacity: 0.7, ..Series::line(measured, MEASURED) }];
            if let Some(k) = column(&run.simulated, name) {
                series.push(Series {
                    width: 1.6,
                    ..Series::line(track(&run.simulated, k, axis, unit_m), SIMULATED)
                });
            }
            Chart {
                title,
                x_label: "time [s]".into(),
                y_label,
                size: WIDE_PX,
                marks: run.start_s.into_iter().collect(),
                series,
                ..Chart::default()
            }
        })
    });
    html! { div.pair { @for chart in charts { (chart.svg()) } } }
}

/// Measured minus simulated over time, with a band of two sigma of the keypoint noise.
pub(super) fn residuals(run: &RunFigures, noise_m: f64) -> Markup {
    let charts = View::of(&run.measured).seen_axes().map(|(axis, letter)| {
        let series = run.measured.keypoints.iter().enumerate().filter_map(|(k, name)| {
            let other = column(&run.simulated, name)?;
            let points = residual(&run.measured, k, &run.simulated, other, axis);
            Some(Series { width: 1.0, ..Series::line(points, KEYPOINTS[k % KEYPOINTS.len()]) })
        });
        Chart {
            title: format!("residual in {letter}"),
            x_label: "time [s]".into(),
            y_label: "residual [mm]".into(),
            size: WIDE_PX,
            band: (noise_m > 0.0).then_some(2e3 * noise_m),
            marks: run.start_s.into_iter().collect(),
            series: series.collect(),
            ..Chart::default()
        }
    });
    html! { div.pair { @for chart in charts { (chart.svg()) } } }
}

/// Residual \[mm\] at the instants both trajectories have; the simulated one is asked at the measured instants.
fn residual(
    measured: &Trajectory,
    keypoint: usize,
    simulated: &Trajectory,
    other: usize,
    axis: usize,
) -> Vec<(f64, f64)> {
    let mut row = 0;
    let mut points = Vec::with_capacity(measured.time_s.len());
    for (instant, &t) in measured.time_s.iter().enumerate() {
        while row < simulated.time_s.len() && simulated.time_s[row] < t {
            row += 1;
        }
        let value = match simulated.time_s.get(row) {
            Some(&same) if same == t => measured.at(instant, keypoint)[axis] - simulated.at(row, other)[axis],
            _ => f64::NAN,
        };
        points.push((t, value * 1e3));
    }
    points
}

/// The pose at one instant as a line \[mm\] from the base over the keypoints.
fn pose(trajectory: &Trajectory, instant: usize, base_m: Option<[f64; 3]>, view: View) -> Vec<(f64, f64)> {
    let has_base = trajectory.keypoints.iter().any(|name| name == "P0");
    let base = base_m.filter(|_| !has_base);
    let is_point = |k: &usize| encoded_joint(&trajectory.keypoints[*k]).is_none();
    let keypoints = (0..trajectory.keypoints.len()).filter(is_point).map(|k| trajectory.at(instant, k));
    base.into_iter().chain(keypoints).map(|place| millimetres(place, view)).collect()
}

/// The two visible coordinates of a place \[mm\].
fn millimetres(place: [f64; 3], view: View) -> (f64, f64) {
    view.seen(place).map(|metres| metres * 1e3).into()
}

/// A square drawing of the plane of motion, without anything in it.
fn drawing(title: &str, view: View) -> Chart {
    let [x_label, y_label] = view.seen_axes().map(|(_, axis)| format!("{axis} [mm]"));
    Chart { title: title.into(), x_label, y_label, size: SQUARE_PX, equal_axes: true, ..Chart::default() }
}

fn is_whole(pose: &[(f64, f64)]) -> bool {
    pose.iter().all(|p| p.0.is_finite() && p.1.is_finite())
}

/// Figs. a and b as drawings: the first pose, measured and simulated, on the same axes.
pub(super) fn first_pose(run: &RunFigures) -> Markup {
    let view = View::of(&run.measured);
    let first = |trajectory: &Trajectory| {
        (0..trajectory.time_s.len()).map(|i| pose(trajectory, i, run.base_m, view)).find(|p| is_whole(p))
    };
    let mut chart = drawing("first pose", view);
    for (trajectory, colour) in [(&run.measured, MEASURED), (&run.simulated, SIMULATED)] {
        if let Some(points) = first(trajectory) {
            chart.dots.extend(points.iter().map(|&p| (p, colour)));
            chart.series.push(Series { width: 2.2, ..Series::line(points, colour) });
        }
    }
    chart.svg()
}

/// Figs. c: poses over time superimposed, early ones pale, and every keypoint's path.
pub(super) fn superimposed(run: &RunFigures) -> Markup {
    let view = View::of(&run.measured);
    let mut charts = Vec::new();
    for (trajectory, title, colour) in
        [(&run.measured, "motion measured", MEASURED), (&run.simulated, "motion simulated", SIMULATED)]
    {
        if trajectory.time_s.is_empty() {
            continue;
        }
        let stride = trajectory.time_s.len().div_ceil(DRAWN_POSES).max(1);
        let lines: Vec<_> = if colour == MEASURED && !run.centrelines_m.is_empty() {
            let every = run.centrelines_m.len().div_ceil(DRAWN_POSES).max(1);
            let line = |c: &Vec<[f64; 2]>| c.iter().map(|p| (p[0] * 1e3, p[1] * 1e3)).collect();
            run.centrelines_m.iter().step_by(every).map(line).collect()
        } else {
            let instants = (0..trajectory.time_s.len()).step_by(stride);
            instants.map(|i| pose(trajectory, i, run.base_m, view)).collect()
        };
        let last = lines.len().max(2) - 1;
        let mut series: Vec<_> = lines
            .into_iter()
            .enumerate()
            .map(|(i, points)| Series {
                points,
                colour: KEYPOINTS[KEYPOINTS.len() - 1],
                opacity: 0.2 + 0.4 * i as f64 / last as f64,
                width: 1.0,
            })
            .collect();
        for (k, _) in
            trajectory.keypoints.iter().enumerate().filter(|(_, name)| encoded_joint(name).is_none())
        {
            let path = (0..trajectory.time_s.len()).map(|i| millimetres(trajectory.at(i, k), view)).collect();
            series.push(Series { width: 1.2, ..Series::line(path, KEYPOINTS[k % KEYPOINTS.len()]) });
        }
        charts.push(Chart { series, ..drawing(title, view) });
    }
    html! { @for chart in charts { (chart.svg()) } }
}

/// Servo angles over time, commanded and measured.
pub(super) fn servo(trace: &ServoTrace) -> Markup {
    let angle = |command: &Command, column: usize| {
        let width = command.actuators.len();
        let row = |(i, &t): (usize, &f64)| (t, command.angle_rad[i * width + column].to_degrees());
        // Each servo is measured at times of its own: an empty cell is no gap.
        command.time_s.iter().enumerate().map(row).filter(|(_, angle)| angle.is_finite()).collect()
    };
    let charts = trace.commanded.actuators.iter().enumerate().map(|(c, name)| {
        let mut series = vec![Series::line(angle(&trace.commanded, c), KEYPOINTS[1])];
        if let Some(measured) = &trace.measured
            && let Some(column) = measured.actuators.iter().position(|a| a == name)
        {
            series.push(Series::line(angle(measured, column), KEYPOINTS[0]));
        }
        Chart {
            title: name.clone(),
            x_label: "time [s]".into(),
            y_label: "angle [°], ccw positive".into(),
            size: (1096, 220),
            series,
            ..Chart::default()
        }
    });
    html! { @for chart in charts { (chart.svg()) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trajectory(time_s: &[f64], x_m: &[f64]) -> Trajectory {
        Trajectory {
            time_s: time_s.to_vec(),
            keypoints: vec!["P1".into()],
            position_m: x_m.iter().map(|&x| [x, f64::NAN, 0.0]).collect(),
            std_m: None,
            pose_std_m: None,
        }
    }

    #[test]
    fn residual_is_measured_minus_simulated_where_both_have_an_instant() {
        let measured = trajectory(&[0.0, 0.1, 0.2], &[0.003, 0.004, 0.005]);
        let simulated = trajectory(&[0.1, 0.2], &[0.001, 0.007]);
        let residual = residual(&measured, 0, &simulated, 0, 0);
        assert!(residual[0].1.is_nan());
        assert!((residual[1].1 - 3.0).abs() < 1e-12 && (residual[2].1 + 2.0).abs() < 1e-12, "{residual:?}");
    }

    #[test]
    fn pivot_of_the_frame_is_not_drawn_over_time() {
        let moving = trajectory(&[0.0, 0.1], &[0.0, 0.001]);
        let resting = trajectory(&[0.0, 0.1], &[0.02, 0.02]);
        assert!(!is_fixed(&moving, "P1") && is_fixed(&with_y(resting), "P1"));
        assert!(!is_fixed(&Trajectory::default(), "P1"));
    }

    fn with_y(mut trajectory: Trajectory) -> Trajectory {
        trajectory.position_m.iter_mut().for_each(|p| p[1] = 0.0);
        trajectory
    }

    #[test]
    fn pose_starts_at_the_base_only_when_p0_is_not_a_keypoint() {
        let mut chain = trajectory(&[0.0], &[0.025]);
        assert_eq!(pose(&chain, 0, Some([0.0; 3]), View::Xz), [(0.0, 0.0), (25.0, 0.0)]);
        chain.keypoints = vec!["P0".into()];
        assert_eq!(pose(&chain, 0, Some([0.0; 3]), View::Xz), [(25.0, 0.0)]);
    }

    #[test]
    fn motion_that_was_filmed_from_above_is_drawn_in_x_and_y() {
        let mut seen = trajectory(&[0.0, 0.1], &[0.0, 0.001]);
        seen.position_m.iter_mut().for_each(|place| *place = [place[0], 0.03, f64::NAN]);
        let run = RunFigures { simulated: with_y(seen.clone()), measured: seen, ..RunFigures::default() };
        for markup in [over_time(&run), residuals(&run, 0.0), superimposed(&run), first_pose(&run)] {
            let text = markup.into_string();
            assert!(text.contains("y [mm]") || text.contains("residual in y"), "{text}");
            assert!(!text.contains("z [mm]") && !text.contains("residual in z"), "{text}");
        }
    }
}
