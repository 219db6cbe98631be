//! The emulator as another program sees it: a serial port, at the pace of the wall clock.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod emulator;

use std::io::{Read as _, Write as _};
use std::process::{Command as Process, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use firmware_protocol::command::Command;
use firmware_protocol::event::Event;
use firmware_protocol::packet::Decoder;
use firmware_protocol::units::{Sequence, Ticks};

use emulator::*;

/// Longest wait for port and answers on a busy machine, chosen.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(20);
/// Time that the board's clock may differ from the wall's over a second, on a busy machine.
const PACE_TOLERANCE: Duration = Duration::from_millis(400);

#[test]
fn board_answers_on_a_pseudo_terminal_in_wall_time() {
    let Some(built) = built() else { return };
    let (link, edges) = (built.elf.with_file_name("port"), built.elf.with_file_name("edges"));
    let _ = std::fs::remove_file(&link);
    let mut child = Process::new(&built.emulator)
        .args([
            built.elf.as_os_str(),
            "--pty".as_ref(),
            link.as_os_str(),
            "--edges".as_ref(),
            edges.as_os_str(),
        ])
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    let mut port = loop {
        match std::fs::File::options().read(true).write(true).open(&link) {
            Ok(port) => break port,
            Err(error) => assert!(began.elapsed() < ANSWER_TIMEOUT, "{error}"),
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let (sender, receiver) = mpsc::channel();
    let mut reader = port.try_clone().unwrap();
    std::thread::spawn(move || {
        let (mut decoder, mut bytes) = (Decoder::default(), [0; 64]);
        while let Ok(count) = reader.read(&mut bytes) {
            for packet in bytes[..count].iter().filter_map(|&byte| decoder.push(byte)) {
                let event = packet.ok().and_then(|packet| Event::decode(&packet));
                if sender.send(event).is_err() {
                    return;
                }
            }
        }
    });
    let mut sequence = Sequence(0);
    let mut tick = || -> (Instant, Ticks) {
        sequence.0 += 1;
        port.write_all(&Command::Ping.encode(sequence).encode()).unwrap();
        loop {
            if let Some(Event::Pong { at, .. }) = receiver.recv_timeout(ANSWER_TIMEOUT).expect("a packet") {
                return (Instant::now(), at);
            }
        }
    };
    let (first_wall, first) = tick();
    std::thread::sleep(Duration::from_secs(1));
    let (wall, last) = tick();
    child.kill().unwrap();
    child.wait().unwrap();
    let passed = Duration::from_micros(last.since(first) as u64);
    assert!(passed.abs_diff(wall - first_wall) < PACE_TOLERANCE, "{passed:?} in {:?}", wall - first_wall);
    let log = std::fs::read_to_string(edges).unwrap();
    assert!(log.lines().any(|line| line.ends_with("D13 1")), "{log}");
}
