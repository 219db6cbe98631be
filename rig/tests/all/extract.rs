//! `rig extract` on a folder of rendered pictures, from config to files.

use std::path::Path;

use camera::calibration::Plane;
use rig::cli::Failure;
use rig::cli::extract::{Args, run};
use tank::render::{Look, Renderer};

const CONFIG: &str = "
[camera]
device = \"/dev/video0\"
fps = 20.0
[mechanism]
mount = \"hanging\"
[calibration]
metres_per_pixel = 0.001
origin_px = [50.0, 20.0]
[vision]
links = 2
mode = \"arc\"
base_px = [50.0, 20.0]
";

/// Two pictures of a bar 80 px long that hangs from (50, 20), and one of an empty tank between them.
fn pictures(folder: &Path) {
    let renderer = Renderer::new(Plane::square(0.001, [50.0, 20.0]), Look::plain(100, 130));
    let bar = vec![[45.0, 20.0], [55.0, 20.0], [55.0, 100.0], [45.0, 100.0]];
    for (name, shape) in [("a.png", vec![bar.clone()]), ("b.png", vec![]), ("c.png", vec![bar])] {
        renderer.draw_polygons(&shape).save(folder.join(name)).unwrap();
    }
}

fn args(folder: &Path, config: &str, centreline: &str) -> Args {
    std::fs::write(folder.join("rig.toml"), config).unwrap();
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    pictures(&frames);
    Args {
        frames,
        config: folder.join("rig.toml"),
        model: None,
        out: folder.join("t.csv"),
        centreline: Some(folder.join(centreline)),
        overlays: Some(folder.join("overlays")),
        self_check: false,
        contact_sheet: Some(folder.join("sheet.png")),
        from_s: None,
        to_s: None,
        slow_motion: None,
        threads: None,
    }
}

#[test]
fn folder_becomes_trajectory_frames_centreline_and_overlays() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = run(&args(folder.path(), CONFIG, "c.csv")).unwrap();
    assert!(outcome.text.contains("3 images, 2 ok, 0 doubtful, 1 rejected"), "{}", outcome.text);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let trajectory = ident::table::read_trajectory(&folder.path().join("t.csv")).unwrap();
    assert_eq!(trajectory.time_s, [0.0, 0.05, 0.1]);
    assert_eq!(trajectory.keypoints, ["P0", "P1", "P2"]);
    let [x, _, z] = trajectory.at(2, 2);
    assert!(x.abs() < 1e-4 && (z + 0.080).abs() < 3e-4, "{x} {z}");
    assert!(trajectory.at(1, 2)[0].is_nan());
    let frames = read("t.csv.frames.csv");
    let lines: Vec<&str> = frames.lines().collect();
    assert_eq!(lines[0], "file,time_s,status,reason");
    assert!(
        lines[1].starts_with("a.png,0.0,ok,") && lines[2].starts_with("b.png,0.05,rejected,"),
        "{frames}"
    );
    let centreline = read("c.csv");
    assert!(centreline.starts_with("time_s,c0_x_m,c0_z_m,c1_x_m,"));
    let cells: Vec<&str> = centreline.lines().nth(2).unwrap().split(',').collect();
    assert!(cells[1..].iter().all(|cell| cell.is_empty()) && cells.len() == 203);
    assert!(folder.path().join("overlays/c.png").is_file());
    assert!(outcome.text.contains("sheet.png: refused"), "{}", outcome.text);
    let sheet = image::open(folder.path().join("sheet.png")).unwrap();
    assert_eq!(sheet.width(), 1380);
}

#[test]
fn overlays_with_a_films_ending_are_a_film_with_every_image_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut args = args(folder.path(), CONFIG, "c.csv");
    let path = folder.path().join("look.mkv");
    args.overlays = Some(path.clone());
    match run(&args) {
        Err(Failure::Input(error)) if error.to_string().starts_with("writing the film") => {
            return eprintln!("skipped: {error}");
        }
        outcome => drop(outcome.unwrap()),
    }
    let film = images::open(&path, None).unwrap();
    let images: Vec<_> = film.images().unwrap().map(Result::unwrap).collect();
    let times_s: Vec<f64> = images.iter().map(|image| (image.time_s * 1e3).round() / 1e3).collect();
    assert_eq!(times_s, [0.0, 0.05, 0.1]);
    // The bar of 10 px by 80 px is there in the first and the last one.
    let dark = |image: &images::TimedImage| {
        let grey = image.grey.as_ref().unwrap();
        let picture = image::imageops::crop_imm(grey, 0, 0, grey.width(), grey.width() * 130 / 100);
        picture.to_image().pixels().filter(|pixel| pixel.0[0] < 120).count()
    };
    assert!(dark(&images[0]) > 30_000 && dark(&images[1]) < 1000 && dark(&images[2]) > 30_000);

    args.overlays = Some(folder.path().join("look.avi"));
    let Err(Failure::Input(error)) = run(&args) else { panic!() };
    assert!(error.to_string().contains(".mp4, .webm or .mkv"), "{error}");
}

