//! Questions and answers on a half-duplex bus: one speaks at a time, and whoever asked waits until a deadline.

use serialport::{ClearBuffer, SerialPort};

use super::packet::{Decoder, Packet, Protocol, Status};
use crate::port::{self, Received};
use ground::clock::MonotonicNs;

/// No answer comes later than this \[s\], chosen: a USB bridge left at its 16 ms latency, and the servo's own delay.
pub(super) const MAX_ANSWER_DELAY_S: f64 = 0.030;

/// An answer, and the times between which the servo gave it.
#[derive(Debug, Clone)]
pub(super) struct Answer {
    pub(super) status: Status,
    pub(super) sent: MonotonicNs,
    pub(super) received: MonotonicNs,
}

/// The port is gone: what the system said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Gone(pub(super) String);

/// The bus's end at this computer.
pub(super) struct Line {
    port: Box<dyn SerialPort>,
    protocol: Protocol,
    decoder: Decoder,
    /// An answer to the last question may still come until here.
    quiet_until: MonotonicNs,
    /// Damaged packets so far.
    pub(super) damaged: u64,
}

impl Line {
    pub(super) fn new(port: Box<dyn SerialPort>, protocol: Protocol) -> Self {
        Self { port, protocol, decoder: Decoder::new(protocol), quiet_until: MonotonicNs(0), damaged: 0 }
    }

    pub(super) fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Sends a packet that no servo answers.
    pub(super) fn send_unanswered(&mut self, packet: &Packet) -> Result<(), Gone> {
        self.send(packet).map(|_| ())
    }

    /// Asks one servo for an answer of `length` bytes, and waits for it for `wait_s` at most.
    pub(super) fn ask(
        &mut self,
        packet: &Packet,
        length: usize,
        wait_s: f64,
    ) -> Result<Option<Answer>, Gone> {
        let quiet_s = self.quiet_until.seconds_since(MonotonicNs::now());
        if quiet_s > 0.0 {
            std::thread::sleep(ground::strict::duration(quiet_s));
        }
        let until = MonotonicNs::now().plus_seconds(wait_s);
        Ok(self
            .exchange(packet, &[packet.id], length, until)?
            .and_then(|mut answers| answers.pop().flatten()))
    }

    /// Asks and waits for an answer of `length` bytes of each of `ids`, until `until` at most; none for those that did not come.
    /// Packets have no numbers: what comes too late for one question would be taken for the answer to the next. So a question that
    /// was not answered makes the line quiet for as long as an answer may take; none until then.
    pub(super) fn exchange(
        &mut self,
        packet: &Packet,
        ids: &[u8],
        length: usize,
        until: MonotonicNs,
    ) -> Result<Option<Vec<Option<Answer>>>, Gone> {
        if MonotonicNs::now() < self.quiet_until {
            return Ok(None);
        }
        let _ = self.port.clear(ClearBuffer::Input);
        self.decoder.reset();
        let sent = MonotonicNs::now();
        let sent_bytes = self.send(packet)?;
        let mut answers: Vec<Option<Answer>> = vec![None; ids.len()];
        let mut bytes = [0; 256];
        // Read first and look at the time after: bytes that are there by then were not late, this thread was.
        let mut over = false;
        while answers.iter().any(Option::is_none) && !over {
            let read = port::read(&mut *self.port, &mut bytes);
            over = MonotonicNs::now() >= until;
            let count = match read {
                Received::Bytes(count) => count,
                Received::Nothing => continue,
                Received::Gone(why) => return Err(Gone(why)),
            };
            let received = MonotonicNs::now();
            for packet in self.decoder.receive(&bytes[..count]) {
                let Ok(packet) = packet else {
                    self.damaged += 1;
                    continue;
                };
                // Adapters that join both directions on one wire receive what they send.
                if self.protocol.encode(&packet) == sent_bytes {
                    continue;
                }
                let Some(status) = self.protocol.as_status(packet) else { continue };
                if let Some(place) = ids.iter().position(|id| *id == status.id)
                    && status.data.len() == length
                {
                    answers[place].get_or_insert(Answer { status, sent, received });
                }
            }
        }
        if answers.iter().any(Option::is_none) {
            self.quiet_until = sent.plus_seconds(MAX_ANSWER_DELAY_S);
        }
        Ok(Some(answers))
    }

    fn send(&mut self, packet: &Packet) -> Result<Vec<u8>, Gone> {
        let bytes = self.protocol.encode(packet);
        self.port.write_all(&bytes).map_err(|error| Gone(format!("{error}; unplugged?")))?;
        Ok(bytes)
    }
}
