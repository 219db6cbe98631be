//! The diagnosis on runs made by another integrator: what is hidden is found, and the run it asks for tells rivals apart.

use crate::common::{self, chain, driven_chain, filmed_exactly, guess, still};
use ident::design::runs::Motion;
use ident::diagnose::{Diagnosis, NamedCause, Verdict, diagnose, pin_down};
use ident::experiment::{DiagnoseConfig, Experiment, FitConfig, Run, RunKind, Use};
use sim::{Command, Model};

const START_S: f64 = 0.3;
const NOISE_M: f64 = 4e-4;
const CORRELATION: f64 = 0.4;
/// A value is recovered to within this share of it: five standard deviations at the sizes hidden here.
const RECOVERED: f64 = 0.2;

fn with(mut model: Model, cause: &str, value: f64) -> Model {
    model.add_cause(cause.split('/').next().unwrap()).unwrap();
    model.set_parameter(cause, value).unwrap();
    model
}

fn strokes(seconds: f64) -> Command {
    let mut command = common::strokes(0.6, 1.2, seconds);
    command.time_s.iter_mut().for_each(|t| *t += START_S - 0.2);
    command
}

fn dropped(id: &str, model: &Model, pose: [f64; 3], seed: u64) -> Run {
    let mut trajectory = filmed_exactly(model, &still(pose), &Command::default(), START_S, 2.5, true);
    common::add_noise(&mut trajectory, NOISE_M, CORRELATION, seed);
    Run { release_s: Some(START_S), prescribed: true, ..Run::new(id, RunKind::Drop, trajectory) }
}

fn driven(id: &str, model: &Model, command: Command, seconds: f64, seed: u64) -> Run {
    let mut trajectory = filmed_exactly(model, &still([0.0; 3]), &command, START_S, seconds, true);
    common::add_noise(&mut trajectory, NOISE_M, CORRELATION, seed);
    Run { command: Some(command), prescribed: true, ..Run::new(id, RunKind::Driven, trajectory) }
}

/// The chain with default coefficients, those of the fluid and the passive joints fitted.
fn experiment(truth: Model, runs: Vec<Run>) -> Experiment {
    let mut model = guess(truth);
    // not fitted: the driven joint's own
    model.set_parameter("q1/damping", 2e-6).unwrap();
    let fit = FitConfig { parameters: vec!["fluidcoef".into(), "damping".into()], ..FitConfig::default() };
    Experiment::new(model, fit, runs)
}

#[test]
fn two_causes_at_once_are_both_named() {
    let truth = with(with(chain(), "added_mass/scale", 1.0), "camera_delay/delay", 0.012);
    let poses = [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2], [-1.1, 0.3, -0.5]];
    let runs =
        poses.iter().zip(1..).map(|(&pose, seed)| dropped(&format!("drop-{seed}"), &truth, pose, seed));
    let diagnosis = diagnose(&experiment(chain(), runs.collect()), &mut ()).unwrap().diagnosis;
    println!("{} {:?}", diagnosis.sentence, diagnosis.remarks);
    assert_eq!(diagnosis.verdict, Verdict::Causes);
    let beyond_noise = 1.0 - (NOISE_M / diagnosis.whiteness.before.rms_m).powi(2);
    assert!((diagnosis.whiteness.explainable - beyond_noise).abs() < 0.05, "{beyond_noise}: {diagnosis:?}");
    for (name, hidden) in [("added_mass/scale", 1.0), ("camera_delay/delay", 0.012)] {
        let mut all = diagnosis.causes.iter().flat_map(|cause| &cause.parameters);
        let found = all.find(|parameter| parameter.name == name).unwrap();
        assert!((found.value / hidden - 1.0).abs() < RECOVERED, "{found:?}");
    }
}

