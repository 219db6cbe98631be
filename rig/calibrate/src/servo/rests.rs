//! Where the servo stood still.

use ground::statistics::median;

use super::Film;

/// Shortest stand that is used \[s\] (chosen).
pub(super) const STAND_DURATION_MIN_S: f64 = 0.25;
/// The angle of a stand is averaged over this last share of it, in which water, lag and latency are over, up to this time before its end
/// \[s\], so that the next move has not begun (both chosen).
const STAND_AVERAGED_SHARE: f64 = 0.4;
const STAND_END_MARGIN_S: f64 = 0.03;
/// Fewest images of a stand (chosen).
const STAND_IMAGES_MIN: usize = 3;

/// A stand at one pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// The pulse \[µs\].
    pub(super) pulse_us: f64,
    /// Difference from the pulse before \[µs\]; none for the first stand.
    pub(super) move_us: Option<f64>,
    /// The angle \[rad\].
    pub(super) angle_rad: f64,
}

/// Stands in the order of the film; those with too few images are left out.
pub(super) fn rests(film: &Film) -> Vec<Rest> {
    let rest = |stand: Stand| {
        let lasts_s = stand.until_s - stand.from_s;
        let from = film
            .time_s
            .partition_point(|&t| t < stand.until_s - STAND_END_MARGIN_S - STAND_AVERAGED_SHARE * lasts_s);
        let until = film.time_s.partition_point(|&t| t < stand.until_s - STAND_END_MARGIN_S);
        (lasts_s >= STAND_DURATION_MIN_S && until >= from + STAND_IMAGES_MIN).then(|| Rest {
            pulse_us: stand.pulse_us,
            move_us: stand.move_us,
            angle_rad: middle(&film.angle_rad[from..until]),
        })
    };
    stands(film).into_iter().filter_map(rest).collect()
}

/// A stretch of the command with one pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stand {
    pub(super) pulse_us: f64,
    pub(super) move_us: Option<f64>,
    pub(super) from_s: f64,
    pub(super) until_s: f64,
}

/// All stands of `film`, those before and after the motion included.
pub(super) fn stands(film: &Film) -> Vec<Stand> {
    let (Some(&(first_s, first_us)), Some(&(last_s, last_us))) = (film.command.first(), film.command.last())
    else {
        return Vec::new();
    };
    let mut corners = vec![(film.time_s.first().map_or(first_s, |&t| t.min(first_s)), first_us)];
    corners.extend(&film.command);
    corners.push((film.time_s.last().map_or(last_s, |&t| t.max(last_s)), last_us));
    let mut stands: Vec<Stand> = Vec::new();
    for pair in corners.windows(2).filter(|pair| pair[0].1 == pair[1].1) {
        let ((from_s, pulse_us), (until_s, _)) = (pair[0], pair[1]);
        match stands.last_mut() {
            Some(last) if last.until_s == from_s && last.pulse_us == pulse_us => last.until_s = until_s,
            last => {
                let move_us = last.map(|last| pulse_us - last.pulse_us);
                stands.push(Stand { pulse_us, move_us, from_s, until_s });
            }
        }
    }
    stands
}

fn middle(angles: &[f64]) -> f64 {
    median(&mut angles.to_vec(), f64::total_cmp).unwrap_or(f64::NAN)
}
