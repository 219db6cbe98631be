use super::*;
use ground::strict::{Finite, NonNegative};

/// One link of 50 mm in water, hanging and driven by a stiff servo.
const DRIVEN: &str = r#"
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" gravity="0 0 -9.81" density="1000" viscosity="0.00095"/>
  <worldbody>
    <body name="link1" gravcomp="0.8">
      <joint name="q1" type="hinge" axis="0 -1 0" damping="1e-4"/>
      <geom name="g1" type="box" size="0.005 0.0025 0.025" pos="0 0 -0.025" density="1250" fluidshape="ellipsoid"/>
      <site name="P1" pos="0 0 -0.05"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="q1" kp="0.5" kv="5e-3"/></actuator>
</mujoco>"#;

const BEGIN: MonotonicNs = MonotonicNs(100_000_000_000);

fn at(time_s: f64) -> MonotonicNs {
    BEGIN.plus_seconds(time_s)
}

fn config(text: &str) -> TankConfig {
    let view = "[view]\nmetres_per_pixel = 0.00025\norigin_px = [320.0, 60.0]\n";
    let text = format!("model = \"none.xml\"\n{text}\n{view}");
    ground::strict::parse(&text, std::path::Path::new("tank.toml")).unwrap()
}

fn motion(text: &str) -> Motion {
    Motion::new(Model::from_mjcf(DRIVEN).unwrap(), &config(text), BEGIN).unwrap()
}

const SERVO: &str = "[[servo]]\nactuator = \"servo\"\nus_per_rad = 500.0\n";

fn pulse(motion: &mut Motion, time_s: f64, pulse_us: Option<u16>) {
    motion.add_event(at(time_s), Event::Pulse { channel: 0, pulse_us });
}

fn angle(motion: &mut Motion, time_s: f64) -> f64 {
    motion.qpos(at(time_s)).unwrap()[0]
}

#[test]
fn link_goes_where_the_pulse_points_and_counts_counter_clockwise_positive() {
    let mut motion = motion(SERVO);
    pulse(&mut motion, 0.1, Some(1750));
    // A 0.5 N m/rad servo yields by the link's weight in water, 0.8 mN m, over its stiffness.
    assert!((angle(&mut motion, 2.0) - 0.5).abs() < 0.005, "{}", angle(&mut motion, 2.0));
    pulse(&mut motion, 2.1, Some(1250));
    assert!((angle(&mut motion, 4.0) + 0.5).abs() < 0.005);
}

#[test]
fn pulse_acts_at_the_servos_next_period_and_not_before() {
    let mut motion = motion(SERVO);
    pulse(&mut motion, 0.1001, Some(2000));
    assert_eq!(angle(&mut motion, 0.119), 0.0);
    assert!(angle(&mut motion, 0.140) > 0.01);
}

#[test]
fn same_pulses_give_the_same_motion_whenever_asked() {
    let pulses = [(0.1, Some(1800)), (0.43, Some(1300)), (0.9, None), (1.2, Some(1600))];
    let mut all_known = motion(SERVO);
    for (time_s, pulse_us) in pulses {
        pulse(&mut all_known, time_s, pulse_us);
    }
    let times: Vec<f64> = (0..200).map(|k| 0.0097 * f64::from(k)).collect();
    let expected: Vec<f64> = times.iter().map(|&time_s| angle(&mut all_known, time_s)).collect();

    // Every pulse becomes known 0.15 s late, images are asked for as they come.
    let mut late = motion(SERVO);
    let mut waiting = pulses.iter().peekable();
    for &time_s in &times {
        while let Some(&(pulsed_s, pulse_us)) = waiting.next_if(|(pulsed_s, _)| pulsed_s + 0.15 < time_s) {
            pulse(&mut late, pulsed_s, pulse_us);
        }
        angle(&mut late, time_s);
    }
    let again: Vec<f64> = times.iter().map(|&time_s| angle(&mut late, time_s)).collect();
    assert_eq!(again, expected);
    assert!(expected.iter().any(|angle| angle.abs() > 0.2));
}

