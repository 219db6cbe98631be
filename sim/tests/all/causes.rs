//! Causes in whole rollouts: their derivatives from rest and driven, what drives and camera make of time.

use crate::common::{DERIVATIVES_PER_PASS, Number, model, relative};
use sim::batch::{self, Candidate};
use sim::causes::{Cause, Role};
use sim::sensitivities::{self, Direction};
use sim::{Command, Integrator, Isa, Method, Model, RolloutOptions, State, Steps, plan, rollout, rollout_of};

/// Driven rows stand where neither steps nor samples do, so that no corner falls on them.
fn driven() -> Command {
    let time_s: Vec<f64> = (0..12).map(|k| 0.0313 + 0.11073 * f64::from(k)).collect();
    let angle_rad = time_s.iter().map(|t| 0.5 * (7.0 * (t - 0.0313)).sin()).collect();
    Command { actuators: vec!["servo".into()], time_s, angle_rad }
}

fn options(prescribed: bool) -> RolloutOptions {
    RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(0.002),
        prescribed,
        ..Default::default()
    }
}

fn samples() -> Vec<f64> {
    (0..25).map(|k| 0.017 + 0.0411 * f64::from(k)).collect()
}

/// One chain and how it is started.
struct Case {
    name: &'static str,
    model: Model,
    qpos: [f64; 3],
    command: Command,
    options: RolloutOptions,
}

fn cases() -> [Case; 3] {
    let drop = [1.4, 0.1, -0.2];
    [
        Case {
            name: "from rest",
            model: model("chain_passive"),
            qpos: drop,
            command: Command::default(),
            options: options(false),
        },
        Case {
            name: "driven by a servo",
            model: model("chain_active"),
            qpos: [0.0; 3],
            command: driven(),
            options: options(false),
        },
        Case {
            name: "prescribed",
            model: model("chain_active"),
            qpos: [0.0; 3],
            command: driven(),
            options: options(true),
        },
    ]
}

impl Case {
    fn plain(&self, model: &Model) -> Vec<f64> {
        let state = State { qpos: self.qpos.to_vec(), qvel: vec![0.0; 3] };
        let seen = rollout(model, &state, &self.command, &samples(), &self.options).unwrap();
        seen.position_m.into_iter().flatten().collect()
    }

    /// Derivatives of all keypoints by the parameters `names`, of `model`.
    fn exact(&self, model: &Model, names: &[String]) -> Vec<Vec<f64>> {
        let mut lifted = model.map(Number::constant);
        for (index, name) in names.iter().enumerate() {
            lifted.set_parameter(name, Number::variable(model.parameter(name).unwrap(), index)).unwrap();
        }
        let state =
            State { qpos: self.qpos.map(Number::constant).to_vec(), qvel: vec![Number::constant(0.0); 3] };
        let seen = rollout_of(&lifted, &state, &self.command, &samples(), &self.options).unwrap();
        let of = |index: usize| seen.position_m.iter().flatten().map(|x| x.partials[index]).collect();
        (0..names.len()).map(of).collect()
    }

    /// The same by differences of fourth order: central, or forward where the value may not go below.
    fn differences(&self, model: &Model, name: &str, step: f64, forward: bool) -> Vec<f64> {
        let value = model.parameter(name).unwrap();
        let at = |k: f64| {
            let mut model = model.clone();
            model.set_parameter(name, value + k * step).unwrap();
            self.plain(&model)
        };
        let weights: &[(f64, f64)] = if forward {
            &[(0.0, -25.0 / 12.0), (1.0, 4.0), (2.0, -3.0), (3.0, 4.0 / 3.0), (4.0, -0.25)]
        } else {
            &[(-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0)]
        };
        let mut sum = vec![0.0; self.plain(model).len()];
        for (k, weight) in weights {
            for (sum, x) in sum.iter_mut().zip(at(*k)) {
                *sum += weight * x / step;
            }
        }
        sum
    }
}

