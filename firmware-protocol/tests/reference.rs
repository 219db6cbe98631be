//! The reference firmware in C against the crate's own board: every byte and every pulse alike.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;

use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};

use firmware_protocol::channel::{ChannelConfig, SafeState};
use firmware_protocol::command::Command;
use firmware_protocol::event::{Fault, State};
use firmware_protocol::units::{Channel, DurationUs, Sequence};

use bench::dice::*;
use bench::*;

/// Builds the C firmware behind a program that replays sessions; none where there is no C compiler.
fn replay_program(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference");
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let built = Process::new(compiler)
        .args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-o"])
        .arg(&program)
        .args([folder.join("replay.c"), folder.join("board.c")])
        .status();
    match built {
        Ok(status) => {
            assert!(status.success(), "the reference firmware does not compile");
            Some(program)
        }
        Err(error) => {
            eprintln!("skipped: no C compiler ({error})");
            None
        }
    }
}

/// What the C firmware makes of the host's side of `sessions`.
fn replay(program: &Path, name: &str, sessions: &str) -> String {
    let input = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&input, sessions).unwrap();
    let file = std::fs::File::open(&input).unwrap();
    let output = Process::new(program).stdin(Stdio::from(file)).output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

/// A conversation at random: mostly sense, some of it resent, cut, damaged, foreign or followed by silence.
fn any_session(dice: &mut Dice, text: &mut String, seen: &mut Vec<(State, Fault)>) {
    let mut setup = Setup::new();
    text.push_str("# another session\n");
    let mut sequence = Sequence(0);
    let mut sent: Vec<Vec<u8>> = Vec::new();
    let mut say = |setup: &mut Setup, dice: &mut Dice, command: Command, text: &mut String| {
        sequence.0 += 1;
        let mut packet = command.encode(sequence);
        if dice.below(30) == 0 {
            packet.version = 2;
        }
        let mut bytes = packet.encode().to_vec();
        match dice.below(20) {
            0 => bytes.truncate(dice.below(bytes.len() as u32) as usize),
            1 => {
                let at = dice.below(bytes.len() as u32) as usize;
                bytes[at] ^= 1 << dice.below(8);
            }
            2 => bytes = bytes.repeat(2),
            // One from before, remembered or not any more.
            3 => bytes = sent.iter().rev().nth(dice.below(12) as usize).cloned().unwrap_or(bytes),
            _ => {}
        }
        sent.push(bytes.clone());
        if !bytes.is_empty() {
            setup.say_recorded(&bytes, text);
        }
    };
    say(&mut setup, dice, Command::Hello, text);
    for (number, safe_state) in (0..2).zip([SafeState::Park, SafeState::Detach]) {
        let config = ChannelConfig { channel: Channel(number), ..servo(safe_state) };
        say(&mut setup, dice, Command::Configure(config), text);
        let jog = Command::Jog { channel: Channel(number), pulse: CENTRE, duration: DurationUs(0) };
        say(&mut setup, dice, jog, text);
    }
    for _ in 0..60 {
        let profile = dice.below(6) == 0;
        for command in
            if profile { whole_profile(dice, &setup, DurationUs(0)) } else { vec![any_command(dice, &setup)] }
        {
            say(&mut setup, dice, command, text);
        }
        let wait = dice.pick(&[0, 0, 0, 0, 500, 12_345, 30_000, 120_000, 400_000]);
        setup.silence_recorded(wait, text);
        seen.push((setup.board.state(), setup.board.fault()));
    }
}

#[test]
fn c_firmware_conducts_the_session_vector() {
    let Some(program) = replay_program("replay-session") else { return };
    let session = include_str!("../vectors/session.txt");
    assert_eq!(replay(&program, "session.txt", session), session);
}

#[test]
fn c_firmware_and_board_agree_on_random_sessions() {
    let Some(program) = replay_program("replay-random") else { return };
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let (mut sessions, mut seen) = (String::new(), Vec::new());
    for _ in 0..300 {
        any_session(&mut dice, &mut sessions, &mut seen);
    }
    let replayed = replay(&program, "random.txt", &sessions);
    let first = sessions.lines().zip(replayed.lines()).position(|(ours, theirs)| ours != theirs);
    if let Some(line) = first {
        let around =
            |text: &str| text.lines().skip(line.saturating_sub(8)).take(10).collect::<Vec<_>>().join("\n");
        panic!("they part at line {line}:\n{}\n--- in C:\n{}", around(&sessions), around(&replayed));
    }
    assert_eq!(sessions.lines().count(), replayed.lines().count());
    // The dice reached all that a host can bring about.
    for state in State::ALL {
        assert!(seen.iter().any(|(s, _)| s == state), "never {state}");
    }
    for fault in [Fault::None, Fault::DeadMan, Fault::EStop, Fault::HostRestarted] {
        assert!(seen.iter().any(|(_, f)| *f == fault), "never {fault}");
    }
    println!("{} lines agree", sessions.lines().count());
}
