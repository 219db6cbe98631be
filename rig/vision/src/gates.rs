//! When an image is refused, and why.

use super::centreline::Centreline;
use super::config::Gates;
use super::rejection::Rejection;
use ground::statistics::{MEDIAN_TO_SIGMA, median};

/// A silhouette's measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// Arc length of the centreline \[px\].
    pub length_px: f64,
    /// Mean width \[px\].
    pub width_px: f64,
    /// Area \[px\].
    pub area_px: f64,
}

impl Sizes {
    /// The measures of a centreline in a silhouette of `area` pixels.
    pub fn of(line: &Centreline, area: usize) -> Self {
        Self { length_px: line.length_px, width_px: 2.0 * line.mean_half_width(), area_px: area as f64 }
    }

    /// The median of each measure; `None` without any.
    pub fn usual(of: &[Self]) -> Option<Self> {
        let middle = |measure: fn(&Self) -> f64| {
            median(&mut of.iter().map(measure).collect::<Vec<_>>(), f64::total_cmp)
        };
        Some(Self {
            length_px: middle(|s| s.length_px)?,
            width_px: middle(|s| s.width_px)?,
            area_px: middle(|s| s.area_px)?,
        })
    }

    /// Sigma of the length \[px\] among `of`, those that are far off left aside; 0 without any.
    pub fn length_scatter_px(of: &[Self]) -> f64 {
        let mut lengths: Vec<f64> = of.iter().map(|sizes| sizes.length_px).collect();
        let Some(middle) = median(&mut lengths, f64::total_cmp) else { return 0.0 };
        let mut off: Vec<f64> = lengths.iter().map(|length| (length - middle).abs()).collect();
        MEDIAN_TO_SIGMA * median(&mut off, f64::total_cmp).unwrap_or(0.0)
    }

    /// Compares the length of something that keeps its own with what is `usual`, whose sigma is `scatter_px`: an end that was lost is
    /// many of them short.
    ///
    /// # Errors
    /// [`Rejection::Unusual`].
    pub fn check_length(&self, usual: &Self, scatter_px: f64) -> Result<(), Rejection> {
        /// No noise reaches so far.
        const LOST_SIGMAS: f64 = 8.0;
        /// Nor what poses make of a blurred end.
        const LEAST_PX: f64 = 2.0;
        let (got, usual) = (self.length_px, usual.length_px);
        let limit_px = (LOST_SIGMAS * scatter_px).max(LEAST_PX);
        if (got - usual).abs() <= limit_px {
            return Ok(());
        }
        Err(Rejection::Unusual { what: "length", got, usual, limit: limit_px / usual })
    }

    /// Compares with what is `usual`.
    ///
    /// # Errors
    /// [`Rejection::Unusual`] for the first measure that is off.
    pub fn check(&self, usual: &Self, gates: &Gates) -> Result<(), Rejection> {
        let measures = [
            ("length", self.length_px, usual.length_px, gates.length),
            ("width", self.width_px, usual.width_px, gates.width),
            ("area", self.area_px, usual.area_px, gates.area),
        ];
        for (what, got, usual, limit) in measures {
            let limit = limit.get();
            if (got - usual).abs() > limit * usual {
                return Err(Rejection::Unusual { what, got, usual, limit });
            }
        }
        Ok(())
    }
}

/// Compares a redrawn shape's `overlap` with the gate.
///
/// # Errors
/// [`Rejection::Overlap`].
pub fn check_overlap(overlap: f64, gates: &Gates) -> Result<(), Rejection> {
    let limit = gates.overlap.get();
    if overlap < limit { Err(Rejection::Overlap { overlap, limit }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_off_by_more_than_its_gate_is_refused_by_name() {
        let usual = Sizes { length_px: 100.0, width_px: 10.0, area_px: 900.0 };
        let gates = Gates::default();
        assert_eq!(Sizes { length_px: 114.0, ..usual }.check(&usual, &gates), Ok(()));
        let message = Sizes { length_px: 80.0, ..usual }.check(&usual, &gates).unwrap_err().to_string();
        assert_eq!(message, "length is 80.0 px, usually 100.0 px: off by more than 15 %");
    }

    #[test]
    fn usual_size_is_the_median_and_ignores_one_outlier() {
        let size = |length_px| Sizes { length_px, width_px: 1.0, area_px: 1.0 };
        assert_eq!(Sizes::usual(&[size(1.0), size(900.0), size(2.0)]).unwrap().length_px, 2.0);
        assert_eq!(Sizes::usual(&[]), None);
    }
}