#[test]
fn centreline_ending_in_wcon_is_a_wcon_document_in_millimetres() {
    let folder = tempfile::tempdir().unwrap();
    run(&args(folder.path(), CONFIG, "c.wcon")).unwrap();
    let text = std::fs::read_to_string(folder.path().join("c.wcon")).unwrap();
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(document["units"], serde_json::json!({ "t": "s", "x": "mm", "y": "mm" }));
    let data = &document["data"][0];
    assert_eq!(data["t"].as_array().unwrap().len(), 3);
    assert!((data["y"][0][100].as_f64().unwrap() + 80.0).abs() < 0.3);
    assert!(data["x"][1][0].is_null());
    assert_eq!(document["@rig"]["images"][1]["status"], "rejected");
}

#[test]
fn a_film_of_too_few_images_is_not_checked_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let mut args = args(folder.path(), CONFIG, "c.csv");
    args.self_check = true;
    let Err(Failure::Input(error)) = run(&args) else { panic!() };
    let text = ground::error_chain::with_causes(error.as_ref());
    assert!(text.contains("only 2 images were found without a doubt, at least 8 are needed"), "{text}");
}

#[test]
fn p0_far_from_what_is_seen_and_two_things_alike_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |config: &str| {
        let Err(failure) = run(&args(folder.path(), config, "c.csv")) else { panic!("{config}") };
        ground::error_chain::with_causes(failure.error().as_ref())
    };
    let elsewhere = refused(&CONFIG.replace("base_px = [50.0, 20.0]", "base_px = [90.0, 60.0]"));
    assert!(
        elsewhere.contains("P0 is expected at (90, 60) px") && elsewhere.contains("begins at (50, "),
        "{elsewhere}"
    );
    let wide = CONFIG.replace("base_px = [50.0, 20.0]", "base_px = [90.0, 60.0]\nbase_std_px = 15.0");
    assert!(run(&args(folder.path(), &wide, "c.csv")).is_ok());

    let mut args = args(folder.path(), &CONFIG.replace("base_px = [50.0, 20.0]", ""), "c.csv");
    let renderer = Renderer::new(Plane::square(0.001, [50.0, 20.0]), Look::plain(100, 130));
    let bar = |x: f64| vec![[x - 5.0, 20.0], [x + 5.0, 20.0], [x + 5.0, 100.0], [x - 5.0, 100.0]];
    for name in ["a.png", "b.png", "c.png"] {
        renderer.draw_polygons(&[bar(30.0), bar(70.0)]).save(args.frames.join(name)).unwrap();
    }
    let Err(failure) = run(&args) else { panic!() };
    let alike = ground::error_chain::with_causes(failure.error().as_ref());
    assert!(
        alike.contains("two things of much the same size") && alike.contains("give `base_px`"),
        "{alike}"
    );
    std::fs::write(&args.config, CONFIG.replace("[50.0, 20.0]", "[70.0, 20.0]")).unwrap();
    args.contact_sheet = None;
    assert!(run(&args).unwrap().text.contains("3 images, 3 ok"));
}

#[test]
fn numbers_that_leave_images_out_and_images_twice_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let args = args(folder.path(), CONFIG, "c.csv");
    for (name, number) in [("a", 8), ("b", 9), ("c", 11)] {
        let named = |name: String| args.frames.join(name);
        std::fs::rename(named(format!("{name}.png")), named(format!("img{number}.png"))).unwrap();
    }
    std::fs::copy(args.frames.join("img11.png"), args.frames.join("img12.png")).unwrap();
    let outcome = run(&args).unwrap();
    let trajectory = ident::table::read_trajectory(&folder.path().join("t.csv")).unwrap();
    let times_s: Vec<f64> = trajectory.time_s.iter().map(|time_s| (time_s * 1e3).round() / 1e3).collect();
    assert_eq!(times_s, [0.0, 0.05, 0.15, 0.2]);
    let [gap, twice] = &outcome.warnings[..] else { panic!("{:?}", outcome.warnings) };
    assert!(gap.contains("1 of 5 are not there, the first of them 10"), "{gap}");
    assert!(twice.contains("1 of 4 images are the one before again"), "{twice}");
    assert_eq!((outcome.exit_code(false), outcome.exit_code(true)), (0, Failure::DATA_EXIT_CODE));
}

#[test]
fn misspelt_key_and_missing_folder_are_the_inputs_fault() {
    let folder = tempfile::tempdir().unwrap();
    let misspelt = CONFIG.replace("base_px", "base_pix");
    let Err(Failure::Input(error)) = run(&args(folder.path(), &misspelt, "c.csv")) else { panic!() };
    assert!(error.to_string().contains("did you mean `base_px`?"), "{error}");
    let mut args = args(folder.path(), CONFIG, "c.csv");
    args.frames = folder.path().join("nowhere");
    assert!(matches!(run(&args), Err(Failure::Input(_))));
}
