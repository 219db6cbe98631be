//! What the servo was told and what it does, and how its board's clock goes.

use std::time::{Duration, Instant};

use serde::Serialize;
use utoipa::ToSchema;

use super::Filming;
use super::picture::rounded;
use super::traces::{Traces, Window};
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};
use record::ServoCommand;
use servo::{PulseProfile, ServoConfig, ServoEvent};

/// Between two fits of the clock.
const FIT_EVERY: Duration = Duration::from_secs(1);
/// A clock is known well enough from the last so many pings, and a day of them need not be kept.
const MOST_PINGS: usize = 20_000;

/// The servo board's clock beside this computer's.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
pub struct Clock {
    /// What it has gained since the first ping \[s\].
    pub gained_s: f64,
    /// How well its time is known now, one standard deviation \[s\].
    pub sigma_s: f64,
    /// How much faster it goes \[parts per million\].
    pub drift_ppm: f64,
    /// Pings that this rests on.
    pub pings: usize,
}

/// The commands, positions and clock of the servo of one job, as they are shown.
#[derive(Debug, Default)]
pub(super) struct Servo {
    pings: Vec<Ping>,
    clock: Option<(ClockFit, Instant)>,
    armed: Option<(MonotonicNs, PulseProfile)>,
    /// What is played, on the run's time, from when it began.
    command: Option<sim::Command>,
    stopped: bool,
    /// How much later than planned it began \[s\].
    pub(super) start_late_s: Option<f64>,
    commanded: Window,
    /// What each driven channel does \[rad\]; nothing before it is known.
    now_rad: Vec<f64>,
    does: Window,
    /// It says itself where it stands.
    is_measured: bool,
}

impl Servo {
    /// The next event of the board that drives what is filmed.
    pub(super) fn hear(&mut self, event: &ServoEvent, filming: &Filming) {
        let Some(servo) = &filming.servo else { return };
        match *event {
            ServoEvent::Ping { sent, board_tick_us, received } => {
                if self.pings.len() >= MOST_PINGS {
                    self.pings.drain(..MOST_PINGS / 2);
                }
                self.pings.push(Ping { sent, board_tick_us, received });
                if self.clock.as_ref().is_none_or(|(_, at)| at.elapsed() >= FIT_EVERY) {
                    self.fit_clock(servo);
                }
            }
            ServoEvent::Pulse { channel, board_tick_us, pulse_us } if !self.is_measured => {
                let Some((clock, _)) = &self.clock else { return };
                let time_s = clock.host(board_tick_us).seconds_since(filming.origin);
                self.stands(channel, pulse_us.map(f64::from), time_s, filming);
            }
            ServoEvent::Position { channel, count, sent, received } => {
                if !self.is_measured {
                    (self.is_measured, self.does) = (true, Window::default());
                }
                let at = sent.plus_seconds(received.seconds_since(sent) / 2.0);
                self.stands(channel, Some(f64::from(count)), at.seconds_since(filming.origin), filming);
            }
            ServoEvent::Started { board_tick_us } => {
                self.fit_clock(servo);
                let (Some((clock, _)), Some((start, profile))) = (&self.clock, &self.armed) else { return };
                let began = clock.host(board_tick_us);
                self.start_late_s = Some(began.seconds_since(*start));
                let start_s = began.seconds_since(filming.origin);
                self.command = profile.command(servo, filming.mirrored, start_s).ok();
            }
            _ => {}
        }
    }

    /// What the board was told next.
    pub(super) fn tell(&mut self, command: &ServoCommand) {
        match command {
            ServoCommand::Arm { start, profile } => self.armed = Some((*start, profile.clone())),
            ServoCommand::Stop { .. } => self.stopped = true,
            ServoCommand::Jog { .. } => {}
        }
    }

    fn fit_clock(&mut self, servo: &ServoConfig) {
        let wire = if self.is_measured { Wire::NONE } else { servo.wire() };
        self.clock = ClockFit::new(&self.pings, wire).map(|clock| (clock, Instant::now()));
    }

    /// The channel is told, or says that it stands at, `told` at `time_s`.
    fn stands(&mut self, channel: u8, told: Option<f64>, time_s: f64, filming: &Filming) {
        let mut driven = filming.servo.iter().flat_map(ServoConfig::driven);
        let Some((place, (channel, _))) = driven.by_ref().enumerate().find(|(_, (c, _))| c.id == channel)
        else {
            return;
        };
        let width = place + 1 + driven.count();
        self.now_rad.resize(width, f64::NAN);
        self.now_rad[place] = told.map_or(f64::NAN, |told| channel.angle_rad(told, filming.mirrored));
        self.does.take(time_s, || self.now_rad.clone());
    }

    /// What it was told up to `now_s` is known.
    pub(super) fn look(&mut self, now_s: f64) {
        let Some(command) = self.command.as_ref().filter(|_| !self.stopped) else { return };
        let begin_s = command.time_s.first().copied().unwrap_or(now_s);
        let mut time_s = self.commanded.next_s().unwrap_or(begin_s);
        while time_s <= now_s {
            let columns = 0..command.actuators.len();
            self.commanded.take(time_s, || columns.map(|column| command.at(column, time_s)).collect());
            match self.commanded.next_s() {
                Some(next_s) if next_s > time_s => time_s = next_s,
                _ => return,
            }
        }
    }

    /// The last seconds of it.
    pub(super) fn traces(&self, servo: &ServoConfig) -> impl Iterator<Item = Traces> {
        let names = |word: &str| -> Vec<String> {
            servo.driven().map(|(_, actuator)| format!("{actuator}, {word}")).collect()
        };
        let columns: Vec<usize> = servo
            .driven()
            .map(|(_, name)| {
                let known = self.command.iter().flat_map(|command| &command.actuators);
                known.into_iter().position(|actuator| actuator == name).unwrap_or(usize::MAX)
            })
            .collect();
        let does = if self.is_measured { "measured" } else { "put out by the board" };
        let commanded = (!self.commanded.is_empty())
            .then(|| self.commanded.lines("angle", "rad", &names("commanded"), 1e4, |i| columns[i]));
        let told = (!self.does.is_empty()).then(|| self.does.lines("angle", "rad", &names(does), 1e4, |i| i));
        commanded.into_iter().chain(told)
    }

    /// How its board's clock goes.
    pub(super) fn clock(&self) -> Option<Clock> {
        let (clock, _) = self.clock.as_ref()?;
        let now = self.pings.last()?.received;
        Some(Clock {
            gained_s: rounded(clock.gained_s(now), 1e7),
            sigma_s: rounded(clock.sigma_s(now), 1e7),
            drift_ppm: rounded(clock.drift_ppm(), 10.0),
            pings: clock.used,
        })
    }
}
