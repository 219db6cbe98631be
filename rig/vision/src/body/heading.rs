//! Which way a body heads: one of its long axis's two directions, followed from image to image and decided for all images of a film
//! together.

use std::f64::consts::{FRAC_PI_2, PI};

use super::moments::Moments;
use crate::config::Ahead;

/// What an image says of which end is ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ends {
    /// Skewness along the heading that it was given; below 0 where the blunt end is ahead. And its sigma.
    pub(super) skew: f64,
    pub(super) skew_std: f64,
}

/// A body's headings through a film.
#[derive(Debug, Default)]
pub(super) struct Headings {
    /// Time \[s\] and heading in the picture \[rad\] of the latest two images, the latest last; not wrapped.
    latest: Vec<(f64, f64)>,
    /// For each image taken so far: which stretch without a break it belongs to, and what it says of the ends.
    images: Vec<Option<(usize, Ends)>>,
    /// Stretches begun.
    stretches: usize,
}

/// Turned by more than this beside a right angle from where it was expected, either direction may be the one \[rad\].
const CLEAR_TURN_RAD: f64 = 0.4;
/// A body is not expected to turn on for longer than this many times the way from the image before the last one.
const LONGEST_GAP: f64 = 4.0;
/// Less skewed bodies are alike at both ends: light and lens make as much of a symmetric one.
pub(super) const LEAST_SKEW: f64 = 0.02;
/// What ends must differ by in sigmas.
pub(super) const CLEAR_SIGMAS: f64 = 5.0;

/// What is known of which end is ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    /// It is.
    Sure,
    /// The two ends look alike.
    Alike,
}

impl Headings {
    /// The heading of the next image \[rad\], of a body that was seen as `moments` say; none where it was not.
    pub(super) fn take(&mut self, time_s: f64, moments: Option<&Moments>, ahead: Ahead) -> Option<f64> {
        let Some(moments) = moments else {
            self.images.push(None);
            return None;
        };
        let axis = moments.axis_rad;
        let (heading, begins) = match self.expected(time_s) {
            Some(expected) => {
                let turns = ((expected - axis) / PI).round();
                let heading = axis + turns * PI;
                let unclear = FRAC_PI_2 - (heading - expected).abs() < CLEAR_TURN_RAD;
                if unclear { (self.by_itself(moments, ahead), true) } else { (heading, false) }
            }
            None => (self.by_itself(moments, ahead), true),
        };
        self.stretches += usize::from(begins);
        if begins {
            self.latest.clear();
        } else if self.latest.len() == 2 {
            self.latest.remove(0);
        }
        self.latest.push((time_s, heading));
        // Turning round the direction turns the sign of what lies along it.
        let skew = if (heading - axis).cos() > 0.0 { moments.skew } else { -moments.skew };
        self.images.push(Some((self.stretches - 1, Ends { skew, skew_std: moments.skew_std })));
        Some(heading)
    }

    /// Where it heads if it turns on as it did.
    fn expected(&self, time_s: f64) -> Option<f64> {
        match self.latest[..] {
            [(before_s, before), (latest_s, latest)] => {
                let share = (time_s - latest_s) / (latest_s - before_s).max(f64::MIN_POSITIVE);
                (share > 0.0 && share <= LONGEST_GAP).then_some(latest + share * (latest - before))
            }
            [(_, latest)] => Some(latest),
            _ => None,
        }
    }

    /// The direction that one image alone tells; the first one's is what somebody says, if anybody does.
    fn by_itself(&self, moments: &Moments, ahead: Ahead) -> f64 {
        let axis = moments.axis_rad;
        let wanted = match ahead {
            Ahead::Blunt | Ahead::Pointed => None,
            Ahead::Right => Some([1.0, 0.0]),
            Ahead::Left => Some([-1.0, 0.0]),
            // Picture rows grow downward.
            Ahead::Up => Some([0.0, -1.0]),
            Ahead::Down => Some([0.0, 1.0]),
        };
        let backwards = match wanted.filter(|_| self.stretches == 0) {
            Some([x, y]) => axis.cos() * x + axis.sin() * y < 0.0,
            None => (moments.skew > 0.0) != (ahead == Ahead::Pointed),
        };
        if backwards { axis + PI } else { axis }
    }

