//! Half a minute of a bad night; half an hour of it: `cargo run -p system-tests --example bad_night`.

use std::time::Duration;

use system_tests::bad_night::Night;
use system_tests::in_real_time;

#[test]
fn a_bad_night_leaves_a_daemon_that_holds_no_more_than_before() {
    let _turn = in_real_time();
    let endured = Night { seed: 1, length: Duration::from_secs(20) }.endure();
    assert!(endured.grown().is_empty(), "{:?}: {endured:?}", endured.grown());
    assert!(!endured.faults.is_empty() && endured.jobs.contains_key("done"), "{endured:?}");
}
