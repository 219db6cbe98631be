//! The staircase: where each pulse leads, from either side.

use ground::statistics::{MEDIAN_TO_SIGMA, median};
use nalgebra::{DMatrix, DVector};

use super::error::ServoCalibrateError;
use super::rests::Rest;
use super::steps::Estimate;

/// A move of at least this share of the travel crosses any dead zone and belongs to the staircase (chosen).
const STAIRCASE_MOVE_SHARE_MIN: f64 = 0.1;
/// Fewest stands after such moves (chosen).
const STANDS_MIN: usize = 8;
/// A stand is misread if it is off by more than this many standard deviations and by more than this angle \[rad\] (both chosen).
const MISREAD_SIGMAS: f64 = 6.0;
const MISREAD_RAD: f64 = 1e-3;
/// Smallest standard deviation of a level \[rad\] (chosen): pulses are whole microseconds, and the servo's share of one is unknown.
pub(super) const LEVEL_STD_MIN_RAD: f64 = 1e-4;

/// A pulse of the staircase and where it leads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// The pulse \[µs\].
    pub pulse_us: f64,
    /// The angle, in the middle between those from either side \[rad\].
    pub angle_rad: f64,
    /// Its standard error \[rad\].
    pub std_rad: f64,
}

/// Result of the staircase.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    /// Levels by rising pulse; their angles all rise or all fall.
    pub levels: Vec<Level>,
    /// Number of stands they were computed from.
    pub rests: usize,
    /// Half of what the angle differs by when approached from either side \[rad\]: the servo's dead band and the play behind it, which
    /// no film of the link can separate.
    pub deadband_rad: Estimate,
    /// Standard deviation with which the servo comes back to a level from the same side \[rad\].
    pub repeatability_rad: f64,
    /// Slope of the straight line through the levels \[rad/µs\]; negative: mirrored.
    pub rad_per_us: Estimate,
    /// Pulse at angle zero \[µs\], on the table.
    pub zero_pulse_us: Estimate,
    /// Greatest distance of a level from the straight line \[rad\].
    pub off_line_rad: f64,
}

/// Whether the move to `rest` is one of the staircase of all `rests`.
pub(super) fn is_staircase_move(rest: &Rest, rests: &[Rest]) -> bool {
    let all = || rests.iter().map(|rest| rest.pulse_us);
    let travel = all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
    rest.move_us.is_some_and(|us| us.abs() >= STAIRCASE_MOVE_SHARE_MIN * travel)
}

/// Levels, dead band and repeatability together by least squares: angle = level - dead band in the direction of the approach.
pub(super) fn levels(rests: &[Rest]) -> Result<Levels, ServoCalibrateError> {
    let mut staircase: Vec<&Rest> = rests.iter().filter(|rest| is_staircase_move(rest, rests)).collect();
    let mut pulses: Vec<f64> = staircase.iter().map(|rest| rest.pulse_us).collect();
    pulses.sort_by(f64::total_cmp);
    pulses.dedup();
    let up = |rest: &&&Rest| rest.move_us.is_some_and(|us| us > 0.0);
    let ups = staircase.iter().filter(up).count();
    if staircase.len() < STANDS_MIN.max(pulses.len() + 3)
        || pulses.len() < 3
        || ups == 0
        || ups == staircase.len()
    {
        return Err(ServoCalibrateError::Levels {
            rests: staircase.len(),
            levels: pulses.len(),
            least: STANDS_MIN,
        });
    }
    let sign =
        line(&staircase.iter().map(|rest| (rest.pulse_us, rest.angle_rad)).collect::<Vec<_>>())[1].signum();
    let lacking =
        ServoCalibrateError::Levels { rests: staircase.len(), levels: pulses.len(), least: STANDS_MIN };
    let mut fit = Fit::of(&staircase, &pulses, sign).ok_or(lacking)?;
    let sizes: Vec<f64> = fit.residuals.iter().map(|r| r.abs()).collect();
    let usual = MEDIAN_TO_SIGMA * median(&mut sizes.clone(), f64::total_cmp).unwrap_or(0.0);
    let limit = (MISREAD_SIGMAS * usual).max(MISREAD_RAD);
    if sizes.iter().any(|size| *size > limit) {
        let retained: Vec<&Rest> =
            staircase.iter().zip(&sizes).filter(|(_, size)| **size <= limit).map(|(rest, _)| *rest).collect();
        if let Some(better) = Fit::of(&retained, &pulses, sign) {
            (staircase, fit) = (retained, better);
        }
    }
    let repeatability_rad = fit.std.max(LEVEL_STD_MIN_RAD);
    let levels: Vec<Level> = pulses
        .iter()
        .enumerate()
        .map(|(k, &pulse_us)| Level {
            pulse_us,
            angle_rad: fit.solution[k],
            std_rad: (repeatability_rad * fit.inverse[(k, k)].sqrt()).max(LEVEL_STD_MIN_RAD),
        })
        .collect();
    if let Some(pair) = levels.windows(2).find(|pair| (pair[1].angle_rad - pair[0].angle_rad) * sign <= 0.0) {
        return Err(ServoCalibrateError::NotMonotone { from_us: pair[0].pulse_us, to_us: pair[1].pulse_us });
    }
    let last = pulses.len();
    let deadband_std = (repeatability_rad * fit.inverse[(last, last)].sqrt()).max(LEVEL_STD_MIN_RAD);
    let mut found = Levels {
        rests: staircase.len(),
        deadband_rad: Estimate { value: fit.solution[last].max(0.0), std: deadband_std },
        repeatability_rad,
        rad_per_us: Estimate { value: 0.0, std: 0.0 },
        zero_pulse_us: Estimate { value: 0.0, std: 0.0 },
        off_line_rad: 0.0,
        levels,
    };
    found.straighten();
    Ok(found)
}

