//! The motion of the mechanism in the tank: a function of its pulses alone, computed when it is asked for.
//!
//! Time goes in steps on a grid of CLOCK_MONOTONIC, so that neither the moment of asking nor the order in which pulses become
//! known changes the motion. A pulse that becomes known late, from a log, sets the motion back to before it.

use sim::{Model, RolloutOptions, Simulator, State};

use super::causes::Linkage;
use super::config::{Hold, Release, TankConfig, TankServo};
use super::error::TankError;
use super::servo::Servo;
use ground::clock::MonotonicNs;

/// Longest time step unless the config sets one \[s\], chosen: with MuJoCo's usual millisecond the tip of a driven chain is 0.1 mm off the
/// exact motion, twenty times what pictures resolve.
const MAX_TIMESTEP_S: f64 = 2e-4;
/// Time between snapshots of the motion \[ns\], chosen.
const SNAPSHOT_PERIOD_NS: u64 = 20_000_000;
/// Most snapshots that are stored, chosen: those of five seconds, much longer than any log is behind.
const MAX_SNAPSHOTS: usize = 250;
/// Greatest rate of any joint of a mechanism at rest \[rad/s\], chosen.
const STILL_RATE_RAD_PER_S: f64 = 1e-6;
/// Snapshots in a row, half a second, after which a mechanism at rest is no longer simulated until the next event; chosen.
const STILL_SNAPSHOTS: u32 = 25;

/// An event that changes the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Event {
    /// A channel's pulse changes.
    Pulse { channel: u8, pulse_us: Option<u16> },
    /// A servo on a bus has turned to here, or is limp.
    Position { channel: u8, counts: Option<f64> },
    /// The mechanism is let go.
    LetGo,
}

/// An instant within a step at which the servos' input changes.
#[derive(Debug, Clone, Copy)]
enum Moment {
    Event(Event),
    /// A servo's period starts.
    Period(usize),
}

/// One servo and what it is connected to.
#[derive(Debug, Clone)]
struct Drive {
    config: TankServo,
    actuator: usize,
    qpos: usize,
    gear: f64,
}

/// The state of the simulation at one step.
#[derive(Debug, Clone)]
struct Now {
    /// Steps since the clock's origin.
    step: u64,
    state: State,
    servos: Vec<Servo>,
    /// Commanded angle of each servo, by its channel \[rad\].
    commands_rad: Vec<Option<f64>>,
    held: bool,
    /// Number of snapshots since it last moved.
    still: u32,
    /// The simulator, with the water's history.
    simulator: Simulator,
    /// Which actuators are limp in the simulator.
    limp: Vec<bool>,
}

/// The motion of one mechanism under its history of events.
#[derive(Debug)]
pub(super) struct Motion {
    model: Model,
    drives: Vec<Drive>,
    hold: Hold,
    release: Release,
    step_ns: u64,
    /// In order of time.
    history: Vec<(MonotonicNs, Event)>,
    now: Now,
    snapshots: std::collections::VecDeque<Now>,
    linkage: Linkage,
    /// Steps since the clock's origin when the tank was filled, where its own time starts.
    filled: u64,
}

impl Motion {
    /// The mechanism in its initial pose at `begin`.
    ///
    /// # Errors
    /// [`TankError`] when the config does not fit the model.
    pub(super) fn new(model: Model, config: &TankConfig, begin: MonotonicNs) -> Result<Self, TankError> {
        let finest_s = model.settings.timestep_s.min(MAX_TIMESTEP_S);
        let timestep_s = config.timestep_s.map_or(finest_s, |step| step.get());
        let step_ns = ((timestep_s * 1e9).round() as u64).max(1);
        let mut state = model.rest_state();
        if !config.initial_qpos.is_empty() {
            if config.initial_qpos.len() != model.nq() {
                return Err(TankError::InitialPose { got: config.initial_qpos.len(), wanted: model.nq() });
            }
            state.qpos = config.initial_qpos.iter().map(|q| q.get()).collect();
        }
        let drives =
            config.servo.iter().map(|servo| Drive::new(&model, servo)).collect::<Result<Vec<_>, _>>()?;
        let limp = vec![true; model.actuators.len()];
        let simulator = simulator(&model, &limp, step_ns)?;
        let now = Now {
            step: begin.0 / step_ns,
            state,
            servos: vec![Servo::LIMP; drives.len()],
            commands_rad: vec![None; drives.len()],
            held: config.hold != Hold::Nothing,
            still: 0,
            simulator,
            limp,
        };
        Ok(Self {
            model,
            drives,
            hold: config.hold,
            release: config.release,
            step_ns,
            history: Vec::new(),
            snapshots: [now.clone()].into(),
            filled: now.step,
            now,
            linkage: Linkage::new(&config.causes),
        })
    }

