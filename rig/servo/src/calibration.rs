//! The calibration file of a servo, as `rig calibrate servo` writes it.

use std::path::{Path, PathBuf};

use ground::strict::{self, Finite, NonNegative, Positive, StrictError};
use serde::{Deserialize, Serialize};

/// A servo's calibration: the file that `[[servo.channel]] calibration` names. Angles are counter-clockwise as the camera sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoCalibration {
    /// When it was made, RFC 3339.
    pub date: String,
    /// Name of the channel.
    pub channel: String,
    /// The run that it was made from.
    pub run: String,
    /// A longer pulse turns it clockwise.
    pub mirrored: bool,
    /// Pulse at angle zero \[µs\], by the table.
    pub zero_pulse_us: Measured,
    /// Change of the pulse per angle \[µs/rad\], of the straight line through the table.
    pub us_per_rad: Measured,
    /// Greatest distance of the table from that line \[rad\].
    pub off_line_rad: NonNegative,
    /// Half the difference of the angles when a level is approached from either side \[rad\]: dead band and backlash.
    pub deadband_rad: Measured,
    /// Standard deviation with which it comes back to a level from the same side \[rad\].
    pub repeatability_rad: Positive,
    /// Time constant with which it follows, in addition to that of the model's actuator \[s\].
    pub lag_s: Measured,
    /// Delay from the pulse to the picture, in addition to the lag \[s\]: of servo, board and camera together, without the wait for the
    /// servo's next look at its pulse.
    pub delay_s: Measured,
    /// Fastest turn \[rad/s\]; left out where it was never reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_limit_rad_per_s: Option<Measured>,
    /// Time from one look at its pulse to the next \[s\]; left out where it looks too often to be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refresh_s: Option<Measured>,
    /// Pulse to angle.
    pub table: Table,
}

/// Why a servo's calibration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ServoCalibrationError {
    /// The file cannot be read as a calibration.
    #[error("reading the servo's calibration")]
    File(#[from] StrictError),
    /// The file is of another channel.
    #[error("channel `{channel}` names the calibration {}, which is of channel `{of}`: calibrate again, or name the right file", path.display())]
    Channel {
        /// The file.
        path: PathBuf,
        /// The channel that names it.
        channel: String,
        /// The channel that it is of.
        of: String,
    },
    /// The channel's limits do not fit the calibration.
    #[error("with the calibration {}: {reason}", path.display())]
    Travel {
        /// The file.
        path: PathBuf,
        /// The limit that does not fit.
        reason: String,
    },
    /// The config contradicts the calibration's sign.
    #[error(
        "[profile] says mirrored = {profile}, the calibration of channel `{channel}` mirrored = {file}: leave `mirrored` out of [profile]"
    )]
    Mirrored {
        /// The channel.
        channel: String,
        /// `mirrored` in the config.
        profile: bool,
        /// `mirrored` in the calibration file.
        file: bool,
    },
}

/// A number and its standard error, in one unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// The number.
    pub value: Finite,
    /// Its standard error.
    pub std: Positive,
}

/// Pulse to angle: straight between its rows, and beyond them as between the last two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Row>", into = "Vec<Row>")]
pub struct Table(Vec<Row>);

/// A row of a [`Table`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// The pulse \[µs\].
    pub pulse_us: Positive,
    /// The angle, in the middle between those from either side \[rad\].
    pub angle_rad: Finite,
    /// Its standard error \[rad\].
    pub std_rad: Positive,
}

impl TryFrom<Vec<Row>> for Table {
    type Error = String;

    fn try_from(rows: Vec<Row>) -> Result<Self, String> {
        if rows.len() < 2 {
            return Err(format!("a table needs 2 rows or more, not {}", rows.len()));
        }
        let rises = |pair: &[Row]| pair[1].angle_rad.get() > pair[0].angle_rad.get();
        let first = rises(&rows[..2]);
        for pair in rows.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            if b.pulse_us.get() <= a.pulse_us.get() {
                return Err(format!(
                    "pulse_us = {} after {}: pulses must rise",
                    b.pulse_us.get(),
                    a.pulse_us.get()
                ));
            }
            if rises(pair) != first || a.angle_rad == b.angle_rad {
                return Err(format!(
                    "angle_rad = {} after {}: angles must all rise or all fall",
                    b.angle_rad.get(),
                    a.angle_rad.get()
                ));
            }
        }
        Ok(Self(rows))
    }
}

