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

    /// Its coordinate.
    #[inline(always)]
    fn along(&self, qpos: &[T]) -> T {
        let mut along = qpos[self.q];
        for term in &self.also {
            along += term.coefficient * qpos[term.q];
        }
        along
    }

    /// Rate of its coordinate.
    #[inline(always)]
    fn rate(&self, qvel: &[T]) -> T {
        let mut rate = qvel[self.dof];
        for term in &self.also {
            rate += term.coefficient * qvel[term.dof];
        }
        rate
    }

    /// Force before range and gear.
    #[inline(always)]
    pub(crate) fn raw_force(&self, qpos: &[T], qvel: &[T], command: T) -> T {
        let (along, rate) = (self.along(qpos), self.rate(qvel));
        let Some(motor) = self.gearmotor.as_ref().filter(|_| self.stiffness != T::ZERO) else {
            return self.gain * self.command(command)
                + self.gear * (self.stiffness * along + self.damping * rate);
        };
        // an error within the dead band is none
        let pull = self.gain * self.command(command) + self.gear * self.stiffness * along;
        let band = self.gain * motor.dead_band;
        pull - pull.clamp(-band, band) + self.gear * self.damping * rate
    }

    /// Torque or force on its coordinate, and by how much of it the supply gives way.
    #[inline(always)]
    fn push(&self, qpos: &[T], qvel: &[T], command: T) -> (T, T) {
        let mut told = self.raw_force(qpos, qvel, command);
        if let Some([low, high]) = self.force_range {
            told = told.clamp(low, high);
        }
        told = self.gear * told;
        let Some(motor) = &self.gearmotor else { return (told, T::ONE) };
        let mut given = T::ONE;
        if let Some(stall) = motor.stall {
            told = told.clamp(-stall, stall);
            let duty = told / stall;
            given = T::ONE / (T::ONE + motor.supply * duty * duty);
        }
        ((told - motor.braking * self.rate(qvel)) * given + motor.offset, given)
    }

    /// By what the gear's friction resists, per rate, under the motor's torque `push`.
    #[inline(always)]
    fn friction_per_rate(&self, qvel: &[T], push: T) -> T {
        let Some(friction) = self.gearmotor.as_ref().and_then(|motor| motor.friction) else { return T::ZERO };
        let rate = self.rate(qvel);
        let share = T::select((push * rate).less(T::ZERO), friction.driven, friction.driving);
        share * push.abs() / (rate * rate + friction.rate * friction.rate).sqrt()
    }

    /// Whether its motor is held back by its supply or by its dead band: it then pushes no harder whatever it is told.
    #[inline(always)]
    fn is_deaf(&self, qpos: &[T], qvel: &[T], command: T) -> Option<T::Mask> {
        let motor = self.gearmotor.as_ref()?;
        let pull = self.gain * self.command(command) + self.gear * self.stiffness * self.along(qpos);
        let within = pull.abs().less(self.gain * motor.dead_band);
        let told = (self.gear * self.raw_force(qpos, qvel, command)).abs();
        Some(match motor.stall {
            Some(stall) => within | stall.less(told),
            None => within,
        })
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
        if let Some(deaf) = drive.is_deaf(qpos, qvel, now) {
            force = S::T::select(deaf, S::T::ZERO, force);
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
        let mut motor_damping = S::T::ZERO;
        if let Some(motor) = &drive.gearmotor {
            if let Some(deaf) = drive.is_deaf(qpos, qvel, command) {
                squared = S::T::select(deaf, S::T::ZERO, squared);
            }
            let (push, given) = drive.push(qpos, qvel, command);
            motor_damping = motor.braking * given + drive.friction_per_rate(qvel, push);
        }
        damping[drive.dof] += motor_damping - squared * drive.damping;
        stiffness[drive.dof] -= squared * drive.stiffness;
        for term in &drive.also {
            let shared = term.coefficient * term.coefficient;
            damping[term.dof] += shared * (motor_damping - squared * drive.damping);
            stiffness[term.dof] -= shared * squared * drive.stiffness;
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
        let (push, _) = drive.push(qpos, qvel, command);
        let rubbing = if drive.gearmotor.is_some() {
            drive.friction_per_rate(qvel, push) * drive.rate(qvel)
        } else {
            S::T::ZERO
        };
        drive.spread(push - rubbing, force);
    }
}
