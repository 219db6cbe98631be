//! `servo.csv`: `time_s,<actuator>_rad`, of motors `<actuator>_Nm`, `_N`, `_A` or `_duty`; optionally `<actuator>_on`, `<actuator>_measured_rad` and what
//! servos report of themselves.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use sim::Command;

use super::{Rows, TableError, read_text, write_text};

const ANGLE_WANTED: &str = "a finite angle in radians; a command has no gaps";
const PUSH_WANTED: &str =
    "a finite number; a command has no gaps, and `<actuator>_on` says where a drive is idle";
const SWITCH_WANTED: &str = "1 where the drive is on, or 0 where it is idle";
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

/// A servo table: what the drives were told, and what they measured.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ServoTable {
    /// Commands; rows that hold until the next are such ([`Command::held`]).
    pub command: Command,
    /// In what each column of the commands is: `rad`, or what pushes, of [`PUSHES`].
    pub units: Vec<&'static str>,
    /// Angles that servos measured of themselves.
    pub measured: Vec<MeasuredAngles>,
}

/// Unit of the columns that command an angle.
const ANGLE: &str = "rad";
/// Units of those that command a push: a torque, a force, a current, a share of the supply.
pub const PUSHES: [&str; 4] = ["Nm", "N", "A", "duty"];
/// What servos report beside their angle: recorded, and not used here.
const REPORTED: [&str; 5] = ["measured_rad_s", "measured_A", "load", "V", "C"];

/// What a column of a servo table holds of the actuator called so.
enum Column<'a> {
    Command(&'a str, &'static str),
    /// 1 where the drive is on, 0 where it is idle.
    On(&'a str),
    Measured(&'a str),
    Reported,
}

/// Reads the commands of the servo table at `path`.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_command(path: &Path) -> Result<Command, TableError> {
    Ok(read_servo(path)?.command)
}

/// Reads the servo table at `path`: commands, and what each servo measured, where it did.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn read_servo(path: &Path) -> Result<ServoTable, TableError> {
    parse_servo(&read_text(path)?, path)
}

/// Reads a servo table from its `text`; errors speak of it as `path`.
///
/// # Errors
/// [`TableError`], naming file, line and column.
pub fn parse_servo(text: &str, path: &Path) -> Result<ServoTable, TableError> {
    let rows = Rows::parse(text, path)?;
    let refuse = |reason: String| TableError::Header { path: path.into(), reason };
    let mut table = ServoTable::default();
    let (mut commanded, mut measured, mut switches) = (Vec::new(), Vec::new(), Vec::new());
    for (column, title) in rows.header.iter().enumerate().skip(1) {
        match meaning(title, &rows.header) {
            Some(Column::Command(actuator, unit)) => {
                table.command.actuators.push(actuator.to_owned());
                table.units.push(unit);
                commanded.push(column);
            }
            Some(Column::Measured(actuator)) => {
                let angles = MeasuredAngles { actuator: actuator.to_owned(), ..MeasuredAngles::default() };
                measured.push((column, angles));
            }
            Some(Column::On(actuator)) => switches.push((column, actuator)),
            Some(Column::Reported) => {}
            None => {
                return Err(refuse(format!(
                    "unknown column `{title}`; wanted are <actuator>_rad, or of motors <actuator>_Nm, _N, _A or _duty, and beside them <actuator>_measured_rad and <actuator>_on"
                )));
            }
        }
    }
    let actuators = &table.command.actuators;
    if actuators.is_empty() {
        return Err(refuse("no actuator columns; wanted is at least one such as `servo_rad`".into()));
    }
    if let Some((place, twice)) =
        actuators.iter().enumerate().find(|(place, name)| actuators[..*place].contains(name))
    {
        return Err(refuse(format!(
            "`{twice}` is commanded in {} and in another unit; leave one of the columns",
            table.units[place]
        )));
    }
    let time_s = rows.times()?;
    if time_s.is_empty() {
        return Err(TableError::Empty { path: path.into(), wanted: "a command needs at least one" });
    }
    let switch = |actuator: &String| switches.iter().find(|(_, name)| name == actuator).map(|(at, _)| *at);
    let switch: Vec<Option<usize>> = actuators.iter().map(switch).collect();
    let mut values = Vec::with_capacity(time_s.len() * commanded.len());
    for (row, &row_s) in time_s.iter().enumerate() {
        for ((&column, &switch), unit) in commanded.iter().zip(&switch).zip(&table.units) {
            let wanted = if *unit == ANGLE { ANGLE_WANTED } else { PUSH_WANTED };
            let value = rows.number(row, column, wanted)?;
            let is_on = match switch.map(|at| rows.number(row, at, SWITCH_WANTED).map(|on| (at, on))) {
                None => true,
                Some(Ok((_, on))) if on == 0.0 || on == 1.0 => on == 1.0,
                Some(Ok((at, _))) => return Err(rows.cell(row, at, SWITCH_WANTED)),
                Some(Err(error)) => return Err(error),
            };
            values.push(if is_on { value } else { f64::NAN });
        }
        for (column, angles) in &mut measured {
            let angle = rows.number_or_gap(row, *column, MEASURED_WANTED)?;
            if angle.is_finite() {
                angles.time_s.push(row_s);
                angles.angle_rad.push(angle);
            }
        }
    }
    (table.command.time_s, table.command.angle_rad) = (time_s, values);
    if is_held(text) {
        table.command = table.command.held();
    }
    table.measured = measured.into_iter().map(|(_, angles)| angles).collect();
    Ok(table)
}

