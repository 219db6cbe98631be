//! The daemon's page in a browser, used as at the tank: start, watch, stop, look at a report and a trend; by mouse, by keyboard, on a
//! phone.

use serde_json::{Value, json};
use system_tests::browser::{Browser, ENTER, TAB};
use system_tests::daemon::{Bench, Served};
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
    browser.wait_for("#now", "At rest", 5.0);
    browser.click("#run");
    browser.wait_for("#more", "job 1 (run)", 10.0);
    served.bench.wait_for_motion();
    browser.wait_for("#now", "Moves", 10.0);
    browser.click("#stop");
    browser.wait_for("#said", "Stopped and held", 5.0);
    browser.wait_for("#now", "Held", 10.0);
    browser.wait_for("#held-why", "By the page", 5.0);
    browser.wait_for("#jobs", "cancelled", 10.0);
    browser.click("#run");
    browser.wait_for("#jobs", "queued", 10.0);
    browser.click("#who");
    browser.keys("Ada");
    browser.click("#release");
    browser.wait_for("#said", "released by Ada", 5.0);
    browser.wait_for("#jobs", "done", 60.0);
    browser.wait_for("#runs", "success", 10.0);
    browser.wait_for("#trend svg title", "+-", 30.0);
    assert_eq!(browser.run(NAMELESS), json!([]));
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
    browser.wait_for("#now", "Moves", 20.0);
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

