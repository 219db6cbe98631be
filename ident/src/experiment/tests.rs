use std::path::{Path, PathBuf};

use super::*;

const MODEL: &str = r#"<mujoco model="two">
  <option timestep="0.001" density="1000"/>
  <default><geom fluidshape="ellipsoid"/></default>
  <worldbody>
    <body name="l1">
      <joint name="j1" axis="0 -1 0"/>
      <geom name="g1" type="box" size="0.005 0.003 0.01" pos="0 0 -0.01"/>
      <site name="P1" pos="0 0 -0.02"/>
      <site name="logo" pos="0 0 0.01"/>
      <body name="l2" pos="0 0 -0.02">
        <joint name="j2" axis="0 -1 0"/>
        <geom name="g2" type="box" size="0.005 0.003 0.01" pos="0 0 -0.01"/>
        <site name="P2" pos="0 0 -0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="j1" kp="0.1"/></actuator>
</mujoco>"#;

const DROP: &str =
    "time_s,P1_x_m,P1_z_m,P2_x_m,P2_z_m\n0,0.02,0,0.04,0\n0.1,0.02,0,0.04,0\n0.2,0.01,-0.01,0.02,-0.02\n";
const SERVO: &str = "time_s,servo_rad\n0,0\n0.1,0\n0.3,0.5\n";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.put("m.xml", MODEL).put("d.csv", DROP).put("s.csv", SERVO);
        folder
    }

    fn put(&self, name: &str, text: &str) -> &Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, text: &str) -> Result<Experiment, ExperimentError> {
        self.put("set/e.toml", text);
        Experiment::read(&self.path("set/e.toml"))
    }

    fn refusal(&self, text: &str) -> String {
        let error = self.read(text).expect_err(text);
        let mut message = error.to_string();
        let mut source = std::error::Error::source(&error);
        while let Some(cause) = source {
            message.push_str(&format!(": {cause}"));
            source = cause.source();
        }
        message
    }
}

/// Everything the contract's example says, word for word but for the file names.
const FULL: &str = r#"
model = "../m.xml"
prescribed = true
noise_m = 0.0004
[fit]
parameters = ["fluidcoef", "damping", "frictionloss"]
fixed = ["g1/magnus"]
tie = [["g1*/blunt", "g2*/blunt"]]
method = "paper"
seed = 3
max_evaluations = 4000
[fit.bounds]
fluidcoef = [0.0, 10.0]
[fit.prior]
"l1/mass" = { mean = 0.0049, std = 0.00002 }
[[run]]
id = "drop-horizontal"
kind = "drop"
trajectory = "../d.csv"
release_s = 0.1
use = "fit"
[[run]]
id = "driven-1"
kind = "driven"
trajectory = "../d.csv"
servo = "../s.csv"
use = "holdout"
[[run]]
folder = "../runs/20261120T101503Z-ab12cd"
use = "fit"
weight = 2.0
[[run]]
id = "free"
kind = "free"
trajectory = "../d.csv"
init_s = 0.15
"#;

fn with_run_folder() -> Folder {
    let folder = Folder::new();
    let start = r#"{"id": "r1", "kind": "drop", "model": "model-start.xml", "prescribed": true, "release_s": 0.1, "config": "anything"}"#;
    for (name, text) in [("start.json", start), ("trajectory.csv", DROP), ("model-start.xml", MODEL)] {
        folder.put(&format!("runs/20261120T101503Z-ab12cd/{name}"), text);
    }
    folder
}

#[test]
fn the_contracts_example_is_read_as_it_says() {
    let experiment = with_run_folder().read(FULL).unwrap();
    assert_eq!(experiment.noise_m, Some(0.0004));
    let fit = &experiment.fit;
    assert_eq!((fit.method, fit.seed, fit.max_evaluations), (Method::Paper, 3, 4000));
    assert_eq!(fit.tie, [["g1*/blunt", "g2*/blunt"]]);
    assert_eq!(fit.prior["l1/mass"].std.get(), 0.00002);
    let [drop, driven, folder, free] = &experiment.runs[..] else { panic!() };
    assert_eq!((drop.kind, drop.usage, drop.release_s), (RunKind::Drop, Use::Fit, Some(0.1)));
    assert_eq!((driven.kind, driven.usage, driven.prescribed), (RunKind::Driven, Use::Holdout, true));
    assert_eq!(driven.command.as_ref().unwrap().actuators, ["servo"]);
    assert_eq!((folder.id.as_str(), folder.release_s, folder.weight), ("r1", Some(0.1), 2.0));
    assert_eq!((free.init_s, free.weight, free.usage), (0.15, 1.0, Use::Fit));
}

