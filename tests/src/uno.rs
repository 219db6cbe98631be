//! The Uno's firmware in the emulator of its chip as a board beside a test, and a servo at its pin.

use std::path::Path;
use std::process::{Command, Stdio};

use ground::clock::MonotonicNs;

use crate::{Background, repository};

/// Processor cycles a second.
const CLOCK_HZ: f64 = 16e6;
/// The pin of channel 0.
const PIN: &str = "D2";
/// Without a pulse for so long a channel is detached \[s\]: a frame and a half.
const DETACH_TIMEOUT_S: f64 = 0.03;

/// Builds firmware and emulator into `folder`. False where a tool for it is missing.
pub fn build(folder: &Path) -> bool {
    let source = repository().join("firmware-protocol/uno");
    let runs = |command: &mut Command| command.status().is_ok_and(|status| status.success());
    runs(Command::new(source.join("build")).arg(folder).stdout(Stdio::null()))
        && runs(
            Command::new("cc")
                .args(["-O2", "-o"])
                .arg(folder.join("emulator"))
                .arg(source.join("emulator.c"))
                .args(["-lsimavr", "-lelf", "-lutil"]),
        )
}

/// Starts what was built into `folder`, behind a pseudo-terminal that `port` will link to, at the pace of the wall clock; what happens at
/// the pins goes into the file `edges`.
pub fn start(folder: &Path, port: &Path, edges: &Path) -> Background {
    let mut board = Command::new(folder.join("emulator"));
    board.arg(folder.join("uno.elf")).arg("--pty").arg(port).arg("--edges").arg(edges).stdin(Stdio::null());
    Background::start(board)
}

/// Reads pulses off the pin of channel 0 as a servo does: a pulse counts when it has ended.
#[derive(Debug, Default)]
pub struct Servo {
    /// A line of the emulator's that has not ended.
    rest: String,
    /// When cycle 0 was \[s\].
    began_s: Option<f64>,
    rose_s: Option<f64>,
    /// The last pulse: when it ended \[s\], and how long it was.
    last: Option<(f64, u16)>,
}

impl Servo {
    /// Takes what the emulator wrote since the last call. The changes in it: when, on its CLOCK_MONOTONIC, and the pulse's length from
    /// then on \[us\]; none: detached.
    pub fn hear(&mut self, text: &str) -> Vec<(MonotonicNs, Option<u16>)> {
        let at = |seconds: f64| MonotonicNs((seconds * 1e9) as u64);
        self.rest += text;
        let whole = self.rest.rfind('\n').map_or(0, |end| end + 1);
        let rest = self.rest.split_off(whole);
        let lines = std::mem::replace(&mut self.rest, rest);
        let mut changes = Vec::new();
        let mut now_s = None;
        for line in lines.lines() {
            let words: Vec<&str> = line.split(' ').collect();
            let [cycle, what, value] = words[..] else { continue };
            let at_s = cycle.parse::<f64>().expect("a cycle") / CLOCK_HZ;
            if what == "began" {
                self.began_s = Some(value.parse::<f64>().expect("seconds") - at_s);
                continue;
            }
            let at_s = at_s + self.began_s.expect("the emulator says when it began");
            now_s = Some(at_s);
            match (what == PIN, value) {
                (true, "1") => self.rose_s = Some(at_s),
                (true, _) => {
                    let width_us = ((at_s - self.rose_s.take().expect("it rose")) * 1e6).round() as u16;
                    if self.last.is_none_or(|(_, before)| before != width_us) {
                        changes.push((at(at_s), Some(width_us)));
                    }
                    self.last = Some((at_s, width_us));
                }
                (false, _) => {}
            }
        }
        if let Some((ended_s, _)) =
            self.last.filter(|(ended_s, _)| now_s.is_some_and(|now_s| now_s - ended_s > DETACH_TIMEOUT_S))
        {
            changes.push((at(ended_s + DETACH_TIMEOUT_S), None));
            self.last = None;
        }
        changes
    }
}
