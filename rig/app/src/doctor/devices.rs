//! Checks of board and camera. Nothing moves.

use std::path::Path;
use std::time::{Duration, Instant};

use super::{Check, Health, picture};
use camera::{Camera, CameraKind, images_lost};
use config::RigConfig;
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};
use run::{RunError, open};
use servo::{ServoBoard, ServoConfig, ServoError, ServoEvent};

/// How long board and camera are observed. Chosen.
const OBSERVATION_TIME: Duration = Duration::from_millis(1500);
/// A run is refused when the board's clock is known less well than this \[s\].
const MAX_CLOCK_SIGMA_S: f64 = 1e-3;
/// A crystal further off than this is broken \[ppm\].
const MAX_DRIFT_PPM: f64 = 200.0;
/// Tolerated departure from the promised image rate, as a share.
const MAX_RATE_ERROR: f64 = 0.05;

/// Opens what the config names, for a rig whose runs are in `runs_dir`, and looks at it. Where one device cannot be opened the others are
/// looked at all the same.
pub fn look(config: &RigConfig, base: &Path, runs_dir: &Path) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut camera = match open::open(config, base, Some(runs_dir)) {
        Ok(mut opened) => {
            opened.begin(MonotonicNs::now());
            if let Some(board) = opened.board.take() {
                checks.extend(look_at_servos(board, config.servo.as_ref()));
            }
            Ok(opened.camera)
        }
        Err(error) => {
            let together = format!("{:#}", anyhow::Error::new(error));
            if config.servo.is_some() {
                match open::board(config, base, Some(runs_dir)) {
                    Ok((board, _claim)) => checks.extend(look_at_servos(board, config.servo.as_ref())),
                    Err(error) => checks.push(cannot_open("servo board", error)),
                }
            }
            let camera = open::camera(config, base).map_err(|error| cannot_open("camera", error));
            if camera.is_ok() && checks.iter().all(|check| check.health != Health::Bad) {
                checks.push(Check::bad("devices", together));
            }
            camera
        }
    };
    let size_px = match &camera {
        Ok(camera) => [camera.info().width_px, camera.info().height_px],
        Err(_) => [config.camera.width_px, config.camera.height_px],
    };
    checks.push(picture::calibration(config, base, size_px));
    checks.extend(image_clock(config));
    match &mut camera {
        Ok(camera) => {
            checks.extend(look_at_camera(camera.as_mut(), config.camera.stall()));
            camera.stop();
        }
        Err(check) => checks.push(check.clone()),
    }
    checks
}

fn cannot_open(subject: &str, error: RunError) -> Check {
    Check::bad(subject, format!("{:#}", anyhow::Error::new(error)))
}

fn look_at_servos(mut board: Box<dyn ServoBoard>, config: Option<&ServoConfig>) -> Vec<Check> {
    let checks = match config {
        Some(servo) if servo.is_bus() => look_at_bus(board.as_mut(), servo),
        servo => look_at_board(board.as_mut(), servo.map_or(Wire::NONE, ServoConfig::wire)),
    };
    board.leave();
    checks
}

/// How well the images' times are known against the servo's.
fn image_clock(config: &RigConfig) -> Option<Check> {
    let subject = "image clock";
    let camera = &config.camera;
    let latency_ms = camera.latency_s.get() * 1e3;
    match camera.latency_std_s {
        Some(std) => {
            let std_ms = std.get() * 1e3;
            let finding =
                format!("latency {latency_ms:.2} ms, 1 sigma {std_ms:.2} ms, as measured by the sync LED");
            Some(if std.get() > MAX_CLOCK_SIGMA_S {
                Check::doubtful(subject, format!("{finding}; film it for longer: `rig calibrate latency`"))
            } else {
                Check::good(subject, finding)
            })
        }
        None if config.servo.is_some() && camera.kind == CameraKind::V4l => Some(Check::doubtful(
            subject,
            format!(
                "a latency of {latency_ms:.1} ms is stated, not how well it is known: webcams are 5 to 60 ms late; with the board's sync LED \
                 in view `rig calibrate latency CONFIG --write CONFIG` measures it"
            ),
        )),
        None => None,
    }
}

