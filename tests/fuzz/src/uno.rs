//! The Uno's firmware in the emulator of its chip, bytes at its serial line and pulses at its pins.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};
use std::sync::LazyLock;

use firmware_protocol::command::Command;
use firmware_protocol::event::{Ack, Event};
use firmware_protocol::packet::{Decoder, MAX_BODY_BYTES, Packet};
use firmware_protocol::units::Sequence;

const CYCLES_PER_US: u64 = 16;
/// From power-on until the board listens \[us\].
const START_US: u64 = 30_000;
/// Time of a byte on the emulator's line, and of what it takes to be done with the last ones \[us\].
const BYTE_US: u64 = 100;
const REST_US: u64 = 60_000;
/// The longest line of bytes, and the longest pauses in it together: an emulated second takes a real tenth of one. Chosen.
const MOST_BYTES: usize = 1024;
const MOST_PAUSES_US: u64 = 300_000;
/// Pins of channels 0 to 7, as printed on the board.
const PINS: [&str; 8] = ["D2", "D3", "D4", "D5", "D6", "D7", "D8", "D9"];
/// Limits of the chip, which no channel's may exceed \[us\]: firmware-protocol/uno/build.
const CHIP_US: [u64; 2] = [100, 4900];
/// The sequence number of the last stop, unlike any before.
const LAST: Sequence = Sequence(0x5354);

/// Emulator and firmware; none where the tools for them are missing, which is said.
static BUILT: LazyLock<Option<[PathBuf; 2]>> = LazyLock::new(|| {
    let built = build();
    if built.is_none() {
        eprintln!("skipped: apt-get install gcc-avr avr-libc libsimavr-dev libelf-dev");
    }
    built
});

fn build() -> Option<[PathBuf; 2]> {
    let folder = std::env::current_exe().ok()?.with_file_name(format!("fuzz-uno-{}", std::process::id()));
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../firmware-protocol/uno");
    let runs =
        |process: &mut Process| process.stdout(Stdio::null()).status().is_ok_and(|status| status.success());
    let emulator = folder.join("emulator");
    let is_built = runs(Process::new(source.join("build")).arg(&folder))
        && runs(
            Process::new("cc")
                .args(["-O2", "-o"])
                .arg(&emulator)
                .arg(source.join("emulator.c"))
                .args(["-lsimavr", "-lelf", "-lutil"]),
        );
    // in one place however often it is built
    let to = [folder.with_file_name("fuzz-uno-emulator"), folder.with_file_name("fuzz-uno.elf")];
    let moved = is_built
        && std::fs::rename(&emulator, &to[0]).is_ok()
        && std::fs::rename(folder.join("uno.elf"), &to[1]).is_ok();
    let _ = std::fs::remove_dir_all(&folder);
    moved.then_some(to)
}

/// What a line is made of: pieces of a length, a pause before them and as many bytes, each a packet without its frame, kind and body, or
/// raw.
fn pieces(mut bytes: &[u8]) -> Vec<(u64, Vec<u8>)> {
    let (mut pieces, mut sequence) = (Vec::new(), 0);
    while let [length, how, rest @ ..] = bytes {
        let (piece, others) = rest.split_at(rest.len().min(usize::from(*length)));
        bytes = others;
        let pause_us = u64::from(how >> 1) * 1000;
        let line = match piece {
            [kind, body @ ..] if how & 1 == 0 && body.len() <= MAX_BODY_BYTES => {
                sequence += 1;
                Packet::new(*kind, Sequence(sequence), body).encode().to_vec()
            }
            raw => raw.to_vec(),
        };
        pieces.push((pause_us, line));
    }
    pieces
}

