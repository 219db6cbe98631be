//! Several numbers side by side, each with its own motion: SIMD lanes.
//!
//! The instruction set is chosen when the program runs ([`Isa::best`]), so a plain build is fast on any machine. No
//! operation is contracted or reordered: a number's bits are the same in any lane of any instruction set, and the same as
//! computed alone.
//!
//! A lane type's operations are compiled for its instruction set only where they are inlined into a function that
//! enables it: see [`Scalar::tuned`].

#![allow(unsafe_code, reason = "instructions beyond the compiler's baseline")]

// The crate's own unit tests do without: a program of everything for each kind of lane takes minutes to build.
#[cfg(all(target_arch = "x86_64", not(test)))]
mod registers;
#[cfg(all(target_arch = "x86_64", not(test)))]
mod x86;

use crate::scalar::Scalar;

/// An instruction set that lanes can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// What every machine of the kind has; one number at a time.
    Baseline,
    /// Four numbers an instruction.
    Avx2,
    /// Eight numbers an instruction.
    Avx512,
}

impl Isa {
    /// Every instruction set of this machine, the widest last.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::Baseline];
        sets.extend(Self::wider());
        sets
    }

    #[cfg(all(target_arch = "x86_64", not(test)))]
    fn wider() -> impl Iterator<Item = Self> {
        let avx512 = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq");
        let found = [(is_x86_feature_detected!("avx2"), Self::Avx2), (avx512, Self::Avx512)];
        found.into_iter().filter(|(there, _)| *there).map(|(_, set)| set)
    }

    #[cfg(not(all(target_arch = "x86_64", not(test))))]
    fn wider() -> [Self; 0] {
        []
    }

    /// The widest instruction set of this machine.
    pub fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Baseline)
    }

    /// No machine has lanes for more candidates.
    pub(crate) const CANDIDATES_MAX: usize = 16;

    /// How many candidates share one pass, at most: two registers full.
    pub fn candidates(self) -> usize {
        match self {
            Self::Baseline => 1,
            Self::Avx2 => 8,
            Self::Avx512 => Self::CANDIDATES_MAX,
        }
    }

    /// How many directions of one candidate share one pass, at most: a register full, beside one of values.
    pub fn directions(self) -> usize {
        match self {
            Self::Baseline => 1,
            Self::Avx2 => 4,
            Self::Avx512 => 8,
        }
    }

    /// Itself, or the best of this machine where that lacks it; the widest only for work that is `wide`.
    fn here(self, wide: bool) -> Self {
        match if Self::available().contains(&self) { self } else { Self::best() } {
            Self::Avx512 if !wide => Self::Avx2,
            isa => isa,
        }
    }

    /// Its name as the world writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline if cfg!(target_arch = "x86_64") => "sse2",
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

/// Work that can be done in lanes of any kind.
pub(crate) trait InLanes {
    /// Result of the work.
    type Output;

    /// How many lanes it needs.
    fn wanted(&self) -> usize;

    /// Does the work in numbers of type `L`.
    fn with<L: Packed>(self) -> Self::Output;
}

/// Does `work` on plain numbers in the lanes of `isa`, or narrower ones that it fits into; one that this machine lacks is
/// replaced by its best.
pub(crate) fn dispatch<W: InLanes>(isa: Isa, work: W) -> W::Output {
    match isa.here(work.wanted() > Isa::Avx2.candidates()) {
        #[cfg(all(target_arch = "x86_64", not(test)))]
        Isa::Avx2 => work.with::<x86::TwoOfAvx2>(),
        #[cfg(all(target_arch = "x86_64", not(test)))]
        Isa::Avx512 => work.with::<x86::TwoOfAvx512>(),
        _ => work.with::<f64>(),
    }
}

/// The same for work on numbers with a derivative each, which fill the registers by themselves. A function of its own: what
/// is chosen at run time is compiled for every kind of lane.
pub(crate) fn dispatch_dual<W: InLanes>(isa: Isa, work: W) -> W::Output {
    match isa.here(work.wanted() > Isa::Avx2.directions()) {
        #[cfg(all(target_arch = "x86_64", not(test)))]
        Isa::Avx2 => work.with::<x86::OneOfAvx2>(),
        #[cfg(all(target_arch = "x86_64", not(test)))]
        Isa::Avx512 => work.with::<x86::OneOfAvx512>(),
        _ => work.with::<f64>(),
    }
}

/// A scalar whose lanes can be filled and read.
pub(crate) trait Packed: Scalar {
    /// From one value per lane.
    fn pack(value: impl FnMut(usize) -> f64) -> Self;

    /// The value in `lane`.
    fn lane(self, lane: usize) -> f64;

    /// Writes the values of all lanes to the front of `values`.
    fn unpack(self, values: &mut [f64]);
}

impl Packed for f64 {
    fn pack(mut value: impl FnMut(usize) -> f64) -> Self {
        value(0)
    }

    fn lane(self, _: usize) -> f64 {
        self
    }

    fn unpack(self, values: &mut [f64]) {
        values[0] = self;
    }
}