/// A dozen misread keypoints among thousands would weigh more than all noise together.
#[test]
fn keypoints_misread_in_single_images_are_set_aside_and_hide_nothing() {
    let truth = with(chain(), "added_mass/scale", 1.0);
    let poses = [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2]];
    let runs = poses.iter().zip(1..).map(|(&pose, seed)| {
        let mut run = dropped(&format!("drop-{seed}"), &truth, pose, seed);
        let width = run.trajectory.keypoints.len();
        for (place, by_m) in [0.012, -0.02, 0.03, -0.04, 0.015, 0.025].into_iter().enumerate() {
            let point = &mut run.trajectory.position_m[(7 + 40 * place) * width + place % width];
            point[0] += by_m;
            point[2] -= 0.5 * by_m;
        }
        Run { release_s: run.release_s, prescribed: true, ..Run::new(run.id, run.kind, run.trajectory) }
    });
    let experiment = experiment(chain(), runs.collect());
    assert_eq!(experiment.runs.iter().map(|run| run.set_aside.len()).collect::<Vec<_>>(), [6, 6]);
    let diagnosis = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    println!("{} {:?}", diagnosis.sentence, diagnosis.remarks);
    assert_eq!(diagnosis.verdict, Verdict::Cause);
    assert_eq!(diagnosis.causes[0].name, "added_mass");
    assert!((diagnosis.noise_m / NOISE_M - 1.0).abs() < 0.1, "{}", diagnosis.noise_m);
    assert!(diagnosis.remarks.iter().any(|remark| remark.starts_with("6 keypoints of drop-1 are set aside")));
}

/// Springs in the hinges of a chain that lies flat are all that brings it back: the baseline bends out of shape without them, and
/// what its derivatives point to from there is an end stop near 0.
#[test]
fn a_cause_too_strong_for_derivatives_is_named() {
    let stiffness = 3e-5;
    let mut plain = driven_chain();
    plain.settings.gravity = sim::math::Vec3([0.0, 9.81, 0.0]);
    let truth = with(plain.clone(), "stiffness/stiffness", stiffness);
    let swings = [(0.5, 1.6), (0.7, 1.1)];
    let runs = swings.iter().zip(1..).map(|(&(amplitude, period), seed)| {
        let mut command = common::strokes(amplitude, period, 3.5);
        command.time_s.iter_mut().for_each(|t| *t += START_S - 0.2);
        driven(&format!("driven-{seed}"), &truth, command, 3.5, seed)
    });
    let diagnosis = diagnose(&experiment(plain, runs.collect()), &mut ()).unwrap().diagnosis;
    println!("{} {:?} {:?}", diagnosis.sentence, diagnosis.causes, diagnosis.remarks);
    assert_eq!(diagnosis.verdict, Verdict::Cause);
    let found = &diagnosis.causes[0].parameters[0];
    assert_eq!(found.name, "stiffness/stiffness");
    assert!((found.value / stiffness - 1.0).abs() < RECOVERED, "{found:?}");
}

/// Two drops in a faint current, of which the model has none.
fn in_a_faint_current() -> Experiment {
    let truth = with(chain(), "current/x", 0.012);
    let poses = [[0.0, 0.2, 0.0], [0.1, 0.0, 0.0]];
    let runs =
        poses.iter().zip(1..).map(|(&pose, seed)| dropped(&format!("drop-{seed}"), &truth, pose, seed));
    experiment(chain(), runs.collect())
}

/// The drag of a current on what rests grows with its square: the first steps from none lead nowhere, and a turned camera is
/// nearly as good.
#[test]
fn a_faint_current_is_not_given_up() {
    let diagnosis = diagnose(&in_a_faint_current(), &mut ()).unwrap().diagnosis;
    println!("{} {:?} {:?}", diagnosis.sentence, diagnosis.causes, diagnosis.remarks);
    assert_eq!(diagnosis.verdict, Verdict::Cause);
    assert_eq!(diagnosis.causes[0].name, "current");
}

