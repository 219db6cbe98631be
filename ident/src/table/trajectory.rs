//! `trajectory.csv`: `time_s,P1_x_m,P1_z_m,...`, optionally `P1_std_m` and the part of it that follows the pose, `P1_pose_std_m`; beside these or
//! alone `q1_rad`, angles that an encoder read on a hinge.

use std::fmt::Write as _;
use std::path::Path;

use sim::Trajectory;
use sim::model::{POINTER_M, encoded_joint};

use super::{Rows, TableError, read_text, write_text};

const COORDINATE_WANTED: &str = "a finite number of metres; leave the cell empty where nothing was seen";
const ANGLE_WANTED: &str = "a finite number of radians; leave the cell empty where nothing was read";
const STD_WANTED: &str = "a finite number of metres above 0; leave the cell empty where it is not known";

/// What a column other than the time holds.
enum Quantity {
    Axis(usize),
    /// Of a hinge, kept as the way of a pointer.
    Angle,
    /// Of all, or of what follows the pose.
    Std(Deviation),
}

/// A column of standard deviations.
#[derive(Clone, Copy, PartialEq)]
enum Deviation {
    Whole,
    Pose,
}

impl Deviation {
    const ALL: [Self; 2] = [Self::Whole, Self::Pose];

    fn name(self) -> &'static str {
        match self {
            Self::Whole => "std",
            Self::Pose => "pose_std",
        }
    }

    /// Its cells in `trajectory`.
    fn of(self, trajectory: &Trajectory) -> Option<&Vec<f64>> {
        match self {
            Self::Whole => trajectory.std_m.as_ref(),
            Self::Pose => trajectory.pose_std_m.as_ref(),
        }
    }
}

/// `P1_x_m` is keypoint `P1`, axis 0; `q1_rad` is a mark of that name.
fn meaning(title: &str) -> Option<(&str, Quantity)> {
    if encoded_joint(title).is_some() {
        return Some((title, Quantity::Angle));
    }
    let all = title.strip_suffix("_m")?;
    let (keypoint, quantity) = match all.strip_suffix("_pose_std") {
        Some(keypoint) => (keypoint, Quantity::Std(Deviation::Pose)),
        None => {
            let (keypoint, quantity) = all.rsplit_once('_')?;
            let quantity = match quantity {
                "x" => Quantity::Axis(0),
                "y" => Quantity::Axis(1),
                "z" => Quantity::Axis(2),
                "std" => Quantity::Std(Deviation::Whole),
                _ => return None,
            };
            (keypoint, quantity)
        }
    };
    (!keypoint.is_empty()).then_some((keypoint, quantity))
}

/// Reads the trajectory table at `path`; positions in metres, tank frame. Angles of encoders come as the way of a pointer of
/// [`POINTER_M`] in place of x.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_trajectory(path: &Path) -> Result<Trajectory, TableError> {
    parse_trajectory(&read_text(path)?, path)
}