fn look_at_board(board: &mut dyn ServoBoard, wire: Wire) -> Vec<Check> {
    let info = board.info().clone();
    let found = format!(
        "{}: protocol {}, {} channels, boot id {:08x}",
        info.name, info.protocol_version, info.channels, info.boot_id
    );
    let mut checks = vec![Check::good("servo board", found)];
    match pings(board) {
        Ok(pings) => checks.push(clock_finding(&pings, wire)),
        Err(error) => checks.push(Check::bad("servo board", error.to_string())),
    }
    checks
}

/// Servos without a board: how long they take to answer, against the time there is for it in a stream.
fn look_at_bus(board: &mut dyn ServoBoard, servo: &ServoConfig) -> Vec<Check> {
    let mut checks = vec![Check::good("servo bus", board.info().name.clone())];
    let until = Instant::now() + OBSERVATION_TIME;
    let mut answers: Vec<(u8, i32, f64)> = Vec::new();
    while Instant::now() < until {
        match board.poll() {
            Ok(events) => answers.extend(events.into_iter().filter_map(|event| match event {
                ServoEvent::Position { channel, count, sent, received } => {
                    Some((channel, count, received.seconds_since(sent)))
                }
                _ => None,
            })),
            Err(error) => {
                checks.push(Check::bad("servo bus", error.to_string()));
                return checks;
            }
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    for channel in &servo.channels {
        let of_channel = || answers.iter().filter(|(id, ..)| *id == channel.id);
        let name = format!("servo {} (`{}`)", channel.id, channel.name);
        checks.push(match of_channel().next_back() {
            None => Check::bad("servo", format!("{name} does not answer: check its cable and supply")),
            Some((_, count, _)) => {
                let mut took_s: Vec<f64> = of_channel().map(|(.., took_s)| *took_s).collect();
                took_s.sort_by(f64::total_cmp);
                answer_finding(&name, *count, &took_s, servo.stream_period_s())
            }
        });
    }
    checks
}

/// A servo's answers took so long each \[s\], in order; there is at least one.
fn answer_finding(name: &str, count: i32, took_s: &[f64], period_s: f64) -> Check {
    // The slowest tells of this computer, the middle one of adapter and wire.
    let (middle_s, slowest_s) = (took_s[took_s.len() / 2], took_s[took_s.len() - 1]);
    let finding = format!(
        "{name} stands at {count} counts; answers take {:.2} ms, the slowest {:.2} ms, of a period of {:.0} ms",
        middle_s * 1e3,
        slowest_s * 1e3,
        period_s * 1e3
    );
    if middle_s > 0.5 * period_s {
        let remedy = "set the adapter's latency timer to 1 ms, raise baud, or lower stream_hz";
        return Check::doubtful("servo", format!("{finding}: {remedy}"));
    }
    Check::good("servo", finding)
}

fn pings(board: &mut dyn ServoBoard) -> Result<Vec<Ping>, ServoError> {
    let until = Instant::now() + OBSERVATION_TIME;
    let mut pings = Vec::new();
    while Instant::now() < until {
        pings.extend(board.poll()?.into_iter().filter_map(|event| match event {
            ServoEvent::Ping { sent, board_tick_us, received } => {
                Some(Ping { sent, board_tick_us, received })
            }
            _ => None,
        }));
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(pings)
}

fn clock_finding(pings: &[Ping], wire: Wire) -> Check {
    let subject = "board clock";
    let Some((fit, last)) = ClockFit::new(pings, wire).zip(pings.last()) else {
        return Check::bad(subject, "no ping was answered: check the cable and the port's speed");
    };
    let sigma_s = fit.sigma_s(last.received);
    let finding = format!(
        "sigma {:.3} ms from {} pings, shortest round trip {:.2} ms, {:.2} ms of it on the wire",
        sigma_s * 1e3,
        fit.used,
        fit.round_trip_min_s * 1e3,
        fit.wire_s * 1e3
    );
    if sigma_s > MAX_CLOCK_SIGMA_S {
        return Check::bad(subject, format!("{finding}; 1 ms is allowed: use a faster or less busy line"));
    }
    // After so short a look the rate is known only roughly: only a clear departure says something.
    let rate_sigma_ppm = sigma_s / OBSERVATION_TIME.as_secs_f64() * 1e6;
    if fit.drift_ppm().abs() > MAX_DRIFT_PPM + 5.0 * rate_sigma_ppm {
        return Check::doubtful(subject, format!("{finding}; its rate is off by {:.0} ppm", fit.drift_ppm()));
    }
    Check::good(subject, finding)
}

fn look_at_camera(camera: &mut dyn Camera, stall: Duration) -> Vec<Check> {
    let info = camera.info().clone();
    let subject = "camera";
    if let Err(error) = camera.start() {
        return vec![Check::bad(subject, error.to_string())];
    }
    let until = Instant::now() + OBSERVATION_TIME;
    let (mut received, mut lost) = (Vec::new(), 0);
    while Instant::now() < until {
        match camera.next_image(stall) {
            Ok(image) => {
                lost += received.last().map_or(0, |&(sequence, _)| images_lost(sequence, image.sequence));
                received.push((image.sequence, image.mid_exposure));
            }
            Err(error) => return vec![Check::bad(subject, error.to_string())],
        }
    }
    let span_s = match (received.first(), received.last()) {
        (Some((_, first)), Some((_, last))) => last.seconds_since(*first),
        _ => 0.0,
    };
    let fps = (received.len().saturating_sub(1) + lost as usize) as f64 / span_s.max(1e-9);
    let finding = format!(
        "{}: {} x {} {:?}, {fps:.2} images/s of {:.2} promised, {lost} lost",
        info.name, info.width_px, info.height_px, info.encoding, info.fps
    );
    if (fps / info.fps - 1.0).abs() > MAX_RATE_ERROR {
        let remedy = "lock the exposure, or ask for the rate it gives";
        return vec![Check::bad(subject, format!("{finding}; more than 5 % off: {remedy}"))];
    }
    if lost > 0 {
        return vec![Check::doubtful(
            subject,
            format!("{finding}: use another USB port or a smaller picture"),
        )];
    }
    vec![Check::good(subject, finding)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pings over `OBSERVATION_TIME` through a line of the given one-way delays, to a clock `ppm` fast.
    fn recorded(to_s: f64, back_s: f64, ppm: f64) -> Vec<Ping> {
        let origin = MonotonicNs(1_000_000_000);
        (0..30)
            .map(|k| {
                let sent = origin.plus_seconds(0.05 * f64::from(k));
                let arrived = 0.05 * f64::from(k) + to_s;
                let board_tick_us = (arrived * (1.0 + ppm * 1e-6) * 1e6) as u64;
                Ping { sent, board_tick_us, received: sent.plus_seconds(to_s + back_s) }
            })
            .collect()
    }

    #[test]
    fn quick_line_is_good_and_silence_is_not() {
        assert_eq!(clock_finding(&recorded(2e-4, 2e-4, 30.0), Wire::NONE).health, Health::Good);
        assert_eq!(clock_finding(&[], Wire::NONE).health, Health::Bad);
    }

    #[test]
    fn an_uno_s_line_is_good_once_its_bytes_are_counted() {
        // 115200 baud and a millisecond of USB either way
        let wire = Wire { to_s: 0.8e-3, back_s: 1.6e-3 };
        let pings = recorded(wire.to_s + 1e-3, wire.back_s + 1e-3, 30.0);
        assert_eq!(clock_finding(&pings, Wire::NONE).health, Health::Bad);
        assert_eq!(clock_finding(&pings, wire).health, Health::Good);
    }

    #[test]
    fn slow_answers_of_a_bus_are_doubtful() {
        assert_eq!(answer_finding("servo 1", 2048, &[1e-3, 1e-3, 9e-3], 1e-2).health, Health::Good);
        let slow = answer_finding("servo 1", 2048, &[8e-3], 1e-2);
        assert!(
            slow.health == Health::Doubtful && slow.finding.contains("latency timer"),
            "{}",
            slow.finding
        );
    }

    #[test]
    fn clock_far_off_its_rate_is_doubtful() {
        let check = clock_finding(&recorded(1e-4, 1e-4, 4000.0), Wire::NONE);
        assert_eq!(check.health, Health::Doubtful, "{}", check.finding);
    }
}
