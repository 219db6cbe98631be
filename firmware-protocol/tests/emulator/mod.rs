//! The firmware for an Uno in simavr: bytes in, edges on pins and bytes out, in virtual time.

#![allow(dead_code, reason = "each test file uses its part")]
#![allow(unreachable_pub, reason = "shared between test files")]
#![allow(missing_docs, reason = "test helpers")]

use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command as Process, Stdio};
use std::sync::OnceLock;

use firmware_protocol::board::BoardConfig;
use firmware_protocol::channel::{ChannelConfig, ChannelKind, SafeState};
use firmware_protocol::command::Command;
use firmware_protocol::event::{Ack, Event, Fault, Refusal};
use firmware_protocol::packet::{Decoder, Packet};
use firmware_protocol::units::{Channel, DurationUs, Name, PulseWidthUs, RateUsPerS, Sequence, Ticks};

pub const CYCLES_PER_US: u64 = 16;
pub const CYCLES_PER_MS: u64 = 1000 * CYCLES_PER_US;
/// Time from one pulse of a channel to the next \[cycles\].
pub const FRAME: u64 = 20 * CYCLES_PER_MS;
/// Pins of channels 0 to 7, as printed on the board.
pub const SERVO_PINS: [&str; 8] = ["D2", "D3", "D4", "D5", "D6", "D7", "D8", "D9"];
pub const HOLD_PIN: &str = "D10";
pub const LAMP_PIN: &str = "D11";
pub const SYNC_LED_PIN: &str = "D13";
/// The chip's memory ends here, and the stack begins.
const RAM_END: u32 = 0x8ff;
/// Bytes that must stay free between stack and variables, chosen as a reserve for cases that no test covers.
const MIN_FREE_STACK_BYTES: u32 = 64;

/// Firmware and emulator, built.
pub struct Built {
    pub elf: PathBuf,
    pub emulator: PathBuf,
    /// First free address after the firmware's variables.
    variables_end: u32,
}

/// Builds both, once; none where the tools for it are missing, unless `RIG_EMULATOR=required`.
pub fn built() -> Option<&'static Built> {
    static BUILT: OnceLock<Option<Built>> = OnceLock::new();
    BUILT.get_or_init(|| build("usual", &[])).as_ref()
}

fn runs(process: &mut Process) -> bool {
    match process.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status() {
        Ok(status) => status.success(),
        Err(error) if error.kind() == ErrorKind::NotFound => false,
        Err(error) => panic!("{process:?}: {error}"),
    }
}

/// As [`built`], with options for the compiler, in a folder of its own.
pub fn build(name: &str, options: &[&str]) -> Option<Built> {
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let has_avr = runs(Process::new("avr-gcc").arg("--version"));
    let headers = ["-include", "simavr/sim_avr.h", "-include", "libelf.h"];
    let has_simavr =
        runs(Process::new(&compiler).args(headers).args(["-x", "c", "-fsyntax-only", "/dev/null"]));
    for (has, what) in [(has_avr, "gcc-avr avr-libc"), (has_simavr, "libsimavr-dev libelf-dev")] {
        if !has {
            assert!(std::env::var_os("RIG_EMULATOR").is_none_or(|v| v != "required"), "{what} is missing");
            eprintln!("skipped: the Uno's firmware in its emulator (apt-get install {what})");
            return None;
        }
    }

    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("uno");
    // Each test binary has its own folder: they build at the same time.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(env!("CARGO_CRATE_NAME")).join(name);
    let sizes = Process::new(source.join("build")).arg(&folder).args(options).output().unwrap();
    assert!(sizes.status.success(), "{}", String::from_utf8_lossy(&sizes.stderr));
    let sizes = String::from_utf8(sizes.stdout).unwrap();
    let size = |column| sizes.lines().nth(1).unwrap().split_whitespace().nth(column).unwrap().parse::<u32>();
    let (data, bss) = (size(1).unwrap(), size(2).unwrap());

    let emulator = folder.join("emulator");
    let status = Process::new(compiler)
        .args(["-O2", "-Wall", "-Wextra", "-Werror", "-o"])
        .arg(&emulator)
        .arg(source.join("emulator.c"))
        .args(["-lsimavr", "-lelf", "-lutil"])
        .status();
    assert!(status.unwrap().success(), "the emulator does not compile");
    Some(Built { elf: folder.join("uno.elf"), emulator, variables_end: 0x100 + data + bss })
}

