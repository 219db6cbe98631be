//! From the film of a servo that climbs a staircase of pulses to how it turns: table, dead zone, lag, rate limit, refresh period.
//!
//! [`motion()`] makes the motion. [`calibrate()`] is a pure function of the servo's command and the measured angle of its link: where it
//! stood still gives the table and the dead zone (`levels`), how it came there lag, rate limit, refresh period and delay (`steps`), by fitting
//! the servo model of `law` to the film. [`link`] computes the driven link's angle from keypoints, [`report`] writes the result.

mod error;
mod law;
mod least_squares;
mod levels;
pub mod link;
mod motion;
pub mod report;
mod rests;
mod steps;

pub use error::ServoCalibrateError;
pub use levels::{Level, Levels};
pub use motion::motion;
pub use steps::{Dynamics, Estimate};

/// One film of the servo.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Film {
    /// The command: time \[s\] and pulse \[µs\] of each corner, linear between them; times rise.
    pub command: Vec<(f64, f64)>,
    /// Times of the images \[s\].
    pub time_s: Vec<f64>,
    /// Measured angle of the link \[rad\], counter-clockwise as the camera sees it, shape as [`Film::time_s`].
    pub angle_rad: Vec<f64>,
}

/// Calibration of a servo from its film.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrated {
    /// Angle of each pulse, dead band and repeatability.
    pub levels: Levels,
    /// Lag, delay, rate limit and refresh period.
    pub dynamics: Dynamics,
}

impl Calibrated {
    /// The same without the effect of `simulated`, a link that the model's actuator moves by the same command: a film shows servo and actuator in
    /// series, and a fit has the actuator already. Where the link gives way under its load the servo's own angle is farther by that; delays and
    /// lags add up in what is late on average, and lags in the squares by which that is spread.
    pub fn without(&self, simulated: &Self) -> Self {
        let (mut levels, mut dynamics) = (self.levels.clone(), self.dynamics.clone());
        let sag_rad = |pulse_us: f64| self.levels.angle_rad(pulse_us) - simulated.levels.angle_rad(pulse_us);
        levels.shift(sag_rad);
        let (lag_s, lag_std_s, simulated_lag_s) =
            (self.dynamics.lag_s.value, self.dynamics.lag_s.std, simulated.dynamics.lag_s.value);
        let remaining_s = |lag_s: f64| (lag_s * lag_s - simulated_lag_s * simulated_lag_s).max(0.0).sqrt();
        let simulated_late_s = simulated_lag_s + simulated.dynamics.delay_s.value;
        let value = remaining_s(lag_s);
        dynamics.lag_s = Estimate { value, std: (remaining_s(lag_s + lag_std_s) - value).max(lag_std_s) };
        dynamics.delay_s.value += lag_s - simulated_late_s - value;
        dynamics.delay_s.std = dynamics.delay_s.std.hypot(dynamics.lag_s.std);
        Self { levels, dynamics }
    }
}

/// How the servo that `film` shows turns.
///
/// # Errors
/// [`ServoCalibrateError`], which says what the film lacks.
pub fn calibrate(film: &Film) -> Result<Calibrated, ServoCalibrateError> {
    calibrate_film(film, true)
}

/// The same for a servo that is known to follow its pulse continuously, as a simulated link does.
///
/// # Errors
/// [`ServoCalibrateError`].
pub fn calibrate_simulated(film: &Film) -> Result<Calibrated, ServoCalibrateError> {
    calibrate_film(film, false)
}

fn calibrate_film(film: &Film, may_refresh: bool) -> Result<Calibrated, ServoCalibrateError> {
    let levels = levels::levels(&rests::rests(film))?;
    let dynamics = steps::dynamics(film, &levels, may_refresh)?;
    Ok(Calibrated { levels, dynamics })
}

#[cfg(test)]
mod tests;