    /// Adds an event. One in the past takes the motion back to before it.
    pub(super) fn add_event(&mut self, at: MonotonicNs, event: Event) {
        let at = match event {
            Event::Pulse { .. } | Event::Position { .. } => at.plus_seconds(self.linkage.delay_s),
            Event::LetGo => at,
        };
        // An event older than the oldest snapshot acts at that snapshot.
        let oldest = self.snapshots.front().map_or(self.now.step, |snapshot| snapshot.step);
        let at = at.max(MonotonicNs(oldest * self.step_ns));
        let place = self.history.partition_point(|(other, _)| *other <= at);
        self.history.insert(place, (at, event));
        if at.0 < self.now.step * self.step_ns {
            while self.snapshots.back().is_some_and(|last| last.step * self.step_ns > at.0) {
                self.snapshots.pop_back();
            }
            if let Some(last) = self.snapshots.back() {
                self.now = last.clone();
            }
        }
    }

    /// Coordinates at `at`, as in the model's `qpos`.
    ///
    /// # Errors
    /// [`TankError::Simulation`] when the simulation diverges.
    pub(super) fn qpos(&mut self, at: MonotonicNs) -> Result<Vec<f64>, TankError> {
        let step = at.0 / self.step_ns;
        if step < self.now.step {
            // The past, as jittered images may ask for it: computed from the snapshot before it; the present state stays.
            let present = self.now.clone();
            let past = self.snapshots.iter().rev().find(|snapshot| snapshot.step <= step);
            let Some(past) = past.or(self.snapshots.front()).cloned() else { return Ok(present.state.qpos) };
            self.now = past;
            let asked = self.advance(step, false).and_then(|()| self.between(at));
            self.now = present;
            return asked;
        }
        self.advance(step, true)?;
        self.between(at)
    }

    /// From the last step on to `at`, without moving on.
    fn between(&mut self, at: MonotonicNs) -> Result<Vec<f64>, TankError> {
        let rest_ns = at.0.saturating_sub(self.now.step * self.step_ns).min(self.step_ns);
        let mut state = self.now.state.clone();
        if rest_ns > 0 && !self.now.held && self.now.still < STILL_SNAPSHOTS {
            let angles = self.angles();
            let (time_s, rest_s) = (self.time_s(), rest_ns as f64 * 1e-9);
            // a step that is not part of the motion must not change the simulator's history
            let mut simulator = self.now.simulator.clone();
            simulator.step_with(&mut state, time_s, rest_s, &|drive, _| angles[drive].unwrap_or(0.0))?;
        }
        Ok(state.qpos)
    }

    /// Time since the tank was filled \[s\].
    fn time_s(&self) -> f64 {
        self.now.step.saturating_sub(self.filled) as f64 * self.step_ns as f64 * 1e-9
    }

    fn advance(&mut self, to: u64, keep: bool) -> Result<(), TankError> {
        while self.now.step < to {
            if self.now.step * self.step_ns / SNAPSHOT_PERIOD_NS
                != self.now.step.saturating_sub(1) * self.step_ns / SNAPSHOT_PERIOD_NS
            {
                self.settle();
                if keep {
                    self.snapshots.push_back(self.now.clone());
                    if self.snapshots.len() > MAX_SNAPSHOTS {
                        self.snapshots.pop_front();
                        self.forget();
                    }
                }
                if let Some(next) = self.nothing_until(to) {
                    self.now.step = next;
                    continue;
                }
            }
            self.step()?;
        }
        Ok(())
    }

    /// Forgets what happened before the oldest snapshot, which contains it.
    fn forget(&mut self) {
        if let Some(oldest) = self.snapshots.front() {
            let begin = MonotonicNs(oldest.step * self.step_ns);
            let past = self.history.partition_point(|(at, _)| *at < begin);
            self.history.drain(..past);
        }
    }

    /// Counts the snapshots for which nothing has moved.
    fn settle(&mut self) {
        let still = self.now.held || self.now.state.qvel.iter().all(|rate| rate.abs() < STILL_RATE_RAD_PER_S);
        self.now.still = if still { self.now.still.saturating_add(1) } else { 0 };
    }

    /// The last step up to `to` before the next event, where the mechanism is at rest; `None` where it moves.
    fn nothing_until(&self, to: u64) -> Option<u64> {
        if self.now.still < STILL_SNAPSHOTS {
            return None;
        }
        let begin = MonotonicNs(self.now.step * self.step_ns);
        let next = self.history.partition_point(|(at, _)| *at < begin);
        let quiet_until = self.history.get(next).map_or(to, |(at, _)| (at.0 / self.step_ns).min(to));
        (quiet_until > self.now.step).then_some(quiet_until)
    }

    fn step(&mut self) -> Result<(), TankError> {
        let from = self.now.step * self.step_ns;
        let before = self.angles();
        self.pass(from, from + self.step_ns);
        let after = self.angles();
        if !self.now.held {
            self.update_limp()?;
            let (time_s, step_s) = (self.time_s(), self.step_ns as f64 * 1e-9);
            let command = |actuator: usize, at_s: f64| match (before[actuator], after[actuator]) {
                (Some(from), Some(to)) => from + (to - from) * (at_s - time_s) / step_s,
                (_, to) => to.unwrap_or(0.0),
            };
            self.now.simulator.step_with(&mut self.now.state, time_s, step_s, &command)?;
        }
        self.now.step += 1;
        Ok(())
    }

