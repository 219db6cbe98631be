use std::sync::Arc;

use image::GrayImage;
use serde_json::Value as Json;

use super::*;
use crate::camera::{CameraImage, fixtures};
use crate::vision::record::Status;
use crate::vision::{ImageRecord, Mask};

const SIZE_PX: (u32, u32) = (160, 120);

fn told(state: &mut State, slots: &Slots, again: bool) -> Json {
    state.look(slots);
    let picture = state.picture(slots, again);
    let line = state.line(picture);
    assert_eq!(line.iter().filter(|&&byte| byte == b'\n').count(), 1, "a snapshot is one line");
    serde_json::from_slice(&line).unwrap()
}

fn film(state: &mut State) {
    state.hear(Told::Film(Box::new(Filming {
        origin: MonotonicNs(0),
        fps: 100.0,
        servo: None,
        mirrored: false,
    })));
    state.hear(Told::Stage("driving".into(), None));
    state.hear(Told::Keypoints(vec!["P0".into(), "P1".into()], View::Xz));
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
    Found { image: TimedImage { name: "1".into(), time_s, grey }, record }
}

#[test]
fn picture_with_keypoints_is_preferred_as_long_as_it_is_recent() {
    let (mut state, slots) = (State::new(3), Slots::default());
    film(&mut state);
    slots.filmed.put(|| image(1.0));
    let first = told(&mut state, &slots, false);
    assert_eq!((&first["job"], &first["stage"]), (&3.into(), &"driving".into()));
    assert_eq!(first["picture"]["time_s"], 1.0);
    assert!(first["picture"].get("found").is_none(), "it was not looked at yet");

    assert!(told(&mut state, &slots, false).get("picture").is_none(), "nothing is new");
    assert_eq!(told(&mut state, &slots, true)["picture"]["time_s"], 1.0, "for who came late");

    slots.filmed.put(|| image(9.0));
    slots.found.put(|| found(2.0));
    let old = told(&mut state, &slots, false);
    assert_eq!(old["picture"]["time_s"], 9.0, "keypoints of seven seconds ago are no live picture");

    slots.filmed.put(|| image(9.5));
    slots.found.put(|| found(9.2));
    let recent = told(&mut state, &slots, false);
    assert_eq!(recent["picture"]["time_s"], 9.2);
    let outline = recent["picture"]["found"]["outline"][0].as_array().unwrap();
    assert_eq!(outline.len(), 4, "{outline:?}");
    slots.filmed.put(|| image(9.6));
    assert!(
        told(&mut state, &slots, false).get("picture").is_none(),
        "the next one with keypoints comes soon"
    );
}

#[test]
fn keypoints_and_counts_are_told_and_one_that_is_not_seen_is_a_gap() {
    let (mut state, slots) = (State::new(3), Slots::default());
    film(&mut state);
    slots.filmed.put(|| image(1.5));
    for k in 0..10 {
        let second = if k == 5 { [f64::NAN; 2] } else { [0.01, -0.02] };
        state.hear(Told::Placed(f64::from(k) * 0.1, vec![[0.0, 0.001], second]));
    }
    let counted = ImageCount { received: 150, lost: 2, ..ImageCount::default() };
    slots.counted.put(|| (counted, Behind { waiting_mib: 3, queue_mib: 128 }));
    let told = told(&mut state, &slots, false);
    let quantities: Vec<&str> = told["traces"]
        .as_array()
        .unwrap()
        .iter()
        .map(|traces| traces["quantity"].as_str().unwrap())
        .collect();
    assert_eq!(quantities, ["x", "z"]);
    let (x, z) = (&told["traces"][0], &told["traces"][1]);
    assert_eq!(x["time_s"].as_array().unwrap().len(), 10);
    assert_eq!((&z["lines"][0]["name"], &z["lines"][0]["values"][3]), (&"P0".into(), &0.001.into()));
    assert_eq!((&x["lines"][1]["values"][4], &x["lines"][1]["values"][5]), (&0.01.into(), &Json::Null));
    let figures = &told["figures"];
    assert_eq!(
        (&figures["received"], &figures["lost"], &figures["waiting_mib"]),
        (&150.into(), &2.into(), &3.into())
    );
    assert!((figures["behind_s"].as_f64().unwrap() - 0.6).abs() < 0.011, "{figures}");
}

#[test]
fn curve_of_a_long_fit_keeps_its_ends_and_another_fit_begins_anew() {
    let mut state = State::new(3);
    let standing = |evaluations: u64| Standing {
        phase: "descent",
        evaluations,
        max_evaluations: 5000,
        rms_m: 1.0 / (1.0 + evaluations as f64),
        is_rough: false,
        values: vec![Value { name: "g3/blunt".into(), value: 0.5 }],
    };
    state.hear(Told::Fit("fit", Box::new(Standing { rms_m: f64::INFINITY, ..standing(0) })));
    (1..=3000).for_each(|k| state.hear(Told::Fit("fit", Box::new(standing(k)))));
    let fit = state.fit.clone().unwrap();
    assert!((MOST_POINTS / 2..=MOST_POINTS).contains(&fit.curve.len()), "{}", fit.curve.len());
    assert_eq!((fit.curve[0].0, fit.curve.last().unwrap().0), (1, 3000));
    assert!(fit.curve.is_sorted_by(|a, b| a.0 < b.0 && a.1 > b.1));
    state.hear(Told::Fit("fit", Box::new(Standing { is_rough: true, ..standing(3001) })));
    let rough = state.fit.clone().unwrap();
    assert_eq!((rough.curve, rough.rough.len()), (fit.curve, 1), "other images are another curve");
    state.hear(Told::Fit("other", Box::new(standing(7))));
    assert_eq!(state.fit.unwrap().curve.len(), 1);
}
