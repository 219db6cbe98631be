//! From a parameter's bounds to the unit interval and back.

/// Bounds of a parameter and how the unit interval is spread over them.
///
/// A coefficient of known size (fluid coefficients, masses) is spread evenly. A joint's damping, friction loss
/// and stiffness may be anything between nothing and a size that stops the mechanism, over decades: these are
/// spread evenly below a knee and logarithmically above it, so that exactly 0 stays within reach. Bounds above
/// 0 that span more than two decades are spread logarithmically.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    lower: f64,
    upper: f64,
    spread: Spread,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Spread {
    Even,
    Logarithmic,
    /// Even up to about this far above the lower bound, logarithmic further up.
    Knee(f64),
    /// Bounds that coincide, with the resolution they had before.
    Pinned(f64),
}

/// A value this share of the bounds' width from a bound lies on it: rounding puts it no further off.
pub(crate) const ON_BOUND_SHARE: f64 = 1e-9;
/// The knee as a share of the bounds' width (chosen): four decades are spread logarithmically.
const KNEE_WIDTH_SHARE: f64 = 1e-4;
/// Bounds above 0 whose ratio is larger than this are spread logarithmically (chosen).
const LOGARITHMIC_BOUNDS_RATIO: f64 = 100.0;
/// Largest factor by which one step of a descent multiplies or divides a value (chosen).
const STEP_RATIO_MAX: f64 = 10.0;
/// Resolution of an evenly spread scale, as a share of the bounds' width (chosen).
const RESOLUTION_WIDTH_SHARE: f64 = 0.05;

impl Scale {
    /// Bounds spread evenly, or logarithmically where both lie above 0 and far apart.
    pub fn new(lower: f64, upper: f64) -> Self {
        let wide = lower > 0.0 && upper / lower > LOGARITHMIC_BOUNDS_RATIO;
        Self { lower, upper, spread: if wide { Spread::Logarithmic } else { Spread::Even } }
    }

    /// Bounds of a quantity whose size is not known beforehand.
    pub fn with_knee(lower: f64, upper: f64) -> Self {
        if lower == 0.0 {
            Self { lower, upper, spread: Spread::Knee(KNEE_WIDTH_SHARE * upper) }
        } else {
            Self::new(lower, upper)
        }
    }

    /// Bounds that leave nothing but `value`.
    pub(crate) fn pinned(&self, value: f64) -> Self {
        Self { lower: value, upper: value, spread: Spread::Pinned(self.resolution()) }
    }

    /// Lower bound.
    pub fn lower(&self) -> f64 {
        self.lower
    }

    /// Upper bound.
    pub fn upper(&self) -> f64 {
        self.upper
    }

    /// Distance between the bounds.
    pub fn width(&self) -> f64 {
        self.upper - self.lower
    }

    /// The value at `unit`, between 0 and 1.
    pub fn value(&self, unit: f64) -> f64 {
        let value = match self.spread {
            Spread::Even | Spread::Pinned(_) => self.lower + unit * self.width(),
            Spread::Logarithmic => self.lower * (unit * (self.upper / self.lower).ln()).exp(),
            Spread::Knee(knee) => self.lower + knee * (unit * (self.width() / knee).ln_1p()).exp_m1(),
        };
        self.clamp(value)
    }

    /// Where `value`, clamped to the bounds, lies between 0 and 1.
    pub fn unit(&self, value: f64) -> f64 {
        let value = self.clamp(value);
        let unit = match self.spread {
            Spread::Pinned(_) => 0.0,
            Spread::Even => (value - self.lower) / self.width(),
            Spread::Logarithmic => (value / self.lower).ln() / (self.upper / self.lower).ln(),
            Spread::Knee(knee) => ((value - self.lower) / knee).ln_1p() / (self.width() / knee).ln_1p(),
        };
        unit.clamp(0.0, 1.0)
    }

    /// `value`, no further than the bounds.
    pub fn clamp(&self, value: f64) -> f64 {
        value.clamp(self.lower, self.upper)
    }

    /// A change too small to matter where the value itself is 0.
    pub fn resolution(&self) -> f64 {
        match self.spread {
            Spread::Even => RESOLUTION_WIDTH_SHARE * self.width(),
            Spread::Logarithmic => self.lower,
            Spread::Knee(knee) => knee,
            Spread::Pinned(resolution) => resolution,
        }
    }

    /// How far one step of a descent may go from `value`: over a decade of a quantity whose size is not known. The
    /// slope says little about what lies further, and a joint that too large a step has frozen stays so.
    pub(crate) fn reach(&self, value: f64) -> [f64; 2] {
        let upper = match self.spread {
            Spread::Even | Spread::Pinned(_) => self.upper,
            Spread::Logarithmic => self.clamp(STEP_RATIO_MAX * value),
            Spread::Knee(knee) => self.clamp(self.lower + STEP_RATIO_MAX * (value - self.lower).max(knee)),
        };
        let lower = match self.spread {
            Spread::Logarithmic => self.clamp(value / STEP_RATIO_MAX),
            Spread::Even | Spread::Pinned(_) | Spread::Knee(_) => self.lower,
        };
        [lower, upper]
    }

    /// As good as nothing where it is a joint's resistance, else `value`.
    pub(crate) fn loose(&self, value: f64) -> f64 {
        match self.spread {
            Spread::Knee(_) => self.start(self.lower),
            Spread::Even | Spread::Pinned(_) | Spread::Logarithmic => value,
        }
    }

    /// A start away from a bound at which a knee's scale is blind.
    pub(super) fn start(&self, value: f64) -> f64 {
        match self.spread {
            // At exactly nothing, friction and damping have no slope to follow.
            Spread::Knee(knee) => self.clamp(value.max(self.lower + knee)),
            Spread::Even | Spread::Pinned(_) | Spread::Logarithmic => self.clamp(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Exponential and logarithm cost a few units in the last place, times the ratio of the scale's ends.
    const ROUNDING: f64 = 1e-11;

    #[test]
    fn both_ends_and_exactly_nothing_are_within_reach() {
        for scale in
            [Scale::new(0.0, 10.0), Scale::new(1e-6, 1.0), Scale::with_knee(0.0, 3e-4), Scale::new(-2.0, 1.0)]
        {
            assert_eq!(scale.value(0.0), scale.lower());
            assert!((scale.value(1.0) - scale.upper()).abs() <= ROUNDING * scale.upper());
            assert_eq!([scale.unit(scale.lower()), scale.unit(scale.upper())], [0.0, 1.0]);
        }
    }

    #[test]
    fn each_decade_above_the_knee_takes_the_same_room() {
        let scale = Scale::with_knee(0.0, 1.0);
        let rooms = [1e-2, 1e-1, 1.0].map(|x| scale.unit(x) - scale.unit(x / 10.0));
        assert!(rooms.iter().all(|room| (room - 0.25).abs() < 0.02), "{rooms:?}");
    }

    proptest! {
        #[test]
        fn unit_and_value_are_inverse(unit in 0.0..1.0f64, upper in 1e-6..1e3f64, share in 1e-5..0.5f64) {
            for scale in [Scale::new(0.0, upper), Scale::new(share * upper, upper), Scale::with_knee(0.0, upper)] {
                prop_assert!((scale.unit(scale.value(unit)) - unit).abs() < ROUNDING);
            }
        }
    }
}
