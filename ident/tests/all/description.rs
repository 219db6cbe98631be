//! Files that describe their runs wrongly: each mistake is named, and nothing is where there is none.

use std::sync::Arc;

use ident::description::{Suspect, suspects};
use ident::diagnose::{Verdict, diagnose};
use ident::experiment::{Experiment, Run, RunKind, Use};
use sim::{Command, Model, Trajectory};

use crate::common::{self, driven_chain, driven_run, film, guess, still};

const FITTED: [&str; 2] = ["fluidcoef", "damping"];

/// Drops and driven runs of the chain, one of each held out, as they should be described.
fn described() -> Experiment {
    moved_by(&driven_chain())
}

/// A drop with the servo off.
fn dropped(id: &str, truth: &Model, pose: [f64; 3], seed: u64) -> Run {
    let trajectory = film(truth, &still(pose), &Command::default(), 0.2, 2.0, true, seed);
    Run { release_s: Some(0.2), prescribed: true, ..Run::new(id, RunKind::Drop, trajectory) }
}

/// The same of another `truth`.
fn moved_by(truth: &Model) -> Experiment {
    let strokes = |amplitude_rad, period_s| common::strokes(amplitude_rad, period_s, 2.0);
    let mut runs = vec![
        dropped("drop-1", truth, [0.9, -0.4, 0.5], 1),
        dropped("drop-2", truth, [-0.6, 0.7, 0.3], 2),
        driven_run("driven-1", truth, strokes(0.7, 0.8), 2.0, true, 3),
        driven_run("driven-2", truth, strokes(0.5, 0.6), 2.0, true, 4),
    ];
    runs[1].usage = Use::Holdout;
    runs[3].usage = Use::Holdout;
    let mut experiment = common::experiment(guess(driven_chain()), runs, &FITTED);
    experiment.noise_m = None;
    experiment
}

fn each(experiment: &mut Experiment, change: impl Fn(&mut [[f64; 3]])) {
    for run in &mut experiment.runs {
        let width = run.trajectory.keypoints.len();
        run.trajectory.position_m.chunks_exact_mut(width).for_each(&change);
    }
}

fn commands(experiment: &mut Experiment, change: impl Fn(&mut Command)) {
    experiment.runs.iter_mut().filter_map(|run| run.command.as_mut()).for_each(change);
}

/// The only suspect.
fn only(experiment: &Experiment) -> Suspect {
    let list = suspects(experiment, Arc::default());
    assert_eq!(list.len(), 1, "{list:?}");
    assert!(list[0].probability > 0.9, "{list:?}");
    list[0].clone()
}

#[test]
fn nothing_is_suspected_where_nothing_is_wrong_or_only_the_water_is() {
    assert_eq!(suspects(&described(), Arc::default()), []);
    for (cause, parameter, size) in [
        ("buoyancy", "buoyancy/scale", 0.1),
        ("current", "current/x", 0.05),
        ("camera_delay", "camera_delay/delay", 0.02),
        ("servo_gain", "servo_gain/scale", 0.1),
        ("camera_rotation", "camera_rotation/angle", 0.03),
    ] {
        let mut truth = driven_chain();
        truth.add_cause(cause).unwrap();
        let place = truth.find_parameter(parameter).unwrap_or_else(|error| panic!("{error}"));
        truth.set(place, size);
        assert_eq!(suspects(&moved_by(&truth), Arc::default()), [], "{cause}");
    }
}

#[test]
fn axes_that_are_exchanged_or_count_the_other_way_are_named() {
    let mut exchanged = described();
    each(&mut exchanged, |marks| marks.iter_mut().for_each(|[x, _, z]| std::mem::swap(x, z)));
    let suspect = only(&exchanged);
    assert_eq!((suspect.name.as_str(), suspect.sentence.as_str()), ("axes", "x and z are exchanged"));

    let mut down = described();
    each(&mut down, |marks| marks.iter_mut().for_each(|[_, _, z]| *z = -*z));
    assert!(only(&down).sentence.starts_with("z counts downward"));

    let mut called_y = described();
    each(&mut called_y, |marks| marks.iter_mut().for_each(|[_, y, z]| std::mem::swap(y, z)));
    assert_eq!(only(&called_y).sentence, "what is called y is z");

    // which of the two it is no film tells
    let mut mirrored = described();
    each(&mut mirrored, |marks| marks.iter_mut().for_each(|[x, ..]| *x = -*x));
    let suspect = only(&mirrored);
    assert!(suspect.sentence.contains("x is mirrored"), "{suspect:?}");
    assert!(suspect.sentence.contains("the servo turns the other way"), "{suspect:?}");
}

#[test]
fn units_and_signs_of_the_servo_table_are_named() {
    let mut degrees = described();
    commands(&mut degrees, |command| {
        command.angle_rad.iter_mut().for_each(|angle| *angle = angle.to_degrees())
    });
    assert_eq!(only(&degrees).name, "servo-degrees");

    let mut milliseconds = described();
    commands(&mut milliseconds, |command| command.time_s.iter_mut().for_each(|time_s| *time_s *= 1e3));
    // what never moves is refused, as the motion begins after the last image
    assert!(milliseconds.check().is_err());

    let mut reversed = described();
    commands(&mut reversed, |command| command.angle_rad.iter_mut().for_each(|angle| *angle = -*angle));
    assert!(only(&reversed).sentence.contains("the servo turns the other way"));
}