    /// Advances the servos from `from` to `until` \[ns\]: pulses change, the mechanism is let go, each servo turns, and takes up its pulse
    /// at the start of its period, all at their exact times.
    fn pass(&mut self, from: u64, until: u64) {
        let first = self.history.partition_point(|(at, _)| at.0 < from);
        let events = self.history[first..].iter().take_while(|(at, _)| at.0 < until);
        let mut moments: Vec<(u64, Moment)> =
            events.map(|&(at, event)| (at.0, Moment::Event(event))).collect();
        for (index, drive) in self.drives.iter().enumerate() {
            let period_ns = ((drive.config.period_s.get() * 1e9) as u64).max(1);
            let starts = (from.div_ceil(period_ns)..until.div_ceil(period_ns)).map(|k| k * period_ns);
            moments.extend(starts.map(|at| (at, Moment::Period(index))));
        }
        // an event at the start of a period acts in that period
        moments.sort_by_key(|&(at, ref moment)| (at, matches!(moment, Moment::Period(_))));
        let mut now = from;
        for (at, moment) in moments {
            self.turn(at - now);
            now = at;
            match moment {
                Moment::Event(event) => self.take(event),
                Moment::Period(index) => self.latch(index),
            }
        }
        self.turn(until - now);
    }

    /// Servos turn for `duration` \[ns\].
    fn turn(&mut self, duration: u64) {
        if !self.now.held && duration > 0 {
            for (servo, drive) in self.now.servos.iter_mut().zip(&self.drives) {
                servo.turn(&drive.config, &self.linkage, duration as f64 * 1e-9);
            }
        }
    }

    fn take(&mut self, event: Event) {
        self.now.still = 0;
        let opens = match event {
            Event::LetGo => true,
            Event::Pulse { channel, pulse_us } => {
                self.set_command(channel, |servo| Some(servo.pulse_angle_rad(pulse_us?)));
                self.release.channel == Some(channel)
                    && pulse_us.is_some_and(|pulse_us| pulse_us >= self.release.open_us)
            }
            Event::Position { channel, counts } => {
                self.set_command(channel, |servo| Some(servo.count_angle_rad(counts?)));
                false
            }
        };
        if opens && self.hold == Hold::Release {
            self.now.held = false;
        }
    }

    fn set_command(&mut self, channel: u8, angle_rad: impl Fn(&TankServo) -> Option<f64>) {
        for (drive, commands_rad) in self.drives.iter().zip(&mut self.now.commands_rad) {
            if drive.config.channel == channel {
                *commands_rad = angle_rad(&drive.config);
            }
        }
    }

    /// Servo `index` takes up its pulse.
    fn latch(&mut self, index: usize) {
        let drive = &self.drives[index];
        let link_rad = self.now.state.qpos[drive.qpos] * drive.gear;
        self.now.servos[index].latch(&self.linkage, self.now.commands_rad[index], link_rad);
        if self.now.commands_rad[index].is_some() && self.hold == Hold::FirstPulse {
            self.now.held = false;
        }
    }

    /// Output angle of each actuator's servo \[rad\]; `None` where it is limp.
    fn angles(&self) -> Vec<Option<f64>> {
        let mut angles = vec![None; self.model.actuators.len()];
        for (servo, drive) in self.now.servos.iter().zip(&self.drives) {
            angles[drive.actuator] = servo.angle_rad();
        }
        angles
    }

    /// Makes the same actuators limp in the simulator as the servos are.
    fn update_limp(&mut self) -> Result<(), TankError> {
        let limp: Vec<bool> = self.angles().iter().map(Option::is_none).collect();
        if limp != self.now.limp {
            self.now.simulator = simulator(&self.model, &limp, self.step_ns)?;
            self.now.limp = limp;
        }
        Ok(())
    }
}

impl Drive {
    fn new(model: &Model, servo: &TankServo) -> Result<Self, TankError> {
        let actuator =
            model.actuators.iter().position(|actuator| actuator.name == servo.actuator).ok_or_else(|| {
                TankError::UnknownActuator {
                    actuator: servo.actuator.clone(),
                    known: model
                        .actuators
                        .iter()
                        .map(|actuator| actuator.name.as_str())
                        .collect::<Vec<_>>()
                        .join(", "),
                }
            })?;
        if servo.us_per_rad.get() == 0.0 {
            return Err(TankError::NoTravel { actuator: servo.actuator.clone() });
        }
        let plan = &model.actuators[actuator];
        Ok(Self {
            config: servo.clone(),
            actuator,
            qpos: model.joints[plan.joint].qpos_address,
            gear: plan.gear,
        })
    }
}

/// A simulator whose limp actuators exert no force.
fn simulator(model: &Model, limp: &[bool], step_ns: u64) -> Result<Simulator, TankError> {
    let mut model = model.clone();
    for (actuator, _) in model.actuators.iter_mut().zip(limp).filter(|(_, limp)| **limp) {
        actuator.kp = 0.0;
        actuator.kv = 0.0;
    }
    let options = RolloutOptions { timestep_s: Some(step_ns as f64 * 1e-9), ..RolloutOptions::default() };
    Ok(Simulator::new(&model, &options)?)
}

#[cfg(test)]
mod tests;
