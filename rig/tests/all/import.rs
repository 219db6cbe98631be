//! `rig import` and `rig export` of other programs' files, from arguments to files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use camera::calibration::Calibration;
use clap::Parser;
use record::folder::RunFolder;
use record::run_id::RunId;
use record::start_stop::{ClockPair, RunKind, Start};
use rig::cli::{Failure, Outcome, export, import};
use sim::Trajectory;

#[derive(Parser)]
struct Import {
    #[command(flatten)]
    args: import::Args,
}

#[derive(Parser)]
struct Export {
    #[command(flatten)]
    args: export::Args,
}

const CONFIG: &str = "
[camera]
fps = 50.0
[calibration]
metres_per_pixel = 0.001
origin_px = [100.0, 50.0]
[vision]
links = 2
";
/// A camera that is not square to the plane, with a lens.
const TILTED: &str = "metres_from_pixels = [[2e-4, 1e-6, -0.05], [-2e-6, -2.1e-4, 0.06], [1e-5, 2e-5, 1.0]]
radial_centre_px = [320.0, 240.0]
radial_per_px2 = -2e-7
";
const DLC: &str = "scorer,net,net,net,net,net,net
bodyparts,hip,hip,hip,toe,toe,toe
coords,x,y,likelihood,x,y,likelihood
0,100.0,50.0,1.0,110.0,30.0,0.99
1,100.0,50.0,1.0,110.5,30.0,0.21
2,,,,,,
";

/// `rig import` of `text` in `folder` with more arguments.
fn taken(folder: &Path, text: &[u8], config: &str, more: &[&str]) -> Result<Outcome, Failure> {
    std::fs::write(folder.join("rig.toml"), config).unwrap();
    std::fs::write(folder.join("in"), text).unwrap();
    let [file, config, out] = ["in", "rig.toml", "t.csv"].map(|name| folder.join(name).display().to_string());
    let line = ["rig", &file, "--config", &config, "--out", &out];
    import::run(&Import::try_parse_from(line.iter().chain(more)).unwrap().args)
}

fn exported(format: &str, from: &Path, out: &Path, more: &[&str]) -> Result<Outcome, Failure> {
    let [from, out] = [from, out].map(|path| path.display().to_string());
    export::run(
        &Export::try_parse_from(["rig", format, &from, "--out", &out].iter().chain(more)).unwrap().args,
    )
}

fn trajectory(folder: &Path) -> Trajectory {
    ident::table::read_trajectory(&folder.join("t.csv")).unwrap()
}

#[test]
fn deeplabcut_becomes_a_trajectory_with_the_reason_of_each_gap() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let outcome = taken(at, DLC.as_bytes(), CONFIG, &["--keypoints", "P1=hip,P2=toe"]).unwrap();
    assert!(outcome.text.contains("image number / 50 s, by [camera] fps"), "{}", outcome.text);
    assert!(outcome.text.contains("std: none written"), "{}", outcome.text);
    assert!(outcome.text.contains("1 with all of them, 1 with some, 1 with none"), "{}", outcome.text);
    let found = trajectory(at);
    assert_eq!(
        (found.keypoints.as_slice(), found.std_m.is_none()),
        (&["P1".to_owned(), "P2".to_owned()][..], true)
    );
    assert_eq!(found.time_s, [0.0, 0.02, 0.04]);
    let [x, _, z] = found.at(0, 1);
    assert!((x - 0.01).abs() < 1e-12 && (z - 0.02).abs() < 1e-12, "{x} {z}");
    let frames = std::fs::read_to_string(at.join("t.csv.frames.csv")).unwrap();
    let rows: Vec<&str> = frames.lines().collect();
    assert_eq!(rows[..2], ["file,time_s,status,reason", "0,0.0,ok,"]);
    assert_eq!(rows[2], "1,0.02,doubtful,\"P2: toe, likelihood 0.210 is below 0.6\"");
    assert_eq!(rows[3], "2,0.04,rejected,\"P1: hip, not seen; P2: toe, not seen\"");

    let more = ["--keypoints", "hip,toe", "--fps", "10", "--least-likelihood", "0.2", "--std-px", "2"];
    taken(at, DLC.as_bytes(), CONFIG, &more).unwrap();
    let found = trajectory(at);
    assert_eq!((found.time_s[1], found.at(1, 1)[0].is_finite()), (0.1, true));
    assert!((found.std_m.unwrap()[0] - 0.002).abs() < 1e-12);
}

