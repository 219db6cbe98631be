//! Whole experiments through the kernel's drivers, with the flashed binary as the board: what is found in the pictures is where the
//! tank's mechanism was.

use std::path::Path;

use camera::Encoding;
use ground::clock::MonotonicNs;
use record::frames;
use record::reader::{Item, Recording};
use system_tests::{json, set};

use crate::bench::{Board, FED, FPS, Running, feeder, must, one_cycle};
use crate::feeder::{Feeder, Mode};

/// Four times what was measured, a seventieth of a pixel: pictures that are one image late are off by millimetres \[m\].
const MEAN_ERROR_M: f64 = 0.03e-3;
/// As much of the worst one \[m\].
const MOST_ERROR_M: f64 = 0.15e-3;

/// Compares each keypoint found with where it was when the image was drawn.
fn assert_where_it_was(run: &Path, camera: &Feeder) {
    let frames = frames::read(&run.join("frames.csv")).expect("frames.csv");
    let trajectory = ident::table::read_trajectory(&run.join("trajectory.csv")).expect("trajectory.csv");
    let (mut errors_m, mut found) = (Vec::new(), 0);
    for (row, time_s) in trajectory.time_s.iter().enumerate() {
        let frame = frames.iter().find(|frame| frame.time_s == *time_s).expect("its row in frames.csv");
        assert_eq!(frame.lost_before, 0, "{frame:?}");
        let shown = camera.shown_at(MonotonicNs(frame.stamp_ns)).expect("an image of this stamp was shown");
        for (keypoint, truth) in shown.keypoints_m.iter().enumerate() {
            let at = trajectory.at(row, keypoint);
            found += usize::from(at[0].is_finite());
            errors_m
                .extend(Some((at[0] - truth[0]).hypot(at[2] - truth[1])).filter(|error| error.is_finite()));
        }
    }
    let wanted = trajectory.time_s.len() * trajectory.keypoints.len();
    let mean_m = errors_m.iter().sum::<f64>() / errors_m.len() as f64;
    let most_m = errors_m.iter().copied().fold(0.0, f64::max);
    eprintln!(
        "    {found} of {wanted} keypoints, mean error {:.3} mm, most {:.3} mm",
        mean_m * 1e3,
        most_m * 1e3
    );
    assert!(trajectory.time_s.len() > 2 * FPS as usize && found * 10 > wanted * 9, "{found} of {wanted}");
    assert!(mean_m < MEAN_ERROR_M && most_m < MOST_ERROR_M, "mean {mean_m} m, most {most_m} m");
}

