//! An expression made ready to be worked out: a list of operations on a short stack, the same for every kind of number.

use crate::scalar::{Scalar, tuned};

/// What an expression may ask of the instant, each with its place among the values that are handed in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Variable {
    Q,
    V,
    Command,
    X,
    Y,
    Z,
    Angle,
    Vx,
    Vy,
    Vz,
    Rate,
    T,
}

/// Number of variables.
pub(super) const VARIABLES: usize = 12;

impl Variable {
    pub(super) const ALL: [Self; VARIABLES] = [
        Self::Q,
        Self::V,
        Self::Command,
        Self::X,
        Self::Y,
        Self::Z,
        Self::Angle,
        Self::Vx,
        Self::Vy,
        Self::Vz,
        Self::Rate,
        Self::T,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Q => "q",
            Self::V => "v",
            Self::Command => "command",
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::Angle => "angle",
            Self::Vx => "vx",
            Self::Vy => "vy",
            Self::Vz => "vz",
            Self::Rate => "rate",
            Self::T => "t",
        }
    }

    /// Further from 0 than this \[SI\] it will hardly be in a tank: where expressions are tried.
    pub(super) fn reach(self) -> f64 {
        match self {
            Self::Q | Self::Angle => 4.0,
            Self::V | Self::Rate | Self::T => 20.0,
            Self::Command => 1.5,
            Self::X | Self::Y | Self::Z => 0.3,
            Self::Vx | Self::Vy | Self::Vz => 1.0,
        }
    }
}

/// What the instant is, in the order of [`Variable::ALL`]; only what a program asks for need be filled in.
pub(super) type Values<T> = [T; VARIABLES];

/// A function of one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum One {
    Neg,
    Sin,
    Cos,
    Tan,
    Exp,
    Log,
    Sqrt,
    Abs,
    Sign,
    Tanh,
}

/// A function of two numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Two {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
    Min,
    Max,
    Atan2,
}

/// One step of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Op {
    Constant(f64),
    Variable(usize),
    Parameter(usize),
    One(One),
    Two(Two),
    /// A whole power.
    Power(i32),
}

/// Size of the stack of intermediate results (chosen).
pub(super) const STACK_DEPTH: usize = 16;
/// Largest whole power that is computed as a product (chosen).
pub(super) const WHOLE_POWER_MAX: i32 = 16;

/// An expression as operations, each on what those before it have left.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Program {
    pub(super) ops: Vec<Op>,
}

impl Program {
    /// Whether it asks for `variable`.
    pub(super) fn asks(&self, variable: Variable) -> bool {
        self.ops.contains(&Op::Variable(variable as usize))
    }

    /// Whether it asks for the parameter at `place`.
    pub(super) fn asks_parameter(&self, place: usize) -> bool {
        self.ops.contains(&Op::Parameter(place))
    }

    /// How many numbers wait at most.
    pub(super) fn depth(&self) -> usize {
        let (mut now, mut most) = (0_usize, 0);
        for op in &self.ops {
            match op {
                Op::Constant(_) | Op::Variable(_) | Op::Parameter(_) => now += 1,
                Op::One(_) | Op::Power(_) => {}
                Op::Two(_) => now -= 1,
            }
            most = most.max(now);
        }
        most
    }

    /// Its value. Compiled once for each kind of number, whatever asks.
    #[inline(never)]
    pub(super) fn value<T: Scalar>(&self, variables: &Values<T>, parameters: &[T]) -> T {
        tuned!(T, self.run(variables, parameters))
    }

    #[inline(always)]
    fn run<T: Scalar>(&self, variables: &Values<T>, parameters: &[T]) -> T {
        let mut stack = [T::ZERO; STACK_DEPTH];
        let mut top = 0;
        for op in &self.ops {
            match *op {
                Op::Constant(x) => {
                    stack[top] = T::from_f64(x);
                    top += 1;
                }
                Op::Variable(place) => {
                    stack[top] = variables[place];
                    top += 1;
                }
                Op::Parameter(place) => {
                    stack[top] = parameters[place];
                    top += 1;
                }
                Op::One(function) => stack[top - 1] = one(function, stack[top - 1]),
                Op::Two(function) => {
                    top -= 1;
                    stack[top - 1] = two(function, stack[top - 1], stack[top]);
                }
                Op::Power(exponent) => stack[top - 1] = power(stack[top - 1], exponent),
            }
        }
        stack[0]
    }
}

#[inline(always)]
pub(super) fn one<T: Scalar>(function: One, x: T) -> T {
    match function {
        One::Neg => -x,
        One::Sin => x.sin_cos().0,
        One::Cos => x.sin_cos().1,
        One::Tan => {
            let (sin, cos) = x.sin_cos();
            sin / cos
        }
        One::Exp => x.exp(),
        One::Log => x.ln(),
        One::Sqrt => x.sqrt(),
        One::Abs => x.abs(),
        One::Sign => T::select(x.less(T::ZERO), -T::ONE, T::select(T::ZERO.less(x), T::ONE, T::ZERO)),
        One::Tanh => tanh(x),
    }
}

#[inline(always)]
pub(super) fn two<T: Scalar>(function: Two, a: T, b: T) -> T {
    match function {
        Two::Add => a + b,
        Two::Sub => a - b,
        Two::Mul => a * b,
        Two::Div => a / b,
        Two::Min => a.min(b),
        Two::Max => a.max(b),
        Two::Atan2 => a.atan2(b),
        // 0 to any power counts as 0, with derivative 0; below 0 it is no number
        Two::Pow => T::select(a.less(T::ZERO) | T::ZERO.less(a), (b * a.ln()).exp(), T::ZERO),
    }
}

/// A whole power, by squaring.
#[inline(always)]
pub(super) fn power<T: Scalar>(x: T, exponent: i32) -> T {
    let (mut square, mut left, mut product) = (x, exponent.unsigned_abs(), T::ONE);
    let mut begun = false;
    while left > 0 {
        if left & 1 == 1 {
            product = if begun { product * square } else { square };
            begun = true;
        }
        left >>= 1;
        if left > 0 {
            square = square * square;
        }
    }
    if exponent < 0 { T::ONE / product } else { product }
}

/// The hyperbolic tangent: near 0, where the quotient of exponentials loses digits, its series.
#[inline(always)]
fn tanh<T: Scalar>(x: T) -> T {
    /// Largest argument for the series: its next term is below 1e-16 of the sum there.
    const SERIES_ARGUMENT_MAX: f64 = 0.15;
    const SERIES: [f64; 7] = [
        -1.0 / 3.0,
        2.0 / 15.0,
        -17.0 / 315.0,
        62.0 / 2835.0,
        -1382.0 / 155_925.0,
        21844.0 / 6_081_075.0,
        -929_569.0 / 638_512_875.0,
    ];
    let squared = x * x;
    let mut sum = T::ZERO;
    for term in SERIES.into_iter().rev() {
        sum = (sum + T::from_f64(term)) * squared;
    }
    let near = x + x * sum;
    let far = T::ONE - T::from_f64(2.0) / ((x + x).exp() + T::ONE);
    T::select(x.abs().less(T::from_f64(SERIES_ARGUMENT_MAX)), near, far)
}