/// Each cause alone, neutral, then with its sizes up: (model, names of its parameters with something to say).
fn settings(plain: &Model, cause: Cause, up: bool) -> (Model, Vec<String>) {
    let mut model = plain.clone();
    model.add_cause(cause.name()).unwrap();
    let effect = &model.causes()[0];
    let parameters: Vec<_> = effect.names().iter().cloned().zip(effect.parameters()).collect();
    let mut names = Vec::new();
    for (name, parameter) in parameters {
        match parameter.role {
            Role::Size | Role::Switch => {
                if up {
                    model.set_parameter(&name, 0.5 * parameter.typical).unwrap();
                }
                names.push(name);
            }
            Role::Hidden(_) => {
                // slow enough to bind; looks that fall on no step, nor the end of what they begin
                let telling = [
                    ("servo_rate_limit/rate", 1.5),
                    ("servo_refresh/period", 0.02137),
                    ("servo_refresh/first", 0.1371),
                    ("servo_refresh/turn", 0.00331),
                ];
                if let Some((_, value)) = telling.iter().find(|(known, _)| *known == name) {
                    model.set_parameter(&name, *value).unwrap();
                }
                if up {
                    names.push(name);
                }
            }
            Role::Detail if parameter.neutral == 0.0 || up => names.push(name),
            _ => {}
        }
    }
    (model, names)
}

