//! How a link takes in the board's packets.

use firmware_protocol::VERSION;
use firmware_protocol::command::kind as command_kind;
use firmware_protocol::event::{Event, Fault, Identity, Occurrence, State, kind as event_kind};
use firmware_protocol::packet::Packet;
use firmware_protocol::units::Sequence;

use super::{Link, MAX_CLOCK_SAMPLES, Trouble};
use crate::ServoEvent;
use ground::clock::{MonotonicNs, Ping};

impl Link {
    pub(super) fn take_packet(&mut self, packet: &Packet, now: MonotonicNs) {
        self.last_packet = now;
        let frozen = matches!(packet.kind, event_kind::HELLO | event_kind::STATUS | event_kind::ACK);
        if packet.version != VERSION && !frozen {
            return;
        }
        let Some(event) = Event::decode(packet) else {
            self.damaged += 1;
            return;
        };
        match event {
            Event::Ack(ack) if ack.command == command_kind::E_STOP => {
                if let Some(stop) = self.e_stop.as_mut().filter(|stop| !stop.acknowledged) {
                    stop.acknowledged = true;
                    self.heartbeat = stop.resume.then_some(now);
                }
                return;
            }
            Event::Hello(identity) => self.introduced(identity, packet.version),
            Event::Pong { at, boot_id, state, fault } => {
                self.same_board(boot_id);
                let board_tick_us = self.ticks.extend(at.0);
                self.ponged(packet.sequence, board_tick_us, now);
                self.follow(state, fault, board_tick_us);
                return;
            }
            Event::Telemetry(telemetry) => {
                let board_tick_us = self.ticks.extend(telemetry.at.0);
                for (channel, pulse) in (0..).zip(telemetry.pulses()) {
                    if !self.watched.contains(&channel) {
                        continue;
                    }
                    let pulse_us = pulse.map(|pulse| pulse.0);
                    self.push_event(ServoEvent::Pulse { channel, board_tick_us, pulse_us });
                }
                return;
            }
            Event::Happened { occurrence, fault, at } => {
                let tick_us = self.ticks.extend(at.0);
                match occurrence {
                    Occurrence::Started => self.started(tick_us),
                    Occurrence::Finished => self.finished(tick_us),
                    Occurrence::Faulted => self.faulted(fault),
                }
                return;
            }
            Event::Ack(_) | Event::Status(_) | Event::Description(_) => {}
        }
        if self.under_way.as_ref().is_some_and(|pending| pending.sequence == packet.sequence) {
            self.under_way = None;
            self.answer = Some(Ok(event));
        }
    }

    fn introduced(&mut self, identity: Identity, version: u8) {
        if self.established {
            self.same_board(identity.boot_id);
        } else {
            // An earlier hello may be from before a reset, still in the port's buffer.
            self.board = Some((identity, version));
        }
    }

    fn same_board(&mut self, boot_id: u32) {
        if let Some((identity, _)) = self.board
            && self.established
            && identity.boot_id != boot_id
        {
            self.end(Trouble::Restarted { before: identity.boot_id, after: boot_id });
        }
    }

    fn ponged(&mut self, sequence: Sequence, board_tick_us: u64, received: MonotonicNs) {
        // Each ping is a new question with a number of its own, so an answer belongs to one sending only.
        let Some(index) = self.pings.iter().position(|&(number, _)| number == sequence) else { return };
        let Some((_, sent)) = self.pings.remove(index) else { return };
        if self.samples.len() == MAX_CLOCK_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Ping { sent, board_tick_us, received });
        self.push_event(ServoEvent::Ping { sent, board_tick_us, received });
    }

    /// What a pong says about the board's state makes up for a lost report of what happened.
    fn follow(&mut self, state: State, fault: Fault, tick_us: u64) {
        match (state, self.armed) {
            (State::Faulted, _) => self.faulted(fault),
            (State::Running, Some(armed)) => self.started(armed.start_us),
            (State::Idle, Some(armed)) if armed.started || tick_us > armed.end_us => {
                self.finished(armed.end_us)
            }
            _ => {}
        }
    }

    fn started(&mut self, board_tick_us: u64) {
        if let Some(armed) = self.armed.as_mut().filter(|armed| !armed.started) {
            armed.started = true;
            self.push_event(ServoEvent::Started { board_tick_us });
        }
    }

    fn finished(&mut self, board_tick_us: u64) {
        if let Some(armed) = self.armed.take() {
            if !armed.started {
                self.push_event(ServoEvent::Started { board_tick_us: armed.start_us });
            }
            self.push_event(ServoEvent::Finished { board_tick_us });
        }
    }

    fn faulted(&mut self, fault: Fault) {
        if fault != self.known_fault {
            self.known_fault = fault;
            self.raise(Trouble::Fault(fault));
        }
    }
}
