//! A servo's calibration for people, and the file of it.

use std::fmt::Write as _;

use ground::strict::{Finite, NonNegative, Positive};

use super::{Calibrated, Dynamics, Estimate, Level, Levels};
use servo::calibration::{Measured, Row, ServoCalibration, Table};

/// Where a calibration comes from, as its file states it.
#[derive(Debug, Clone)]
pub struct Origin {
    /// Date and time of the calibration, RFC 3339.
    pub date: String,
    /// Name of the channel.
    pub channel: String,
    /// The run that it was made from.
    pub run: String,
}

/// `calibrated` as a file says it; none where a figure is no number.
pub fn file(calibrated: &Calibrated, origin: &Origin) -> Option<ServoCalibration> {
    let Calibrated { levels, dynamics } = calibrated;
    let measured = |estimate: Estimate| {
        Some(Measured {
            value: Finite::new(rounded(estimate.value))?,
            std: Positive::new(rounded(estimate.std))?,
        })
    };
    let slope = levels.rad_per_us;
    let us_per_rad = slope.value.abs().recip();
    let row = |level: &Level| {
        Some(Row {
            pulse_us: Positive::new(level.pulse_us)?,
            angle_rad: Finite::new(rounded(level.angle_rad))?,
            std_rad: Positive::new(rounded(level.std_rad))?,
        })
    };
    let rows = levels.levels.iter().map(row).collect::<Option<Vec<_>>>()?;
    Some(ServoCalibration {
        date: origin.date.clone(),
        channel: origin.channel.clone(),
        run: origin.run.clone(),
        mirrored: slope.value < 0.0,
        zero_pulse_us: measured(levels.zero_pulse_us)?,
        us_per_rad: measured(Estimate { value: us_per_rad, std: slope.std * us_per_rad.powi(2) })?,
        off_line_rad: NonNegative::new(rounded(levels.off_line_rad))?,
        deadband_rad: measured(levels.deadband_rad)?,
        repeatability_rad: Positive::new(rounded(levels.repeatability_rad))?,
        lag_s: measured(dynamics.lag_s)?,
        delay_s: measured(dynamics.delay_s)?,
        rate_limit_rad_per_s: dynamics.rate_limit_rad_per_s.and_then(measured),
        refresh_s: dynamics.refresh_s.and_then(measured),
        table: Table::try_from(rows).ok()?,
    })
}

/// To a millionth: microradians and microseconds.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// The file's text.
///
/// # Errors
/// Where it cannot be written as TOML, which would be our fault.
pub fn toml(calibration: &ServoCalibration) -> Result<String, toml::ser::Error> {
    let text = toml::to_string(calibration)?;
    Ok(format!(
        "# A servo's calibration by rig {}, for [[servo.channel]] calibration. Angles are counter-clockwise as the camera sees it.\n{text}",
        env!("CARGO_PKG_VERSION")
    ))
}

/// The result as text for people; `filmed` are the dynamics of servo and model's actuator together, as the film shows them.
pub fn text(calibrated: &Calibrated, filmed: &Dynamics, calibration: &ServoCalibration) -> String {
    let Calibrated { levels, dynamics } = calibrated;
    let mut out = format!(
        "channel {}: the link stood still {} times at {} levels\n\n  pulse [µs]   angle [rad]       ±   off the line\n",
        calibration.channel,
        levels.rests,
        levels.levels.len()
    );
    let slope = levels.rad_per_us.value;
    for level in &levels.levels {
        let off = level.angle_rad - levels.line_rad(level.pulse_us);
        // writing into a String cannot fail
        let _ = writeln!(
            out,
            "  {:>10.0}   {:>11.4}  {:.4}        {off:>+7.4}",
            level.pulse_us, level.angle_rad, level.std_rad
        );
    }
    out.push('\n');
    let mut say = |name: &str, what: String| {
        let _ = writeln!(out, "  {name:<14} {what}");
    };
    let Measured { value: zero, std: zero_std } = calibration.zero_pulse_us;
    let Measured { value: gain, std: gain_std } = calibration.us_per_rad;
    say("zero", format!("{:.1} ± {:.1} µs", zero.get(), zero_std.get()));
    let way = if slope < 0.0 { "clockwise (mirrored)" } else { "counter-clockwise" };
    say("gain", format!("{:.1} ± {:.2} µs/rad; a longer pulse turns it {way}", gain.get(), gain_std.get()));
    say(
        "dead band",
        format!("{} either way, with the play between horn and link", mrad(levels.deadband_rad)),
    );
    say("repeatability", format!("{:.1} mrad from one side", levels.repeatability_rad * 1e3));
    say_dynamics(dynamics, filmed, &mut say);
    out
}

fn say_dynamics(dynamics: &Dynamics, filmed: &Dynamics, say: &mut impl FnMut(&str, String)) {
    // the effect of the model's actuator is taken off where the model follows its command at all
    let through = |servo: Estimate, filmed: Estimate| match servo == filmed {
        true => String::new(),
        false => format!(" ({:.1} ms in the film, with that of the model's actuator)", filmed.value * 1e3),
    };
    say("lag", format!("{}{}", ms(dynamics.lag_s), through(dynamics.lag_s, filmed.lag_s)));
    let whose = "servo, board and camera, in addition to the lag";
    say("delay", format!("{}: {whose}{}", ms(dynamics.delay_s), through(dynamics.delay_s, filmed.delay_s)));
    say(
        "refresh",
        match dynamics.refresh_s {
            Some(period) => format!("it looks at its pulse every {}", ms(period)),
            None => "none found: it looks at its pulse too often".to_owned(),
        },
    );
    say(
        "rate",
        match dynamics.rate_limit_rad_per_s {
            Some(rate) => format!("{:.2} ± {:.2} rad/s at most", rate.value, rate.std),
            None => {
                format!(
                    "its limit was not reached: the command was at most {:.1} rad/s",
                    dynamics.command_rad_per_s
                )
            }
        },
    );
    say("unexplained", format!("{:.1} mrad, root mean square", dynamics.rms_rad * 1e3));
}

fn ms(estimate: Estimate) -> String {
    format!("{:.2} ± {:.2} ms", estimate.value * 1e3, estimate.std * 1e3)
}

fn mrad(estimate: Estimate) -> String {
    format!("{:.1} ± {:.1} mrad", estimate.value * 1e3, estimate.std * 1e3)
}

impl Levels {
    /// The straight line through the levels, at `pulse_us` \[rad\].
    fn line_rad(&self, pulse_us: f64) -> f64 {
        let count = self.levels.len() as f64;
        let mean_us = self.levels.iter().map(|level| level.pulse_us).sum::<f64>() / count;
        let mean_rad = self.levels.iter().map(|level| level.angle_rad).sum::<f64>() / count;
        mean_rad + self.rad_per_us.value * (pulse_us - mean_us)
    }
}