#[test]
fn page_that_hears_nothing_says_so_and_greys_out() {
    let _turn = in_real_time();
    let Some(browser) = Browser::open([390, 844], true) else { return };
    let served = Served::start("127.0.0.1:0");
    browser.go(&format!("http://{}/#token={}", served.address, served.token));
    served.post("/api/v1/rigs/rig/jobs", r#"{"work":{"kind":"run","film_only":true}}"#);
    browser.wait_for("#now", "Moves", 20.0);
    served.kill_daemon();
    browser.wait_for("#now", "No news for", 4.0);
    browser.wait_for("#now", "the rig may move", 1.0);
    browser.wait_for("#more", "last heard of at", 1.0);
    assert_eq!(browser.run("return document.body.classList.contains('stale')"), json!(true));
    let opacity = browser.run("return getComputedStyle(document.querySelector('.camera')).opacity");
    assert!(
        opacity.as_str().is_some_and(|opacity| opacity.parse::<f64>().is_ok_and(|opacity| opacity < 0.5)),
        "{opacity}"
    );
}

/// Where keypoints are drawn, each in the camera's pixels and on the screen, and the picture on the screen; nothing before they are.
const SPOTS: &str = "const picture = document.getElementById('picture'), box = picture.getBoundingClientRect();
    const spots = [...document.querySelectorAll('#found circle')].map(e => {
        const at = e.getBoundingClientRect();
        return [+e.getAttribute('cx'), +e.getAttribute('cy'), (at.left + at.right) / 2 - box.left, (at.top + at.bottom) / 2 - box.top];
    });
    return spots.length ? { spots, size: [picture.naturalWidth, picture.naturalHeight], shown: [box.width, box.height] } : null";

/// Points of the first line of each chart of the motion.
const POINTS: &str = "return [...document.querySelectorAll('#traces figure > svg')]
    .map(e => (e.querySelector('path').getAttribute('d').match(/[ML]/g) ?? []).length)";

/// How a fit on the page began and where it is \[mm\].
const FITS: &str = r"return [...document.querySelectorAll('#fits figure > svg')]
    .map(e => e.getAttribute('aria-label').match(/([\d.e-]+) mm rms; it began with ([\d.e-]+) mm/)?.slice(1).map(Number))";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn run_is_seen_live_and_a_changed_model_is_marked_in_the_trends() {
    let _turn = in_real_time();
    let Some(browser) = Browser::open([1280, 900], false) else { return };
    let served = Served::on(Bench::long(), "127.0.0.1:0");
    browser.go(&format!("http://{}/#token={}", served.address, served.token));
    browser.wait_for("#stage", "No job goes on.", 10.0);
    browser.click("#run");
    browser.wait_for("#seen", "640 x 480 px", 30.0);
    browser.wait_until("a servo's trace", 30.0, || {
        browser.run(POINTS)[0].as_u64().is_some_and(|points| points > 3)
    });
    let before = browser.run(POINTS)[0].as_u64();
    browser.wait_until("a longer one", 30.0, || browser.run(POINTS)[0].as_u64() > before);
    browser.wait_for("#figures", "received", 10.0);
    browser.wait_for("#figures", "ppm", 10.0);

    browser.wait_until("keypoints", 60.0, || !browser.run(SPOTS).is_null());
    let seen = browser.run(SPOTS);
    assert_eq!(seen["size"], json!([640, 480]), "a real picture");
    let scale = number(&seen["shown"][0]) / 640.0;
    assert!((scale - number(&seen["shown"][1]) / 480.0).abs() < 0.01, "in its own shape: {seen}");
    let spots = seen["spots"].as_array().expect("spots");
    assert_eq!(spots.len(), 4);
    for spot in spots {
        let [x, y, left, top] = [0, 1, 2, 3].map(|i| number(&spot[i]));
        let off = (left - (x + 0.5) * scale).hypot(top - (y + 0.5) * scale);
        assert!(off < 1.0, "{off} px beside where the picture shows it: {spot}");
    }
    // P0 is the shaft, where the calibration has the origin
    assert!((number(&spots[0][0]) - 320.0).hypot(number(&spots[0][1]) - 420.0) < 4.0, "{seen}");
    let label = browser.run("return document.getElementById('found').getAttribute('aria-label')");
    assert!(label.as_str().is_some_and(|label| label.contains("P3 ") && label.contains(" mm")), "{label}");
    browser
        .wait_until("traces of keypoints", 30.0, || browser.run(POINTS).as_array().map_or(0, Vec::len) == 3);
    browser.wait_until("a fit that converges", 120.0, || {
        let fits = browser.run(FITS);
        let converges = |fit: &Value| !fit.is_null() && number(&fit[0]) < 0.99 * number(&fit[1]);
        fits.as_array().is_some_and(|fits| fits.iter().any(converges))
    });
    browser.wait_for("#jobs", "done", 120.0);
    assert_eq!(browser.run(NAMELESS), json!([]));

    browser.wait_for("#trend svg title", "+-", 30.0);
    assert_eq!(browser.run("return document.querySelectorAll('#trend .change').length"), 0);
    served.bench.change_model();
    browser.click("#run");
    browser.wait_for("#changes", "another model file", 120.0);
    assert_eq!(browser.run("return document.querySelectorAll('#trend .change').length"), 1);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// What is drawn of a trend: its areas, its single runs, and all its words.
const TREND: &str = "const svg = document.querySelector('#trend svg');
    return svg && [svg.querySelectorAll('.area').length, svg.querySelectorAll('circle').length, svg.textContent, svg.querySelectorAll('*').length]";

#[test]
fn trend_of_many_runs_has_unit_bounds_and_bands() {
    let Some(browser) = Browser::open([390, 844], false) else { return };
    let bench = Bench::quiet();
    for number in 0..2000 {
        system_tests::many_runs::make(&bench.runs, number).expect("a run");
    }
    let served = Served::on(bench, "127.0.0.1:0");
    browser.go(&format!("http://{}/#token={}", served.address, served.token));
    browser.wait_for("#trend", "1714 of 2000 runs determine it", 60.0);
    let trend = browser.run(TREND);
    assert_eq!(
        (&trend[0], &trend[1]),
        (&json!(2), &json!(0)),
        "those that determine it, and the others: {trend}"
    );
    let words = trend[2].as_str().expect("its words");
    assert!(words.contains("no unit") && words.contains("sought from 0 to 10"), "{words}");
    assert!(trend[3].as_u64().is_some_and(|elements| elements < 60), "{trend}");
    browser.click("#determined");
    browser.wait_until("the determined ones alone", 10.0, || browser.run(TREND)[0] == 1);
    // what a word is broken by shows in how wide its column may become
    let narrow = "return [...document.querySelectorAll('#runs td.came')].every(e => e.getBoundingClientRect().width > 150)";
    assert_eq!(browser.run(narrow), true);
    assert_eq!(browser.run("return document.documentElement.scrollWidth"), 390);
    assert_eq!(browser.errors(), Vec::<String>::new());
}