/// Compares each image recorded with what the driver had got, byte by byte.
fn assert_as_shown(run: &Path, camera: &Feeder) {
    let recording = Recording::open(&run.join("recording.mcap")).expect("a recording");
    let mut sequences = Vec::new();
    for item in recording {
        if let (_, Item::Image(image)) = item.expect("an item") {
            let shown = camera.shown_at(image.stamp).expect("an image of this stamp was shown");
            assert!(*shown.data == image.data && !image.damaged, "{}", image.sequence);
            sequences.push(image.sequence);
        }
    }
    assert!(sequences.len() > 2 * FPS as usize, "{}", sequences.len());
    assert!(sequences.windows(2).all(|pair| pair[1] == pair[0] + 1), "{sequences:?}");
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn a_whole_experiment_passes_through_camera_and_serial_driver() {
    let board = Board::uno();
    let camera = feeder(&board, Encoding::Jpeg);
    // Its fit is cut short: an emulated processor takes minutes for a whole one.
    let config = board.config(FED, Encoding::Jpeg, |config| {
        one_cycle(config);
        set(config, "fit", "parameters", vec!["q2/damping"]);
        set(config, "fit", "max_evaluations", 20);
    });
    let ended = Running::start(&board, &config, &[]).ended_within(90.0);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    assert_eq!(ended.stop["status"], "success");
    assert_eq!(ended.stop["servo"], "acknowledged");
    assert_eq!((&ended.stop["images_lost"], &ended.stop["messages_dropped"]), (&0.into(), &0.into()));
    assert_as_shown(&ended.run, &camera);
    assert_where_it_was(&ended.run, &camera);
    // It was the chip's pin that moved the tank: 0.6 rad to either side.
    let widths_us: Vec<u16> = board.pulses().into_iter().filter_map(|(_, width_us)| width_us).collect();
    let ends_us =
        [widths_us.iter().min(), widths_us.iter().max()].map(|width_us| *width_us.expect("a pulse"));
    assert!(
        ends_us[1] - ends_us[0] > 700 && widths_us.len() > 50,
        "{ends_us:?}, {} changes",
        widths_us.len()
    );
    let fit = json(&ended.run.join("fit.json"));
    assert!(fit["runs"][0]["keypoints"].as_array().is_some_and(|keypoints| keypoints.len() == 4), "{fit}");
    for file in ["report.html", "model.xml", "servo.csv"] {
        assert!(ended.run.join(file).exists(), "{file}");
    }
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn images_are_recorded_as_the_driver_had_them_in_every_format() {
    let board = Board::mock();
    // As JPEG the whole experiment has them.
    for encoding in [Encoding::Grey, Encoding::Yuyv] {
        let camera = feeder(&board, encoding);
        let config = board.config(FED, encoding, one_cycle);
        let ended = Running::start(&board, &config, &["--film-only"]).ended_within(60.0);
        assert_eq!(ended.code, Some(0), "{encoding:?}: {}", ended.said);
        assert_as_shown(&ended.run, &camera);
    }
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn camera_that_stops_freezes_or_cuts_its_images_short_is_told() {
    let board = Board::mock();
    for (mode, reason) in [(Mode::Stall, "no image for 1500 ms"), (Mode::Freeze, "the picture is frozen")] {
        let camera = feeder(&board, Encoding::Jpeg);
        let config = board.config(FED, Encoding::Jpeg, |_| {});
        let mut running = Running::start(&board, &config, &["--film-only"]);
        running.wait_for_motion();
        camera.set(mode);
        let ended = running.ended_within(20.0);
        ended.assert_failed(reason);
        ended.assert_stopped(&board);
    }

    let camera = feeder(&board, Encoding::Jpeg);
    let config = board.config(FED, Encoding::Jpeg, one_cycle);
    let mut running = Running::start(&board, &config, &["--film-only"]);
    running.wait_for_motion();
    camera.set(Mode::Cut);
    std::thread::sleep(std::time::Duration::from_millis(200));
    camera.set(Mode::Film);
    let ended = running.ended_within(20.0);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    assert!(ended.stop["images_damaged"].as_u64().is_some_and(|n| (1..=8).contains(&n)), "{}", ended.stop);
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn wall_clock_that_jumps_an_hour_changes_no_run() {
    let board = Board::mock();
    let _camera = feeder(&board, Encoding::Grey);
    let config = board.config(FED, Encoding::Grey, one_cycle);
    let mut running = Running::start(&board, &config, &["--film-only"]);
    running.wait_for_motion();
    let seconds = must("date", &["+%s"]).trim().parse::<u64>().expect("seconds");
    must("date", &["-s", &format!("@{}", seconds - 3600)]);
    let ended = running.ended_within(30.0);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    let recording = Recording::open(&ended.run.join("recording.mcap")).expect("a recording");
    let stamps: Vec<MonotonicNs> = recording
        .filter_map(|item| match item {
            Ok((_, Item::Image(image))) => Some(image.stamp),
            _ => None,
        })
        .collect();
    let steps_s = stamps.windows(2).map(|pair| pair[1].seconds_since(pair[0]));
    let most_s = steps_s.fold(0.0, f64::max);
    assert!(stamps.len() > 2 * FPS as usize && most_s < 0.5, "{} images, {most_s} s", stamps.len());
    // Both clocks at both ends: that it jumped can be read.
    let utc = |file: &str| json(&ended.run.join(file))["clock"]["utc"].as_str().expect("a time").to_owned();
    assert!(utc("stop.json") < utc("start.json"));
}
