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
        self.gain * self.command(command)
            + self.gear * (self.stiffness * qpos[self.q] + self.damping * qvel[self.dof])
    }
}

/// Adds -`h` times the slope of the drives' forces against velocity to the diagonal of `matrix`; a drive at
/// the end of its force range has none.
#[inline(always)]
pub(crate) fn add_slope<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    command: &[S::T],
    off: &[bool],
    h: S::T,
    matrix: &mut [S::T],
) {
    for ((drive, &command), _) in plant.drives.iter().zip(command).zip(off).filter(|(_, off)| !**off) {
        let slope = drive.gear * drive.gear * drive.damping;
        let slope = match drive.force_range {
            Some([low, high]) => {
                let push = drive.raw_force(qpos, qvel, command);
                S::T::select(low.less(push) & push.less(high), slope, S::T::ZERO)
            }
            None => slope,
        };
        matrix[plant.row[drive.dof]] -= h * slope;
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
        force[drive.dof] += drive.gear * push;
    }
}
