//! Recording at a high rate with a fit beside it: nothing is dropped, memory stays below its bound, the servo keeps its time. Ten
//! minutes of it: `cargo run --release -p system-tests --example soak`.

use camera::Encoding;
use record::reader::{Item, Recording};
use run::machine::Ending;
use system_tests::in_real_time;
use system_tests::soak::Soak;

#[test]
fn hd_images_are_all_recorded_in_bounded_memory_while_a_fit_has_the_other_core() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("recording.mcap");
    // Half the rate of the long run: other tests may want the cores too.
    let soak =
        Soak { size_px: (1280, 720), fps: 60.0, encoding: Encoding::Grey, noise_grey: 3.0, profile_s: 6.0 };
    let endured = soak.endure(&path);

    assert_eq!(endured.filmed.ending, Ending::Success, "{endured:?}");
    assert_eq!(endured.dropped, 0, "{endured:?}");
    assert_eq!(endured.profile_late_us, 0, "the board plays by its own clock: {endured:?}");
    // The queue, and as much again for what is on its way to it and from it; less than all images together.
    let bound = soak.queue_bytes() as u64 + (128 << 20);
    assert!(endured.received_bytes > bound, "too short to tell: {endured:?}");
    let most = endured.resident_bytes.iter().max().expect("a look at the memory");
    assert!(most - endured.resident_before_bytes < bound, "{endured:?}");
    let read = Recording::open(&path).expect("a recording");
    let images = read.filter(|item| matches!(item, Ok((_, Item::Image(_))))).count() as u64;
    assert_eq!(images, endured.images);
}
