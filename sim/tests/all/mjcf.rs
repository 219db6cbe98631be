//! MJCF is read as MuJoCo reads it, refused by name and line where it cannot be, and written so that it reads back.

use crate::common::model;
use sim::math::Vec3;
use sim::model::KuttaLift;
use sim::{JointKind, MjcfError, Model};

fn read(body: &str) -> Result<Model, MjcfError> {
    Model::from_mjcf(&format!("<mujoco>\n<worldbody>\n{body}\n</worldbody>\n</mujoco>"))
}

fn refusal(text: &str) -> String {
    Model::from_mjcf(text).unwrap_err().to_string()
}

#[test]
fn angles_are_degrees_unless_said_otherwise() {
    let body = r#"<body euler="0 0 90"><joint range="-90 45" springref="30"/><geom size="1"/></body>"#;
    let model = read(body).unwrap();
    let joint = &model.joints[0];
    let close = |a: f64, b: f64| (a - b).abs() < 1e-15;
    assert!(close(joint.limit.unwrap()[0], -std::f64::consts::FRAC_PI_2));
    assert!(close(joint.spring_reference, std::f64::consts::FRAC_PI_6));
    let x = model.bodies[1].quat.matrix().apply(Vec3([1.0, 0.0, 0.0]));
    assert!((x - Vec3([0.0, 1.0, 0.0])).norm() < 1e-15);
}

#[test]
fn classes_inherit_and_the_nearest_one_counts() {
    let text = r#"<mujoco>
      <default>
        <joint damping="1"/>
        <default class="arm"><joint armature="2"/>
          <default class="tip"><joint damping="3" type="slide"/></default></default>
      </default>
      <worldbody>
        <body><joint name="a"/><geom size="1"/>
          <body childclass="arm"><joint name="b"/><geom size="1"/>
            <body><joint name="c" class="tip" damping="4"/><geom size="1"/></body></body></body>
      </worldbody></mujoco>"#;
    let model = Model::from_mjcf(text).unwrap();
    let of = |name: &str| model.joints.iter().find(|joint| joint.name == name).unwrap();
    assert_eq!((of("a").damping[0], of("a").armature), (1.0, 0.0));
    assert_eq!((of("b").damping[0], of("b").armature), (1.0, 2.0));
    assert_eq!((of("c").damping[0], of("c").armature, of("c").kind), (4.0, 2.0, JointKind::Slide));
}

#[test]
fn unnamed_elements_are_called_by_their_place_in_the_file() {
    let model = read(
        r#"<geom type="plane" size="1 1 1"/>
           <body><body><joint/><geom size="1"/></body><joint/><geom size="1"/><geom name="named" size="1"/></body>"#,
    )
    .unwrap();
    // joints and geoms stand in the order of their bodies, as in MuJoCo, but keep their place's name
    let names: Vec<_> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names, ["joint#1", "joint#0"]);
    let names: Vec<_> = model.geoms.iter().map(|geom| geom.name.as_str()).collect();
    assert_eq!(names, ["geom#0", "geom#2", "named", "geom#1"]);
}

