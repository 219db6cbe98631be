//! Films of a servo that climbs a staircase of pulses, to how it turns: table, dead zone, lag, rate limit, looks.
//!
//! [`motion`] makes the motions. [`calibrate()`] is a pure function of what the servo was told and where its link was seen: where it
//! stood still gives the table and the hysteresis (`levels`), small steps to and fro the dead band (`deadband`), quick steps lag, rate
//! limit, looks and delay (`steps`), by laying a servo that follows `law` on them. [`link`] reads the driven link's angle off keypoints,
//! [`report`] says what came out.

mod deadband;
mod error;
mod law;
mod least_squares;
mod levels;
pub mod link;
pub mod motion;
pub mod report;
mod rests;
mod steps;

pub use error::ServoCalibrateError;
pub use levels::{Level, Levels};
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

/// What films of a servo say.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrated {
    /// The table, and how well it is kept.
    pub levels: Levels,
    /// Half of the smallest change that moves it back after it has turned round \[rad\].
    pub deadband_rad: Estimate,
    /// How it follows.
    pub dynamics: Dynamics,
}

/// How the servo that `films` show turns.
///
/// # Errors
/// [`ServoCalibrateError`], which says what is not to be seen.
pub fn calibrate(films: &[Film]) -> Result<Calibrated, ServoCalibrateError> {
    let rests = rests::rests(films);
    let levels = levels::levels(&rests)?;
    let deadband_rad = deadband::deadband(&rests, &levels)?;
    let dynamics = steps::dynamics(films, &levels)?;
    Ok(Calibrated { levels, deadband_rad, dynamics })
}

#[cfg(test)]
mod tests;