#[test]
fn a_run_folder_brings_its_model() {
    let text = "[[run]]\nfolder = \"../runs/20261120T101503Z-ab12cd\"\n";
    let folder = with_run_folder();
    let experiment = folder.read(text).unwrap();
    assert_eq!(experiment.model.name, "two");
    assert_eq!(experiment.fit, FitConfig::default());

    folder.put("runs/b/start.json", r#"{"id": "r2", "kind": "drop", "model": "other.xml"}"#);
    folder.put("runs/b/trajectory.csv", DROP).put("runs/b/other.xml", &MODEL.replace("0.1\"", "0.2\""));
    let message = folder.refusal(&format!("{text}[[run]]\nfolder = \"../runs/b\"\n"));
    assert!(message.contains("other.xml differ; name the one to fit as `model`"), "{message}");
}

#[test]
fn what_is_wrong_with_an_experiment_is_said_with_its_place() {
    let folder = with_run_folder();
    folder.put("one.csv", "time_s,P1_x_m,P1_z_m\n0,0,0\n1,,\n");
    folder
        .put("p9.csv", &DROP.replace("P2", "P9"))
        .put("gap.csv", "time_s,P1_x_m,P2_x_m\n0,0,\n1,0,\n2,0,\n");
    folder.put("logo.csv", &DROP.replace("P2", "logo"));
    folder.put("still.csv", "time_s,servo_rad\n0,0\n1,0\n").put("srv.csv", "time_s,srvo_rad\n0,0\n1,1\n");
    folder
        .put("late.csv", "time_s,servo_rad\n0,0\n7,0\n8,1\n")
        .put("bad.xml", "<mujoco><worldbody></mujoco>");
    folder.put("runs/c/start.json", "{\"id\": 3}");
    let run = |kind: &str, table: &str| {
        format!("model=\"../m.xml\"\n[[run]]\nid=\"a\"\nkind=\"{kind}\"\ntrajectory=\"../{table}\"\n")
    };
    let drop = run("drop", "d.csv");
    let entry = drop.strip_prefix("model=\"../m.xml\"\n").unwrap();
    let driven = |servo: &str| run("driven", "d.csv") + &format!("servo=\"../{servo}\"\n");
    let with = |head: &str| format!("model=\"../m.xml\"\n{head}\n{entry}");
    let cases: Vec<(String, &str)> = vec![
        (drop.replace("model", "modl"), "did you mean `model`?"),
        (with("[fit]\nmethd=\"paper\""), "did you mean `method`?"),
        (with("[fit]\nmethod=\"papr\""), "did you mean `paper`?"),
        (with("noise_m=0"), "must be finite and above 0"),
        (with("[fit.bounds]\ndamping=[0.0, inf]"), "must be finite"),
        (drop.clone() + "release=0.2", "did you mean `release_s`?"),
        (entry.into(), "no `model` is named and no run folder brings one"),
        (drop.replace("m.xml", "none.xml"), "none.xml"),
        (drop.replace("m.xml", "bad.xml"), "bad.xml"),
        ("model=\"../m.xml\"".into(), "the experiment has no runs; add a `[[run]]`"),
        ("model=\"../m.xml\"\n[[run]]\nkind=\"drop\"".into(), "run `#1`: `id` is missing"),
        ("model=\"../m.xml\"\n[[run]]\nid=\"a\"".into(), "run `a`: `kind` is missing"),
        ("model=\"../m.xml\"\n[[run]]\nid=\"a\"\nkind=\"drop\"".into(), "run `a`: `trajectory` is missing"),
        (with(entry), "run `a`: another run has the same id"),
        (run("driven", "d.csv"), "a driven run needs its `servo` table"),
        (driven("still.csv"), "nothing ever moves the mechanism in this driven run"),
        (driven("srv.csv"), "no actuator of that name (did you mean `servo`?)"),
        (driven("late.csv"), "the motion starts at 7 s, after the last image at 0.2 s"),
        (driven("s.csv") + "release_s=1", "`release_s` belongs to runs of kind \"drop\""),
        (drop.clone() + "init_s=1", "`init_s` belongs to runs of kind \"free\""),
        (run("free", "d.csv") + "init_s=3", "no longer than `init_s` = 3 s"),
        (run("drop", "p9.csv"), "shows `P9`, but the model has no site of that name (did you mean `P1`?)"),
        (run("drop", "logo.csv"), "shows `logo`"),
        (run("drop", "one.csv"), "1 of 2 images show a keypoint, 3 are the least"),
        (run("drop", "gap.csv"), "keypoint `P2` is never seen"),
        (run("drop", "none.csv"), "none.csv"),
        (
            "[[run]]\nfolder=\"../runs/20261120T101503Z-ab12cd\"\nkind=\"drop\"".into(),
            "the run folder already says `kind`",
        ),
        ("[[run]]\nfolder=\"../runs/none\"".into(), "reading the start of run"),
        ("[[run]]\nfolder=\"../runs/c\"".into(), "not the start of a run: invalid type"),
    ];
    for (text, wanted) in cases {
        let message = folder.refusal(&text);
        assert!(message.contains(wanted), "{text}\n-> {message}\nwanted: {wanted}");
    }
}

#[test]
fn lack_of_data_is_told_from_wrong_input() {
    let folder = Folder::new();
    folder.put("gap.csv", "time_s,P1_x_m\n0,\n1,\n2,\n");
    let run = "model=\"../m.xml\"\n[[run]]\nid=\"a\"\nkind=\"drop\"\ntrajectory=\"../gap.csv\"\n";
    assert!(folder.read(run).unwrap_err().is_lack_of_data());
    assert!(!folder.read("model=\"../m.xml\"\n").unwrap_err().is_lack_of_data());
    assert!(!Experiment::read(Path::new("none.toml")).unwrap_err().is_lack_of_data());
}

const CAUSE: &str = r#"model = "../m.xml"
[[run]]
id = "d"
kind = "drop"
trajectory = "../d.csv"
[[cause]]
name = "detent"
joint = "j2"
torque = "-size * tanh(v / width)"
[cause.parameters]
size = { unit = "N m", bounds = [0.0, 1e-2], typical = 1e-5 }
width = { unit = "rad/s", bounds = [1e-3, 1.0], typical = 0.05, hidden = [0.02, 0.2] }
"#;

#[test]
fn a_cause_written_down_is_known_to_the_model_and_fitted_by_name() {
    let folder = Folder::new();
    let plain = folder.read(CAUSE).unwrap();
    let known: Vec<&str> = plain.model.own_causes().iter().map(|cause| cause.name()).collect();
    assert_eq!(known, ["detent"]);
    assert!(plain.model.causes().is_empty(), "nobody asked for it yet");
    let named =
        folder.read(&format!("{CAUSE}[fit]\nparameters = [\"detent/size\", \"detent/width\"]\n")).unwrap();
    assert_eq!(named.model.parameter("detent/width").unwrap(), 0.02);
    let selected = crate::parameters::Parameters::select(&named.model, &named.fit).unwrap();
    assert_eq!(
        selected.free.iter().flat_map(|free| &free.names).collect::<Vec<_>>(),
        ["detent/size", "detent/width"]
    );
    // what a rig config hands on reads back the same
    let table =
        |text: &str| toml::from_str::<std::collections::BTreeMap<String, Vec<CauseConfig>>>(text).unwrap();
    let causes =
        table(CAUSE.split_once("[[cause]]").map(|(_, text)| format!("[[cause]]{text}")).unwrap().as_str());
    assert_eq!(table(&toml::to_string(&causes).unwrap()), causes);
}

#[test]
fn a_cause_that_is_wrong_is_shown_where_it_stands() {
    let folder = Folder::new();
    let width = ", hidden = [0.02, 0.2] }";
    let cases = [
        ("-size * tanh(v / width)", "-size * tanh(v / widht)", "`widht` (did you mean `width`?)", 9, "^^^^^"),
        ("-size * tanh(v / width)", "-size * tanh(v / width", "this `(` is never closed", 9, "            ^"),
        (
            "-size * tanh(v / width)",
            "-size * v / abs(v) * width",
            "is no finite number at v = 0.000",
            9,
            "^^^",
        ),
        (
            "-size * tanh(v / width)",
            "-size * command * width",
            "no actuator drives the joint `j2`",
            9,
            "^^^^^^^",
        ),
        ("joint = \"j2\"", "joint = \"j3\"", "no hinge or slide `j3`", 8, "^^"),
        ("joint = \"j2\"", "", "it acts nowhere", 7, "^^^^^^"),
        ("joint = \"j2\"", "joint = \"j2\"\nbody = \"l2\"", "it acts in one place", 7, "^^^^^^"),
        ("joint = \"j2\"", "body = \"l2\"", "`torque` does not go with body `l2`", 9, "^^^^^^"),
        ("joint = \"j2\"", "joint = \"j2\"\npoint = [0, 0, 0]", "`point` belongs to a `body`", 9, "^^^^^"),
        (width, ", hidden = [] }", "`hidden` needs one start value", 12, "^^^^^"),
        (width, ", hidden = [7.0] }", "its start 7 under `hidden` lies outside", 12, "^^^^^"),
        (width, "}", "must lie within the bounds 0.001 and 1 of a size", 12, "^^^^^"),
        ("\"detent\"", "\"slosh\"", "a known cause is called that", 7, "^^^^^"),
        ("typical = 1e-5", "typical = 0", "must be finite and above 0", 11, "^"),
    ];
    for (old, new, reason, line, carets) in cases {
        let message = folder.refusal(&CAUSE.replace(old, new));
        let shown = format!("line {line}");
        assert!(
            message.contains(reason) && message.contains(&shown) && message.contains(carets),
            "{new}: {message}"
        );
    }
}

#[test]
fn a_base_belongs_to_its_run_and_must_go_with_it() {
    let folder = Folder::new();
    let rows = "0,0.1,0.2,0.3\n0.05,0.1,0.2,0.3\n0.1,0.2,0.2,0.3\n0.3,0.3,0.2,0.3\n";
    folder.put("b.csv", &format!("time_s,x_m,z_m,angle_rad\n{rows}"));
    folder.put("short.csv", "time_s,x_m,z_m,angle_rad\n0,0,0,0\n0.01,1,0,0\n");
    folder.put("still.csv", "time_s,x_m,z_m,angle_rad\n0,0,0,0\n1,0,0,0\n");
    let free = MODEL.replace("<joint name=\"j1\" axis=\"0 -1 0\"/>", "<freejoint name=\"j1\"/>");
    let (head, tail) = free.split_once("<actuator>").unwrap();
    folder.put("free.xml", &format!("{head}{}", tail.split_once("</actuator>").unwrap().1));
    let towed = "model = \"../m.xml\"\n[[run]]\nid = \"towed\"\nkind = \"driven\"\ntrajectory = \"../d.csv\"\nbase = \"../b.csv\"\n";
    let experiment = folder.read(towed).unwrap();
    let [run] = &experiment.runs[..] else { panic!() };
    assert_eq!(run.base.as_ref().unwrap().poses()[2], [0.2, 0.2, 0.3]);
    assert_eq!(run.first_motion_s(), Some(0.05), "the base's motion is the run's where no servo moves");
    for (old, new, reason) in [
        ("b.csv", "short.csv", "`base` says where the base was from 0 to 0.01 s, and the images are from 0"),
        ("b.csv", "none.csv", "reading table"),
        ("b.csv", "still.csv", "nothing ever moves the mechanism in this driven run"),
        ("m.xml", "free.xml", "`base` moves what hangs from the world, and `l1` floats freely"),
        ("\"driven\"", "\"drop\"", "a release cannot be seen in the images; state `release_s`"),
    ] {
        let message = folder.refusal(&towed.replace(old, new));
        assert!(message.contains(reason), "{new}: {message}");
    }
}