#[test]
fn derivatives_by_every_parameter_are_exact_at_zero_effect_and_beyond() {
    let mut wrong = Vec::new();
    for case in cases() {
        for &cause in Cause::ALL {
            for up in [false, true] {
                let (model, names) = settings(&case.model, cause, up);
                let info: Vec<_> = model.causes()[0].parameters().collect();
                let all = model.causes()[0].names().to_vec();
                for names in names.chunks(DERIVATIVES_PER_PASS) {
                    for (name, exact) in names.iter().zip(case.exact(&model, names)) {
                        assert!(exact.iter().all(|x| x.is_finite()), "{} {name}", case.name);
                        let parameter = info[all.iter().position(|other| other == name).unwrap()];
                        let value = model.parameter(name).unwrap();
                        let forward = value <= parameter.bounds[0];
                        let step = step(cause) * parameter.typical;
                        let other = case.differences(&model, name, step, forward);
                        let worst = disagreement(&exact, &other, step);
                        println!("{}, {name} = {value}: {worst:.1e}", case.name);
                        if worst > DIFFERENCE_TOLERANCE {
                            wrong.push(format!("{}, {name} = {value}: {worst:e}", case.name));
                        }
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Relative accuracy of the finite differences (chosen).
const DIFFERENCE_TOLERANCE: f64 = 1e-5;

/// Step of the differences, as a share of a parameter's typical size. Where the force or the command has corners, few
/// instants of the integrator may lie between the values compared.
fn step(cause: Cause) -> f64 {
    match cause.name() {
        "end_stop" | "one_sided_stiffness" => 1e-5,
        "servo_delay" | "servo_lag" | "servo_loop" | "backlash" | "servo_rate_limit" | "servo_refresh" => {
            1e-6
        }
        _ => 1e-3,
    }
}

/// Max difference over max value, where that is more than the rounding of positions of 0.1 m over the step.
fn disagreement(exact: &[f64], differences: &[f64], step: f64) -> f64 {
    let largest = differences.iter().chain(exact).fold(0.0_f64, |most, x| most.max(x.abs()));
    if largest * step < 1e-15 { 0.0 } else { relative(exact, differences) }
}

/// Friction that stops a link within a quarter of a millisecond of rest. Explicit steps chatter about rest there: positions stay
/// near, and derivatives grow without bound.
#[test]
fn planned_steps_bear_strong_friction() {
    let [mut case, ..] = cases();
    for (name, value) in [("coulomb_friction/torque", 1e-5), ("coulomb_friction/rate", 0.015)] {
        case.model.add_cause("coulomb_friction").unwrap();
        case.model.set_parameter(name, value).unwrap();
    }
    let state = State { qpos: case.qpos.to_vec(), qvel: vec![0.0; 3] };
    let own = RolloutOptions::default();
    let planned = plan(&case.model, &state, &case.command, &samples(), &own, 1e-5).unwrap();
    // the explicit ones that are as exact are ten times as many
    assert!(planned.steps.ends_s.len() < 400, "{}", planned.steps.ends_s.len());
    case.options = RolloutOptions { steps: Some(planned.steps), ..own };
    let name = "coulomb_friction/torque".to_owned();
    let step = 1e-10;
    let differences = case.differences(&case.model, &name, step, false);
    let exact = case.exact(&case.model, &[name]);
    assert!(
        relative(&exact[0], &differences) < DIFFERENCE_TOLERANCE,
        "{:e}",
        relative(&exact[0], &differences)
    );
}

/// Soft friction is solved for with the joints' own friction loss: its torque moves all of them at once, from none on.
#[test]
fn soft_friction_is_friction_loss() {
    let [mut case, ..] = cases();
    let hinges: Vec<String> =
        case.model.joints.iter().map(|joint| format!("{}/frictionloss", joint.name)).collect();
    let torque = "coulomb_friction/torque".to_owned();
    for torque_n_m in [0.0, 2e-6] {
        let mut lossy = case.model.clone();
        lossy.remove_cause("coulomb_friction".parse().unwrap());
        hinges.iter().for_each(|name| lossy.set_parameter(name, torque_n_m).unwrap());
        case.model.add_cause("coulomb_friction").unwrap();
        case.model.set_parameter("coulomb_friction/soft", 1.0).unwrap();
        case.model.set_parameter(&torque, torque_n_m).unwrap();
        let own = case.exact(&case.model, std::slice::from_ref(&torque)).remove(0);
        let each = case.exact(&lossy, &hinges);
        let together: Vec<f64> = (0..own.len()).map(|i| each.iter().map(|one| one[i]).sum()).collect();
        assert!(own.iter().any(|x| *x != 0.0));
        // rounding, which friction's stops make more of
        assert!(relative(&own, &together) < 1e-9, "{:e}", relative(&own, &together));
    }
}

/// The velocity jumps where the command has a corner, and memory with it. After a jump it fades as the root of
/// time, so that the error falls as the step to the power of one and a half.
#[test]
fn history_of_a_driven_link_converges_as_its_steps() {
    let [.., mut case] = cases();
    case.model.add_cause("basset").unwrap();
    case.model.set_parameter("basset/history", 2e-4).unwrap();
    let time_s: Vec<f64> = (0..=110).map(|k| 0.01 * f64::from(k)).collect();
    let angle_rad = time_s.iter().map(|t| 0.5 * (7.0 * t).sin()).collect();
    case.command = Command { actuators: vec!["servo".into()], time_s, angle_rad };
    let mut with_steps = |h: f64| {
        case.options.steps = Some(Steps::even(Method::RungeKutta, h));
        case.plain(&case.model)
    };
    let [coarse, middle, fine] = [5e-3, 2.5e-3, 1.25e-3].map(&mut with_steps);
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let (first, second) = (apart(&coarse, &middle), apart(&middle, &fine));
    assert!(second < 0.4 * first && second < 2e-6, "{first:e} {second:e}");
}

/// `plain` with every cause, all sizes at a share of what is typical.
fn with_every_cause(plain: &Model, share: f64) -> Model {
    let mut model = plain.clone();
    for cause in Cause::ALL {
        model.add_cause(cause.name()).unwrap();
    }
    let effects = model.causes().to_vec();
    for effect in &effects {
        for (name, parameter) in effect.names().iter().zip(effect.parameters()) {
            if matches!(parameter.role, Role::Size | Role::Switch) {
                model.set_parameter(name, share * parameter.typical).unwrap();
            }
        }
    }
    model
}

#[test]
fn what_is_seen_after_the_planned_steps_is_as_exact() {
    const LATE_S: f64 = 0.08;
    let [case, ..] = cases();
    let state = State { qpos: case.qpos.to_vec(), qvel: vec![0.0; 3] };
    // the steps end while the chain falls, and are short there
    let times: Vec<f64> = (0..32).map(|k| 0.01 * f64::from(k)).collect();
    let own = RolloutOptions { integrator: None, timestep_s: None, ..case.options.clone() };
    let planned = plan(&case.model, &state, &case.command, &times, &own, 1e-5).unwrap();
    let mut late = case.model.clone();
    late.add_cause("camera_delay").unwrap();
    late.set_parameter("camera_delay/delay", LATE_S).unwrap();
    let own = RolloutOptions { steps: Some(planned.steps), ..own };
    let seen = rollout(&late, &state, &case.command, &times, &own).unwrap();
    let shifted: Vec<f64> = times.iter().map(|t| t + LATE_S).collect();
    let fine = RolloutOptions { steps: Some(Steps::even(Method::RungeKutta, 5e-4)), ..own };
    let truth = rollout(&case.model, &state, &case.command, &shifted, &fine).unwrap();
    let coordinates = seen.position_m.iter().flatten().zip(truth.position_m.iter().flatten());
    let error_m = coordinates.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("{error_m:.1e} m");
    // steps as long as the last are not chosen for what follows
    assert!(error_m < 5e-5, "{error_m:e}");
}

/// Parameters of every way in which a cause acts, and that differ from lane to lane: delays fall into other rows and steps.
const VARIED_PARAMETERS: [&str; 10] = [
    "added_mass/scale",
    "slosh/frequency",
    "wall/scale",
    "basset/history",
    "coulomb_friction/torque",
    "servo_lag/time",
    "servo_delay/delay",
    "backlash/half_width",
    "camera_delay/delay",
    "rolling_shutter/slowness",
];

#[test]
fn causes_act_the_same_to_the_bit_in_lanes_and_alone() {
    let model = with_every_cause(&model("chain_active"), 0.3);
    let parameters: Vec<_> =
        VARIED_PARAMETERS.iter().map(|name| model.find_parameter(name).unwrap()).collect();
    let candidates: Vec<Candidate> = (0..9)
        .map(|k| {
            let factor = 1.0 + 0.9 * f64::from(k);
            let values = parameters.iter().map(|&parameter| model.get(parameter) * factor).collect();
            Candidate { values, state: model.rest_state(), start_s: 0.0 }
        })
        .collect();
    let ours = |method| RolloutOptions { steps: Some(Steps::even(method, 0.004)), ..Default::default() };
    for options in [options(false), options(true), ours(Method::RungeKutta), ours(Method::Rosenbrock)] {
        for isa in Isa::available() {
            let together =
                batch::positions(&model, &parameters, &candidates, &driven(), &samples(), &options, isa)
                    .unwrap();
            for (candidate, positions) in candidates.iter().zip(together) {
                let mut model = model.clone();
                for (&parameter, &value) in parameters.iter().zip(&candidate.values) {
                    model.set(parameter, value);
                }
                let alone = rollout(&model, &candidate.state, &driven(), &samples(), &options).unwrap();
                assert_eq!(positions.unwrap(), alone.position_m, "{} {options:?}", isa.name());
            }
        }
    }
}

#[test]
fn sensitivities_in_lanes_are_the_derivatives() {
    let [_, case, _] = cases();
    let model = with_every_cause(&case.model, 0.3);
    let parameters: Vec<_> =
        VARIED_PARAMETERS.iter().map(|name| model.find_parameter(name).unwrap()).collect();
    let values: Vec<f64> = parameters.iter().map(|&parameter| model.get(parameter)).collect();
    let directions: Vec<Direction> = (0..VARIED_PARAMETERS.len())
        .map(|index| Direction {
            values: (0..VARIED_PARAMETERS.len()).map(|other| f64::from(other == index)).collect(),
            qpos: vec![0.0; 3],
            qvel: vec![0.0; 3],
            start_s: 0.0,
        })
        .collect();
    let candidate = Candidate { values, state: model.rest_state(), start_s: 0.0 };
    let command = driven();
    let of = |isa: Isa| {
        let (at, times, options) = (&candidate, &samples(), &case.options);
        sensitivities::sensitivities(&model, &parameters, at, &directions, &command, times, options, isa)
            .unwrap()
    };
    let sensed = of(Isa::best());
    for isa in Isa::available() {
        assert_eq!(of(isa), sensed, "{}", isa.name());
    }
    let names: Vec<String> = VARIED_PARAMETERS.iter().map(ToString::to_string).collect();
    let exact: Vec<Vec<f64>> =
        names.chunks(DERIVATIVES_PER_PASS).flat_map(|names| case.exact(&model, names)).collect();
    for ((name, slopes), exact) in names.iter().zip(&sensed.slopes).zip(&exact) {
        let slopes: Vec<f64> = slopes.iter().flatten().copied().collect();
        // rounding of a thousand stages
        assert!(relative(&slopes, exact) < 1e-10, "{name}: {:e}", relative(&slopes, exact));
    }
}

/// Keypoints of a chain are sums of sines of its coordinates: what these say of the derivatives must be what those say.
#[test]
fn derivatives_of_coordinates_are_those_that_keypoints_show() {
    let model = model("chain_passive");
    let place = model.find_parameter("g2/blunt").unwrap();
    let candidate = Candidate {
        values: vec![model.get(place)],
        state: State { qpos: vec![1.2, 0.1, -0.2], qvel: vec![0.0, 0.5, 0.0] },
        start_s: 0.0,
    };
    let along = |values: f64, qpos: f64, qvel: f64| Direction {
        values: vec![values],
        qpos: vec![qpos, 0.0, 0.0],
        qvel: vec![0.0, qvel, 0.0],
        start_s: 0.0,
    };
    let directions = [along(1.0, 0.0, 0.0), along(0.0, 1.0, 0.0), along(0.0, 0.0, 1.0)];
    let times: Vec<f64> = (0..25).map(|k| 0.04 * f64::from(k)).collect();
    let (options, none, places) = (RolloutOptions::default(), Command::default(), [place]);
    let of = sensitivities::of_states(
        &model,
        &places,
        &candidate,
        &directions,
        &none,
        &times,
        &options,
        Isa::best(),
    );
    let all = of.unwrap();
    let plain = sensitivities::sensitivities(
        &model,
        &places,
        &candidate,
        &directions,
        &none,
        &times,
        &options,
        Isa::best(),
    );
    let plain = plain.unwrap();
    assert_eq!((&all.position_m, &all.slopes), (&plain.position_m, &plain.slopes));
    assert!(plain.qpos.is_empty() && plain.qpos_slopes.iter().all(Vec::is_empty));
    let run = rollout(&model, &candidate.state, &none, &times, &options).unwrap();
    assert!(relative(&all.qpos, &run.qpos) < 1e-12 && relative(&all.qvel, &run.qvel) < 1e-12);
    // P1 hangs 25 mm below the first hinge, which turns it to the right
    for (slopes, turned) in all.slopes.iter().zip(&all.qpos_slopes) {
        for (instant, slope) in slopes.chunks(3).enumerate() {
            let expected = 0.025 * run.qpos[3 * instant].cos() * turned[3 * instant];
            assert!((slope[0][0] - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{instant}");
        }
    }
    // the first row is the start itself
    assert_eq!([all.qpos_slopes[1][0], all.qvel_slopes[2][1]], [1.0, 1.0]);
}
