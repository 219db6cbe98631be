//! How well a stream of positions keeps the time of a profile, on emulated servos behind a pseudo-terminal: strokes are played, and
//! where the servo passed its centre is compared with when the profile did. The mean of that is the servo's own lag; its scatter is what
//! this computer's timing costs.
//!
//! `cargo run --release -p rig --example bus_timing -- [STREAM_HZ] [SERVOS] [CYCLES]`

use std::sync::{Arc, Mutex};

use ground::clock::MonotonicNs;
use servo::bus::{BusBoard, BusOptions, EmulatedBus};
use servo::{PulseProfile, PulseSink, PulseTrack, ServoBoard as _, ServoConfig, ServoEvent};

#[derive(Clone, Default)]
struct Recorder(Arc<Mutex<Vec<(MonotonicNs, f64)>>>);

impl PulseSink for Recorder {
    fn pulse(&mut self, _: u8, _: Option<u16>, _: MonotonicNs) {}

    fn position(&mut self, channel: u8, position_counts: Option<f64>, at: MonotonicNs) {
        if let (1, Some(counts), Ok(mut log)) = (channel, position_counts, self.0.lock()) {
            log.push((at, counts));
        }
    }
}

fn config(stream_hz: f64, servos: u8) -> Result<ServoConfig, toml::de::Error> {
    let mut text = format!(
        "kind = \"dynamixel\"\nport = \"mock\"\ndead_man_ms = 2000\nmax_late_ms = 2000\nstream_hz = {stream_hz:.1}\n"
    );
    for id in 1..=servos {
        text += &format!(
            "[[channel]]\nid = {id}\nname = \"servo {id}\"\nmin_count = 1000\nmax_count = 3000\nmax_rate_rad_per_s = 6.0\n\
             safe_state = \"detach\"\n"
        );
    }
    toml::from_str(&text)
}

const CENTRE: f64 = 2048.0;
const AMPLITUDE: u16 = 391;

/// When the motion passed the centre \[s\] after `start`, upwards or downwards.
fn crossings(log: &[(MonotonicNs, f64)], start: MonotonicNs) -> Vec<f64> {
    log.windows(2)
        .filter(|pair| (pair[0].1 - CENTRE) * (pair[1].1 - CENTRE) < 0.0)
        .map(|pair| {
            let share = (CENTRE - pair[0].1) / (pair[1].1 - pair[0].1);
            let (before_s, after_s) = (pair[0].0.seconds_since(start), pair[1].0.seconds_since(start));
            before_s + share * (after_s - before_s)
        })
        .collect()
}

#[expect(clippy::print_stdout, reason = "what it is for")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<f64> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let argument = |index: usize, default: f64| arguments.get(index).copied().unwrap_or(default);
    let (stream_hz, servos, cycles) = (argument(0, 100.0), argument(1, 1.0) as u8, argument(2, 10.0) as u32);
    let config = config(stream_hz, servos)?;
    let recorder = Recorder::default();
    let options = BusOptions::of(&config).ok_or("no bus")?;
    let bus = EmulatedBus::start(options, Box::new(recorder.clone()))?;
    let mut board = BusBoard::open(&bus.port().to_string_lossy(), &config)?;

    let (up, down) = (2048 + AMPLITUDE, 2048 - AMPLITUDE);
    let mut segments = vec![(500_000, up)];
    for _ in 1..cycles {
        segments.extend([(500_000, down), (1_000_000, up)]);
    }
    segments.extend([(500_000, down), (500_000, 2048)]);
    let profile = PulseProfile { tracks: vec![PulseTrack { channel: 1, start_pulse: 2048, segments }] };
    board.jog(1, 2048, 0.0)?;
    let start = MonotonicNs::now().plus_seconds(0.5);
    board.arm(&profile, start)?;
    let (mut widths, mut over) = (Vec::new(), false);
    while !over {
        for event in board.poll()? {
            match event {
                ServoEvent::Position { sent, received, .. } => widths.push(received.seconds_since(sent)),
                ServoEvent::Note { text } => {
                    println!("{text}");
                    over = true;
                }
                _ => {}
            }
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    board.stop();
    let log = recorder.0.lock().map_err(|_| "the bus panicked")?.clone();
    // The centre is passed each half cycle, first on the way down.
    let wanted = (0..cycles).flat_map(|k| [0.75 + 1.5 * f64::from(k), 1.5 + 1.5 * f64::from(k)]);
    let passed = crossings(&log, start);
    let late: Vec<f64> =
        wanted.take(2 * cycles as usize - 1).zip(&passed).map(|(wanted, passed)| passed - wanted).collect();
    let mean_s = late.iter().sum::<f64>() / late.len() as f64;
    let scatter_s = (late.iter().map(|l| (l - mean_s).powi(2)).sum::<f64>() / late.len() as f64).sqrt();
    let worst_s = late.iter().map(|l| (l - mean_s).abs()).fold(0.0, f64::max);
    widths.sort_by(f64::total_cmp);
    println!(
        "{} crossings: behind by {:.2} ms (the servo's own lag is 20 ms), scatter {:.2} ms rms, {:.2} ms at worst",
        late.len(),
        mean_s * 1e3,
        scatter_s * 1e3,
        worst_s * 1e3
    );
    println!(
        "question to answer: median {:.2} ms, 99 % {:.2} ms, of {} answers",
        widths[widths.len() / 2] * 1e3,
        widths[widths.len() * 99 / 100] * 1e3,
        widths.len()
    );
    Ok(())
}
