//! How far a soft arm bends in its strokes.

use sim::{Command, Trajectory};

/// Median angle \[deg\] from the chord P0-P1 to the chord P1-P2 in the middle third of the last full stroke in which the command rises or falls; not a number where there is no such
/// stroke or nothing is seen in it.
pub fn bend_degrees(trajectory: &Trajectory, command: &Command, rising: bool) -> f64 {
    let rows: Vec<(f64, f64)> = command
        .time_s
        .iter()
        .enumerate()
        .map(|(row, &t)| (t, command.angle_rad[row * command.actuators.len()]))
        .collect();
    // the last stroke brings the arm back to rest
    let strokes = rows.windows(2).rev().skip(1);
    let Some(stroke) = strokes.into_iter().find(|stroke| (stroke[1].1 > stroke[0].1) == rising) else {
        return f64::NAN;
    };
    let [from_s, to_s] =
        [1.0 / 3.0, 2.0 / 3.0].map(|share| stroke[0].0 + share * (stroke[1].0 - stroke[0].0));
    let place = |name: &str| trajectory.keypoints.iter().position(|keypoint| keypoint == name);
    let (Some(base), Some(middle), Some(tip)) = (place("P0"), place("P1"), place("P2")) else {
        return f64::NAN;
    };
    let inside = (0..trajectory.time_s.len()).filter(|&row| (from_s..to_s).contains(&trajectory.time_s[row]));
    let mut bends: Vec<f64> = inside
        .map(|row| {
            let [a, b, c] = [base, middle, tip].map(|column| trajectory.at(row, column));
            let [first, second] = [(a, b), (b, c)].map(|(from, to)| [to[0] - from[0], to[2] - from[2]]);
            let cross = first[0] * second[1] - first[1] * second[0];
            cross.atan2(first[0] * second[0] + first[1] * second[1]).to_degrees()
        })
        .filter(|bend| bend.is_finite())
        .collect();
    bends.sort_by(f64::total_cmp);
    bends.get(bends.len() / 2).copied().unwrap_or(f64::NAN)
}
