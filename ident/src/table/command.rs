//! `servo.csv`: `time_s,<actuator>_rad`, optionally `<actuator>_measured_rad`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use sim::Command;

use super::{Rows, TableError, read_text, write_text};

const ANGLE_WANTED: &str = "a finite angle in radians; a command has no gaps";
const MEASURED_WANTED: &str = "a finite angle in radians; leave the cell empty where nothing was measured";

/// Angles that a servo measured of itself.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeasuredAngles {
    /// Name of the actuator in the model.
    pub actuator: String,
    /// Times of the measurements \[s\], strictly rising.
    pub time_s: Vec<f64>,
    /// Measured angles \[rad\], on the scale of the command, shape as `time_s`.
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
        let is_commanded = |actuator: &str| rows.header.contains(&format!("{actuator}_rad"));
        if let Some(actuator) = name.strip_suffix("_measured").filter(|actuator| is_commanded(actuator)) {
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
    write_servo(path, command, &[])
}

/// Writes the table of [`servo_text`] to `path`.
///
/// # Errors
/// [`TableError::Unwritable`].
pub fn write_servo(path: &Path, command: &Command, measured: &[MeasuredAngles]) -> Result<(), TableError> {
    write_text(path, &servo_text(command, measured))
}

/// `command` as the text of its table, with the angles that servos measured, in rows at the times of measurement, where the command is
/// interpolated between its rows. Angles of actuators that the command has not are left out, as are times that are not finite.
pub fn servo_text(command: &Command, measured: &[MeasuredAngles]) -> String {
    let width = command.actuators.len();
    let column = |angles: &MeasuredAngles| command.actuators.iter().position(|name| *name == angles.actuator);
    // By time: the command's own row there, if it has one, and what was measured.
    let mut rows: BTreeMap<Instant, (Option<usize>, Vec<Option<f64>>)> = command
        .time_s
        .iter()
        .enumerate()
        .map(|(row, &time_s)| (Instant(time_s), (Some(row), vec![None; width])))
        .collect();
    let mut is_measured = vec![false; width];
    for angles in measured {
        let Some(column) = column(angles) else { continue };
        for (&time_s, &angle_rad) in angles.time_s.iter().zip(&angles.angle_rad) {
            if time_s.is_finite() {
                is_measured[column] = true;
                let (_, row) = rows.entry(Instant(time_s)).or_insert_with(|| (None, vec![None; width]));
                row[column] = Some(angle_rad);
            }
        }
    }
    let mut text = String::from("time_s");
    // Writing into a string cannot fail.
    for actuator in &command.actuators {
        let _ = write!(text, ",{actuator}_rad");
    }
    for (actuator, _) in command.actuators.iter().zip(&is_measured).filter(|(_, is_measured)| **is_measured) {
        let _ = write!(text, ",{actuator}_measured_rad");
    }
    text.push('\n');
    for (Instant(time_s), (command_row, measured)) in rows {
        let _ = write!(text, "{time_s}");
        for column in 0..width {
            let between = || command.at(column, time_s);
            let angle = command_row.map_or_else(between, |row| command.angle_rad[row * width + column]);
            let _ = write!(text, ",{angle}");
        }
        for (angle, _) in measured.iter().zip(&is_measured).filter(|(_, is_measured)| **is_measured) {
            match angle {
                Some(angle) => drop(write!(text, ",{angle}")),
                None => text.push(','),
            }
        }
        text.push('\n');
    }
    text
}

/// A row's time, in order.
#[derive(Debug, Clone, Copy)]
struct Instant(f64);

impl PartialEq for Instant {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Instant {}

impl PartialOrd for Instant {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Instant {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}