    /// For each image whether it heads the other way than was said, and how sure that is: all images of a stretch without a break
    /// together tell. Where somebody `said` which end is ahead in the first image, that holds for its stretch, and what the ends then look
    /// like for the others.
    pub(super) fn settled(&self, ahead: Ahead) -> Vec<Option<(bool, Known)>> {
        let said = !matches!(ahead, Ahead::Blunt | Ahead::Pointed);
        let means: Vec<Ends> = (0..self.stretches).map(|stretch| self.mean(stretch)).collect();
        let clear = |ends: &Ends| ends.skew.abs() > (CLEAR_SIGMAS * ends.skew_std).max(LEAST_SKEW);
        // Which sign the skewness has where the right end is ahead.
        let sign = match ahead {
            Ahead::Blunt => -1.0,
            Ahead::Pointed => 1.0,
            _ => means.first().map_or(-1.0, |ends| ends.skew.signum()),
        };
        let settled = |&(stretch, _): &(usize, Ends)| {
            let ends = &means[stretch];
            let clear_here = clear(ends) && (!said || clear(&means[0]));
            match said && stretch == 0 {
                true => (false, Known::Sure),
                false if clear_here => (ends.skew.signum() != sign, Known::Sure),
                false => (false, Known::Alike),
            }
        };
        self.images.iter().map(|image| image.as_ref().map(settled)).collect()
    }

    /// The weighted mean of a stretch.
    fn mean(&self, stretch: usize) -> Ends {
        let own = self.images.iter().flatten().filter(|(of, _)| *of == stretch).map(|(_, ends)| ends);
        let (mut sum, mut weights) = (0.0, 0.0);
        for ends in own {
            let weight = ends.skew_std.powi(-2);
            sum += weight * ends.skew;
            weights += weight;
        }
        Ends { skew: sum / weights, skew_std: weights.powf(-0.5) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body of the given skewness whose blunt end heads for `heading`; its axis is told in (-π/2, π/2].
    fn seen(heading: f64, skew: f64) -> Moments {
        let axis_rad = (heading.sin() * heading.cos().signum()).atan2(heading.cos().abs());
        let ahead = (heading - axis_rad).cos() > 0.0;
        Moments {
            area_px: 1000.0,
            centroid: [0.0; 2],
            centroid_std_px: 0.01,
            variances: [200.0, 40.0],
            axis_rad,
            axis_std_rad: 1e-3,
            skew: if ahead { -skew } else { skew },
            skew_std: 0.01,
            foreign_px: 0,
        }
    }

    #[test]
    fn a_heading_is_followed_over_whole_turns() {
        let mut headings = Headings::default();
        for i in 0..100 {
            let heading = 0.3 * f64::from(i);
            let got = headings.take(f64::from(i), Some(&seen(heading, 0.2)), Ahead::Blunt).unwrap();
            assert!((got - heading).abs() < 1e-9, "{i}: {got} {heading}");
        }
        assert!(headings.settled(Ahead::Blunt).iter().all(|one| *one == Some((false, Known::Sure))));
    }

    #[test]
    fn what_one_image_cannot_tell_all_together_do() {
        let mut headings = Headings::default();
        // The first image misleads.
        headings.take(0.0, Some(&seen(0.1, -0.02)), Ahead::Blunt);
        for i in 1..40 {
            headings.take(f64::from(i), Some(&seen(0.1, 0.03)), Ahead::Blunt);
        }
        assert!(headings.settled(Ahead::Blunt).iter().all(|one| *one == Some((true, Known::Sure))));
    }

    #[test]
    fn alike_ends_are_called_so_unless_somebody_says_which_is_ahead() {
        for (ahead, known) in [(Ahead::Blunt, Known::Alike), (Ahead::Left, Known::Sure)] {
            let mut headings = Headings::default();
            let got: Vec<f64> =
                (0..9).filter_map(|i| headings.take(f64::from(i), Some(&seen(0.1, 0.0)), ahead)).collect();
            assert!(got.iter().all(|one| one.cos() < 0.0) == (ahead == Ahead::Left), "{got:?}");
            assert!(headings.settled(ahead).iter().all(|one| *one == Some((false, known))));
        }
    }

    #[test]
    fn after_a_break_the_ends_tell_anew() {
        let mut headings = Headings::default();
        for i in 0..5 {
            headings.take(f64::from(i), Some(&seen(0.0, 0.2)), Ahead::Right);
        }
        for i in 5..15 {
            headings.take(f64::from(i), None, Ahead::Right);
        }
        let got = headings.take(15.0, Some(&seen(2.5, 0.2)), Ahead::Right).unwrap();
        assert!((got - 2.5).cos() > 0.99, "{got}");
        assert_eq!(headings.settled(Ahead::Right)[15], Some((false, Known::Sure)));
    }
}