#[test]
fn limp_servo_lets_the_link_fall_back() {
    let mut motion = motion(SERVO);
    pulse(&mut motion, 0.0, Some(2000));
    assert!(angle(&mut motion, 1.0) > 0.9);
    pulse(&mut motion, 1.0, None);
    assert!(angle(&mut motion, 20.0).abs() < 0.05);
}

#[test]
fn support_line_holds_until_the_release() {
    let text = "initial_qpos = [1.5]\nhold = \"release\"";
    let mut motion = motion(text);
    assert_eq!(angle(&mut motion, 3.0), 1.5);
    motion.add_event(at(3.5), Event::LetGo);
    assert_eq!(angle(&mut motion, 3.499), 1.5);
    let fallen = angle(&mut motion, 3.7);
    assert!(fallen < 1.4, "{fallen}");
}

#[test]
fn release_actuator_opens_at_its_pulse() {
    let text = "initial_qpos = [1.5]\nhold = \"release\"\n[release]\nchannel = 3\n";
    let mut motion = motion(text);
    motion.add_event(at(0.1), Event::Pulse { channel: 3, pulse_us: Some(1600) });
    motion.add_event(at(0.2), Event::Pulse { channel: 2, pulse_us: Some(1900) });
    assert_eq!(angle(&mut motion, 0.5), 1.5);
    motion.add_event(at(0.6), Event::Pulse { channel: 3, pulse_us: Some(1700) });
    assert!(angle(&mut motion, 0.9) < 1.45);
}

#[test]
fn support_goes_with_the_first_pulse() {
    let mut motion = motion(&format!("initial_qpos = [1.0]\nhold = \"first-pulse\"\n{SERVO}"));
    assert_eq!(angle(&mut motion, 1.0), 1.0);
    pulse(&mut motion, 1.1, Some(1500));
    assert!(angle(&mut motion, 2.5).abs() < 0.01);
}

#[test]
fn free_fall_agrees_with_a_rollout_of_the_same_model() {
    let mut motion = motion("initial_qpos = [1.5]\nhold = \"release\"");
    motion.add_event(at(1.0), Event::LetGo);
    let times: Vec<f64> = (0..40).map(|k| 0.02 * f64::from(k)).collect();
    let mut model = Model::from_mjcf(DRIVEN).unwrap();
    model.actuators[0].kp = 0.0;
    model.actuators[0].kv = 0.0;
    let state = State { qpos: vec![1.5], qvel: vec![0.0] };
    let options = RolloutOptions { timestep_s: Some(MAX_TIMESTEP_S), ..RolloutOptions::default() };
    let rollout = sim::rollout(&model, &state, &sim::Command::default(), &times, &options).unwrap();
    for (&time_s, expected) in times.iter().zip(&rollout.qpos) {
        let got = angle(&mut motion, 1.0 + time_s);
        assert!((got - expected).abs() < 1e-9, "{time_s}: {got} {expected}");
    }
}

#[test]
fn hours_of_waiting_cost_little_and_change_nothing() {
    let mut motion = motion(SERVO);
    let begun = std::time::Instant::now();
    assert_eq!(angle(&mut motion, 36_000.0), 0.0);
    assert!(begun.elapsed().as_secs_f64() < 1.0);
    pulse(&mut motion, 36_000.1, Some(2000));
    assert!((angle(&mut motion, 36_002.0) - 1.0).abs() < 0.01);
}

#[test]
fn hours_of_pulses_are_not_all_kept() {
    let mut motion = motion(SERVO);
    for period in 0..3000 {
        let time_s = 0.02 * f64::from(period);
        pulse(&mut motion, time_s, Some(1500 + (period % 50) as u16));
        angle(&mut motion, time_s);
    }
    assert!(motion.history.len() <= MAX_SNAPSHOTS + 2, "{}", motion.history.len());
}