#[test]
fn what_would_change_the_motion_is_refused_by_name_and_line() {
    for (body, wanted) in [
        (r#"<body><joint type="hinge" springdamper="1 1"/></body>"#, ["line 3", "springdamper"]),
        ("<body>\n<joint dampling=\"1\"/></body>", ["line 4", "dampling"]),
        (r#"<body mocap="true"/>"#, ["line 3", "mocap"]),
        (
            r#"<body><geom name="g" type="mesh" contype="0" conaffinity="0"/></body>"#,
            ["line 3", "<inertial>"],
        ),
        (r#"<body><geom name="g" type="mesh" mass="0"/></body>"#, ["line 3", "may touch"]),
        (r#"<replicate count="1000000"><body/></replicate>"#, ["line 3", "count"]),
        (r#"<composite/>"#, ["line 3", "<composite>"]),
        (r#"<body><joint damping="x"/></body>"#, ["damping=\"x\"", "finite numbers"]),
        (r#"<body><joint stiffness="nan"/></body>"#, ["stiffness=\"nan\"", "finite numbers"]),
        (r#"<body><geom type="box" size="0.1 0 0.1"/></body>"#, ["size", "above 0"]),
        (r#"<body><joint/></body>"#, ["body#0", "no mass"]),
        (r#"<body name="a"/><body name="a"/>"#, ["line 3", "\"a\" is taken"]),
        (
            r#"<body><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/></body>"#,
            ["diaginertia", "none above the sum"],
        ),
    ] {
        let error = read(body).unwrap_err().to_string();
        assert!(wanted.iter().all(|part| error.contains(part)), "{error} should say {wanted:?}");
    }
    for (text, wanted) in [
        ("<mujoco>\n<option integrator=\"discrete\"/></mujoco>", ["line 2", "implicitfast"]),
        ("<mujoco>\n<option><flag spring=\"disable\"/></option></mujoco>", ["line 2", "spring"]),
        ("<mujoco><equality>\n<weld body1=\"a\"/></equality></mujoco>", ["line 2", "<weld>"]),
        ("<mujoco>\n<include file=\"a.xml\"/></mujoco>", ["line 2", "without a file"]),
        (
            "<mujoco><tendon>\n<spatial limited=\"true\" range=\"0 1\"/></tendon></mujoco>",
            ["line 2", "<spatial>"],
        ),
        ("<mujoco><equality>\n<joint joint1=\"j\"/></equality></mujoco>", ["line 2", "equality <joint>"]),
        (
            "<mujoco><actuator>\n<general tendon=\"t\"/></actuator></mujoco>",
            ["line 2", "name of a fixed tendon"],
        ),
        ("<mujoco><actuator>\n<general site=\"s\"/></actuator></mujoco>", ["line 2", "acts on a site"]),
        (
            "<mujoco><actuator>\n<general joint=\"j\" gainprm=\"2\" biastype=\"affine\"  biasprm=\"0 -1\"/></actuator></mujoco>",
            ["line 2", "position servo"],
        ),
        (
            "<mujoco><actuator>\n<general joint=\"j\" dyntype=\"filter\"/></actuator></mujoco>",
            ["line 2", "dyntype=\"filter\""],
        ),
        ("<robot name=\"arm\"/>", ["URDF", "mj_saveLastXML"]),
        ("<sdf/>", ["no MJCF", "<sdf>"]),
        ("<mujoco><actuator>\n<muscle joint=\"a\"/></actuator></mujoco>", ["line 2", "<muscle>"]),
        ("<mujoco><actuator>\n<motor joint=\"a\"/></actuator></mujoco>", ["line 2", "name of a joint"]),
    ] {
        let error = refusal(text);
        assert!(wanted.iter().all(|part| error.contains(part)), "{error} should say {wanted:?}");
    }
    assert!(refusal("<mujoco>").contains("well-formed"));
}

#[test]
fn everything_that_is_refused_is_listed_at_once() {
    let error = refusal(
        r#"<mujoco><option noslip_iterations="3"/>
          <default><joint springdamper="1 1"/><geom dampling="1"/></default>
          <worldbody><body><joint name="j"/><geom type="box" size="1 1"/><frame><hinge/></frame></body>
            <body><joint/><geom type="mesh"/></body>
            <body><joint/><geom type="mesh"/></body></worldbody>
          <actuator><motor joint="j"/><motor joint="i"/><muscle joint="j"/></actuator></mujoco>"#,
    );
    let lines: Vec<&str> = error.lines().collect();
    assert!(lines[0].contains(&format!("{} things", lines.len() - 1)), "{error}");
    for (line, wanted) in [
        (1, "noslip_iterations"),
        (2, "springdamper"),
        (2, "dampling"),
        (3, "3 numbers above 0"),
        (3, "<hinge>"),
        (4, "geom#1"),
        (5, "geom#2"),
        (6, "joint=\"i\""),
        (6, "<muscle>"),
    ] {
        let found =
            lines.iter().filter(|text| text.contains(&format!("line {line}:")) && text.contains(wanted));
        // two things are wrong with a mesh, each told by itself
        assert_eq!(
            found.count(),
            if wanted.starts_with("geom#") { 2 } else { 1 },
            "{line}, {wanted}: {error}"
        );
    }
    assert_eq!(error.matches("saveinertial").count(), 1, "the way is told once: {error}");
}

#[test]
fn what_only_draws_or_states_the_default_is_passed_over() {
    let text = r#"<mujoco>
      <visual><global fovy="10"/></visual> <asset><texture name="t" builtin="flat" width="1" height="1"/></asset>
      <option solver="Newton"><flag eulerdamp="enable" contact="disable"/></option>
      <worldbody><light pos="0 0 1"/><camera name="c"/>
        <body><joint solreflimit="0.02 1.0"/><geom size="1" rgba="1 0 0 1" material="m"/></body></worldbody>
      <deformable><skin/></deformable>
      <sensor/></mujoco>"#;
    assert_eq!(Model::from_mjcf(text).unwrap().joints.len(), 1);
}

#[test]
fn geoms_that_would_collide_are_listed_not_refused() {
    let balls = |bits: &str| {
        format!(
            r#"<geom name="floor" type="plane" size="1 1 1"/>
               <body name="a"><joint/><geom name="g" size="1" {bits}/>
                 <body name="b"><joint/><geom name="h" size="1" {bits}/>
                   <body name="c"><joint/><geom name="i" size="1" {bits}/></body></body></body>"#
        )
    };
    let pairs = |model: &Model| -> Vec<String> {
        model.possible_contacts().iter().map(|pair| pair.geoms.join("-")).collect()
    };
    // parent and child never collide, the world's planes with everything
    assert_eq!(pairs(&read(&balls("")).unwrap()), ["floor-g", "floor-h", "floor-i", "g-i"]);
    assert!(pairs(&read(&balls(r#"contype="0" conaffinity="0""#)).unwrap()).is_empty());
    let text = format!(
        r#"<mujoco><worldbody>{}</worldbody><contact><exclude body1="a" body2="c"/></contact></mujoco>"#,
        balls("")
    );
    let model = Model::from_mjcf(&text).unwrap();
    assert_eq!(pairs(&model), ["floor-g", "floor-h", "floor-i"]);
    assert_eq!(pairs(&Model::from_mjcf(&model.to_mjcf("")).unwrap()), pairs(&model));
}

#[test]
fn a_model_reads_back_from_its_export_to_the_bit() {
    for name in ["chain_passive", "chain_friction", "chain_active", "arm8", "octopus8"] {
        let mut model = model(name);
        let first = model.parameter_names()[0].clone();
        model.set_parameter(&first, 0.1 + 0.2).unwrap();
        let text = model.to_mjcf("calibrated -- by a test");
        assert!(text.contains("3.14 and later"), "{text}");
        assert_eq!(Model::from_mjcf(&text).unwrap(), model);
    }
}

/// As MuJoCo 4.0.0 compiles them: what is within 1e-14 of length 1 stays, what is further off is divided by its length.
#[test]
fn turns_and_axes_of_length_1_are_kept_to_the_bit() {
    let compiled = |quat: [f64; 4], axis: [f64; 3]| {
        let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let (quat, axis) = (words(&quat), words(&axis));
        let model =
            read(&format!(r#"<body quat="{quat}"><joint axis="{axis}"/><geom size="0.1"/></body>"#)).unwrap();
        (model.bodies[1].quat.0, model.joints[0].axis.0)
    };
    // neither has length 1 to the last bit, and scaling would change some of their numbers
    let (quat, axis) = ([0.5, 0.5, 0.5, 0.5 + 1e-14], [0.6, 0.0, 0.8 - 1e-14]);
    assert_eq!(compiled(quat, axis), (quat, axis));
    let (quat, axis) = ([0.5, 0.5, 0.5, 0.5 + 3e-14], [0.6, 0.0, 0.8 - 2e-14]);
    let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let scaled = (quat.map(|x| x / length(&quat)), axis.map(|x| x / length(&axis)));
    assert_ne!(scaled, (quat, axis));
    assert_eq!(compiled(quat, axis), scaled);
}

#[test]
fn an_export_says_whose_kutta_lift_it_has() {
    let text = r#"<mujoco><custom><text name="kutta_lift" data="before-3.14"/></custom></mujoco>"#;
    let export = Model::from_mjcf(text).unwrap().to_mjcf("");
    assert!(export.contains("in MuJoCo before 3.14"), "{export}");
    assert_eq!(Model::from_mjcf(&export).unwrap().settings.kutta_lift, KuttaLift::Clamped);
    let error = Model::from_mjcf(&text.replace("before-3.14", "3.13")).unwrap_err().to_string();
    assert!(error.contains("3.13") && error.contains("before-3.14"), "{error}");
}

#[test]
fn parameters_are_set_by_name_and_mass_carries_inertia() {
    let mut model = model("chain_active");
    let inertia = model.bodies[2].inertia;
    let mass = model.parameter("link2/mass").unwrap();
    model.set_parameter("link2/mass", 2.0 * mass).unwrap();
    assert_eq!(model.bodies[2].inertia, inertia * 2.0);
    model.set_parameter("servo/gain", 0.07).unwrap();
    assert_eq!(model.actuators[0].kp, 0.07);
    let names = model.parameter_names();
    for (index, name) in names.iter().enumerate() {
        model.set_parameter(name, index as f64 + 1.0).unwrap();
    }
    for (index, name) in names.iter().enumerate() {
        assert_eq!(model.parameter(name), Ok(index as f64 + 1.0), "{name}");
    }
    let error = model.parameter("g9/blunt").unwrap_err().to_string();
    assert!(error.contains("`g9/blunt`") && error.contains("g1/blunt"), "{error}");
}