#[test]
fn other_formats_are_told_by_how_they_begin() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let sleap =
        "track,frame_idx,instance.score,hip.x,hip.y,hip.score,toe.x,toe.y,toe.score\n,4,,100,50,,110,30,\n";
    let outcome = taken(at, sleap.as_bytes(), CONFIG, &["--keypoints", "hip,toe"]).unwrap();
    assert!(outcome.text.contains("1 images from SLEAP analysis CSV"), "{}", outcome.text);
    assert_eq!(trajectory(at).time_s, [0.08]);

    let wcon =
        r#"{"units":{"t":"s","x":"mm","y":"mm"},"data":[{"id":1,"t":[3],"x":[[0,10,10]],"y":[[0,0,30]]}]}"#;
    for (more, sign) in [(&[][..], 1.0), (&["--y-down"], -1.0)] {
        let outcome = taken(at, wcon.as_bytes(), CONFIG, more).unwrap();
        assert!(outcome.text.contains("P0..P2 at shares [0.0000, 0.5000, 1.0000]"), "{}", outcome.text);
        let [x, _, z] = trajectory(at).at(0, 1);
        assert!((x - 0.01).abs() < 1e-12 && (z - sign * 0.01).abs() < 1e-12, "{x} {z}");
    }
}

/// Of the distance from the world's origin.
const ROUND_TRIP: f64 = 1e-9;

/// A run that was filmed through the lens of [`TILTED`].
fn run_folder(at: &Path) -> PathBuf {
    let start = Start {
        id: RunId::now(),
        number: 0,
        kind: RunKind::Drop,
        model: "model-start.xml".into(),
        prescribed: false,
        clock: ClockPair::now(),
        version: "0.1.0".into(),
        board: None,
        camera: None,
        config: "[run]\nname = \"a drop\"\n[camera]\nfps = 100.0\n[calibration]\nfile = \"tank.toml\"\n"
            .into(),
        details: BTreeMap::new(),
    };
    let run = RunFolder::create(at, start).unwrap();
    run.write("tank.toml", TILTED.as_bytes()).unwrap();
    run.write("trajectory.csv", b"time_s,P1_x_m,P1_z_m,P1_std_m\n0.5,0.01,-0.02,0.0001\n0.51,,,\n").unwrap();
    run.path().into()
}

#[test]
fn a_run_knows_its_own_camera() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let run = run_folder(at);
    exported("dlc", &run, &at.join("d.csv"), &[]).unwrap();
    let text = std::fs::read_to_string(at.join("d.csv")).unwrap();
    let tank = run.join("tank.toml");
    let plane = Calibration { file: Some(tank), ..Calibration::default() }.plane(at).unwrap();
    let [column, row] = plane.pixel([0.01, -0.02]);
    assert_eq!(text.lines().skip(3).collect::<Vec<_>>(), [format!("0,{column},{row},1"), "1,,,0".into()]);
    let frames = std::fs::read_to_string(at.join("d.csv.frames.csv")).unwrap();
    assert!(frames.ends_with("0,0.5,ok,\n1,0.51,rejected,gap in the trajectory\n"), "{frames}");
    exported("wcon", &run, &at.join("w.wcon"), &[]).unwrap();
    let text = std::fs::read_to_string(at.join("w.wcon")).unwrap();
    assert!(text.contains(&*run.file_name().unwrap().to_string_lossy()), "{text}");
}

#[test]
fn what_goes_out_comes_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("tank.toml"), TILTED).unwrap();
    let config = "[calibration]\nfile = \"tank.toml\"\n";
    std::fs::write(at.join("rig.toml"), config).unwrap();
    let images = 200;
    let mut out =
        Trajectory { keypoints: ["P1", "P2", "P3"].map(str::to_owned).to_vec(), ..Trajectory::default() };
    for image in 0..images {
        let i = f64::from(image);
        // a camera that does not keep time, and begins before the run does
        out.time_s.push(-0.0371 + 0.01 * i + 0.002 * (7.0 * i).sin());
        for keypoint in 0..3 {
            let gap = (image + keypoint) % 37 == 5 || image == 90;
            let angle = 0.03 * i + f64::from(keypoint);
            let [x, z] = [0.06 * angle.sin(), -0.03 + 0.05 * angle.cos()];
            out.position_m.push(if gap { [f64::NAN; 3] } else { [x, f64::NAN, z] });
        }
    }
    ident::table::write_trajectory(&at.join("out.csv"), &out).unwrap();
    let config_path = at.join("rig.toml").display().to_string();
    for (format, name, more) in [("dlc", "d.csv", &["--config", &config_path][..]), ("wcon", "w.wcon", &[])] {
        exported(format, &at.join("out.csv"), &at.join(name), more).unwrap();
        let line = ["rig", format, &at.join(name).display().to_string(), "--config", &config_path, "--out"]
            .map(str::to_owned)
            .into_iter()
            .chain([at.join("t.csv").display().to_string()]);
        import::run(&Import::try_parse_from(line).unwrap().args).unwrap();
        let back = trajectory(at);
        assert_eq!((&back.time_s, &back.keypoints), (&out.time_s, &out.keypoints), "{format}");
        let mut worst: f64 = 0.0;
        for (there, back) in out.position_m.iter().zip(&back.position_m) {
            assert_eq!(there[0].is_nan(), back[0].is_nan(), "{format}");
            if there[0].is_finite() {
                worst = worst.max((there[0] - back[0]).hypot(there[2] - back[2]) / there[0].hypot(there[2]));
            }
        }
        println!("{format}: {images} images, worst {worst:e} of the distance from the origin");
        assert!(worst < ROUND_TRIP, "{format}: {worst:e}");
    }
}

