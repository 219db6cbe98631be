//! Hypotheses as columns: which number has which size in which run.

use super::atoms::{Atoms, Form};

/// Prior scale of a size, in typical sizes: typical ones are right to a factor of a few (a prototype, chosen).
const SIZE_WIDTH_TYPICAL: f64 = 2.0;

/// What is believed of a column's size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Belief {
    /// Cauchy with this scale: sizes far above the typical one cost a logarithm, not a square, since typical sizes are those of one
    /// tank.
    Size(f64),
    /// Normal, with tau times this as its standard deviation; tau by evidence.
    Deviation(f64),
    /// Normal with this standard deviation.
    Hidden(f64),
    /// 1 for certain: a switch.
    Given,
}

/// A size: one number in some runs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    /// Its place in [`Atoms::numbers`].
    pub(super) number: usize,
    /// Where it acts, rising.
    pub(super) runs: Vec<usize>,
    pub(super) belief: Belief,
    /// Physics allows no other sign than above 0.
    pub(super) is_positive: bool,
}

impl Belief {
    /// The precision of the normal distribution that has the slope of this belief at `size`, `tau` being the by-run one.
    pub(super) fn precision(self, size: f64, tau: f64) -> f64 {
        match self {
            Self::Size(scale) => 2.0 / (scale * scale + size * size),
            Self::Deviation(typical) => (tau * typical).powi(-2),
            Self::Hidden(std) => std.powi(-2),
            Self::Given => 0.0,
        }
    }
}

impl Column {
    pub(super) fn acts_in(&self, run: usize) -> bool {
        self.runs.contains(&run)
    }
}

/// The columns of a hypothesis, atom by atom, a switch among them.
pub(super) fn columns(atoms: &Atoms, set: &[usize]) -> Vec<Column> {
    set.iter().flat_map(|&atom| of_atom(atoms, atom)).collect()
}

/// The columns of one atom.
pub(super) fn of_atom(atoms: &Atoms, place: usize) -> Vec<Column> {
    let atom = &atoms.list[place];
    let mut list = Vec::new();
    for &number in &atom.numbers {
        let known = &atoms.numbers[number];
        let mut put = |runs: Vec<usize>, belief: Belief| {
            // what differs from run to run stands upon the least of all runs then
            let is_size = matches!(belief, Belief::Size(_) | Belief::Deviation(_));
            let is_positive = is_size && known.bounds[0] >= known.neutral;
            list.push(Column { number, runs, belief, is_positive });
        };
        let all = || atom.runs.clone();
        let each = || atom.runs.iter().map(|&run| vec![run]);
        let size = Belief::Size(SIZE_WIDTH_TYPICAL * known.typical);
        let deviation = Belief::Deviation(known.typical);
        match atom.form {
            _ if known.is_switch => put(all(), Belief::Given),
            _ if known.is_hidden => put(all(), Belief::Hidden(SIZE_WIDTH_TYPICAL * known.typical)),
            Form::All if known.each_run => each().for_each(|run| put(run, size)),
            Form::All => put(all(), size),
            Form::CommonAndByRun => {
                put(all(), size);
                each().for_each(|run| put(run, deviation));
            }
            Form::ByRunOnly => each().for_each(|run| put(run, deviation)),
            Form::DropsOnly => put(atom.drops.clone(), size),
            Form::DropsByRun => atom.drops.iter().for_each(|&run| put(vec![run], deviation)),
            Form::OneRun(run) => put(vec![run], size),
        }
    }
    list
}

/// Whether some size of `columns` differs from run to run by a tau.
pub(super) fn has_deviations(columns: &[Column]) -> bool {
    columns.iter().any(|column| matches!(column.belief, Belief::Deviation(_)))
}
