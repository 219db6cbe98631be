//! How soft a constraint is: MuJoCo's `solref` and `solimp`.

use crate::scalar::Scalar;

/// MuJoCo's range of impedances and smallest divisor.
const IMPEDANCE_RANGE: [f64; 2] = [1e-4, 0.9999];
const DIVISOR_MIN: f64 = 1e-15;

/// How soft a constraint is, by MuJoCo's names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Softness {
    /// Time constant \[s\] and damping ratio; or, below 0, stiffness \[1/s2\] and damping \[1/s\].
    pub solref: [f64; 2],
    /// Least and greatest impedance, the depth over which it rises \[m\] or \[rad\], the middle of the rise, its power.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

impl Softness {
    /// With numbers out of range put into it, as MuJoCo does.
    pub(crate) fn in_range(self) -> Self {
        let [from, to, width, middle, power] = self.solimp;
        let kept = |impedance: f64| impedance.clamp(IMPEDANCE_RANGE[0], IMPEDANCE_RANGE[1]);
        Self { solimp: [kept(from), kept(to), width.max(0.0), kept(middle), power.max(1.0)], ..self }
    }

    /// Stiffness \[1/s2\] and damping \[1/s\] of the reference acceleration in steps of `h` \[s\], of which the time constant is at
    /// least two.
    pub(crate) fn spring(&self, h: f64) -> [f64; 2] {
        let ([first, second], most) = (self.solref, self.solimp[1]);
        if first > 0.0 {
            let first = first.max(2.0 * h);
            [1.0 / (most * first * second).powi(2).max(DIVISOR_MIN), 2.0 / (most * first).max(DIVISOR_MIN)]
        } else {
            [-first / (most * most), -second / most]
        }
    }

    /// How fast what it holds comes to rest at most \[1/s\].
    pub(crate) fn rate_per_s(&self) -> f64 {
        let [stiffness, damping] = self.spring(0.0);
        damping.max(stiffness.sqrt())
    }

    /// The impedance at this distance beyond the margin: rises over the width, as a power up to the middle and as its mirror
    /// image from there on.
    #[inline(always)]
    pub(crate) fn impedance<T: Scalar>(&self, beyond: T) -> T {
        let [from, to, width, middle, power] = self.solimp;
        if from == to || width <= DIVISOR_MIN {
            return T::from_f64(0.5 * (from + to));
        }
        let x = (beyond.abs() * T::from_f64(1.0 / width)).min(T::ONE);
        let raised = |x: T| match power {
            1.0 => x,
            2.0 => x * x,
            _ => T::select(T::ZERO.less(x), (x.ln() * T::from_f64(power)).exp(), T::ZERO),
        };
        let y = if power == 1.0 {
            x
        } else {
            let low = raised(x) * T::from_f64(middle.powf(1.0 - power));
            let high = T::ONE - raised(T::ONE - x) * T::from_f64((1.0 - middle).powf(1.0 - power));
            T::select(T::from_f64(middle).less(x), high, low)
        };
        T::from_f64(from) + y * T::from_f64(to - from)
    }
}
