//! Small steps to and fro: what it takes to move the link back.

use super::error::ServoCalibrateError;
use super::levels::{LEAST_STD_RAD, Levels, is_firm};
use super::rests::Rest;
use super::steps::Estimate;

/// Least small steps.
const LEAST: usize = 6;
/// Widths that are tried, and how often the best is looked at more closely.
const TRIED: usize = 60;
const CLOSER: usize = 12;

/// Half of the width of the dead zone that small steps show: a link that stays until what is commanded leads it.
pub(super) fn deadband(rests: &[Rest], levels: &Levels) -> Result<Estimate, ServoCalibrateError> {
    let film = (0..=rests.last().map_or(0, |rest| rest.film)).max_by_key(|film| {
        let small = |rest: &&Rest| rest.film == *film && rest.move_us.is_some() && !is_firm(rest, rests);
        rests.iter().filter(small).count()
    });
    let shown: Vec<&Rest> = rests.iter().filter(|rest| Some(rest.film) == film).collect();
    // from the last firm move before the first small one
    let small = shown.iter().position(|rest| rest.move_us.is_some() && !is_firm(rest, rests));
    let train = match small {
        Some(first) if first > 0 => &shown[first - 1..],
        _ => return Err(ServoCalibrateError::NoSmallSteps),
    };
    let count = train.iter().skip(1).take_while(|rest| !is_firm(rest, rests)).count();
    if count < LEAST {
        return Err(ServoCalibrateError::NoSmallSteps);
    }
    let train = &train[..=count];
    let rising = train[0].move_us.unwrap_or(0.0) * levels.rad_per_us.value > 0.0;
    let told: Vec<f64> = train.iter().map(|rest| levels.angle_rad(rest.pulse_us)).collect();
    let left = |half: f64| -> Vec<f64> {
        let mut at = if rising { told[0] - half } else { told[0] + half };
        let mut left: Vec<f64> = train
            .iter()
            .zip(&told)
            .map(|(rest, told)| {
                at = at.clamp(told - half, told + half);
                rest.angle_rad - at
            })
            .collect();
        // between levels the table is straight and the servo is not
        let mean = left.iter().sum::<f64>() / left.len() as f64;
        left.iter_mut().for_each(|x| *x -= mean);
        left
    };
    let squares = |half: f64| left(half).iter().map(|x| x * x).sum::<f64>();
    let widest = told.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max) / 2.0;
    let (mut half, mut step) = (0.0, widest / TRIED as f64);
    for k in 0..=TRIED {
        if squares(step * k as f64) < squares(half) {
            half = step * k as f64;
        }
    }
    for _ in 0..CLOSER {
        for other in [half - step, half + step] {
            if other >= 0.0 && squares(other) < squares(half) {
                half = other;
            }
        }
        step /= 2.0;
    }
    let bit = widest / TRIED as f64;
    let slope: f64 = left(half + bit).iter().zip(left(half)).map(|(a, b)| ((a - b) / bit).powi(2)).sum();
    let variance = squares(half) / (train.len() - 2) as f64;
    let std = (variance / slope.max(f64::MIN_POSITIVE)).sqrt().clamp(LEAST_STD_RAD, widest);
    Ok(Estimate { value: half, std })
}
