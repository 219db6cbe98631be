//! How a board answers commands.

use super::motion::Line;
use super::{Board, DEAD_MAN_RANGE_MS, Hardware, MAX_DURATION, MAX_LEAD, MIN_LEAD, STORED_ANSWERS};
use crate::channel::{ChannelConfig, ChannelKind};
use crate::command::{Command, Segment, kind};
use crate::event::{Ack, Event, Fault, Refusal, State, Status};
use crate::packet::Packet;
use crate::units::{Channel, DurationMs, DurationUs, PulseWidthUs, RateUsPerS, Sequence, Ticks};

/// Why a command is refused: the reason, the channel, the limit and what was asked for.
struct Denial {
    refusal: Refusal,
    channel: Option<Channel>,
    limit: u32,
    got: u32,
}

impl From<Refusal> for Denial {
    fn from(refusal: Refusal) -> Self {
        Self { refusal, channel: None, limit: 0, got: 0 }
    }
}

impl Denial {
    fn on(refusal: Refusal, channel: Channel, limit: impl Into<u32>, got: impl Into<u32>) -> Self {
        Self { refusal, channel: Some(channel), limit: limit.into(), got: got.into() }
    }
}

impl<const SEGMENTS: usize> Board<SEGMENTS> {
    pub(super) fn handle(&mut self, packet: &Packet, now: Ticks, hardware: &mut impl Hardware) {
        let sequence = packet.sequence;
        let same_version = packet.version == crate::VERSION;
        if !same_version && !Command::is_frozen(packet.kind) {
            let denial = Denial {
                limit: crate::VERSION.into(),
                got: packet.version.into(),
                ..Refusal::Version.into()
            };
            return self.acknowledge(packet.kind, sequence, Err(denial), hardware);
        }
        let Some(command) = Command::decode(packet) else {
            return self.acknowledge(packet.kind, sequence, Err(Refusal::Malformed.into()), hardware);
        };
        let answer = match command {
            Command::Hello => {
                if same_version {
                    self.begin_session(now, hardware);
                }
                Event::Hello(self.identity)
            }
            Command::Status => Event::Status(Status {
                state: self.state,
                fault: self.fault,
                dead_man: self.dead_man,
                now,
                fault_at: if self.fault == Fault::None { Ticks(0) } else { self.fault_at },
                boot_id: self.identity.boot_id,
                damaged: self.damaged,
                refused: self.refused,
            }),
            Command::Ping => {
                let boot_id = self.identity.boot_id;
                Event::Pong { at: now, boot_id, state: self.state, fault: self.fault }
            }
            Command::EStop => {
                self.trip(Fault::EStop, now, hardware);
                return self.acknowledge(kind::E_STOP, sequence, Ok(()), hardware);
            }
            Command::Describe(channel) => match self.config(channel) {
                Ok(config) => Event::Description(config),
                Err(denial) => return self.acknowledge(packet.kind, sequence, Err(denial), hardware),
            },
            _ => return self.once(&command, sequence, now, hardware),
        };
        hardware.send(&answer.encode(sequence).encode());
    }

    fn begin_session(&mut self, now: Ticks, hardware: &mut impl Hardware) {
        if matches!(self.state, State::Armed | State::Running) {
            self.trip(Fault::HostRestarted, now, hardware);
        }
        self.forget_profile();
        self.answers = [None; STORED_ANSWERS];
        self.last_packet = Some(now);
    }

    /// Carries out a command that changes something; a resent one only gets its answer again.
    fn once(&mut self, command: &Command, sequence: Sequence, now: Ticks, hardware: &mut impl Hardware) {
        let kind = command.kind();
        let known = self.answers.iter().flatten().find(|(s, ack)| *s == sequence && ack.command == kind);
        if let Some((_, ack)) = known {
            return hardware.send(&Event::Ack(*ack).encode(sequence).encode());
        }
        let result = match self.last_packet {
            None => Err(Refusal::NoSession.into()),
            Some(_) => self.carry_out(command, now, hardware),
        };
        self.acknowledge(kind, sequence, result, hardware);
    }

    fn acknowledge(
        &mut self,
        command: u8,
        sequence: Sequence,
        result: Result<(), Denial>,
        hardware: &mut impl Hardware,
    ) {
        let denial = result.err().unwrap_or(Refusal::None.into());
        let Denial { refusal, channel, limit, got } = denial;
        if refusal != Refusal::None {
            self.refused = self.refused.wrapping_add(1);
        }
        let ack = Ack { command, refusal, channel, limit, got };
        self.answers[self.next_answer] = Some((sequence, ack));
        self.next_answer = (self.next_answer + 1) % STORED_ANSWERS;
        hardware.send(&Event::Ack(ack).encode(sequence).encode());
    }