/// A pin went high or low.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Edge {
    pub cycle: u64,
    pub pin: String,
    pub high: bool,
}

/// From one cycle to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pulse {
    pub rise: u64,
    pub width: u64,
}

/// A packet and the cycle at which its last byte came, or was handed to the line.
pub type At<T> = (u64, T);

pub struct Emulator {
    child: Child,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
    pub now_us: u64,
    pub edges: Vec<Edge>,
    pub events: Vec<At<(Sequence, Event)>>,
    /// When bytes had reached the board.
    pub taken: Vec<At<u8>>,
    pub resets: Vec<u64>,
    pub lowest_stack: u32,
    variables_end: u32,
    decoder: Decoder,
    sequence: Sequence,
}

impl Emulator {
    pub fn new(built: &Built, arguments: &[&str]) -> Self {
        let mut child = Process::new(&built.emulator)
            .arg(&built.elf)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut emulator = Self {
            stdin: child.stdin.take(),
            stdout: BufReader::new(child.stdout.take().unwrap()),
            child,
            now_us: 0,
            edges: Vec::new(),
            events: Vec::new(),
            taken: Vec::new(),
            resets: Vec::new(),
            lowest_stack: RAM_END,
            variables_end: built.variables_end,
            decoder: Decoder::default(),
            sequence: Sequence(0),
        };
        // It writes its count of starts, begins, and says hello.
        emulator.run_ms(30);
        emulator
    }

    pub fn order(&mut self, line: &str) {
        writeln!(self.stdin.as_mut().unwrap(), "{line}").unwrap();
    }

    pub fn run_us(&mut self, us: u64) {
        self.run_us_and_cycles(us, 0);
    }

    /// A part of a microsecond further: until the next run, `now_us` is that much behind.
    pub fn run_us_and_cycles(&mut self, us: u64, cycles: u64) {
        self.now_us += us;
        self.order(&format!("run {}", self.now_us * CYCLES_PER_US + cycles));
        loop {
            let mut line = String::new();
            assert!(self.stdout.read_line(&mut line).unwrap() > 0, "the emulator ended by itself");
            let words: Vec<_> = line.split_whitespace().collect();
            match words[..] {
                ["=", _, stack] => {
                    self.lowest_stack = stack.parse().unwrap();
                    break;
                }
                [cycle, "<", byte] => {
                    self.hear(cycle.parse().unwrap(), u8::from_str_radix(byte, 16).unwrap())
                }
                [cycle, ">", byte] => {
                    self.taken.push((cycle.parse().unwrap(), u8::from_str_radix(byte, 16).unwrap()));
                }
                [cycle, "reset"] => self.resets.push(cycle.parse().unwrap()),
                [cycle, pin, level] => self.edges.push(Edge {
                    cycle: cycle.parse().unwrap(),
                    pin: pin.to_owned(),
                    high: level == "1",
                }),
                _ => panic!("the emulator said {line:?}"),
            }
        }
        assert!(
            self.stack_left() >= MIN_FREE_STACK_BYTES,
            "the stack came within {} bytes of the variables",
            self.stack_left()
        );
    }

    /// Bytes that the stack never reached.
    pub fn stack_left(&self) -> u32 {
        self.lowest_stack - self.variables_end
    }

    pub fn run_ms(&mut self, ms: u64) {
        self.run_us(1000 * ms);
    }