/// A file, a config, more arguments; the exit code and a part of what is said.
type Case<'a> = (&'a [u8], &'a str, Vec<&'a str>, i32, &'a str);

#[test]
fn what_cannot_be_taken_over_is_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let dlc = DLC.as_bytes();
    let keypoints = ["--keypoints", "hip,toe"];
    let with = |more: &[&'static str]| [&keypoints[..], more].concat();
    let no_rate = CONFIG.replace("fps = 50.0", "");
    let no_calibration = "[camera]\nfps = 50.0\n";
    let unsorted = DLC.replace("\n2,", "\n1,");
    let wcon = br#"{"units":{"t":"s","x":"mm","y":"mm"},"data":[{"id":1,"t":[3],"x":[1],"y":[1]}]}"#;
    let cases: [Case; 16] = [
        (dlc, CONFIG, vec![], 2, "--keypoints a,b,c (or P1=a,P2=b): the file has `hip`, `toe`"),
        (dlc, CONFIG, vec!["--keypoints", "hip,tip"], 2, "no body part `tip`; the file has `hip`, `toe`"),
        (dlc, &no_rate, with(&[]), 2, "give --fps, a table --times (file,time_s), or [camera] fps in"),
        (dlc, no_calibration, with(&[]), 2, "[calibration] needs either"),
        (dlc, CONFIG, with(&["--y-down"]), 2, "--y-down is for WCON"),
        (dlc, CONFIG, with(&["--fps", "0"]), 2, "--fps 0 must be finite and above 0"),
        (dlc, CONFIG, with(&["--std-px", "-1"]), 2, "--std-px -1 must be finite and above 0"),
        (
            dlc,
            CONFIG,
            with(&["--least-likelihood", "60"]),
            2,
            "--least-likelihood 60 must be between 0 and 1",
        ),
        (dlc, CONFIG, with(&["--times", "/nowhere.csv"]), 2, "/nowhere.csv"),
        (dlc, CONFIG, with(&["--individual", "left"]), 2, "leave out --individual"),
        (
            unsorted.as_bytes(),
            CONFIG,
            with(&[]),
            2,
            "line 6: image 1 does not come after 1 of the row above; sort",
        ),
        (
            &dlc[..dlc.len() - 3],
            CONFIG,
            with(&[]),
            2,
            "line 6: 5 cells under a header of 7; is the file cut off?",
        ),
        (b"\x89HDF\r\n\x1a\n\xff\xfe", CONFIG, with(&[]), 2, "an HDF5 file"),
        (b"scorer,\xff\n", CONFIG, with(&[]), 2, "letter in Windows-1252 or Latin-1; save it as UTF-8"),
        (wcon, CONFIG, vec!["--fps", "5"], 2, "--fps is of no use: WCON has metres and seconds of its own"),
        (
            wcon,
            CONFIG,
            vec![],
            4,
            "no keypoint in any of 1 images: a line has two points or more, this one 1",
        ),
    ];
    for (text, config, more, code, wanted) in cases {
        let failure = taken(folder.path(), text, config, &more).unwrap_err();
        let said = format!("{:#}", failure.error());
        assert!(said.contains(wanted), "{wanted:?} is not in {said:?}");
        assert_eq!(i32::from(failure.exit_code()), code, "{said}");
        assert!(!folder.path().join("t.csv").exists(), "{said}");
    }
    let unlikely = DLC.replace("1.0,", "0.1,").replace("0.99", "0.1");
    let Err(Failure::Data(error)) = taken(folder.path(), unlikely.as_bytes(), CONFIG, &keypoints) else {
        panic!()
    };
    assert!(error.to_string().contains("P0: hip, likelihood 0.100 is below 0.6"), "{error}");

    let at = folder.path();
    std::fs::write(at.join("o.csv"), "time_s,P1_x_m,P1_z_m\n0,0.1,0.2\n").unwrap();
    for (format, from, wanted) in [
        ("dlc", "o.csv", "is no run folder: say with --config"),
        ("dlc", "nothing.csv", "nothing.csv"),
        ("wcon", ".", "holds no trajectory.csv"),
        ("mjcf", "o.csv", "is not a folder"),
    ] {
        let said = format!("{:#}", exported(format, &at.join(from), &at.join("e"), &[]).unwrap_err().error());
        assert!(said.contains(wanted), "{wanted:?} is not in {said:?}");
    }
}
