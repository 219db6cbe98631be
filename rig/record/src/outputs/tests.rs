use std::os::unix::fs::symlink;

use super::*;

/// A folder with what commands read: a film, a folder of pictures, a recorded run.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        for folder in ["pictures", "original", "made", &format!("runs/{RUN}"), "again"] {
            std::fs::create_dir_all(bench.at(folder)).unwrap();
        }
        for file in ["film.mkv", "rig.toml", "pictures/0.png", "original/1.png", "again/start.json"] {
            std::fs::write(bench.at(file), file).unwrap();
        }
        for file in [file::START, file::JOURNAL] {
            std::fs::write(bench.at(&format!("runs/{RUN}/{file}")), "").unwrap();
        }
        symlink(bench.at("original/1.png"), bench.at("pictures/1.png")).unwrap();
        symlink("film.mkv", bench.at("soft.csv")).unwrap();
        symlink("pictures", bench.at("look")).unwrap();
        std::fs::hard_link(bench.at("film.mkv"), bench.at("hard.csv")).unwrap();
        bench
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The outputs of a command that reads film, pictures and config.
    fn outputs(&self) -> Outputs {
        Outputs::reading(["film.mkv", "pictures", "rig.toml"].map(|name| self.at(name)))
    }

    fn run(&self) -> String {
        format!("runs/{RUN}")
    }
}

const RUN: &str = "20261120T101503Z-ab12cd";

#[test]
fn an_output_that_is_an_input_is_refused_however_it_is_called() {
    let bench = Bench::new();
    for name in [
        "film.mkv",
        "./film.mkv",
        "made/../film.mkv",
        "new/../film.mkv",
        "soft.csv",
        "hard.csv",
        "look/../rig.toml",
    ] {
        let refused = bench.outputs().file(&bench.at(name)).unwrap_err();
        assert!(matches!(refused, OutputError::Input { .. }), "{name}: {refused}");
        let (out, said) = (bench.at(name).display().to_string(), refused.to_string());
        assert!(said.contains(&out) && said.contains("is the input"), "{said}");
    }
    for name in ["pictures/t.csv", "look/new/t.csv"] {
        let refused = bench.outputs().file(&bench.at(name)).unwrap_err();
        assert!(matches!(refused, OutputError::InInput { .. }), "{name}: {refused}");
    }
    for folder in ["look", "pictures", "pictures/overlays"] {
        assert!(bench.outputs().folder(&bench.at(folder), &["*"]).is_err(), "{folder}");
    }
    for name in ["t.csv", "film.mkv.csv", "made/t.csv", "new/folder/t.csv", "original/t.csv"] {
        bench.outputs().file(&bench.at(name)).unwrap();
    }
}

#[test]
fn a_folder_that_holds_an_input_is_refused_if_it_gets_files_of_that_name() {
    let bench = Bench::new();
    let held = |path: &str, names: &[&str]| {
        let refused = bench.outputs().folder(&bench.at(path), names);
        matches!(refused, Err(OutputError::HoldsInput { .. }))
    };
    assert!(held("", &["*"]) && held("", &["fit.json", "rig.toml"]) && held("", &["*.toml"]));
    assert!(held("original", &["*.png"]), "a picture of `pictures` lies there");
    assert!(!held("", &["fit.json", "report.html"]) && !held("made", &["*"]) && !held("new", &["*"]));
    let mut outputs = Outputs::reading([bench.at(&bench.run())]);
    let refused = outputs.folder(&bench.at("runs"), &["fit.json"]).unwrap_err();
    assert!(matches!(refused, OutputError::HoldsInput { .. }), "{refused}");
}

#[test]
fn what_lies_in_a_run_folder_is_refused_and_a_replay_may_be_replayed() {
    let bench = Bench::new();
    let in_run = |path: &str| bench.at(&bench.run()).join(path);
    for path in [in_run("start.json"), in_run("t.csv"), in_run("new/t.csv"), bench.at("again/t.csv")] {
        for refused in [Outputs::default().file(&path).err(), Outputs::edited(&path).err()] {
            assert!(matches!(refused, Some(OutputError::InRun { .. })), "{refused:?}");
        }
        let refused = Outputs::default().folder(path.parent().unwrap(), &["fit.json"]);
        assert!(matches!(refused, Err(OutputError::InRun { .. })), "{refused:?}");
    }
    let results = |path: &Path| Outputs::reading([bench.at(&bench.run())]).results(path, &["fit.json"]);
    for path in [bench.at("again"), bench.at("new"), bench.at("redone").join(RUN)] {
        results(&path).unwrap();
    }
    for path in [in_run(""), in_run("again"), bench.at("runs"), bench.at("again/again")] {
        assert!(results(&path).is_err(), "{path:?}");
    }
}

#[test]
fn two_outputs_that_are_one_file_are_refused() {
    let bench = Bench::new();
    let mut outputs = bench.outputs();
    outputs.file(&bench.at("t.csv")).unwrap();
    let refused = outputs.file(&bench.at("made/../t.csv")).unwrap_err();
    assert!(matches!(refused, OutputError::Twice { .. }), "{refused}");
    assert!(matches!(outputs.folder(&bench.at(""), &["t.csv"]), Err(OutputError::Twice { .. })));
    outputs.folder(&bench.at("made"), &["fit.json", "next"]).unwrap();
    for name in ["made/fit.json", "made/next/1.toml"] {
        assert!(matches!(outputs.file(&bench.at(name)), Err(OutputError::Twice { .. })), "{name}");
    }
    outputs.file(&bench.at("made/t.csv")).unwrap();
}

#[test]
fn what_no_file_can_take_the_place_of_is_refused() {
    let bench = Bench::new();
    for (path, found) in [
        (bench.at("made"), "a folder"),
        (PathBuf::from("/dev/null"), "a device or a pipe"),
        (bench.at("film.mkv/t.csv"), "below a file"),
        (PathBuf::new(), "no name"),
    ] {
        let refused = Outputs::default().file(&path).unwrap_err().to_string();
        assert!(refused.contains(found) && refused.contains("give the name of a file"), "{refused}");
    }
    assert!(matches!(
        Outputs::default().folder(&bench.at("film.mkv"), &["*"]),
        Err(OutputError::Kind { .. })
    ));
}

#[test]
fn a_handle_writes_through_a_link_and_makes_folders_that_are_not_there() {
    let bench = Bench::new();
    Outputs::default().file(&bench.at("soft.csv")).unwrap().write(b"new").unwrap();
    assert!(bench.at("soft.csv").is_symlink());
    assert_eq!(std::fs::read(bench.at("film.mkv")).unwrap(), b"new");
    assert_eq!(std::fs::read(bench.at("hard.csv")).unwrap(), b"film.mkv", "another name keeps what it had");

    let folder = Outputs::default().folder(&bench.at("new/fitted"), &["fit.json"]).unwrap();
    assert!(!bench.at("new").exists());
    folder.write("fit.json", b"{}").unwrap();
    assert_eq!(std::fs::read(bench.at("new/fitted/fit.json")).unwrap(), b"{}");
}

#[test]
#[should_panic(expected = "model.xml was not asked for")]
fn a_file_that_was_not_asked_for_is_our_fault() {
    let bench = Bench::new();
    Outputs::default().folder(&bench.at("made"), &["fit.json"]).unwrap().file("model.xml");
}
