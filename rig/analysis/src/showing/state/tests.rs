use std::sync::Arc;

use image::GrayImage;
use serde_json::Value as Json;

use super::*;
use camera::{CameraImage, fixtures};
use config::RigConfig;
use servo::{ServoConfig, ServoEvent};
use vision::record::Status;
use vision::{ImageRecord, Mask};

const SIZE_PX: (u32, u32) = (160, 120);

fn snapshot(state: &mut State, slots: &Slots, again: bool) -> Json {
    state.poll(slots);
    let picture = state.picture(slots, again);
    let line = state.line(picture);
    assert_eq!(line.iter().filter(|&&byte| byte == b'\n').count(), 1, "a snapshot is one line");
    serde_json::from_slice(&line).unwrap()
}

fn filming(run: &str, origin: MonotonicNs, servo: Option<ServoConfig>) -> Message {
    Message::Film(Box::new(Filming { run: run.into(), origin, fps: 100.0, servo, mirrored: false }))
}

fn film(state: &mut State) {
    state.apply(filming("first", MonotonicNs(0), None));
    state.apply(Message::Stage("driving".into(), None));
    state.apply(Message::Keypoints(vec!["P0".into(), "P1".into()], View::Xz));
}

fn image(time_s: f64) -> Arc<CameraImage> {
    Arc::new(fixtures::image(1, MonotonicNs(0).plus_seconds(time_s), SIZE_PX))
}

fn found(time_s: f64) -> Found {
    let mut mask = Mask::empty(20, 20, 40, 10);
    mask.bits.fill(true);
    let grey = Ok(GrayImage::new(SIZE_PX.0, SIZE_PX.1));
    let record = ImageRecord {
        name: "1".into(),
        time_s,
        status: Status::Ok,
        reason: String::new(),
        keypoints: Vec::new(),
        mask: Some(mask),
        centreline: vec![[20.0, 25.0], [59.0, 25.0]],
    };
    Found { image: TimedImage { name: "1".into(), time_s, chroma: None, grey }, record }
}

#[test]
fn picture_with_keypoints_is_preferred_as_long_as_it_is_recent() {
    let (mut state, slots) = (State::new(3), Slots::default());
    film(&mut state);
    slots.filmed.put(|| image(1.0));
    let first = snapshot(&mut state, &slots, false);
    assert_eq!((&first["job"], &first["stage"]), (&3.into(), &"driving".into()));
    assert_eq!(first["picture"]["time_s"], 1.0);
    assert!(first["picture"].get("found").is_none(), "it is not processed yet");

    assert!(snapshot(&mut state, &slots, false).get("picture").is_none(), "nothing is new");
    assert_eq!(snapshot(&mut state, &slots, true)["picture"]["time_s"], 1.0, "for who came late");

    slots.filmed.put(|| image(9.0));
    slots.found.put(|| found(2.0));
    let old = snapshot(&mut state, &slots, false);
    assert_eq!(old["picture"]["time_s"], 9.0, "keypoints of seven seconds ago are no live picture");

    slots.filmed.put(|| image(9.5));
    slots.found.put(|| found(9.2));
    let recent = snapshot(&mut state, &slots, false);
    assert_eq!(recent["picture"]["time_s"], 9.2);
    let outline = recent["picture"]["found"]["outline"][0].as_array().unwrap();
    assert_eq!(outline.len(), 4, "{outline:?}");
    slots.filmed.put(|| image(9.6));
    assert!(
        snapshot(&mut state, &slots, false).get("picture").is_none(),
        "the next one with keypoints comes soon"
    );
}

#[test]
fn keypoints_and_counts_are_shown_and_one_that_is_not_seen_is_a_gap() {
    let (mut state, slots) = (State::new(3), Slots::default());
    film(&mut state);
    slots.filmed.put(|| image(1.5));
    for k in 0..10 {
        let second = if k == 5 { [f64::NAN; 2] } else { [0.01, -0.02] };
        state.apply(Message::KeypointPositions(f64::from(k) * 0.1, vec![[0.0, 0.001], second]));
    }
    let counted = ImageCount { received: 150, lost: 2, ..ImageCount::default() };
    slots.counted.put(|| (counted, Behind { waiting_mib: 3, queue_mib: 128 }));
    let snapshot = snapshot(&mut state, &slots, false);
    let quantities: Vec<&str> = snapshot["traces"]
        .as_array()
        .unwrap()
        .iter()
        .map(|traces| traces["quantity"].as_str().unwrap())
        .collect();
    assert_eq!(quantities, ["x", "z"]);
    let (x, z) = (&snapshot["traces"][0], &snapshot["traces"][1]);
    assert_eq!(x["time_s"].as_array().unwrap().len(), 10);
    assert_eq!((&z["lines"][0]["name"], &z["lines"][0]["values"][3]), (&"P0".into(), &0.001.into()));
    assert_eq!((&x["lines"][1]["values"][4], &x["lines"][1]["values"][5]), (&0.01.into(), &Json::Null));
    let figures = &snapshot["figures"];
    assert_eq!(
        (&figures["received"], &figures["lost"], &figures["waiting_mib"]),
        (&150.into(), &2.into(), &3.into())
    );
    assert!((figures["behind_s"].as_f64().unwrap() - 0.6).abs() < 0.011, "{figures}");
}

