//! Commanded and measured angles of the servo, and the clock of its board.

use std::time::{Duration, Instant};

use serde::Serialize;
use utoipa::ToSchema;

use super::Filming;
use super::picture::rounded;
use super::traces::{Traces, Window};
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};
use record::ServoCommand;
use servo::{PulseProfile, ServoConfig, ServoEvent};

/// Time between two fits of the clock. Chosen.
const CLOCK_FIT_INTERVAL: Duration = Duration::from_secs(1);
/// Pings that are stored at most: enough to know the clock, without storing those of a whole day. Chosen.
const STORED_PINGS_MAX: usize = 20_000;

/// The servo board's clock against this computer's.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
pub struct Clock {
    /// How much the board's clock has gained since the first ping \[s\].
    pub gained_s: f64,
    /// Standard deviation of the board's time as it is known now \[s\].
    pub sigma_s: f64,
    /// How much faster the board's clock runs \[parts per million\].
    pub drift_ppm: f64,
    /// Number of pings used.
    pub pings: usize,
}

/// The commands, positions and clock of the servo of one job, as they are shown.
#[derive(Debug, Default)]
pub(super) struct Servo {
    pings: Vec<Ping>,
    clock: Option<(ClockFit, Instant)>,
    armed: Option<(MonotonicNs, PulseProfile)>,
    /// The profile that is played, in the run's time.
    command: Option<sim::Command>,
    stopped: bool,
    /// How much later than planned the motion began \[s\].
    pub(super) start_late_s: Option<f64>,
    commanded: Window,
    /// Latest angle of each driven channel \[rad\]; NaN before it is known.
    angles_rad: Vec<f64>,
    output: Window,
    /// Whether the servo itself reports its position.
    is_measured: bool,
}

impl Servo {
    /// The next event of the board that drives what is filmed.
    pub(super) fn apply_event(&mut self, event: &ServoEvent, filming: &Filming) {
        let Some(servo) = &filming.servo else { return };
        match *event {
            ServoEvent::Ping { sent, board_tick_us, received } => {
                if self.pings.len() >= STORED_PINGS_MAX {
                    self.pings.drain(..STORED_PINGS_MAX / 2);
                }
                self.pings.push(Ping { sent, board_tick_us, received });
                if self.clock.as_ref().is_none_or(|(_, at)| at.elapsed() >= CLOCK_FIT_INTERVAL) {
                    self.fit_clock(servo);
                }
            }
            ServoEvent::Pulse { channel, board_tick_us, pulse_us } if !self.is_measured => {
                let Some((clock, _)) = &self.clock else { return };
                let time_s = clock.host(board_tick_us).seconds_since(filming.origin);
                self.add_position(channel, pulse_us.map(f64::from), time_s, filming);
            }
            ServoEvent::Position { channel, count, sent, received } => {
                if !self.is_measured {
                    (self.is_measured, self.output) = (true, Window::default());
                }
                let at = sent.plus_seconds(received.seconds_since(sent) / 2.0);
                self.add_position(channel, Some(f64::from(count)), at.seconds_since(filming.origin), filming);
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

    /// The next command to the board.
    pub(super) fn apply_command(&mut self, command: &ServoCommand) {
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

    /// The channel puts out, or reports that it is at, `position` (pulse width or count) at `time_s`.
    fn add_position(&mut self, channel: u8, position: Option<f64>, time_s: f64, filming: &Filming) {
        let mut driven = filming.servo.iter().flat_map(ServoConfig::driven);
        let Some((place, (channel, _))) = driven.by_ref().enumerate().find(|(_, (c, _))| c.id == channel)
        else {
            return;
        };
        let width = place + 1 + driven.count();
        self.angles_rad.resize(width, f64::NAN);
        self.angles_rad[place] =
            position.map_or(f64::NAN, |position| channel.angle_rad(position, filming.mirrored));
        self.output.push(time_s, || self.angles_rad.clone());
    }

    /// Extends the trace of commanded angles up to `now_s`.
    pub(super) fn extend_commanded(&mut self, now_s: f64) {
        let Some(command) = self.command.as_ref().filter(|_| !self.stopped) else { return };
        let begin_s = command.time_s.first().copied().unwrap_or(now_s);
        let mut time_s = self.commanded.next_s().unwrap_or(begin_s);
        while time_s <= now_s {
            let columns = 0..command.actuators.len();
            self.commanded.push(time_s, || columns.map(|column| command.at(column, time_s)).collect());
            match self.commanded.next_s() {
                Some(next_s) if next_s > time_s => time_s = next_s,
                _ => return,
            }
        }
    }

    /// Commanded and measured angles of the last seconds.
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
        let label = if self.is_measured { "measured" } else { "put out by the board" };
        let commanded = (!self.commanded.is_empty())
            .then(|| self.commanded.lines("angle", "rad", &names("commanded"), 1e4, |i| columns[i]));
        let output =
            (!self.output.is_empty()).then(|| self.output.lines("angle", "rad", &names(label), 1e4, |i| i));
        commanded.into_iter().chain(output)
    }

    /// The state of its board's clock.
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
