//! Faults of a camera, injected into the kernel's own virtual one; and what it must not be talked into.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use camera::Encoding;
use record::reader::{Item, Recording};
use system_tests::{Background, printed, run_rig, set};

use crate::bench::{Board, Ended, FPS, Running, must, one_cycle};

const CAMERA: &str = "/dev/video0";
const SIZE_PX: [u32; 2] = [320, 180];

/// Sets one of its controls, named as v4l2-ctl names them.
fn control(name: &str, value: i64) {
    must("v4l2-ctl", &["-d", CAMERA, "-c", &format!("{name}={value}")]);
}

/// The camera, its picture on the move.
fn plugged_in() {
    must(
        "modprobe",
        &["vivid", "n_devs=1", "node_types=0x1", "vid_cap_nr=0", "num_inputs=2", "input_types=0x8"],
    );
    must("v4l2-ctl", &["-d", CAMERA, "-i", "0"]);
    for (name, value) in [
        ("osd_text_mode", 2),
        ("timestamp_source", 1),
        ("horizontal_movement", 6),
        ("percentage_of_dropped_buffers", 0),
        ("gain_automatic", 1),
    ] {
        control(name, value);
    }
}

/// A run with this camera: what it shows moves, so that it is not taken for frozen.
fn config(board: &Board, change: impl FnOnce(&mut toml::Table)) -> PathBuf {
    board.config(CAMERA, Encoding::Grey, |config| {
        set(config, "run", "still_share", 1.0);
        set(config, "camera", "width_px", SIZE_PX[0]);
        set(config, "camera", "height_px", SIZE_PX[1]);
        one_cycle(config);
        change(config);
    })
}