impl From<Table> for Vec<Row> {
    fn from(table: Table) -> Self {
        table.0
    }
}

impl Table {
    /// Its rows, by rising pulse.
    pub fn rows(&self) -> &[Row] {
        &self.0
    }

    /// Whether a longer pulse is a smaller angle.
    pub fn falls(&self) -> bool {
        self.0[1].angle_rad.get() < self.0[0].angle_rad.get()
    }

    /// The angle for a pulse \[rad\].
    pub fn angle_rad(&self, pulse_us: f64) -> f64 {
        let next = self.0.partition_point(|row| row.pulse_us.get() <= pulse_us);
        let ([p0, p1], [a0, a1]) = self.piece(next);
        a0 + (pulse_us - p0) * (a1 - a0) / (p1 - p0)
    }

    /// The pulse for an angle \[µs\]: the inverse of [`Table::angle_rad`].
    pub fn pulse_us(&self, angle_rad: f64) -> f64 {
        let before = |row: &Row| {
            if self.falls() { row.angle_rad.get() >= angle_rad } else { row.angle_rad.get() <= angle_rad }
        };
        let ([p0, p1], [a0, a1]) = self.piece(self.0.partition_point(before));
        p0 + (angle_rad - a0) * (p1 - p0) / (a1 - a0)
    }

    /// Pulses and angles at both ends of the piece before row `next`, or of the nearest one.
    fn piece(&self, next: usize) -> ([f64; 2], [f64; 2]) {
        let next = next.clamp(1, self.0.len() - 1);
        let rows = [self.0[next - 1], self.0[next]];
        (rows.map(|row| row.pulse_us.get()), rows.map(|row| row.angle_rad.get()))
    }
}

impl ServoCalibration {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`StrictError`], naming the line.
    pub fn read(path: &Path) -> Result<Self, StrictError> {
        let calibration: Self = strict::read(path)?;
        let refused = |message: String| StrictError::Refused { path: PathBuf::from(path), message };
        let above_zero =
            [("zero_pulse_us", calibration.zero_pulse_us), ("us_per_rad", calibration.us_per_rad)];
        if let Some((key, measured)) =
            above_zero.into_iter().find(|(_, measured)| measured.value.get() <= 0.0)
        {
            return Err(refused(format!("{key} = {} must be above 0", measured.value.get())));
        }
        match calibration.table.falls() == calibration.mirrored {
            true => Ok(calibration),
            false => Err(refused(format!(
                "mirrored = {}, but the table's angles {} with the pulse",
                calibration.mirrored,
                if calibration.table.falls() { "fall" } else { "rise" }
            ))),
        }
    }

    /// Pulse at angle zero \[µs\] and change of the pulse per angle \[µs/rad\].
    pub(super) fn scale(&self) -> (Positive, Positive) {
        let positive = |measured: Measured| {
            Positive::new(measured.value.get()).unwrap_or_else(|| unreachable!("it was read as above 0"))
        };
        (positive(self.zero_pulse_us), positive(self.us_per_rad))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: &[[f64; 2]]) -> Result<Table, String> {
        let row = |[pulse, angle]: &[f64; 2]| Row {
            pulse_us: Positive::new(*pulse).unwrap(),
            angle_rad: Finite::new(*angle).unwrap(),
            std_rad: Positive::literal(1e-3),
        };
        rows.iter().map(row).collect::<Vec<_>>().try_into()
    }

    #[test]
    fn table_is_straight_between_rows_goes_on_beyond_them_and_turns_back() {
        let falling = table(&[[1000.0, 0.8], [1500.0, 0.1], [2000.0, -0.7]]).unwrap();
        assert!(falling.falls());
        for (pulse, angle) in
            [(900.0, 0.94), (1000.0, 0.8), (1250.0, 0.45), (1500.0, 0.1), (1600.0, -0.06), (2100.0, -0.86)]
        {
            assert!((falling.angle_rad(pulse) - angle).abs() < 1e-12, "{pulse}");
            assert!((falling.pulse_us(angle) - pulse).abs() < 1e-9, "{angle}");
        }
    }

    #[test]
    fn table_that_turns_round_is_refused() {
        assert!(table(&[[1000.0, 0.0]]).unwrap_err().contains("2 rows"));
        assert!(table(&[[1000.0, 0.0], [900.0, 1.0]]).unwrap_err().contains("must rise"));
        assert!(table(&[[1000.0, 0.0], [1100.0, 1.0], [1200.0, 0.5]]).unwrap_err().contains("all rise"));
    }
}