    fn carry_out(
        &mut self,
        command: &Command,
        now: Ticks,
        hardware: &mut impl Hardware,
    ) -> Result<(), Denial> {
        match *command {
            Command::Configure(config) => self.configure(config, now, hardware),
            Command::Timing { dead_man, telemetry } => self.set_timing(dead_man, telemetry, now),
            Command::Clear => {
                self.in_state(&[State::Idle, State::Jogging])?;
                self.forget_profile();
                Ok(())
            }
            Command::Track { channel, start_pulse, segments } => {
                self.add_track(channel, start_pulse, segments)
            }
            Command::Segments { channel, first, segments } => {
                self.add_segments(channel, first, segments.as_slice())
            }
            Command::Arm { start, segments } => self.arm(start, segments, now),
            Command::Jog { channel, pulse, duration } => self.jog(channel, pulse, duration, now, hardware),
            Command::Abort => {
                self.in_state(&[State::Idle, State::Jogging, State::Armed, State::Running])?;
                self.forget_profile();
                for channel in &mut self.channels {
                    channel.line = None;
                }
                self.state = State::Idle;
                Ok(())
            }
            Command::Acknowledge(fault) => self.clear_fault(fault, now, hardware),
            Command::Goodbye => {
                self.in_state(&[State::Idle, State::Jogging, State::Faulted])?;
                self.last_packet = None;
                self.telemetry = DurationMs(0);
                if self.state != State::Faulted {
                    self.make_safe(now, hardware);
                    self.state = State::Jogging;
                    self.rest_if_still(now, hardware);
                }
                Ok(())
            }
            Command::Hello | Command::Status | Command::EStop | Command::Ping | Command::Describe(_) => {
                Err(Refusal::Malformed.into())
            }
        }
    }

    fn in_state(&self, allowed: &[State]) -> Result<(), Denial> {
        match self.state {
            state if allowed.contains(&state) => Ok(()),
            State::Faulted => Err(Denial { got: self.fault.code().into(), ..Refusal::Latched.into() }),
            state => Err(Denial { got: state.code().into(), ..Refusal::Busy.into() }),
        }
    }

    fn index(&self, channel: Channel) -> Result<usize, Denial> {
        if channel.0 < self.identity.channels {
            Ok(channel.0.into())
        } else {
            Err(Denial::on(Refusal::NoSuchChannel, channel, self.identity.channels, channel.0))
        }
    }

    fn config(&self, channel: Channel) -> Result<ChannelConfig, Denial> {
        let index = self.index(channel)?;
        self.channels[index].config.ok_or(Denial::on(Refusal::NotConfigured, channel, 0u32, 0u32))
    }

    fn configure(
        &mut self,
        config: ChannelConfig,
        now: Ticks,
        hardware: &mut impl Hardware,
    ) -> Result<(), Denial> {
        self.in_state(&[State::Idle])?;
        let index = self.index(config.channel)?;
        let pulses = config.min_pulse..=config.max_pulse;
        let sound = config.min_pulse.0 > 0
            && pulses.contains(&config.park_pulse)
            && (config.max_rate.0 > 0 || config.kind != ChannelKind::Servo);
        if !sound {
            return Err(Denial::on(Refusal::BadLimits, config.channel, 0u32, 0u32));
        }
        self.forget_profile();
        // A pulse that the new limits forbid must not go on.
        if self.channels[index].pulse.is_some_and(|pulse| !pulses.contains(&pulse)) {
            self.set_pulse(index, None, now, hardware);
        }
        self.channels[index].config = Some(config);
        Ok(())
    }

    fn set_timing(&mut self, dead_man: DurationMs, telemetry: DurationMs, now: Ticks) -> Result<(), Denial> {
        if !DEAD_MAN_RANGE_MS.contains(&dead_man.0) {
            let limit = dead_man.0.clamp(*DEAD_MAN_RANGE_MS.start(), *DEAD_MAN_RANGE_MS.end()).into();
            return Err(Denial { limit, got: dead_man.0.into(), ..Refusal::BadTiming.into() });
        }
        self.dead_man = dead_man;
        self.telemetry = telemetry;
        self.telemetry_due = now.plus(telemetry.into());
        Ok(())
    }

    fn check_pulse(config: &ChannelConfig, pulse: PulseWidthUs) -> Result<(), Denial> {
        let (channel, min, max) = (config.channel, config.min_pulse, config.max_pulse);
        if pulse < min {
            Err(Denial::on(Refusal::PulseTooShort, channel, min.0, pulse.0))
        } else if pulse > max {
            Err(Denial::on(Refusal::PulseTooLong, channel, max.0, pulse.0))
        } else {
            Ok(())
        }
    }

    fn check_line(config: &ChannelConfig, from: PulseWidthUs, to: &Segment) -> Result<(), Denial> {
        Self::check_pulse(config, to.end_pulse)?;
        if to.duration > MAX_DURATION {
            return Err(Denial::on(Refusal::TooLong, config.channel, MAX_DURATION.0, to.duration.0));
        }
        if !config.max_rate.allows(from, to.end_pulse, to.duration) {
            let needed = RateUsPerS::needed(from, to.end_pulse, to.duration);
            return Err(Denial::on(Refusal::RateTooHigh, config.channel, config.max_rate.0, needed.0));
        }
        Ok(())
    }