    fn hear(&mut self, cycle: u64, byte: u8) {
        if let Some(packet) = self.decoder.push(byte) {
            // A reset cuts a packet short; nothing else does.
            let cut = |at: &u64| cycle - at < 100 * CYCLES_PER_MS;
            match packet {
                Ok(packet) => {
                    self.events.push((cycle, (packet.sequence, Event::decode(&packet).unwrap())));
                }
                Err(error) => {
                    assert!(self.resets.last().is_some_and(cut), "the board sent garbage: {error:?}")
                }
            }
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
        self.order(&format!("send {hex}"));
    }

    pub fn next_packet(&mut self, command: Command) -> Packet {
        self.sequence.0 = self.sequence.0.wrapping_add(1);
        command.encode(self.sequence)
    }

    /// Sends bytes and lets time pass until the board has them all; says when, in cycles.
    pub fn hand_over(&mut self, bytes: &[u8]) -> u64 {
        let before = self.taken.len();
        self.send(bytes);
        let patience = self.now_us + 200 * bytes.len() as u64 + 20_000;
        while self.taken.len() < before + bytes.len() {
            assert!(self.now_us < patience, "the board does not read");
            self.run_us(500);
        }
        let (cycle, _) = *self.taken.last().unwrap();
        while self.now_us * CYCLES_PER_US <= cycle {
            self.run_us(100);
        }
        cycle
    }

    /// Sends a command and waits for the answer.
    pub fn say(&mut self, command: Command) -> Event {
        let packet = self.next_packet(command);
        let events_before = self.events.len();
        self.send(&packet.encode());
        for _ in 0..200 {
            self.run_us(500);
            let answer = self.events[events_before..].iter().find(|(_, (sequence, event))| {
                *sequence == packet.sequence && !matches!(event, Event::Happened { .. } | Event::Telemetry(_))
            });
            if let Some((_, (_, event))) = answer {
                return *event;
            }
        }
        panic!("no answer to {command:?}");
    }

    pub fn ack(&mut self, command: Command) -> Ack {
        match self.say(command) {
            Event::Ack(ack) => ack,
            other => panic!("{command:?} was answered by {other:?}"),
        }
    }

    pub fn must(&mut self, command: Command) {
        let ack = self.ack(command);
        assert_eq!(ack.refusal, Refusal::None, "{command:?}: {ack:?}");
    }

    /// Lets time pass with a host that pings.
    pub fn pass_ms(&mut self, ms: u64) {
        let until = self.now_us + 1000 * ms;
        while self.now_us < until {
            self.say(Command::Ping);
            self.run_us((until.saturating_sub(self.now_us)).min(50_000));
        }
    }

    /// The cycle at which the board's tick was 0, by a ping.
    pub fn tick_origin(&mut self) -> u64 {
        let Event::Pong { at, .. } = self.say(Command::Ping) else { panic!("no pong") };
        let end = self.taken.last().unwrap().0;
        end - u64::from(at.0) * CYCLES_PER_US
    }

    /// The board's tick at the end of what was run.
    pub fn tick(&mut self) -> Ticks {
        let origin = self.tick_origin();
        Ticks(((self.now_us * CYCLES_PER_US - origin) / CYCLES_PER_US) as u32)
    }

    /// What the board said it is when it started.
    pub fn board_config(&self) -> BoardConfig {
        let (_, (_, Event::Hello(identity))) = self.events[0] else { panic!("no hello") };
        BoardConfig {
            boot_id: identity.boot_id,
            channels: identity.channels,
            firmware: identity.firmware,
            fault: Fault::None,
        }
    }

    /// Whole pulses of a pin.
    pub fn pulses(&self, pin: &str) -> Vec<Pulse> {
        let mut rise = None;
        let mut pulses = Vec::new();
        // One that was under way when the record began is not whole.
        for edge in self.edges.iter().filter(|edge| edge.pin == pin).skip_while(|edge| !edge.high) {
            match (edge.high, rise) {
                (true, None) => rise = Some(edge.cycle),
                (false, Some(rise_cycle)) => {
                    pulses.push(Pulse { rise: rise_cycle, width: edge.cycle - rise_cycle });
                    rise = None;
                }
                (high, _) => panic!("{pin} went twice to {high} at cycle {}", edge.cycle),
            }
        }
        pulses
    }

    pub fn attach(&mut self, config: ChannelConfig, pulse: u16) {
        self.must(Command::Configure(config));
        self.jog(config.channel.0, pulse, 0);
    }

    pub fn jog(&mut self, channel: u8, pulse: u16, us: u32) {
        let (channel, pulse) = (Channel(channel), PulseWidthUs(pulse));
        self.must(Command::Jog { channel, pulse, duration: DurationUs(us) });
    }

    /// Ends the emulator as a power cut does; its EEPROM stays.
    pub fn power_off(mut self) {
        self.stdin = None;
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.stdin = None;
        let _ = self.child.wait();
    }
}

/// A servo with the whole range, fast enough for any step in a microsecond.
pub fn wide_servo(channel: u8, safe_state: SafeState) -> ChannelConfig {
    ChannelConfig {
        channel: Channel(channel),
        kind: ChannelKind::Servo,
        safe_state,
        min_pulse: PulseWidthUs(500),
        max_pulse: PulseWidthUs(2500),
        park_pulse: PulseWidthUs(1400),
        max_rate: RateUsPerS(u32::MAX),
        name: Name::new("servo").unwrap(),
    }
}
