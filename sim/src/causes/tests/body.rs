//! What bodies measure and weigh, and what resists them where there is no water.

use super::*;

/// One link in a vacuum.
fn dry_link() -> Model {
    mjcf(
        r#"gravity="0 0 -9.81""#,
        r#"<body name="link"><joint name="q" axis="0 -1 0"/>
           <geom name="g" type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125" density="1240"/>
           <site name="P1" pos="0 0 -0.0275"/></body>"#,
    )
}

#[test]
fn medium_resists_a_turning_link_with_the_fourth_power_of_its_length() {
    let effect = |model: &Model, w: f64| {
        let state = State { qpos: vec![0.7], qvel: vec![w] };
        Simulator::new(model, &RolloutOptions::default()).unwrap().forces(&state, &[]).effect[0]
    };
    for drag in [&[("medium_drag/drag", 0.01)][..], &[("medium_drag/link", 0.01)]] {
        let model = with(&dry_link(), drag);
        for w in [3.0_f64, -5.0] {
            assert_close(effect(&model, w), -0.01 * w.abs() * w * TIP_M.powi(4) / 4.0, 1e-9, "medium_drag");
        }
        assert_eq!(effect(&model, 0.0), 0.0);
    }
    // in water the ellipsoids resist, and this has no say
    assert_eq!(torque(&[("medium_drag/drag", 0.01)], 0.7, 3.0), 0.0);
}

#[test]
fn medium_resists_motion_across_a_link_and_not_along_it() {
    let slide = |axis: &str| {
        let model = mjcf(
            r#"gravity="0 0 0""#,
            &format!(
                r#"<body name="rod"><joint name="s" type="slide" axis="{axis}"/>
                   <geom type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125" density="1240"/>
                   <site name="P1" pos="0 0 -0.0275"/></body>"#
            ),
        );
        let state = State { qpos: vec![0.0], qvel: vec![0.4] };
        let model = with(&model, &[("medium_drag/drag", 0.01)]);
        Simulator::new(&model, &RolloutOptions::default()).unwrap().forces(&state, &[]).effect[0]
    };
    assert_close(slide("1 0 0"), -0.01 * TIP_M * 0.16, 1e-9, "across");
    assert!(slide("0 0 1").abs() < 1e-12, "along");
}

/// A physical pendulum of small swing comes to the bottom after a quarter of its period.
#[test]
fn inertia_slows_a_pendulum() {
    const SWING_RAD: f64 = 1e-3;
    let model = dry_link();
    let [long, wide] = [0.03, 0.01];
    let own = LINK_KG / 12.0 * (long * long + wide * wide);
    for values in [&[("inertia/scale", 0.3)][..], &[("inertia/link", 0.3)]] {
        let whole = 1.3 * own + LINK_KG * LEVER_M * LEVER_M;
        let quarter_s = std::f64::consts::FRAC_PI_2 * (whole / (LINK_KG * G * LEVER_M)).sqrt();
        let seen = run(&with(&model, values), &[SWING_RAD], &[0.0, quarter_s], &rk4(1e-4));
        assert!(seen.position_m[1][0].abs() < 1e-6 * SWING_RAD, "{:e}", seen.position_m[1][0]);
    }
}

#[test]
fn longer_links_and_askew_ones_stand_where_geometry_says() {
    let model = chain("active");
    let at =
        |values: &[(&str, f64)], q: [f64; 3]| run(&with(&model, values), &q, &[0.0], &rk4(1e-3)).position_m;
    let q = [0.3, -0.5, 0.8];
    let plain = at(&[], q);
    let longer = at(&[("link_length/link2", 0.002)], q);
    let heading: f64 = q[..2].iter().sum();
    let along = [heading.sin(), 0.0, -heading.cos()];
    for (point, (ours, plain)) in longer.iter().zip(&plain).enumerate() {
        for axis in 0..3 {
            let moved = if point == 0 { 0.0 } else { 0.002 * along[axis] };
            assert!((ours[axis] - plain[axis] - moved).abs() < 1e-12, "P{} {axis}", point + 1);
        }
    }
    // only the servo's own hinge has a zero here
    let askew = with(&model, &[("joint_zero/q1", 0.1)]);
    assert_eq!(askew.causes()[0].names(), ["joint_zero/q1"]);
    let turned = at(&[("joint_zero/q1", 0.1)], q);
    for (ours, other) in turned.iter().flatten().zip(at(&[], [q[0] + 0.1, q[1], q[2]]).iter().flatten()) {
        assert!((ours - other).abs() < 1e-12);
    }
}
