use std::path::Path;

use clap::Args as _;
use sim::{Model, State};

use super::*;
use ::config::RigConfig;
use servo::profile::Profile;
use vision::{Mode, Outline};

/// Answers as the command line gives them.
fn answers(options: &[&str]) -> Answers {
    let command = Answers::augment_args(clap::Command::new("new"));
    let matches = command.try_get_matches_from(["new"].iter().chain(options)).unwrap();
    <Answers as clap::FromArgMatches>::from_arg_matches(&matches).unwrap()
}

fn chain(options: &[&str]) -> Chain {
    Chain::new(&answers(options)).unwrap()
}

fn refusal(options: &[&str]) -> String {
    Chain::new(&answers(options)).unwrap_err().to_string()
}

fn text(files: &[File], name: &str) -> String {
    files.iter().find(|file| file.name == name).unwrap_or_else(|| panic!("no {name}")).text.clone()
}

fn model(options: &[&str]) -> Model {
    Model::from_mjcf(&text(&files("mine", &chain(options)), MODEL)).unwrap()
}

fn shipped(name: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/models").join(name);
    Model::from_mjcf(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Water of 22 °C is lighter by so much than the round 1000 kg/m3 of the shipped models.
const WATER: f64 = 0.0023;
/// Numbers are written with six digits.
const DIGITS: f64 = 1e-5;

#[track_caller]
fn close(got: f64, wanted: f64, within: f64) {
    assert!((got - wanted).abs() <= within * wanted.abs().max(1e-12), "{got} instead of {wanted}");
}

#[test]
fn shipped_chains_come_out_of_their_numbers() {
    let numbers =
        ["--links=3", "--length-m=0.03", "--overlap-m=0.005", "--width-m=0.01", "--thickness-m=0.005"];
    for (name, options) in [
        ("chain-driven-hanging.xml", ["--mount=hanging", "--motion=driven", "--density-kg-per-m3=1240"]),
        ("chain-driven-upright.xml", ["--mount=upright", "--motion=driven", "--density-kg-per-m3=900"]),
        ("chain-driven-flat.xml", ["--mount=horizontal", "--motion=driven", "--dry-mass-kg=0.00186"]),
        ("chain-passive.xml", ["--mount=hanging", "--motion=drop", "--dry-mass-kg=0.00186,0.00186,0.00186"]),
    ] {
        let (ours, theirs) = (model(&[&numbers[..], &options].concat()), shipped(name));
        assert_eq!(ours.keypoints(), theirs.keypoints(), "{name}");
        assert_eq!(ours.parameter_names(), theirs.parameter_names(), "{name}");
        assert_eq!(ours.settings.gravity, theirs.settings.gravity, "{name}");
        close(ours.settings.viscosity, theirs.settings.viscosity, 0.01);
        for (a, b) in ours.bodies.iter().zip(&theirs.bodies).skip(1) {
            close(a.mass, b.mass, DIGITS);
            close(a.gravity_compensation, b.gravity_compensation, WATER);
            (0..3).for_each(|i| close(a.inertia.0[i], b.inertia.0[i], DIGITS));
            (0..3).for_each(|i| close(a.pos.0[i], b.pos.0[i], DIGITS));
            (0..3).for_each(|i| close(a.com.0[i], b.com.0[i], DIGITS));
        }
        for (a, b) in ours.geoms.iter().zip(&theirs.geoms) {
            assert_eq!((a.kind, a.fluid), (b.kind, b.fluid), "{name}");
            (0..3).for_each(|i| close(a.size[i], b.size[i], DIGITS));
        }
        for (a, b) in ours.sites.iter().zip(&theirs.sites) {
            (0..3).for_each(|i| close(a.pos.0[i], b.pos.0[i], DIGITS));
        }
        for (a, b) in ours.joints.iter().zip(&theirs.joints) {
            assert_eq!(
                (&a.name, a.axis, a.damping, a.friction_loss),
                (&b.name, b.axis, b.damping, b.friction_loss)
            );
        }
        assert_eq!(ours.actuators, theirs.actuators, "{name}");
    }
}

#[test]
fn weights_in_water_say_the_buoyancy() {
    let weighed = ["--dry-mass-kg=0.0018,0.0019,0.002", "--wet-mass-kg=0.0003,0.0004,0.0005"];
    let model = model(&weighed);
    for (body, dry_kg) in model.bodies[1..].iter().zip([0.0018, 0.0019, 0.002]) {
        close(body.mass, dry_kg, DIGITS);
        close(body.gravity_compensation, 0.0015 / dry_kg, DIGITS);
    }
}

#[test]
fn configs_of_all_kinds_are_read_as_a_run_reads_them() {
    let kinds: [&[&str]; 6] = [
        &[],
        &["--mount=upright", "--dry-mass-kg=0.0013", "--wet-mass-kg=-0.0002", "--links=5"],
        &["--motion=drop", "--port=/dev/ttyACM0", "--device=/dev/video\"2", "--format=yuyv", "--fps=120"],
        &["--mount=horizontal", "--shape=ellipsoid", "--links=1", "--calibration=tank.toml"],
        &["--length-m=0.2", "--size-px=1280x720", "--metres-per-pixel=0.001"],
        &["--mount=upright", "--motion=drop", "--salinity-g-per-kg=35"],
    ];
    for options in kinds {
        for mock in [&[][..], &["--mock"]] {
            let real = ["--port", "--device", "--format", "--calibration"];
            let dropped =
                |option: &&&str| mock.is_empty() || !real.iter().any(|name| option.starts_with(name));
            let options: Vec<&str> = options.iter().filter(dropped).chain(mock).copied().collect();
            let chain = chain(&options);
            let files = files("my \"rig\" & <tank>", &chain);
            let config = RigConfig::parse(&text(&files, CONFIG), Path::new(CONFIG)).unwrap();
            let model = Model::from_mjcf(&text(&files, MODEL)).unwrap();
            let outline = Outline::new(&config.vision, Some(&model)).unwrap();
            assert_eq!((outline.mode, outline.links), (Mode::Links, chain.links.len()), "{options:?}");
            assert_eq!(outline.base_m, Some([0.0; 3]), "{options:?}");
            close(outline.overhang_m.unwrap().0, chain.overlap_m / 2.0, 1e-3);
            if let (Some(profile), Some(servo)) = (&config.profile, &config.servo) {
                Profile::new(profile).unwrap().pulses(servo).unwrap();
            }
            let mut fitted = model.clone();
            let mut fit = config.fit.clone();
            config.mechanism.weights().put_into(&config.water.water(), &mut fitted, &mut fit).unwrap();
            for (a, b) in fitted.bodies.iter().zip(&model.bodies).skip(1) {
                close(a.mass, b.mass, DIGITS);
                close(a.gravity_compensation, b.gravity_compensation, 2.0 * DIGITS);
            }
            if config.mock.is_some() {
                let folder = tempfile::tempdir().unwrap();
                files
                    .iter()
                    .for_each(|file| std::fs::write(folder.path().join(file.name), &file.text).unwrap());
                let tank = ground::strict::read(&folder.path().join(TANK)).unwrap();
                let tank = tank::Tank::new(&tank, folder.path()).unwrap();
                assert_eq!(tank.model().keypoints(), model.keypoints());
            }
        }
    }
}

#[test]
fn a_chain_hangs_or_stands_at_rest_where_its_model_says() {
    for options in [&["--mount=hanging"][..], &["--mount=upright"], &["--length-m=0.3", "--links=4"]] {
        let model = model(options);
        let pushed = State { qpos: vec![0.1; model.nq()], qvel: vec![0.0; model.nv()] };
        let command = sim::Command::default();
        let times = [0.0, 20.0];
        let moved = sim::rollout(&model, &pushed, &command, &times, &sim::RolloutOptions::default()).unwrap();
        let end = &moved.qpos[model.nq()..];
        assert!(end.iter().all(|q| q.abs() < 0.03), "{options:?}: {end:?}");
    }
}

#[test]
fn answers_that_cannot_be_are_refused_by_name() {
    for (options, says) in [
        (&["--overlap-m=0.03"][..], "--overlap-m 0.03 must be less than --length-m 0.03"),
        (&["--overlap-m=-0.01"], "--overlap-m -0.01 is not between 0 and 2 m"),
        (&["--length-m=30"], "--length-m 30 is not between 0.0005 and 2 m: metres are asked for"),
        (&["--length-m=nan"], "--length-m NaN"),
        (&["--links=0"], "--links 0"),
        (&["--links=65"], "--links 65"),
        (
            &["--dry-mass-kg=0.0014"],
            "link1 weighs 0.001400 kg and displaces 0.001497 kg of water, so it floats",
        ),
        (&["--dry-mass-kg=0.0018,0.0018,0.0014"], "link3 weighs"),
        (&["--density-kg-per-m3=900"], "--mount hanging needs links that sink"),
        (&["--mount=upright", "--density-kg-per-m3=1240"], "--mount upright needs links that float"),
        (&["--dry-mass-kg=0.0018,0.0018"], "--dry-mass-kg has 2 weights for 3 links"),
        (&["--dry-mass-kg=0"], "--dry-mass-kg 0"),
        (&["--wet-mass-kg=0.0003"], "only together with --dry-mass-kg"),
        (&["--dry-mass-kg=0.0018", "--wet-mass-kg=0.0019"], "water takes weight away"),
        (
            &["--dry-mass-kg=0.0018", "--wet-mass-kg=0.0015"],
            "link1 displaces 0.000300 kg of water by its weights",
        ),
        (&["--mount=horizontal", "--motion=drop"], "nothing would move it"),
        (&["--metres-per-pixel=0.0001"], "800 px long in a picture 480 px high"),
        (&["--fps=200", "--exposure-s=0.01"], "--exposure-s 0.01 is longer than"),
        (&["--water-temperature-c=80"], "80 °C"),
        (&["--salinity-g-per-kg=-1"], "-1 g/kg"),
    ] {
        let refusal = refusal(options);
        assert!(refusal.contains(says), "{options:?}: {refusal}");
    }
}