#[test]
fn curve_of_a_long_fit_keeps_its_ends_and_another_fit_begins_a_new_curve() {
    let mut state = State::new(3);
    let progress = |evaluations: u64| FitProgress {
        phase: "descent",
        evaluations,
        max_evaluations: 5000,
        rms_m: 1.0 / (1.0 + evaluations as f64),
        is_rough: false,
        values: vec![Value { name: "g3/blunt".into(), value: 0.5 }],
    };
    state.apply(Message::Fit("fit", Box::new(FitProgress { rms_m: f64::INFINITY, ..progress(0) })));
    (1..=3000).for_each(|k| state.apply(Message::Fit("fit", Box::new(progress(k)))));
    let fit = state.fit.clone().unwrap();
    assert!((CURVE_MAX_POINTS / 2..=CURVE_MAX_POINTS).contains(&fit.curve.len()), "{}", fit.curve.len());
    assert_eq!((fit.curve[0].0, fit.curve.last().unwrap().0), (1, 3000));
    assert!(fit.curve.is_sorted_by(|a, b| a.0 < b.0 && a.1 > b.1));
    state.apply(Message::Fit("fit", Box::new(FitProgress { is_rough: true, ..progress(3001) })));
    let rough = state.fit.clone().unwrap();
    assert_eq!((rough.curve, rough.rough.len()), (fit.curve, 1), "other images are another curve");
    state.apply(Message::Fit("other", Box::new(progress(7))));
    assert_eq!(state.fit.unwrap().curve.len(), 1);
}

/// A second of a run that begins at `origin`, of a board that was switched on so long before.
fn second_of(state: &mut State, slots: &Slots, origin: MonotonicNs, on_since_s: f64) {
    let tick_us = |time_s: f64| ((on_since_s + time_s) * 1e6) as u64;
    let times_s = || (0..20).map(|k| 0.05 * f64::from(k));
    for time_s in times_s() {
        let (sent, received) = (origin.plus_seconds(time_s), origin.plus_seconds(time_s + 2e-4));
        let board_tick_us = tick_us(time_s + 1e-4);
        state.apply(Message::Servo(ServoEvent::Ping { sent, board_tick_us, received }));
    }
    state.apply(Message::Servo(ServoEvent::Started { board_tick_us: tick_us(0.0) }));
    for time_s in times_s() {
        let (board_tick_us, pulse_us) = (tick_us(time_s), Some(1500));
        state.apply(Message::Servo(ServoEvent::Pulse { channel: 0, board_tick_us, pulse_us }));
        state.apply(Message::KeypointPositions(time_s, vec![[0.0, 0.001], [0.01, -0.02]]));
    }
    slots.filmed.put(|| Arc::new(fixtures::image(1, origin.plus_seconds(0.9), SIZE_PX)));
    slots.counted.put(|| {
        let counted = ImageCount { received: 100, lost: 2, ..ImageCount::default() };
        (counted, Behind { waiting_mib: 3, queue_mib: 128 })
    });
}

#[test]
fn second_run_of_a_job_begins_with_nothing_of_the_first() {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-pose-1.toml");
    let servo = RigConfig::read(&path).unwrap().servo;
    let (mut state, slots) = (State::new(3), Slots::default());
    let (one, two) = (MonotonicNs(0).plus_seconds(100.0), MonotonicNs(0).plus_seconds(1100.0));
    state.apply(filming("first", one, servo.clone()));
    state.apply(Message::Keypoints(vec!["P0".into(), "P1".into()], View::Xz));
    second_of(&mut state, &slots, one, 40.0);
    let progress = FitProgress {
        phase: "descent",
        evaluations: 7,
        max_evaluations: 5000,
        rms_m: 1e-4,
        is_rough: false,
        values: Vec::new(),
    };
    state.apply(Message::Fit("fit", Box::new(progress)));
    let first = snapshot(&mut state, &slots, false);
    assert_eq!((&first["run"], &first["figures"]["received"]), (&"first".into(), &100.into()));
    assert!(first["fit"].is_object() && first["picture"].is_object());
    let angles = first["traces"].as_array().unwrap();
    assert!(angles.iter().any(|trace| trace["quantity"] == "angle"), "{angles:?}");

    // the mock board of the next run has just been switched on
    state.apply(filming("second", two, servo));
    let begun = snapshot(&mut state, &slots, true);
    assert_eq!((&begun["job"], &begun["run"]), (&3.into(), &"second".into()));
    assert_eq!(begun["traces"], serde_json::json!([]));
    assert!(["picture", "figures", "fit", "steps"].iter().all(|key| begun.get(key).is_none()), "{begun}");

    state.apply(Message::Keypoints(vec!["P0".into(), "P1".into()], View::Xz));
    second_of(&mut state, &slots, two, 0.5);
    let second = snapshot(&mut state, &slots, false);
    let gained_s = second["figures"]["clock"]["gained_s"].as_f64().unwrap();
    assert!(gained_s.abs() < 1e-3, "{second}");
    for trace in second["traces"].as_array().unwrap() {
        let times_s: Vec<f64> =
            trace["time_s"].as_array().unwrap().iter().map(|t| t.as_f64().unwrap()).collect();
        assert!(times_s.iter().all(|time_s| (-0.01..1.0).contains(time_s)), "{trace}");
    }
    assert!((second["picture"]["time_s"].as_f64().unwrap() - 0.9).abs() < 1e-6);
}