    fn add_track(
        &mut self,
        channel: Channel,
        start_pulse: PulseWidthUs,
        segments: u16,
    ) -> Result<(), Denial> {
        self.in_state(&[State::Idle, State::Jogging])?;
        let config = self.config(channel)?;
        Self::check_pulse(&config, start_pulse)?;
        let index = self.index(channel)?;
        self.last_track_complete()?;
        if self.channels[index].track.is_some() {
            return Err(Denial::on(Refusal::OutOfOrder, channel, 0u32, 0u32));
        }
        let track = self
            .store
            .track(start_pulse, segments)
            .map_err(|refusal| Denial::on(refusal, channel, SEGMENTS as u32, segments))?;
        self.channels[index].track = Some(track);
        self.uploading = Some(channel);
        Ok(())
    }

    fn last_track_complete(&self) -> Result<(), Denial> {
        match self.uploading.and_then(|channel| Some((channel, self.channels[usize::from(channel.0)].track?)))
        {
            Some((channel, track)) if !track.is_complete() => {
                Err(Denial::on(Refusal::Incomplete, channel, track.received as u32, 0u32))
            }
            _ => Ok(()),
        }
    }

    fn add_segments(&mut self, channel: Channel, first: u16, segments: &[Segment]) -> Result<(), Denial> {
        self.in_state(&[State::Idle, State::Jogging])?;
        let config = self.config(channel)?;
        let index = self.index(channel)?;
        let Some(mut track) = self.channels[index].track.filter(|_| self.uploading == Some(channel)) else {
            return Err(Denial::on(Refusal::OutOfOrder, channel, 0u32, first));
        };
        if usize::from(first) != track.received {
            return Err(Denial::on(Refusal::OutOfOrder, channel, track.received as u32, first));
        }
        if track.room() < segments.len() {
            return Err(Denial::on(Refusal::NoRoom, channel, track.room() as u32, segments.len() as u32));
        }
        let mut from = track.last_pulse();
        let mut duration = track.duration;
        for segment in segments {
            Self::check_line(&config, from, segment)?;
            from = segment.end_pulse;
            duration = DurationUs(duration.0 + segment.duration.0);
            if duration > MAX_DURATION {
                return Err(Denial::on(Refusal::TooLong, channel, MAX_DURATION.0, duration.0));
            }
        }
        self.store.extend(&mut track, segments);
        self.channels[index].track = Some(track);
        Ok(())
    }

    fn arm(&mut self, start: Ticks, segments: u16, now: Ticks) -> Result<(), Denial> {
        self.in_state(&[State::Idle])?;
        self.last_track_complete()?;
        if self.store.used() != usize::from(segments) || segments == 0 {
            let limit = self.store.used() as u32;
            return Err(Denial { limit, got: segments.into(), ..Refusal::Incomplete.into() });
        }
        let lead = start.since(now);
        if lead < MIN_LEAD.0 as i32 {
            let got = lead.max(0).unsigned_abs();
            return Err(Denial { limit: MIN_LEAD.0, got, ..Refusal::Underflow.into() });
        }
        if lead > MAX_LEAD.0 as i32 {
            return Err(Denial { limit: MAX_LEAD.0, got: lead.unsigned_abs(), ..Refusal::TooFar.into() });
        }
        for (number, channel) in (0..).zip(&self.channels) {
            if let Some(track) = channel.track
                && channel.pulse != Some(track.start_pulse)
            {
                let is = channel.pulse.map_or(0, |pulse| pulse.0);
                return Err(Denial::on(Refusal::NotAtStart, Channel(number), is, track.start_pulse.0));
            }
        }
        self.start = start;
        self.state = State::Armed;
        Ok(())
    }

    fn jog(
        &mut self,
        channel: Channel,
        pulse: PulseWidthUs,
        duration: DurationUs,
        now: Ticks,
        hardware: &mut impl Hardware,
    ) -> Result<(), Denial> {
        self.in_state(&[State::Idle, State::Jogging])?;
        let config = self.config(channel)?;
        let index = self.index(channel)?;
        Self::check_pulse(&config, pulse)?;
        let Some(from) = self.channels[index].line.map(|line| line.at(now)).or(self.channels[index].pulse)
        else {
            self.set_pulse(index, Some(pulse), now, hardware);
            return Ok(());
        };
        Self::check_line(&config, from, &Segment { duration, end_pulse: pulse })?;
        self.channels[index].line = Some(Line::new(from, pulse, now, duration));
        self.state = State::Jogging;
        self.advance(now, hardware);
        Ok(())
    }

    fn clear_fault(&mut self, fault: Fault, now: Ticks, hardware: &mut impl Hardware) -> Result<(), Denial> {
        if fault != self.fault {
            let (limit, got) = (self.fault.code().into(), fault.code().into());
            return Err(Denial { limit, got, ..Refusal::OtherFault.into() });
        }
        if self.state == State::Faulted {
            self.fault = Fault::None;
            // A channel still on its way to its park pulse goes on there.
            self.state = State::Jogging;
            self.rest_if_still(now, hardware);
        }
        Ok(())
    }
}
