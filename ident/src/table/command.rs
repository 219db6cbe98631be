//! `servo.csv`: `time_s,<actuator>_rad`, optionally `<actuator>_measured_rad`.

use std::fmt::Write as _;
use std::path::Path;

use sim::Command;

use super::{Rows, TableError, read_text, write_text};

const ANGLE_WANTED: &str = "a finite angle in radians; a command has no gaps";
const MEASURED_WANTED: &str = "a finite angle in radians; leave the cell empty where nothing was measured";

/// Angles that a servo measured of itself.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeasuredAngles {
    /// The model's actuator.
    pub actuator: String,
    /// When \[s\], strictly rising.
    pub time_s: Vec<f64>,
    /// Which angle \[rad\], in terms of the command.
    pub angle_rad: Vec<f64>,
}

/// Reads the commands of the servo table at `path`; angles in radians.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_command(path: &Path) -> Result<Command, TableError> {
    Ok(read_servo(path)?.0)
}

/// Reads the servo table at `path`: commands, and what each servo measured, where it did; angles in radians.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_servo(path: &Path) -> Result<(Command, Vec<MeasuredAngles>), TableError> {
    parse_servo(&read_text(path)?, path)
}

/// Reads a servo table from its `text`; errors speak of it as `path`.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn parse_servo(text: &str, path: &Path) -> Result<(Command, Vec<MeasuredAngles>), TableError> {
    let rows = Rows::parse(text, path)?;
    let mut actuators = Vec::new();
    let mut commanded = Vec::new();
    let mut measured = Vec::new();
    for (column, title) in rows.header.iter().enumerate().skip(1) {
        let name = title.strip_suffix("_rad").filter(|name| !name.is_empty()).ok_or_else(|| {
            let reason =
                format!("unknown column `{title}`; wanted are <actuator>_rad and <actuator>_measured_rad");
            TableError::Header { path: path.into(), reason }
        })?;
        // `arm_measured_rad` is a measurement only beside the command it belongs to.
        let beside = |actuator: &str| rows.header.contains(&format!("{actuator}_rad"));
        if let Some(actuator) = name.strip_suffix("_measured").filter(|actuator| beside(actuator)) {
            let angles = MeasuredAngles { actuator: actuator.to_owned(), ..MeasuredAngles::default() };
            measured.push((column, angles));
        } else {
            actuators.push(name.to_owned());
            commanded.push(column);
        }
    }
    if actuators.is_empty() {
        let reason = "no actuator columns; wanted is at least one such as `servo_rad`".into();
        return Err(TableError::Header { path: path.into(), reason });
    }
    let time_s = rows.times()?;
    if time_s.is_empty() {
        return Err(TableError::Empty { path: path.into(), wanted: "a command needs at least one" });
    }
    let mut angle_rad = Vec::with_capacity(time_s.len() * commanded.len());
    for (row, &row_s) in time_s.iter().enumerate() {
        for &column in &commanded {
            angle_rad.push(rows.number(row, column, ANGLE_WANTED)?);
        }
        for (column, angles) in &mut measured {
            let angle = rows.number_or_gap(row, *column, MEASURED_WANTED)?;
            if angle.is_finite() {
                angles.time_s.push(row_s);
                angles.angle_rad.push(angle);
            }
        }
    }
    let measured = measured.into_iter().map(|(_, angles)| angles).collect();
    Ok((Command { actuators, time_s, angle_rad }, measured))
}

/// Writes `command` to `path`.
///
/// # Errors
/// [`TableError::Unwritable`].
pub fn write_command(path: &Path, command: &Command) -> Result<(), TableError> {
    let mut text = String::from("time_s");
    for actuator in &command.actuators {
        // Writing into a string cannot fail.
        let _ = write!(text, ",{actuator}_rad");
    }
    text.push('\n');
    let width = command.actuators.len();
    for (row, time_s) in command.time_s.iter().enumerate() {
        let _ = write!(text, "{time_s}");
        for angle in &command.angle_rad[row * width..(row + 1) * width] {
            let _ = write!(text, ",{angle}");
        }
        text.push('\n');
    }
    write_text(path, &text)
}