#[test]
fn a_release_that_is_stated_wrongly_is_named_with_its_amount() {
    let mut late = described();
    late.runs[0].release_s = Some(0.25);
    let suspect = only(&late);
    assert_eq!(suspect.name, "release");
    assert_eq!(suspect.runs, ["drop-1"]);
    let amount_ms =
        suspect.sentence.split_once("late by ").and_then(|(_, rest)| rest.split_once(" ms in drop-1"));
    let amount_ms: f64 = amount_ms.and_then(|(amount, _)| amount.parse().ok()).expect("an amount");
    assert!((amount_ms - 50.0).abs() <= 2.0, "{suspect:?}");
}

#[test]
fn exchanged_labels_are_named_with_their_run_and_images() {
    let mut run = described();
    let marks = &mut run.runs[2].trajectory;
    let width = marks.keypoints.len();
    let (a, b) =
        (marks.keypoints.iter().position(|k| k == "P1"), marks.keypoints.iter().position(|k| k == "P2"));
    let (a, b) = (a.unwrap(), b.unwrap());
    marks.position_m.chunks_exact_mut(width).for_each(|marks| marks.swap(a, b));
    assert_eq!(only(&run).sentence, "in driven-1, the labels `P1` and `P2` are exchanged");

    let mut images = described();
    let swapped = images.runs[0].trajectory.position_m.chunks_exact_mut(width).skip(60).take(20);
    swapped.for_each(|marks| marks.swap(a, b));
    assert!(only(&images).sentence.ends_with("in 20 images from 0.600 to 0.790 s"), "{:?}", only(&images));

    let mut order = described();
    each(&mut order, |marks| marks.swap(a, b));
    let suspect = only(&order);
    assert_eq!(suspect.sentence, "the labels `P1` and `P2` are exchanged in all runs", "{suspect:?}");
    assert_eq!(suspect.runs.len(), 4);
}

#[test]
fn a_run_that_does_not_belong_is_named_with_what_happened_to_it() {
    let mut knocked = described();
    let marks = &mut knocked.runs[2].trajectory;
    let width = marks.keypoints.len();
    for [x, _, z] in marks.position_m.iter_mut().skip(120 * width) {
        (*x, *z) = (*x - 0.01 * *z + 2e-3, *z + 0.01 * *x - 1.5e-3);
    }
    let suspect = only(&knocked);
    assert_eq!((suspect.name.as_str(), &suspect.runs[..]), ("run", &["driven-1".to_owned()][..]));
    assert!(suspect.sentence.contains("was the camera knocked?"), "{suspect:?}");

    let mut lost = described();
    let marks = &mut lost.runs[3].trajectory;
    marks.position_m.drain(70 * width..76 * width);
    marks.time_s.truncate(marks.time_s.len() - 6);
    let suspect = only(&lost);
    assert_eq!(suspect.runs, ["driven-2"]);
    assert!(suspect.sentence.contains("images are missing"), "{suspect:?}");

    let mut other = described();
    let longer = Model::from_mjcf(&common::CHAIN.replace("0 0 -0.025", "0 0 -0.03")).unwrap();
    other.runs[1].trajectory = dropped("drop-2", &longer, [-0.6, 0.7, 0.3], 2).trajectory;
    let suspect = only(&other);
    assert_eq!(suspect.runs, ["drop-2"]);
    assert!(suspect.sentence.contains("another mechanism"), "{suspect:?}");
}

#[test]
fn numbers_that_cannot_be_in_the_unit_of_their_column_are_refused() {
    fn refusal(change: impl Fn(&mut Trajectory)) -> String {
        let mut experiment = described();
        change(&mut experiment.runs[0].trajectory);
        experiment.check().expect_err("no such lengths or times").to_string()
    }
    let scaled =
        |by: f64| move |marks: &mut Trajectory| marks.position_m.iter_mut().flatten().for_each(|x| *x *= by);
    assert!(refusal(scaled(1e3)).contains("millimetres"));
    assert!(refusal(scaled(4e3)).contains("pixels"));
    assert!(refusal(scaled(1e-3)).contains("is the model in millimetres?"));
    let numbered =
        refusal(|marks| marks.time_s = (0..marks.time_s.len()).map(|image| image as f64).collect());
    assert!(numbered.contains("numbers of images"), "{numbered}");
    let milliseconds = refusal(|marks| marks.time_s.iter_mut().for_each(|time_s| *time_s *= 1e3));
    assert!(milliseconds.contains("milliseconds"), "{milliseconds}");
    let mut pulses = described();
    commands(&mut pulses, |command| {
        command.angle_rad.iter_mut().for_each(|angle| *angle = 1500.0 + 600.0 * *angle)
    });
    assert!(pulses.check().expect_err("no such angle").to_string().contains("microseconds"));
    assert!(described().check().is_ok());
}

#[test]
fn a_diagnosis_leads_with_the_files_and_goes_on_as_if_they_were_right() {
    let mut down = described();
    each(&mut down, |marks| marks.iter_mut().for_each(|[_, _, z]| *z = -*z));
    let diagnosis = diagnose(&down, &mut ()).unwrap().diagnosis;
    assert_eq!(diagnosis.suspects.len(), 1);
    assert_eq!(diagnosis.verdict, Verdict::Suspected);
    assert!(diagnosis.causes.is_empty(), "{:?}", diagnosis.causes);
    assert!(diagnosis.sentence.starts_with("The files first: z counts downward"), "{}", diagnosis.sentence);
    assert_eq!(diagnosis.next_experiments[0].separates, ["axes"]);
}
