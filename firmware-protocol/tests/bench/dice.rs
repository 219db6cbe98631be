//! Commands that the dice choose, good and bad.

use firmware_protocol::channel::{ChannelConfig, ChannelKind, SafeState};
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::Fault;
use firmware_protocol::units::{Channel, DurationMs, DurationUs, PulseWidthUs, RateUsPerS};

use super::{CENTRE, Setup, servo};

/// Numbers for random sessions, the same each time (xorshift64).
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, limit: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 32) as u32) % limit
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u32) as usize]
    }
}

pub fn any_channel(dice: &mut Dice) -> Channel {
    Channel(dice.pick(&[0, 0, 0, 1, 1, 7, 8]))
}

pub fn any_pulse(dice: &mut Dice) -> PulseWidthUs {
    PulseWidthUs(dice.pick(&[0, 999, 1000, 1300, 1500, 1500, 1501, 1700, 2000, 2001]))
}

pub fn any_duration(dice: &mut Dice) -> DurationUs {
    DurationUs(dice.pick(&[0, 1, 999, 1000, 1001, 7_777, 50_000, 100_000, 250_000, 1_800_000_000, u32::MAX]))
}

pub fn any_segments(dice: &mut Dice) -> Segments {
    let count = dice.pick(&[1, 1, 2, 3, 10]);
    let all: Vec<_> =
        (0..count).map(|_| Segment { duration: any_duration(dice), end_pulse: any_pulse(dice) }).collect();
    Segments::new(&all).unwrap()
}

pub fn any_command(dice: &mut Dice, setup: &Setup) -> Command {
    match dice.below(22) {
        0 => Command::Hello,
        1 => Command::Status,
        2 => Command::EStop,
        3 | 4 => Command::Ping,
        5 => Command::Describe(any_channel(dice)),
        6 => Command::Configure(ChannelConfig {
            channel: any_channel(dice),
            kind: dice.pick(ChannelKind::ALL),
            safe_state: dice.pick(SafeState::ALL),
            park_pulse: any_pulse(dice),
            max_rate: RateUsPerS(dice.pick(&[0, 1, 2000, 50_000])),
            ..servo(SafeState::Hold)
        }),
        7 => Command::Timing {
            dead_man: DurationMs(dice.pick(&[49, 50, 250, 2000, 2001])),
            telemetry: DurationMs(dice.pick(&[0, 20, 100])),
        },
        8 => Command::Clear,
        9..=11 => Command::Track {
            channel: any_channel(dice),
            start_pulse: any_pulse(dice),
            segments: dice.pick(&[0, 1, 1, 2, 3, 64, 65]) as u16,
        },
        12..=14 => Command::Segments {
            channel: any_channel(dice),
            first: dice.pick(&[0, 0, 0, 1, 2]),
            segments: any_segments(dice),
        },
        15 | 16 => Command::Arm {
            start: setup
                .now
                .plus(dice.pick(&[0, 5_999, 6_000, 20_000, 61_000_000, u32::MAX].map(DurationUs))),
            segments: dice.pick(&[0, 1, 1, 2, 3]) as u16,
        },
        17 => {
            Command::Jog { channel: any_channel(dice), pulse: any_pulse(dice), duration: any_duration(dice) }
        }
        18 | 19 => Command::Jog {
            channel: Channel(0),
            pulse: PulseWidthUs(1000 + dice.below(1000) as u16),
            duration: DurationUs(500_000 + dice.below(100_000)),
        },
        20 => dice.pick(&[Command::Abort, Command::Goodbye]),
        _ => match setup.board.fault() {
            fault if dice.below(4) > 0 => Command::Acknowledge(fault),
            _ => Command::Acknowledge(dice.pick(Fault::ALL)),
        },
    }
}

/// A profile of one channel that the board may well take, by a host that needs `sending` to say all this.
pub fn whole_profile(dice: &mut Dice, setup: &Setup, sending: DurationUs) -> Vec<Command> {
    let channel = Channel(dice.below(2) as u8);
    let start_pulse = setup.board.pulse(channel).unwrap_or(CENTRE);
    let turns = [PulseWidthUs(1450 + dice.below(100) as u16), start_pulse];
    let segments = turns.map(|end_pulse| Segment { duration: DurationUs(300_000), end_pulse });
    let segments = Segments::new(&segments).unwrap();
    vec![
        Command::Abort,
        Command::Acknowledge(setup.board.fault()),
        Command::Track { channel, start_pulse, segments: 2 },
        Command::Segments { channel, first: 0, segments },
        Command::Arm {
            start: setup
                .now
                .plus(sending)
                .plus(DurationUs(dice.pick(&[30_000, 30_000, 47_123, 8_000, 61_500_000]))),
            segments: 2,
        },
    ]
}