/// What the column called `title` holds in a table with this `header`.
fn meaning<'a>(title: &'a str, header: &[String]) -> Option<Column<'a>> {
    let units = || std::iter::once(ANGLE).chain(PUSHES);
    // `arm_measured_rad` is a measurement only beside the command it belongs to
    let is_commanded = |actuator: &str| units().any(|unit| header.contains(&format!("{actuator}_{unit}")));
    let beside = |what: &str| {
        let actuator = title.strip_suffix(what).and_then(|actuator| actuator.strip_suffix('_'));
        actuator.filter(|actuator| is_commanded(actuator))
    };
    if let Some(actuator) = beside("measured_rad") {
        return Some(Column::Measured(actuator));
    }
    if let Some(actuator) = beside("on") {
        return Some(Column::On(actuator));
    }
    if REPORTED.iter().any(|what| beside(what).is_some()) {
        return Some(Column::Reported);
    }
    let (actuator, unit) = title.rsplit_once('_').filter(|(actuator, _)| !actuator.is_empty())?;
    units().find(|known| *known == unit).map(|unit| Column::Command(actuator, unit))
}

/// Whether a line of remarks before the header says that rows hold until the next.
fn is_held(text: &str) -> bool {
    let remarks = text
        .trim_start_matches('\u{feff}')
        .lines()
        .take_while(|line| line.trim().is_empty() || line.starts_with('#'));
    remarks
        .map(|line| line.trim_start_matches('#').replace([' ', '"'], ""))
        .any(|remark| remark == "hold=steps")
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
    let held = command.steps();
    let command = held.as_ref().unwrap_or(command);
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
    let mut text =
        if held.is_some() { String::from("# hold = steps\ntime_s") } else { String::from("time_s") };
    // Writing into a string cannot fail.
    for actuator in &command.actuators {
        let _ = write!(text, ",{actuator}_rad");
    }
    let is_idle =
        |column: usize| command.angle_rad.iter().skip(column).step_by(width).any(|angle| angle.is_nan());
    let idle: Vec<bool> = (0..width).map(is_idle).collect();
    for (actuator, _) in command.actuators.iter().zip(&idle).filter(|(_, idle)| **idle) {
        let _ = write!(text, ",{actuator}_on");
    }
    for (actuator, _) in command.actuators.iter().zip(&is_measured).filter(|(_, is_measured)| **is_measured) {
        let _ = write!(text, ",{actuator}_measured_rad");
    }
    text.push('\n');
    for (Instant(time_s), (command_row, measured)) in rows {
        let _ = write!(text, "{time_s}");
        // the row that holds here, or what is between two
        let last = command.time_s.partition_point(|&row_s| row_s <= time_s).saturating_sub(1);
        let told = |column: usize| {
            let between = || match held {
                Some(_) => command.angle_rad[last * width + column],
                None => command.at(column, time_s),
            };
            command_row.map_or_else(between, |row| command.angle_rad[row * width + column])
        };
        for angle in (0..width).map(told) {
            let _ = write!(text, ",{}", if angle.is_nan() { 0.0 } else { angle });
        }
        for column in (0..width).filter(|&column| idle[column]) {
            let _ = write!(text, ",{}", u8::from(!told(column).is_nan()));
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
