//! What a drive with motor and gear does beyond MuJoCo's actuators. Causes put it there; no file holds it.

use crate::scalar::Scalar;

/// Motor and gear of a drive, as its joint feels them. By default a drive has neither, and is MuJoCo's.
#[derive(Debug, Clone, PartialEq)]
pub struct Gearmotor<T> {
    /// The controller sees no error up to this one \[rad\] or \[m\].
    pub dead_band: T,
    /// The motor, at rest and with all of its supply, pushes so hard \[N m\] or \[N\]; `None`: as hard as it is told.
    pub stall: Option<T>,
    /// Resistance of the supply and its cable, as a share of the motor's: its voltage gives way under load.
    pub supply: T,
    /// Torque against turning, of a motor that is on, per rate \[N m s/rad\] or \[N s/m\].
    pub braking: T,
    /// Torque beside what is commanded, of a motor that is on \[N m\] or \[N\].
    pub offset: T,
    /// Friction of the gear, where it depends on what the gear bears.
    pub friction: Option<LoadFriction<T>>,
}

/// Friction of a gear in proportion to the motor's torque: without unit but for the rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadFriction<T> {
    /// Share of the torque that is lost where the motor turns the joint.
    pub driving: T,
    /// The same where the joint turns the motor.
    pub driven: T,
    /// Rate over which friction turns round \[rad/s\] or \[m/s\].
    pub rate: T,
}

impl<T: Scalar> Default for Gearmotor<T> {
    fn default() -> Self {
        Self {
            dead_band: T::ZERO,
            stall: None,
            supply: T::ZERO,
            braking: T::ZERO,
            offset: T::ZERO,
            friction: None,
        }
    }
}

impl<T: Scalar> Gearmotor<T> {
    pub(crate) fn map<U: Scalar>(&self, f: impl Fn(T) -> U) -> Gearmotor<U> {
        let friction = self.friction.map(|gear| LoadFriction {
            driving: f(gear.driving),
            driven: f(gear.driven),
            rate: f(gear.rate),
        });
        Gearmotor {
            dead_band: f(self.dead_band),
            stall: self.stall.map(&f),
            supply: f(self.supply),
            braking: f(self.braking),
            offset: f(self.offset),
            friction,
        }
    }
}