/// What came over the line, and pulses with their channels \[cycles\].
fn heard(said: &str) -> (Vec<Packet>, Vec<(usize, u64)>) {
    let (mut packets, mut pulses, mut decoder, mut rose) =
        (Vec::new(), Vec::new(), Decoder::default(), [None; 8]);
    for line in said.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let cycle = || words[0].parse::<u64>().unwrap_or_else(|error| panic!("{line}: {error}"));
        match words[..] {
            [_, "reset"] => panic!("the board has reset itself: {said}"),
            [_, "<", byte] => {
                let byte = u8::from_str_radix(byte, 16).unwrap_or_else(|error| panic!("{line}: {error}"));
                packets.extend(
                    decoder
                        .push(byte)
                        .map(|packet| packet.unwrap_or_else(|error| panic!("{error:?}: {said}"))),
                );
            }
            [_, pin, level] => {
                let Some(channel) = PINS.iter().position(|name| *name == pin) else { continue };
                match (level, rose[channel].take()) {
                    ("1", _) => rose[channel] = Some(cycle()),
                    (_, Some(at)) => pulses.push((channel, cycle() - at)),
                    _ => {}
                }
            }
            _ => {}
        }
    }
    (packets, pulses)
}

/// Bytes at the serial line: each pulse is as long as a channel's limits allow that were told the board, the board answers in whole packets,
/// does not reset itself, and hears a stop behind all of it.
pub(crate) fn uno(bytes: &[u8]) -> bool {
    // nothing is there that could fail
    let Some([emulator, firmware]) = &*BUILT else { return true };
    let (mut orders, mut at_us, mut sent, mut paused_us) = (String::new(), START_US, Vec::new(), 0);
    for (pause_us, line) in pieces(bytes) {
        paused_us += pause_us;
        if sent.len() + line.len() > MOST_BYTES || paused_us > MOST_PAUSES_US {
            break;
        }
        at_us += pause_us;
        let hex: String = line.iter().map(|byte| format!("{byte:02x}")).collect();
        let _ = write!(orders, "run {}\nsend {hex}\n", at_us * CYCLES_PER_US);
        at_us += BYTE_US * line.len() as u64;
        sent.extend(line);
    }
    let stop = Command::EStop.encode(LAST).encode();
    let hex: String = stop.iter().map(|byte| format!("{byte:02x}")).collect();
    at_us += REST_US;
    let end_us = at_us + REST_US;
    let _ = write!(orders, "run {}\nsend {hex}\nrun {}\n", at_us * CYCLES_PER_US, end_us * CYCLES_PER_US);

    let said = run(emulator, firmware, &orders).unwrap_or_else(|error| panic!("the emulator: {error}"));
    let (packets, pulses) = heard(&said);
    let is_stopped = |packet: &Packet| {
        packet.sequence == LAST && matches!(Event::decode(packet), Some(Event::Ack(Ack { .. })))
    };
    assert!(packets.iter().any(is_stopped), "a stop behind garbage is answered: {orders}{said}");

    let mut limits_us = [[u64::MAX, 0]; 8];
    let mut decoder = Decoder::default();
    for packet in sent.iter().filter_map(|&byte| decoder.push(byte)).filter_map(Result::ok) {
        if let Some(Command::Configure(channel)) = Command::decode(&packet)
            && let Some([least, most]) = limits_us.get_mut(usize::from(channel.channel.0))
        {
            *least = u64::from(channel.min_pulse.0).max(CHIP_US[0]).min(*least);
            *most = u64::from(channel.max_pulse.0).min(CHIP_US[1]).max(*most);
        }
    }
    for (channel, cycles) in &pulses {
        let [least, most] = limits_us[*channel];
        let allowed = least.saturating_mul(CYCLES_PER_US)..=most * CYCLES_PER_US;
        assert!(
            allowed.contains(cycles),
            "channel {channel}: {cycles} cycles, {least} to {most} us allowed: {orders}{said}"
        );
    }
    !pulses.is_empty()
}

fn run(emulator: &Path, firmware: &Path, orders: &str) -> std::io::Result<String> {
    let mut process = Process::new(emulator);
    let mut child = process.arg(firmware).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    let mut input = child.stdin.take();
    // what it says is less than a pipe holds only if nobody sends much: it is read beside
    std::thread::scope(|scope| {
        scope.spawn(move || input.take().map(|mut input| input.write_all(orders.as_bytes())));
        let output = child.wait_with_output()?;
        if output.status.success() {
            String::from_utf8(output.stdout).map_err(std::io::Error::other)
        } else {
            Err(std::io::Error::other(output.status.to_string()))
        }
    })
}