/// What cannot be is not tried, what is unlikely must explain more, and after the limit the best so far is said.
#[test]
fn what_is_known_beforehand_and_how_long_it_may_take_count() {
    let plain = in_a_faint_current();
    let said = |change: &str| {
        let mut experiment = plain.clone();
        experiment.diagnose = toml::from_str::<DiagnoseConfig>(change).unwrap();
        let diagnosis = diagnose(&experiment, &mut ()).unwrap().diagnosis;
        println!("{change}: {} {:?}", diagnosis.sentence, diagnosis.remarks);
        diagnosis
    };
    let names = |diagnosis: &Diagnosis, name: &str| diagnosis.causes.iter().any(|cause| cause.name == name);
    let excluded = said("exclude = [\"current\"]");
    assert!(!names(&excluded, "current"));
    assert!(excluded.detectable.iter().all(|entry| !entry.name.starts_with("current/")));
    let unlikely = said("odds = { current = 1e-300 }");
    assert!(!names(&unlikely, "current"), "1381 noise variances are more than it explains");
    let cut = said("limit_s = 1e-3");
    assert!(!cut.complete && cut.causes.is_empty(), "{}", cut.sentence);
    assert!(cut.remarks.iter().any(|said| said.contains("limit_s")), "{:?}", cut.remarks);
}

/// The servo's hinge rubs too where it is let go, and a fit has the friction of the passive ones only.
#[test]
fn what_is_fitted_at_some_joints_only_is_said_and_found_where_it_is_fitted() {
    let truth = with(driven_chain(), "coulomb_friction/q1", 1e-5);
    let poses = [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2]];
    let runs =
        poses.iter().zip(1..).map(|(&pose, seed)| dropped(&format!("drop-{seed}"), &truth, pose, seed));
    let mut experiment = experiment(driven_chain(), runs.collect());
    experiment.fit.parameters.push("frictionloss".into());
    let first = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    println!("{} {:?}", first.sentence, first.remarks);
    assert_ne!(first.verdict, Verdict::NothingDetectable);
    assert!(first.remarks.iter().any(|said| said.starts_with("not fitted: `q1/frictionloss`")));
    experiment.fit.parameters.push("q1/frictionloss".into());
    let second = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    println!("{} {:?}", second.sentence, second.remarks);
    assert_eq!(second.verdict, Verdict::NothingDetectable);
}

/// Nothing is wrong with the model; its servo was off in the drop, which nobody has said.
#[test]
fn a_servo_that_was_off_is_asked_about() {
    let pose = still([0.4, 0.0, 0.0]);
    let mut trajectory = filmed_exactly(&driven_chain(), &pose, &Command::default(), START_S, 0.8, true);
    common::add_noise(&mut trajectory, NOISE_M, CORRELATION, 1);
    let mut experiment = experiment(driven_chain(), vec![Run::new("drop", RunKind::Drop, trajectory)]);
    let first = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    println!("{} {:?}", first.sentence, first.remarks);
    assert_ne!(first.verdict, Verdict::NothingDetectable);
    let asks = |said: &String| said.contains("`q1` at 0.") && said.contains("`prescribed = true`");
    assert!(first.remarks.iter().any(asks));
    experiment.runs[0].prescribed = true;
    let second = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    assert_eq!((second.verdict, second.remarks), (Verdict::NothingDetectable, Vec::new()));
}

/// A late servo and a late camera are told apart by a drop whose release is on the same clock; by another one they are not.
#[test]
fn only_a_stated_release_tells_the_clocks_apart() {
    let truth = with(driven_chain(), "servo_delay/delay", 0.03);
    let drop = dropped("drop", &truth, [1.2, 0.0, 0.0], 1);
    let runs = vec![drop, driven("driven", &truth, strokes(2.5), 2.5, 2)];
    let mut experiment = experiment(driven_chain(), runs);
    let stated = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    experiment.runs[0].release_s = None;
    let unknown = diagnose(&experiment, &mut ()).unwrap().diagnosis;
    println!("{} {}", stated.sentence, unknown.sentence);
    let causes = |diagnosis: &Diagnosis| -> Vec<(String, Vec<String>)> {
        diagnosis.causes.iter().map(|cause| (cause.name.clone(), cause.aliases.clone())).collect()
    };
    assert_eq!((stated.verdict, causes(&stated)), (Verdict::Cause, vec![("servo_delay".into(), vec![])]));
    let [(name, aliases)] = &causes(&unknown)[..] else { panic!("{}", unknown.sentence) };
    let mut both = [name.as_str(), aliases[0].as_str()];
    both.sort_unstable();
    assert_eq!((unknown.verdict, both), (Verdict::Cause, ["camera_delay", "servo_delay"]));
}

