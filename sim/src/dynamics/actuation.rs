//! Stage 6: what the drives do.

use super::plant::{Drive, Plant};
use crate::scalar::Scalar;
use crate::space::Space;

impl<T: Scalar> Drive<T> {
    /// The command, kept in its range.
    #[inline(always)]
    pub(crate) fn command(&self, command: T) -> T {
        match self.command_range {
            Some([low, high]) => command.clamp(low, high),
            None => command,
        }
    }

    /// Force before range and gear.
    #[inline(always)]
    pub(crate) fn raw_force(&self, qpos: &[T], qvel: &[T], command: T) -> T {
        let (mut along, mut rate) = (qpos[self.q], qvel[self.dof]);
        for term in &self.also {
            along += term.coefficient * qpos[term.q];
            rate += term.coefficient * qvel[term.dof];
        }
        self.gain * self.command(command) + self.gear * (self.stiffness * along + self.damping * rate)
    }

    /// Adds `push` on its coordinate to `force` on the dofs.
    #[inline(always)]
    fn spread(&self, push: T, force: &mut [T]) {
        force[self.dof] += push;
        for term in &self.also {
            force[term.dof] += term.coefficient * push;
        }
    }
}

/// Adds to `rise` how fast the drives' forces rise because their commands do, shape (nv): from the first to the second of
/// `commands` in a time of which `per_s` is the reciprocal \[1/s\]. A drive at the end of its force range does not push harder.
#[inline(always)]
pub(crate) fn rises<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    (now, ahead): (&[S::T], &[S::T]),
    per_s: S::T,
    off: &[bool],
    rise: &mut [S::T],
) {
    let commands = now.iter().zip(ahead);
    for ((drive, (&now, &ahead)), _) in plant.drives.iter().zip(commands).zip(off).filter(|(_, off)| !**off) {
        let mut force = drive.gear * drive.gain * (drive.command(ahead) - drive.command(now)) * per_s;
        if let Some([low, high]) = drive.force_range {
            let push = drive.raw_force(qpos, qvel, now);
            force = S::T::select(low.less(push) & push.less(high), force, S::T::ZERO);
        }
        drive.spread(force, rise);
    }
}

/// Adds the drives' slopes, reversed, to `damping` (against velocity) and `stiffness` (against coordinate), shape (nv)
/// each; a drive at the end of its force range has none.
#[inline(always)]
pub(crate) fn slopes<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    command: &[S::T],
    off: &[bool],
    damping: &mut [S::T],
    stiffness: &mut [S::T],
) {
    for ((drive, &command), _) in plant.drives.iter().zip(command).zip(off).filter(|(_, off)| !**off) {
        let mut squared = drive.gear * drive.gear;
        if let Some([low, high]) = drive.force_range {
            let push = drive.raw_force(qpos, qvel, command);
            squared = S::T::select(low.less(push) & push.less(high), squared, S::T::ZERO);
        }
        damping[drive.dof] -= squared * drive.damping;
        stiffness[drive.dof] -= squared * drive.stiffness;
        for term in &drive.also {
            let squared = squared * term.coefficient * term.coefficient;
            damping[term.dof] -= squared * drive.damping;
            stiffness[term.dof] -= squared * drive.stiffness;
        }
    }
}

/// Adds the drives' forces to `force`; the drives with `off` exert none.
#[inline(always)]
pub(crate) fn actuation<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    command: &[S::T],
    off: &[bool],
    force: &mut [S::T],
) {
    for ((drive, &command), _) in plant.drives.iter().zip(command).zip(off).filter(|(_, off)| !**off) {
        let mut push = drive.raw_force(qpos, qvel, command);
        if let Some([low, high]) = drive.force_range {
            push = push.clamp(low, high);
        }
        drive.spread(drive.gear * push, force);
    }
}
