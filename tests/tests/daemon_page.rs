//! The daemon's page in a browser, used as at the tank: start, watch, stop, look at a report and a trend; by mouse, by keyboard, on a
//! phone.

use system_tests::browser::{Browser, ENTER, TAB};
use system_tests::daemon::Served;
use system_tests::in_real_time;

/// Every control has a name for who cannot see it.
const NAMELESS: &str = "return [...document.querySelectorAll('button, select, input, a')]
    .filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.[0]?.textContent.trim())).map(e => e.outerHTML)";

#[test]
fn run_is_started_watched_stopped_and_its_report_opened() {
    let _turn = in_real_time();
    let Some(browser) = Browser::open([1280, 900], false) else { return };
    let served = Served::start("127.0.0.1:0");
    browser.go(&format!("http://{}/#token={}", served.address, served.token));
    browser.wait_for("#link", "connected", 10.0);
    assert_eq!(browser.run("return location.hash"), "", "the token does not stay in the address");
    browser.wait_for("#now", "Idle", 5.0);
    browser.click("#run");
    browser.wait_for("#now", "moves the rig", 10.0);
    served.bench.wait_for_motion();
    browser.click("#stop");
    browser.wait_for("#said", "told to stop", 5.0);
    browser.wait_for("#jobs", "cancelled", 10.0);
    browser.click("#run");
    browser.wait_for("#jobs", "done", 60.0);
    browser.wait_for("#runs", "success", 10.0);
    browser.wait_for("#trend svg title", "+-", 30.0);
    assert_eq!(browser.run(NAMELESS), serde_json::json!([]));
    browser.click("#runs a");
    browser.newest_window();
    browser.wait_for("body", "Keypoint errors", 10.0);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn phone_and_keyboard_do_it_too_and_without_the_token_nothing_moves() {
    let _turn = in_real_time();
    let Some(browser) = Browser::open([390, 844], true) else { return };
    let served = Served::start("127.0.0.1:0");
    served.post(
        "/api/v1/rigs/rig/jobs",
        r#"{"work":{"kind":"run","film_only":true},"why":"a job for the table"}"#,
    );
    browser.go(&format!("http://{}/", served.address));
    browser.wait_for("#jobs", "run", 10.0);
    let width = browser.run("return document.documentElement.scrollWidth");
    assert_eq!(width, 390, "the page fits, what is wider scrolls in itself");
    browser.wait_for("#now", "moves the rig", 10.0);
    let focused = || browser.run("return document.activeElement.id");
    browser.keys(TAB);
    assert_eq!(focused(), "stop", "one key to the button that matters");
    browser.keys(ENTER);
    browser.wait_for("dialog[open]", "Token", 5.0);
    assert!(!served.bench.job(1).contains("cancelled"), "nothing is stopped before the token is said");
    browser.keys(&served.token);
    browser.keys(ENTER);
    browser.wait_for("#jobs", "cancelled", 10.0);
    let height = browser.run("return document.getElementById('stop').getBoundingClientRect().height");
    assert!(height.as_f64().is_some_and(|height| height >= 44.0), "a thumb hits it: {height}");
}