/// Suggested runs that an ambiguity may take to be resolved.
const MOST_RUNS: u64 = 3;

/// One drop with `hidden` in it leaves an ambiguity; runs that the diagnosis asks for, made with the same mechanism and put to this `usage`,
/// leave none.
fn is_resolved(hidden: &str, value: f64, usage: Use) {
    let truth = with(driven_chain(), hidden, value);
    let mut experiment = experiment(driven_chain(), vec![dropped("drop", &truth, [1.2, 0.0, 0.0], 1)]);
    // a single drop could as well be explained by the damping of the hinge that it leaves free
    experiment.fit.fixed = vec!["q1/damping".into()];
    let first = diagnose(&experiment, &mut ()).unwrap();
    println!("{} {:?} {:?}", first.diagnosis.sentence, first.diagnosis.partial, first.diagnosis.unknown);
    assert_eq!(first.diagnosis.verdict, Verdict::Ambiguous);
    let mut last = first.clone();
    for seed in 8..8 + MOST_RUNS {
        println!("{} {:?}", last.diagnosis.sentence, last.diagnosis.alternatives);
        let next = &last.next[0];
        let run = match &next.motion {
            Motion::Drop { pose_rad } => {
                dropped("next", &truth, [pose_rad[0], pose_rad[1], pose_rad[2]], seed)
            }
            Motion::Driven { .. } => {
                driven("next", &truth, next.command(&experiment).unwrap(), next.seconds, seed)
            }
        };
        experiment.runs.push(Run { usage, id: format!("next-{seed}"), ..run });
        last = diagnose(&experiment, &mut ()).unwrap();
        if last.diagnosis.verdict != Verdict::Ambiguous {
            break;
        }
    }
    let last = last.diagnosis;
    println!("{} {:?} {:?}", last.sentence, last.alternatives, last.remarks);
    assert_eq!(last.verdict, Verdict::Cause);
    assert_eq!(Some(last.causes[0].name.as_str()), hidden.split('/').next());
    // held-out runs are asked what it is, and nothing is fitted to them: only which sets of causes the size is averaged over may change
    let size = |causes: &[NamedCause]| {
        let own = causes.iter().find(|cause| cause.name == last.causes[0].name)?;
        Some((own.parameters[0].value, own.parameters[0].ci95?))
    };
    if usage == Use::Holdout
        && let Some((before, [low, high])) = size(&first.diagnosis.causes)
    {
        let (after, _) = size(&last.causes).unwrap();
        assert!((after - before).abs() < 0.1 * (high - low), "{before} {after}");
    }
}

#[test]
fn suggested_runs_resolve_an_ambiguity() {
    is_resolved("drag_exponent/exponent", -0.25, Use::Fit);
}

#[test]
fn runs_held_out_resolve_an_ambiguity_too() {
    is_resolved("drag_exponent/exponent", -0.25, Use::Holdout);
}

#[test]
fn a_loose_parameter_is_pinned_down_by_the_runs_proposed_for_it() {
    let experiment =
        experiment(driven_chain(), vec![driven("driven", &driven_chain(), strokes(2.0), 2.0, 3)]);
    let (advice, runs) = pin_down(&experiment, &["g3/blunt".to_owned()]).unwrap();
    assert_eq!(advice.len(), runs.len());
    assert!(advice[0].after < 0.7 * advice[0].before, "{:?}", advice[0]);
    assert!(advice.windows(2).all(|pair| pair[0].after <= pair[1].after), "best first");
    let message = pin_down(&experiment, &["g3/blnt".to_owned()]).unwrap_err().to_string();
    assert!(message.contains("did you mean `g3/blunt`?"), "{message}");
}