#[test]
fn pulse_from_before_the_tank_was_filled_acts_from_its_beginning() {
    let mut motion = motion(SERVO);
    pulse(&mut motion, -5.0, Some(1750));
    assert!((angle(&mut motion, 1.0) - 0.5).abs() < 0.01);
}

#[test]
fn diverging_tank_says_so() {
    let mut config = config("initial_qpos = [1.5]");
    config.timestep_s = ground::strict::Positive::new(0.001);
    let mut model = Model::from_mjcf(DRIVEN).unwrap();
    // A spring that pushes away from its rest.
    model.joints[0].stiffness = [-1.0, 0.0, 0.0];
    let mut motion = Motion::new(model, &config, BEGIN).unwrap();
    assert!(matches!(motion.qpos(at(5.0)), Err(TankError::Simulation(_))));
}

#[test]
fn config_that_does_not_fit_its_model_is_refused() {
    let model = || Model::from_mjcf(DRIVEN).unwrap();
    let wrong_pose = TankConfig { initial_qpos: vec![Finite::new(0.0).unwrap(); 3], ..config("") };
    assert!(matches!(
        Motion::new(model(), &wrong_pose, BEGIN),
        Err(TankError::InitialPose { got: 3, wanted: 1 })
    ));
    let wrong_name = config("[[servo]]\nactuator = \"motor\"\n");
    let error = Motion::new(model(), &wrong_name, BEGIN).err().unwrap().to_string();
    assert!(error.contains("`motor`") && error.contains("servo"), "{error}");
    assert_eq!(config("").release.after_s, NonNegative::new(0.5).unwrap());
}

/// As in a tank that hides `causes` too.
fn hiding(causes: &str) -> Motion {
    // the servo alone already turns about as fast as steps of 1 ms can follow
    let config = config(&format!("timestep_s = 0.0005\n{SERVO}\n[causes]\n{causes}"));
    let mut model = Model::from_mjcf(DRIVEN).unwrap();
    crate::causes::add_to_model(&mut model, &config.causes).unwrap();
    Motion::new(model, &config, BEGIN).unwrap()
}

#[test]
fn water_with_a_memory_gives_the_same_motion_whenever_asked() {
    let pulses = [(0.1, 1800), (0.43, 1300), (0.9, 1600)];
    let memory = "basset = { history = 2e-3 }";
    let (mut known, mut late, mut plain) = (hiding(memory), hiding(memory), hiding(""));
    for (time_s, pulse_us) in pulses {
        pulse(&mut known, time_s, Some(pulse_us));
        pulse(&mut plain, time_s, Some(pulse_us));
    }
    let mut waiting = pulses.iter().peekable();
    let mut apart = 0.0_f64;
    for k in 0..200 {
        let time_s = 0.0097 * f64::from(k);
        while let Some(&(pulsed_s, pulse_us)) = waiting.next_if(|(pulsed_s, _)| pulsed_s + 0.15 < time_s) {
            pulse(&mut late, pulsed_s, Some(pulse_us));
        }
        angle(&mut late, time_s);
        apart = apart.max((angle(&mut known, time_s) - angle(&mut plain, time_s)).abs());
    }
    assert_eq!(angle(&mut late, 2.5), angle(&mut known, 2.5));
    assert!(apart > 1e-4, "the memory does something: {apart}");
}

#[test]
fn delayed_servo_does_later_what_a_prompt_one_does() {
    let (mut prompt, mut delayed) = (hiding(""), hiding("servo_delay = { delay = 0.04 }"));
    for motion in [&mut prompt, &mut delayed] {
        pulse(motion, 0.1, Some(1800));
    }
    for k in 0..50 {
        let time_s = 0.05 + 0.01 * f64::from(k);
        // on the servo's own periods and at rest before, so the same but for rounding
        assert!((angle(&mut delayed, time_s + 0.04) - angle(&mut prompt, time_s)).abs() < 1e-9);
    }
}
