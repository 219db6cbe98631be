//! What a cause between command and drive may do.
//!
//! A command is straight between its rows. Every stage is exact on straight pieces: it hands on as many pieces as its law has
//! corners, so that neither the rows' spacing nor the integrator's step plays a part, and derivatives are exact too.

use crate::command::Command;
use crate::model::cause::CauseValues;
use crate::scalar::Scalar;

/// A straight piece of a command.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece<T> {
    /// Where it starts.
    pub(crate) from: T,
    /// Where it ends.
    pub(crate) to: T,
    /// When it starts \[s\], as the command's rows are timed.
    pub(crate) start_s: T,
    /// How long it takes \[s\], 0 or more.
    pub(crate) duration: T,
}

impl<T: Scalar> Piece<T> {
    /// Change per second; 0 where it takes no time.
    #[inline(always)]
    pub(crate) fn slope(&self) -> T {
        let lasts = T::ZERO.less(self.duration);
        T::select(lasts, (self.to - self.from) / T::select(lasts, self.duration, T::ONE), T::ZERO)
    }
}

/// One stage cuts a piece in four, two others in two.
const MOST_PIECES: usize = 16;

/// What a stage keeps from one piece to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kept<T> {
    /// Where the last piece handed on ended.
    pub(crate) end: T,
    /// The command it last looked at, where it looks at it now and then.
    pub(crate) seen: T,
}

impl<T: Scalar> Kept<T> {
    /// After a command has stood at `command` for ever.
    pub(crate) fn steady(command: T) -> Self {
        Self { end: command, seen: command }
    }
}

/// A few pieces in a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pieces<T> {
    items: [Piece<T>; MOST_PIECES],
    count: usize,
}

impl<T: Scalar> Pieces<T> {
    /// None yet.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        let none = Piece { from: T::ZERO, to: T::ZERO, start_s: T::ZERO, duration: T::ZERO };
        Self { items: [none; MOST_PIECES], count: 0 }
    }

    /// One.
    #[inline(always)]
    pub(crate) fn of(piece: Piece<T>) -> Self {
        let mut pieces = Self::new();
        pieces.push(piece);
        pieces
    }

    /// One more.
    #[inline(always)]
    pub(crate) fn push(&mut self, piece: Piece<T>) {
        assert!(self.count < MOST_PIECES, "a new stage that cuts pieces needs more room");
        self.items[self.count] = piece;
        self.count += 1;
    }

    #[inline(always)]
    pub(crate) fn as_slice(&self) -> &[Piece<T>] {
        &self.items[..self.count]
    }

    /// Where the last one ends.
    #[inline(always)]
    pub(crate) fn end(&self) -> T {
        self.items[self.count - 1].to
    }
}

/// How a driven joint followed its command in one run.
#[derive(Debug, Clone, Default)]
pub struct Following<'a> {
    /// The commands.
    pub command: std::borrow::Cow<'a, Command>,
    /// The drive's column of the commands.
    pub column: usize,
    /// Times \[s\], rising.
    pub time_s: Vec<f64>,
    /// How far the joint is ahead of where a model has it \[rad\].
    pub ahead_rad: Vec<f64>,
}

/// What a cause does to the command.
pub(crate) trait Stage<T: Scalar>: Sized {
    /// The cause with these values.
    fn new(values: &CauseValues<T>) -> Self;

    /// When the command was given that acts at `time_s`.
    #[inline(always)]
    fn given(&self, time_s: T) -> T {
        time_s
    }

    /// What it hands on when the command has stood still for ever.
    #[inline(always)]
    fn steady(&self, command: T) -> T {
        command
    }

    /// Longest piece that it can be handed \[s\].
    fn longest_piece_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Longest step that follows what it hands on \[s\].
    fn longest_step_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Hands on what becomes of `piece`; `kept` is what it kept of the one before.
    #[inline(always)]
    fn pass(&self, kept: &mut Kept<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        kept.end = piece.to;
        out.push(piece);
    }
}