fn with_fault(board: &Board, inject: impl FnOnce()) -> Ended {
    let mut running = Running::start(board, &config(board, |_| {}), &["--film-only"]);
    running.wait_for_motion();
    inject();
    running.ended_within(30.0)
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn faults_that_end_the_stream_end_the_run_in_the_safe_stop() {
    let board = Board::mock();
    plugged_in();
    for (fault, reason) in [
        ("inject_vidioc_qbuf_error", "taking an image: Invalid argument"),
        ("inject_fatal_streaming_error", "unplug and replug it"),
        ("disconnect", "unplugged or gone"),
    ] {
        eprintln!("    {fault}");
        let ended = with_fault(&board, || control(fault, 1));
        ended.assert_failed(reason);
        ended.assert_stopped(&board);
    }
    // All are over with the stream, the unplugged camera is plugged in again: the next run is as any.
    let ended = with_fault(&board, || {});
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn stream_that_does_not_start_ends_the_run_before_anything_moves() {
    let board = Board::mock();
    plugged_in();
    for (fault, doing) in [
        ("inject_vidioc_streamon_error", "starting the stream"),
        ("inject_vidioc_reqbufs_error", "asking for buffers"),
    ] {
        eprintln!("    {fault}");
        control(fault, 1);
        let ended = Running::start(&board, &config(&board, |_| {}), &["--film-only"]).ended_within(30.0);
        ended.assert_failed_with_images(doing, 0);
        ended.assert_stopped(&board);
        assert_eq!(ended.stop["images"], 0);
    }
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn damaged_and_dropped_images_are_counted_and_the_run_goes_on() {
    let board = Board::mock();
    plugged_in();
    let ended = with_fault(&board, || {
        for _ in 0..3 {
            control("inject_v4l2_buf_flag_error", 1);
            std::thread::sleep(Duration::from_millis(100));
        }
        control("percentage_of_dropped_buffers", 30);
        std::thread::sleep(Duration::from_millis(600));
        control("percentage_of_dropped_buffers", 0);
    });
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    eprintln!("    {}", ended.stop);
    assert!(ended.stop["images_damaged"].as_u64().is_some_and(|n| (1..=3).contains(&n)), "{}", ended.stop);
    assert!(ended.stop["images_lost"].as_u64().is_some_and(|lost| lost > 0), "{}", ended.stop);
    let recording = Recording::open(&ended.run.join("recording.mcap")).expect("a recording");
    let damaged =
        recording.filter(|item| matches!(item, Ok((_, Item::Image(image))) if image.damaged)).count() as u64;
    assert_eq!(Some(damaged), ended.stop["images_damaged"].as_u64());
    let shown = run_rig(["runs".as_ref(), "show".as_ref(), ended.run.as_os_str()]);
    assert!(printed(&shown).contains("damaged"), "{}", printed(&shown));
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn what_the_driver_gives_instead_of_what_was_asked_is_refused() {
    let board = Board::mock();
    plugged_in();
    type Change = fn(&mut toml::Table);
    let changes: [(Change, &str); 3] = [
        (
            |config| set(config, "camera", "format", "jpeg"),
            "asked for 320x180 MJPG, the driver gives 320x180 YUYV",
        ),
        (
            |config| set(config, "camera", "width_px", 300),
            "asked for 300x180 GREY, the driver gives 320x180 GREY",
        ),
        (
            |config| {
                set(config, "camera", "width_px", 1280);
                set(config, "camera", "height_px", 720);
                set(config, "camera", "fps", 50.0);
            },
            "asked for 50 images a second, the driver gives",
        ),
    ];
    for (change, says) in changes {
        let config = config(&board, change);
        let output =
            run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), board.runs().as_os_str()]);
        let text = printed(&output);
        assert_eq!(output.status.code(), Some(3), "{text}");
        assert!(text.contains(says) && !text.contains("panicked"), "{text}");
    }
    // Its other input is a television's.
    must("v4l2-ctl", &["-d", CAMERA, "-i", "1"]);
    let config = config(&board, |config| {
        set(config, "camera", "width_px", 720);
        set(config, "camera", "height_px", 576);
    });
    let output = run_rig(["doctor".as_ref(), config.as_os_str()]);
    let text = printed(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("interlaced"), "{text}");
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn camera_that_another_program_films_with_is_said_to_be_in_use() {
    let board = Board::mock();
    plugged_in();
    let config = config(&board, |_| {});
    let mut other = Command::new("v4l2-ctl");
    other.args(["-d", CAMERA, "--stream-mmap", "--stream-count=1000"]);
    let other = Background::start(other);
    std::thread::sleep(Duration::from_secs(1));
    let text = printed(&run_rig(["list"]));
    assert!(text.contains("/dev/video0") && text.contains("v4l2-ctl"), "{text}");
    let output = run_rig(["doctor".as_ref(), config.as_os_str()]);
    let text = printed(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("another program uses it"), "{text}");
    drop(other);
    let output = run_rig(["doctor".as_ref(), config.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn rows_longer_than_asked_are_undone_and_automatic_gain_is_off() {
    let board = Board::mock();
    plugged_in();
    // Still bars: every row is the same.
    control("horizontal_movement", 3);
    let long = format!("width={},height={},pixelformat=GREY,bytesperline=512", SIZE_PX[0], SIZE_PX[1]);
    must("v4l2-ctl", &["-d", CAMERA, &format!("--set-fmt-video={long}")]);
    let doctor = run_rig(["doctor".as_ref(), config(&board, |_| {}).as_os_str()]);
    let text = printed(&doctor);
    assert!(doctor.status.success() && text.contains("320 x 180 Grey, 25.0"), "{text}");
    assert_eq!(must("v4l2-ctl", &["-d", CAMERA, "-C", "gain_automatic"]).trim(), "gain_automatic: 0");

    let running = Running::start(&board, &config(&board, |_| {}), &["--film-only"]);
    // Nothing in it moves while the servo does.
    let ended = running.ended_within(30.0);
    ended.assert_failed("the picture is frozen");
    let recording = Recording::open(&ended.run.join("recording.mcap")).expect("a recording");
    let mut images = 0;
    for item in recording {
        if let (_, Item::Image(image)) = item.expect("an item") {
            let rows: Vec<&[u8]> = image.data.chunks(SIZE_PX[0] as usize).collect();
            assert_eq!(rows.len(), SIZE_PX[1] as usize);
            assert!(rows.iter().all(|row| *row == rows[0]), "a row of image {} is shifted", image.sequence);
            images += 1;
        }
    }
    assert!(images > FPS as usize, "{images}");
}
