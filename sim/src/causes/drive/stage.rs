//! A stage: what a cause does to the command on its way to the drive.
//!
//! A command is straight between its rows. Every stage is exact on straight pieces: it hands on as many pieces as its law has
//! corners, so that neither the rows' spacing nor the integrator's step plays a part, and derivatives are exact too.

use crate::command::Command;
use crate::model::cause::CauseValues;
use crate::scalar::Scalar;

/// A straight piece of a command.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece<T> {
    /// Command at its start.
    pub(crate) from: T,
    /// Command at its end.
    pub(crate) to: T,
    /// Time of its start \[s\], as the command's rows are timed.
    pub(crate) start_s: T,
    /// Duration \[s\], 0 or more.
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

/// Most pieces that the stages cut one piece into: one stage cuts it in four, two others in two.
const PIECES_MAX: usize = 16;

/// State of a stage between one piece and the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StageState<T> {
    /// Where the last piece handed on ended.
    pub(crate) end: T,
    /// The command that was read last, by a stage with a refresh period.
    pub(crate) last_read: T,
    /// How fast its output goes there, of a stage with inertia \[1/s\].
    pub(crate) rate: T,
}

impl<T: Scalar> StageState<T> {
    /// The state after a constant `command`.
    pub(crate) fn steady(command: T) -> Self {
        Self { end: command, last_read: command, rate: T::ZERO }
    }
}

/// A few pieces in a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pieces<T> {
    items: [Piece<T>; PIECES_MAX],
    count: usize,
}

impl<T: Scalar> Pieces<T> {
    /// No pieces.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        let none = Piece { from: T::ZERO, to: T::ZERO, start_s: T::ZERO, duration: T::ZERO };
        Self { items: [none; PIECES_MAX], count: 0 }
    }

    /// The one `piece`.
    #[inline(always)]
    pub(crate) fn of(piece: Piece<T>) -> Self {
        let mut pieces = Self::new();
        pieces.push(piece);
        pieces
    }

    /// Appends `piece`.
    #[inline(always)]
    pub(crate) fn push(&mut self, piece: Piece<T>) {
        assert!(self.count < PIECES_MAX, "a new stage that cuts pieces needs more room");
        self.items[self.count] = piece;
        self.count += 1;
    }

    #[inline(always)]
    pub(crate) fn as_slice(&self) -> &[Piece<T>] {
        &self.items[..self.count]
    }

    /// Command at the end of the last piece.
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
    /// Measured minus modelled angle of the joint \[rad\], shape as `time_s`.
    pub ahead_rad: Vec<f64>,
}

/// What a cause does to the command.
pub(crate) trait Stage<T: Scalar>: Sized {
    /// The cause with these values.
    fn new(values: &CauseValues<T>) -> Self;

    /// Time of the command that acts at `time_s` \[s\].
    #[inline(always)]
    fn given(&self, time_s: T) -> T {
        time_s
    }

    /// Its output after a constant `command`.
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

    /// Appends the output for `piece` to `out`; `state` is that after the piece before.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        state.end = piece.to;
        out.push(piece);
    }
}
