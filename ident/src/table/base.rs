//! `base.csv`: `time_s,x_m,z_m,angle_rad`, where the base was.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

use sim::BasePath;

use super::{Rows, TableError, read_text, write_text};

const COLUMNS: [&str; 3] = ["x_m", "z_m", "angle_rad"];
const PLACE_WANTED: &str = "a finite number; a base's path has no gaps: leave the row out";
const ANGLE_WANTED: &str =
    "within half a turn of the row above; let the angle run on beyond a turn instead of jumping back";

/// Reads the base's path at `path`: place in metres, angle in radians, counter-clockwise.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_base(path: &Path) -> Result<BasePath, TableError> {
    parse_base(&read_text(path)?, path)
}

/// Reads a base's path from its `text`; errors speak of it as `path`.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn parse_base(text: &str, path: &Path) -> Result<BasePath, TableError> {
    let rows = Rows::parse(text, path)?;
    let refuse = |reason: String| TableError::Header { path: path.into(), reason };
    if let Some(title) = rows.header.iter().skip(1).find(|title| !COLUMNS.contains(&title.as_str())) {
        let reason = format!("unknown column `{title}`; a base's path has time_s, x_m, z_m and angle_rad");
        return Err(refuse(reason));
    }
    let column = |title: &str| {
        let place = rows.header.iter().position(|known| known == title);
        let reason =
            || format!("column `{title}` is missing; a base's path has time_s, x_m, z_m and angle_rad");
        place.ok_or_else(|| refuse(reason()))
    };
    let columns = [column("x_m")?, column("z_m")?, column("angle_rad")?];
    let time_s = rows.times()?;
    let mut poses: Vec<[f64; 3]> = Vec::with_capacity(time_s.len());
    for row in 0..time_s.len() {
        let mut pose = [0.0; 3];
        for (number, &column) in pose.iter_mut().zip(&columns) {
            *number = rows.number(row, column, PLACE_WANTED)?;
        }
        if poses.last().is_some_and(|before| (pose[2] - before[2]).abs() > PI) {
            return Err(rows.cell(row, columns[2], ANGLE_WANTED));
        }
        poses.push(pose);
    }
    // rows are finite and rise by now, so that only their number can be wrong
    let empty = |_| TableError::Empty { path: path.into(), wanted: "a base's path needs at least one" };
    BasePath::new(time_s, poses).map_err(empty)
}

/// Writes the rows of `base` to `path`.
///
/// # Errors
/// [`TableError::Unwritable`].
pub fn write_base(path: &Path, base: &BasePath) -> Result<(), TableError> {
    let mut text = String::from("time_s,x_m,z_m,angle_rad\n");
    for (time_s, [x, z, angle]) in base.time_s().iter().zip(base.poses()) {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{time_s},{x},{z},{angle}");
    }
    write_text(path, &text)
}