/// Reads a trajectory table from its `text`; errors speak of it as `path`.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn parse_trajectory(text: &str, path: &Path) -> Result<Trajectory, TableError> {
    let rows = Rows::parse(text, path)?;
    let refuse = |reason: String| TableError::Header { path: path.into(), reason };
    let mut keypoints: Vec<String> = Vec::new();
    let mut located: Vec<bool> = Vec::new();
    let mut columns = Vec::new();
    for (column, title) in rows.header.iter().enumerate().skip(1) {
        let (keypoint, quantity) = meaning(title).ok_or_else(|| {
            refuse(format!(
                "unknown column `{title}`; wanted are <keypoint>_x_m, <keypoint>_y_m, <keypoint>_z_m, <keypoint>_std_m, <keypoint>_pose_std_m and <joint>_rad"
            ))
        })?;
        let index = keypoints.iter().position(|known| known == keypoint).unwrap_or_else(|| {
            keypoints.push(keypoint.to_owned());
            located.push(false);
            keypoints.len() - 1
        });
        located[index] |= matches!(quantity, Quantity::Axis(_) | Quantity::Angle);
        columns.push((column, index, quantity));
    }
    if keypoints.is_empty() {
        return Err(refuse(
            "no keypoint columns; wanted is at least one such as `P1_x_m`, or `q1_rad` of an encoder".into(),
        ));
    }
    if let Some(lost) = located.iter().position(|is_located| !is_located) {
        let name = &keypoints[lost];
        return Err(refuse(format!(
            "`{name}_std_m` has no position beside it; add `{name}_x_m` or remove it"
        )));
    }

    let time_s = rows.times()?;
    let (width, length) = (keypoints.len(), time_s.len());
    let mut position_m = vec![[f64::NAN; 3]; length * width];
    let mut stds_m = Deviation::ALL.map(|one| {
        let is_there =
            columns.iter().any(|(.., quantity)| matches!(quantity, Quantity::Std(of) if *of == one));
        is_there.then(|| vec![f64::NAN; length * width])
    });
    for row in 0..length {
        for &(column, keypoint, ref quantity) in &columns {
            let cell = row * width + keypoint;
            match quantity {
                Quantity::Axis(axis) => {
                    position_m[cell][*axis] = rows.number_or_gap(row, column, COORDINATE_WANTED)?;
                }
                Quantity::Angle => {
                    let angle_rad = rows.number_or_gap(row, column, ANGLE_WANTED)?;
                    position_m[cell][0] = POINTER_M * angle_rad;
                }
                Quantity::Std(deviation) => {
                    let std = rows.number_or_gap(row, column, STD_WANTED)?;
                    if std <= 0.0 {
                        return Err(rows.cell(row, column, STD_WANTED));
                    }
                    if let Some(std_m) = &mut stds_m[*deviation as usize] {
                        std_m[cell] = std;
                    }
                }
            }
        }
    }
    let [std_m, pose_std_m] = stds_m;
    Ok(Trajectory { time_s, keypoints, position_m, std_m, pose_std_m })
}

/// Writes `trajectory` to `path`.
///
/// # Errors
/// [`TableError::Unwritable`].
pub fn write_trajectory(path: &Path, trajectory: &Trajectory) -> Result<(), TableError> {
    write_text(path, &trajectory_text(trajectory))
}

/// `trajectory` as the text of its table.
///
/// An axis that holds no number anywhere is left out, unless a keypoint would lose all its columns: then x and
/// z stay, empty.
pub fn trajectory_text(trajectory: &Trajectory) -> String {
    let width = trajectory.keypoints.len();
    let mut columns = Vec::new();
    for keypoint in 0..width {
        if encoded_joint(&trajectory.keypoints[keypoint]).is_some() {
            columns.push((keypoint, Quantity::Angle));
            continue;
        }
        let is_observed = |axis: usize| {
            trajectory.position_m.iter().skip(keypoint).step_by(width).any(|p| p[axis].is_finite())
        };
        let mut axes: Vec<usize> = (0..3).filter(|&axis| is_observed(axis)).collect();
        if axes.is_empty() {
            axes = vec![0, 2];
        }
        columns.extend(axes.into_iter().map(|axis| (keypoint, Quantity::Axis(axis))));
        let stated = |std: &Vec<f64>| std.iter().skip(keypoint).step_by(width).any(|s| s.is_finite());
        let deviations = Deviation::ALL.into_iter().filter(|one| one.of(trajectory).is_some_and(stated));
        columns.extend(deviations.map(|one| (keypoint, Quantity::Std(one))));
    }
    let mut text = String::from("time_s");
    for (keypoint, quantity) in &columns {
        let mark = &trajectory.keypoints[*keypoint];
        // Writing into a string cannot fail.
        let _ = match quantity {
            Quantity::Axis(axis) => write!(text, ",{mark}_{}_m", ["x", "y", "z"][*axis]),
            Quantity::Angle => write!(text, ",{mark}"),
            Quantity::Std(deviation) => write!(text, ",{mark}_{}_m", deviation.name()),
        };
    }
    text.push('\n');
    for (row, time_s) in trajectory.time_s.iter().enumerate() {
        let _ = write!(text, "{time_s}");
        for (keypoint, quantity) in &columns {
            let cell = row * width + keypoint;
            let value = match quantity {
                Quantity::Axis(axis) => trajectory.position_m[cell][*axis],
                Quantity::Angle => trajectory.position_m[cell][0] / POINTER_M,
                Quantity::Std(deviation) => deviation.of(trajectory).map_or(f64::NAN, |std| std[cell]),
            };
            text.push(',');
            if value.is_finite() {
                let _ = write!(text, "{value}");
            }
        }
        text.push('\n');
    }
    text
}
