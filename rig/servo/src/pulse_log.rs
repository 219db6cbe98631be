//! The pulses of a mock board in a file, so that a mock camera in another process can follow them.
//!
//! One line per change, `monotonic_ns,channel,pulse_us` with `-` for a detached channel, or `monotonic_ns,sync-led,1` with 0 for
//! a dark one; written whole and at once. A file beside it, `.known` in place of `.log`, holds in eight bytes until when all of it is
//! written. CLOCK_MONOTONIC is the same for all processes of a machine, so the stamps need no translation.

#![allow(clippy::disallowed_methods, reason = "a log that grows while another process reads it")]

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::PulseSink;
use ground::clock::MonotonicNs;

/// What stands in the channel's column for the sync LED.
const SYNC_LED: &str = "sync-led";

/// A line of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Logged {
    /// As [`PulseSink::pulse`].
    Pulse {
        /// Channel number.
        channel: u8,
        /// Pulse width, or none while detached \[µs\].
        pulse_us: Option<u16>,
    },
    /// As [`PulseSink::sync_led`].
    SyncLed {
        /// Whether it is lit.
        lit: bool,
    },
}

impl Logged {
    /// Passes this entry, of the time `at`, on to `sink`.
    pub fn send_to(self, at: MonotonicNs, sink: &mut dyn PulseSink) {
        match self {
            Self::Pulse { channel, pulse_us } => sink.pulse(channel, pulse_us, at),
            Self::SyncLed { lit } => sink.sync_led(lit, at),
        }
    }
}

/// Appends pulses to a log.
#[derive(Debug)]
pub struct PulseLogWriter {
    path: PathBuf,
    file: File,
    known: Option<File>,
    failed: bool,
}

impl PulseLogWriter {
    /// Opens the log at `path` to append to it, and makes it where there is none.
    ///
    /// # Errors
    /// What the system says.
    pub fn append(path: &Path) -> std::io::Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        // Without it whoever reads the log waits a little longer.
        let known = File::create(completeness_path(path)).ok();
        Ok(Self { path: path.into(), file, known, failed: false })
    }
}

impl PulseSink for PulseLogWriter {
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs) {
        self.log(match pulse_us {
            Some(us) => format!("{},{channel},{us}\n", at.0),
            None => format!("{},{channel},-\n", at.0),
        });
    }

    fn sync_led(&mut self, lit: bool, at: MonotonicNs) {
        self.log(format!("{},{SYNC_LED},{}\n", at.0, u8::from(lit)));
    }

    fn complete(&mut self, until: MonotonicNs) {
        if let Some(known) = &self.known {
            // Eight bytes at one place are there whole or not at all.
            let _ = known.write_at(&until.0.to_le_bytes(), 0);
        }
    }
}

impl PulseLogWriter {
    fn log(&mut self, line: String) {
        // A pulse train has nobody to return an error to: say it once, go on moving the mechanism.
        if let Err(error) = self.file.write_all(line.as_bytes())
            && !std::mem::replace(&mut self.failed, true)
        {
            tracing::error!(
                "writing pulses to {}: {error}; the mock camera will not see them",
                self.path.display()
            );
        }
    }
}

fn completeness_path(log: &Path) -> PathBuf {
    log.with_extension("known")
}

/// Follows a log while it grows.
#[derive(Debug)]
pub struct PulseLogReader {
    path: PathBuf,
    file: Option<File>,
    position: u64,
    /// A line not yet ended.
    rest: Vec<u8>,
    malformed: u64,
}

impl PulseLogReader {
    /// A reader of the log at `path`, from its beginning; the log may come into being later.
    pub fn new(path: &Path) -> Self {
        Self { path: path.into(), file: None, position: 0, rest: Vec::new(), malformed: 0 }
    }

    /// The whole lines added since the last call, in the order written.
    /// A log that became shorter is a new one and is read from its beginning; a malformed line is counted.
    pub fn poll(&mut self) -> Vec<(MonotonicNs, Logged)> {
        match self.read_on() {
            Ok(()) => {}
            Err(error) => {
                tracing::debug!("reading pulses from {}: {error}", self.path.display());
                self.file = None;
            }
        }
        let Some(end) = self.rest.iter().rposition(|&b| b == b'\n') else { return Vec::new() };
        let lines: Vec<u8> = self.rest.drain(..=end).collect();
        let mut pulses = Vec::new();
        for line in lines.split(|&b| b == b'\n').filter(|line| !line.is_empty()) {
            match parse(line) {
                Some(pulse) => pulses.push(pulse),
                None => self.malformed += 1,
            }
        }
        pulses
    }

    /// Until when the log is complete, as its writer says; to be read before [`PulseLogReader::poll`].
    pub fn complete_until(&self) -> Option<MonotonicNs> {
        let bytes = std::fs::read(completeness_path(&self.path)).ok()?;
        Some(MonotonicNs(u64::from_le_bytes(bytes.try_into().ok()?)))
    }

    /// Number of malformed lines so far.
    pub fn malformed(&self) -> u64 {
        self.malformed
    }

    fn read_on(&mut self) -> std::io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            None => match File::open(&self.path) {
                Ok(file) => self.file.insert(file),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
                Err(error) => return Err(error),
            },
        };
        if file.metadata()?.len() < self.position {
            self.position = 0;
            self.rest.clear();
        }
        file.seek(SeekFrom::Start(self.position))?;
        self.position += file.read_to_end(&mut self.rest)? as u64;
        Ok(())
    }
}

fn parse(line: &[u8]) -> Option<(MonotonicNs, Logged)> {
    let mut fields = std::str::from_utf8(line).ok()?.split(',');
    let at = MonotonicNs(fields.next()?.parse().ok()?);
    let logged = match (fields.next()?, fields.next()?) {
        (SYNC_LED, lit) => Logged::SyncLed { lit: lit.parse::<u8>().ok()? == 1 },
        (channel, "-") => Logged::Pulse { channel: channel.parse().ok()?, pulse_us: None },
        (channel, us) => Logged::Pulse { channel: channel.parse().ok()?, pulse_us: Some(us.parse().ok()?) },
    };
    fields.next().is_none().then_some((at, logged))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reader_follows_writer_across_a_torn_line_and_a_new_log() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("servo.log");
        let mut reader = PulseLogReader::new(&path);
        assert_eq!(reader.poll(), []);

        let mut writer = PulseLogWriter::append(&path).unwrap();
        let pulse = |channel, pulse_us| Logged::Pulse { channel, pulse_us };
        writer.pulse(0, Some(1500), MonotonicNs(7));
        writer.sync_led(true, MonotonicNs(8));
        let lit = Logged::SyncLed { lit: true };
        assert_eq!(reader.poll(), [(MonotonicNs(7), pulse(0, Some(1500))), (MonotonicNs(8), lit)]);
        assert_eq!(reader.poll(), []);
        assert_eq!(reader.complete_until(), None);
        writer.complete(MonotonicNs(8));
        assert_eq!(reader.complete_until(), Some(MonotonicNs(8)));

        writer.file.write_all(b"9,1").unwrap();
        assert_eq!(reader.poll(), []);
        writer.file.write_all(b",-\nrubbish\n").unwrap();
        assert_eq!(reader.poll(), [(MonotonicNs(9), pulse(1, None))]);
        assert_eq!(reader.malformed(), 1);

        std::fs::write(&path, "1,2,3\n").unwrap();
        assert_eq!(reader.poll(), [(MonotonicNs(1), pulse(2, Some(3)))]);
    }
}
