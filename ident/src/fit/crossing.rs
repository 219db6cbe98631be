//! Where a profile of the likelihood crosses a limit.

use crate::parameters::Scale;

/// A step beyond the last point goes at least and at most this many times as far (chosen).
const STEP_GROWTH_RANGE: [f64; 2] = [1.05, 3.0];
/// Beyond this many times the limit, a rise is not used to interpolate where the limit is met (chosen).
const INTERPOLATION_RISE_RATIO_MAX: f64 = 4.0;

/// How closely a limit is met.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Closeness {
    /// As a share of the limit.
    pub(crate) met: f64,
    /// Most points tried.
    pub(crate) most_points: usize,
}

/// The end on one side of `best`, first sought at `next`, of where `rise`, the root of the cost's rise, stays below `limit`; the
/// bound of `scale` where it does not reach it before. In roots the rise is straight where all is linear, so the next point is
/// found by proportion; half way to where it is far beyond the limit, or where the best values of all others cannot be found.
pub(crate) fn crossing(
    best: f64,
    mut next: f64,
    limit: f64,
    scale: &Scale,
    closeness: Closeness,
    mut rise: impl FnMut(f64) -> f64,
) -> f64 {
    let (mut before, mut inside, mut outside) = ((best, 0.0), (best, 0.0), None);
    for _ in 0..closeness.most_points {
        let x = scale.clamp(next);
        if x == inside.0 {
            return x;
        }
        let risen = rise(x);
        if (risen / limit - 1.0).abs() <= closeness.met || x != next && risen < limit {
            return x;
        }
        if risen < limit {
            (before, inside) = (inside, (x, risen));
        } else {
            outside = Some((x, risen));
        }
        next = match outside {
            Some((far, high)) if high < INTERPOLATION_RISE_RATIO_MAX * limit => {
                inside.0 + (far - inside.0) * (limit - inside.1) / (high - inside.1)
            }
            Some((far, _)) => (inside.0 + far) / 2.0,
            None => {
                // as steeply as it rose last
                let further = (limit - inside.1) / (inside.1 - before.1).max(0.0) * (inside.0 - before.0);
                let growth = 1.0 + further / (inside.0 - best);
                best + (inside.0 - best) * growth.clamp(STEP_GROWTH_RANGE[0], STEP_GROWTH_RANGE[1])
            }
        };
    }
    scale.clamp(next)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOSENESS: Closeness = Closeness { met: 0.01, most_points: 8 };

    #[test]
    fn a_limit_is_met_whether_the_rise_is_straight_bent_or_broken_off() {
        let scale = Scale::new(-10.0, 10.0);
        for (next, rise, wanted) in [
            (0.5, (|x: f64| x) as fn(f64) -> f64, 2.0),
            (8.0, |x| x.sqrt() * 1.3, (2.0_f64 / 1.3).powi(2)),
            (9.0, |x| if x > 5.0 { f64::INFINITY } else { x }, 2.0),
            // as where a number comes near a bound at which the model is another
            (9.0, |x| if x > 8.9 { 100.0 } else { 0.25 * x }, 8.0),
            (0.2, |x| 0.7 * x.cbrt() + 0.6, 8.0),
        ] {
            let x = crossing(0.0, next, 2.0, &scale, CLOSENESS, rise);
            assert!((rise(x) / 2.0 - 1.0).abs() < 0.02, "{x}, wanted {wanted}");
        }
    }

    #[test]
    fn a_rise_that_never_reaches_the_limit_ends_at_the_bound() {
        let scale = Scale::new(-1.0, 1.0);
        assert_eq!(crossing(0.0, -0.3, 2.0, &scale, CLOSENESS, f64::abs), -1.0);
        assert_eq!(crossing(1.0, 1.3, 2.0, &scale, CLOSENESS, |_| 0.0), 1.0);
    }
}
