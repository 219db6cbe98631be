//! The film of a servo that climbs a staircase of pulses, to how it turns: table, dead zone, lag, rate limit, looks.
//!
//! [`motion()`] makes the motion. [`calibrate()`] is a pure function of what the servo was told and where its link was seen: where it
//! stood still gives the table and the dead zone (`levels`), how it came there lag, rate limit, looks and delay (`steps`), by laying a
//! servo that follows `law` on the film. [`link`] reads the driven link's angle off keypoints, [`report`] says what came out.

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
    /// What the servo was told: time \[s\] and pulse \[µs\] of each corner, straight between them; times rise.
    pub told: Vec<(f64, f64)>,
    /// When its link was seen \[s\].
    pub time_s: Vec<f64>,
    /// Where \[rad\], counter-clockwise as the camera sees it, shape as [`Film::time_s`].
    pub angle_rad: Vec<f64>,
}

/// What the film of a servo says.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrated {
    /// The table, and how well it is kept.
    pub levels: Levels,
    /// How it follows.
    pub dynamics: Dynamics,
}

impl Calibrated {
    /// The same without what `own` does, a link that the model's own actuator moves the same way: a film shows both, one behind the other,
    /// and a fit has one of them already. Where the link gives way under its load the servo's own angle is farther by that; delays and
    /// lags add up in what is late on average, and lags in the squares by which that is spread.
    pub fn without(&self, own: &Self) -> Self {
        let (mut levels, mut dynamics) = (self.levels.clone(), self.dynamics.clone());
        let sag_rad = |pulse_us: f64| self.levels.angle_rad(pulse_us) - own.levels.angle_rad(pulse_us);
        levels.shift(sag_rad);
        let (lag_s, lag_std_s, own_s) =
            (self.dynamics.lag_s.value, self.dynamics.lag_s.std, own.dynamics.lag_s.value);
        let beside = |lag_s: f64| (lag_s * lag_s - own_s * own_s).max(0.0).sqrt();
        let own_late_s = own_s + own.dynamics.delay_s.value;
        let value = beside(lag_s);
        dynamics.lag_s = Estimate { value, std: (beside(lag_s + lag_std_s) - value).max(lag_std_s) };
        dynamics.delay_s.value += lag_s - own_late_s - value;
        dynamics.delay_s.std = dynamics.delay_s.std.hypot(dynamics.lag_s.std);
        Self { levels, dynamics }
    }
}

/// How the servo that `film` shows turns.
///
/// # Errors
/// [`ServoCalibrateError`], which says what is not to be seen.
pub fn calibrate(film: &Film) -> Result<Calibrated, ServoCalibrateError> {
    seen(film, true)
}

/// The same of what is known to look at its pulse all the time, as a simulated link does.
///
/// # Errors
/// [`ServoCalibrateError`].
pub fn calibrate_simulated(film: &Film) -> Result<Calibrated, ServoCalibrateError> {
    seen(film, false)
}

fn seen(film: &Film, may_look: bool) -> Result<Calibrated, ServoCalibrateError> {
    let levels = levels::levels(&rests::rests(film))?;
    let dynamics = steps::dynamics(film, &levels, may_look)?;
    Ok(Calibrated { levels, dynamics })
}

#[cfg(test)]
mod tests;