struct Fit {
    /// The levels and, last, the dead band.
    solution: DVector<f64>,
    inverse: DMatrix<f64>,
    residuals: Vec<f64>,
    std: f64,
}

impl Fit {
    /// None where `rests` do not determine the levels and the dead band.
    fn of(rests: &[&Rest], pulses: &[f64], sign: f64) -> Option<Self> {
        let width = pulses.len() + 1;
        let mut design = DMatrix::zeros(rests.len(), width);
        for (row, rest) in rests.iter().enumerate() {
            if let Some(k) = pulses.iter().position(|pulse| *pulse == rest.pulse_us) {
                design[(row, k)] = 1.0;
            }
            design[(row, width - 1)] = -sign * rest.move_us.unwrap_or(0.0).signum();
        }
        let angles = DVector::from_iterator(rests.len(), rests.iter().map(|rest| rest.angle_rad));
        let normal = design.transpose() * &design;
        // a level at an end is approached from one side: the others say what the dead band is
        let inverse = normal.try_inverse()?;
        let solution = &inverse * design.transpose() * &angles;
        let residuals = &angles - &design * &solution;
        let freedom = rests.len().saturating_sub(width).max(1) as f64;
        let std = (residuals.norm_squared() / freedom).sqrt();
        Some(Self { solution, inverse, residuals: residuals.iter().copied().collect(), std })
    }
}

/// Offset and slope of the straight line through points.
fn line(points: &[(f64, f64)]) -> [f64; 2] {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let along: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let spread: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    let slope = along / spread;
    [y - slope * x, slope]
}

impl Levels {
    /// Each level farther by `by_rad` of its pulse \[rad\].
    pub(super) fn shift(&mut self, by_rad: impl Fn(f64) -> f64) {
        for level in &mut self.levels {
            level.angle_rad += by_rad(level.pulse_us);
        }
        self.straighten();
    }

    /// The straight line through the levels, and where they are at zero.
    fn straighten(&mut self) {
        let count = self.levels.len() as f64;
        let points: Vec<(f64, f64)> =
            self.levels.iter().map(|level| (level.pulse_us, level.angle_rad)).collect();
        let [offset, slope] = line(&points);
        self.off_line_rad =
            points.iter().fold(0.0, |most, (us, rad)| f64::max(most, (rad - offset - slope * us).abs()));
        let mean_us = points.iter().map(|point| point.0).sum::<f64>() / count;
        let spread: f64 = points.iter().map(|point| (point.0 - mean_us).powi(2)).sum();
        let usual = self.levels.iter().map(|level| level.std_rad.powi(2)).sum::<f64>() / count;
        self.rad_per_us = Estimate { value: slope, std: (usual / spread).sqrt() };
        let nearest = self.levels.iter().map(|level| (level.angle_rad.abs(), level.std_rad));
        let std_rad =
            nearest.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(LEVEL_STD_MIN_RAD, |nearest| nearest.1);
        self.zero_pulse_us = Estimate { value: self.pulse_us(0.0), std: std_rad / slope.abs() };
    }

    /// Where `pulse_us` leads \[rad\].
    pub fn angle_rad(&self, pulse_us: f64) -> f64 {
        let next = self.levels.partition_point(|level| level.pulse_us <= pulse_us);
        let next = next.clamp(1, self.levels.len() - 1);
        let [a, b] = [self.levels[next - 1], self.levels[next]];
        a.angle_rad + (pulse_us - a.pulse_us) * (b.angle_rad - a.angle_rad) / (b.pulse_us - a.pulse_us)
    }

    fn pulse_us(&self, angle_rad: f64) -> f64 {
        let sign = self.rad_per_us.value.signum();
        let next = self.levels.partition_point(|level| sign * level.angle_rad <= sign * angle_rad);
        let next = next.clamp(1, self.levels.len() - 1);
        let [a, b] = [self.levels[next - 1], self.levels[next]];
        a.pulse_us + (angle_rad - a.angle_rad) * (b.pulse_us - a.pulse_us) / (b.angle_rad - a.angle_rad)
    }
}
