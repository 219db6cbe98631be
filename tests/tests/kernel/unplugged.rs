//! The board unplugged and plugged in again.

use std::path::Path;
use std::time::Duration;

use camera::Encoding;
use ground::clock::MonotonicNs;
use system_tests::{json, printed, run_rig, wait_until};

use crate::bench::{Board, DEAD_MAN_MS, FED, Running, feeder, one_cycle};

/// From the dead-man's time to the pin, and an emulated computer's lateness \[s\].
const LATE_S: f64 = 0.5;

/// The board lets the servo go within its dead-man's time from `unplugged` on, is idle with a latched fault, and stays so by itself.
fn assert_safe_and_idle(board: &Board, config: &Path, unplugged: MonotonicNs) {
    wait_until("the dead-man", 5.0, || board.pulse_us().is_none());
    let let_go_s = board.pulses().last().expect("a pulse").0.seconds_since(unplugged);
    eprintln!("    let go {let_go_s:.3} s after the plug was pulled");
    assert!(let_go_s < DEAD_MAN_MS as f64 * 1e-3 + LATE_S, "{let_go_s} s");
    let pulses = board.pulses().len();
    let status = run_rig(["status".as_ref(), config.as_os_str()]);
    let text = printed(&status);
    assert!(status.status.success() && text.contains("latched fault: DeadMan"), "{text}");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(board.pulses().len(), pulses, "the board went on by itself: {:?}", board.pulses());
}

/// Pulls the plug and puts it back before the dead-man's time: what was under way must not find its board again.
fn unplug_for_a_moment(board: &Board) -> MonotonicNs {
    assert!(board.pulse_us().is_some(), "the servo gets no pulses");
    board.gadget.unplug();
    let unplugged = MonotonicNs::now();
    std::thread::sleep(Duration::from_millis(200));
    board.gadget.plug();
    unplugged
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn unplugged_board_lets_its_servo_go_and_is_idle_after_replugging() {
    let board = Board::uno();
    let _camera = feeder(&board, Encoding::Grey);
    let config = board.config(FED, Encoding::Grey, one_cycle);
    let mut running = Running::start(&board, &config, &["--film-only"]);
    running.wait_for_motion();
    let unplugged = unplug_for_a_moment(&board);
    let ended = running.ended_within(20.0);
    ended.assert_failed("lost");
    assert_eq!(ended.stop["servo"], "left-to-dead-man", "{}", ended.stop);
    assert_safe_and_idle(&board, &config, unplugged);

    // The next one is a run of its own, from the start.
    let before = json(&ended.run.join("start.json"))["id"].clone();
    let next = Running::start(&board, &config, &["--film-only"]).ended_within(60.0);
    assert_eq!(next.code, Some(0), "{}", next.said);
    assert_ne!(json(&next.run.join("start.json"))["id"], before);
    let journal = std::fs::read_to_string(next.run.join("journal.jsonl")).expect("a journal");
    let [acknowledged, arming] = ["board had stopped before (dead-man", "arming"]
        .map(|event| journal.find(event).unwrap_or_else(|| panic!("no {event}: {journal}")));
    assert!(acknowledged < arming, "{journal}");
}

#[test]
#[ignore = "runs in the guest of scripts/kernel-test"]
fn board_that_stays_away_is_missed_by_name_and_found_when_it_is_back() {
    let board = Board::mock();
    let camera = feeder(&board, Encoding::Grey);
    let config = board.config(FED, Encoding::Grey, |_| {});
    board.gadget.unplug();
    let away = run_rig(["doctor".as_ref(), config.as_os_str()]);
    let text = printed(&away);
    assert_eq!(away.status.code(), Some(3), "{text}");
    assert!(text.contains("/dev/ttyACM0: no such port"), "{text}");
    let text = printed(&run_rig(["list"]));
    assert!(!text.contains("ttyACM0"), "{text}");

    board.gadget.plug();
    let text = printed(&run_rig(["list"]));
    assert!(text.contains("/dev/ttyACM0  Uno (2341:0043)  [ready]"), "{text}");
    assert!(text.contains("/dev/video9") && text.contains("(v4l2 loopback)"), "{text}");
    let back = run_rig(["doctor".as_ref(), config.as_os_str()]);
    assert!(back.status.success(), "{}", printed(&back));
    drop(camera);
}
