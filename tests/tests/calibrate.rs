//! `rig calibrate camera` on pictures of a ray-traced tank.

use std::path::Path;

use calibrate::world::Upright;
use calibrate::{Board, CalibrateError, Calibrated, Corner, Picture, Setup, calibrate, detect};
use camera::calibration::{Calibration, CalibrationError, View};
use image::GrayImage;
use nalgebra::{Rotation2, Vector2};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use system_tests::planes::{covered, errors, from_origin, most, rms, shape_errors};
use system_tests::wall::{Place, PlacedBoard, Sheet, Trouble, WallCamera, picture, spread};
use system_tests::{printed, run_rig};

const CORNERS: [usize; 2] = [9, 6];
const SQUARE_M: f64 = 0.02;

fn board() -> Board {
    format!("chessboard:{}x{}:{SQUARE_M}", CORNERS[0], CORNERS[1]).parse().expect("a board")
}

fn setup() -> Setup {
    Setup {
        board: board(),
        view: View::Xz,
        origin_px: [640.0, 80.0],
        upright: Upright::Rows,
        offset: None,
        most_rms_m: 3e-4,
    }
}

/// What is found in pictures of boards at these places.
fn pictures(camera: &WallCamera, boards: &[PlacedBoard], trouble: &Trouble) -> Vec<Picture> {
    let look = |(i, placed): (usize, &PlacedBoard)| {
        let picture = picture(camera, Some(placed), trouble, i as u64);
        let corners = detect(&picture, &board()).map_err(|error| error.to_string());
        Picture { name: format!("{i}.png"), size_px: Some(camera.size_px), corners }
    };
    boards.iter().enumerate().map(look).collect()
}

/// Errors of the corners found in a picture, and how many of the board's are not \[px\].
fn detection(camera: &WallCamera, placed: &PlacedBoard, found: &Picture) -> (Vec<f64>, usize) {
    let truth: Vec<Place> = placed.corners().into_iter().map(|corner| camera.seen(corner)).collect();
    let corners = found.corners.as_ref().unwrap_or_else(|why| panic!("{}: {why}", found.name));
    let errors: Vec<f64> = corners
        .iter()
        .map(|corner| {
            let off = |true_px: &Place| (corner.px[0] - true_px[0]).hypot(corner.px[1] - true_px[1]);
            truth.iter().map(off).fold(f64::INFINITY, f64::min)
        })
        .collect();
    (errors, truth.len() - corners.len())
}

fn calibrated(pictures: &[Picture], setup: &Setup) -> Calibrated {
    calibrate(pictures, setup).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn camera_square_to_the_wall_is_calibrated_to_a_twentieth_of_a_millimetre() {
    let camera = WallCamera::square();
    let boards = spread(&camera, CORNERS, SQUARE_M);
    let found = pictures(&camera, &boards, &Trouble::usual());
    let mut all = Vec::new();
    for (placed, found) in boards.iter().zip(&found) {
        let (errors, missing) = detection(&camera, placed, found);
        eprintln!(
            "{}: rms {:.3} px, worst {:.3} px, {missing} missing",
            found.name,
            rms(&errors),
            most(&errors)
        );
        assert_eq!(missing, 0, "{}", found.name);
        all.extend(errors);
    }
    eprintln!("corners: rms {:.3} px, worst {:.3} px", rms(&all), most(&all));
    assert!(rms(&all) < 0.1);
    let setup = setup();
    let calibrated = calibrated(&found, &setup);
    let errors = errors(&calibrated.plane, from_origin(&camera, setup.origin_px), &covered(&found));
    eprintln!("plane: rms {:.4} mm, worst {:.4} mm", rms(&errors) * 1e3, most(&errors) * 1e3);
    eprintln!("{}", calibrate::report::text(&calibrated));
    assert!(most(&errors) < 5e-5, "{}", most(&errors));
}

/// What a detector that errs by `noise_px` would find.
fn corners_with_noise(camera: &WallCamera, boards: &[PlacedBoard], noise_px: f64) -> Vec<Picture> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let normal = Normal::new(0.0, noise_px).expect("a standard deviation");
    let mut look = |(i, placed): (usize, &PlacedBoard)| {
        let mut corner = |(k, at): (usize, Place)| {
            let px = camera.seen_behind(at, placed.behind_m).map(|x| x + normal.sample(&mut random));
            Corner { px, place: [(k % CORNERS[0]) as i32, (k / CORNERS[0]) as i32] }
        };
        let corners = placed.corners().into_iter().enumerate().map(&mut corner).collect();
        Picture { name: format!("{i}.png"), size_px: Some(camera.size_px), corners: Ok(corners) }
    };
    boards.iter().enumerate().map(&mut look).collect()
}

/// What the detector leaves of a corner, as the pictures above show \[px\].
const DETECTOR_PX: f64 = 0.04;

#[test]
fn other_walls_and_cameras_at_an_angle_are_calibrated_to_a_tenth_of_a_millimetre() {
    let square = WallCamera::square();
    let layouts = [
        ("near, wide lens", 5e-5, WallCamera { air_m: 0.2, water_m: 0.15, focal_px: 1600.0, ..square }),
        ("far", 5e-5, WallCamera { air_m: 1.0, water_m: 0.4, focal_px: 3000.0, ..square }),
        ("a lens of its own", 1e-4, WallCamera { lens: -0.12, ..square }),
    ];
    for (name, limit_m, camera) in layouts {
        let square_m = SQUARE_M * (camera.air_m + 0.75 * camera.water_m) / camera.focal_px * 1500.0 / 0.725;
        let spec = Setup { board: format!("chessboard:9x6:{square_m}").parse().expect("a board"), ..setup() };
        let found = corners_with_noise(&camera, &spread(&camera, CORNERS, square_m), DETECTOR_PX);
        let calibrated = calibrated(&found, &spec);
        let errors = errors(&calibrated.plane, from_origin(&camera, spec.origin_px), &covered(&found));
        eprintln!("{name}: rms {:.4} mm, worst {:.4} mm", rms(&errors) * 1e3, most(&errors) * 1e3);
        assert!(most(&errors) < limit_m, "{name}: {}", most(&errors));
    }
    for degrees in [0.0, 2.0, 5.0, 10.0, 15.0] {
        for tilt in [[1.0, 0.0], [0.0, 1.0]] {
            let tilt_rad = tilt.map(|share| share * f64::to_radians(degrees));
            let camera = WallCamera { tilt_rad, ..square };
            let found = corners_with_noise(&camera, &spread(&camera, CORNERS, SQUARE_M), DETECTOR_PX);
            let calibrated = calibrated(&found, &setup());
            let errors = shape_errors(&calibrated.plane, |px| camera.traced(px, 0.0), &covered(&found));
            eprintln!(
                "{degrees}° {tilt:?}: rms {:.3} mm, worst {:.3} mm; told: corners {:.3} mm rms, tilt {:.1}°",
                rms(&errors) * 1e3,
                most(&errors) * 1e3,
                calibrated.quality.rms_m * 1e3,
                calibrated.quality.tilt_rad.to_degrees()
            );
            assert!(most(&errors) < 1e-4, "{}", most(&errors));
            assert!((calibrated.quality.tilt_rad.to_degrees() - degrees).abs() < 1.0);
        }
    }
}

#[test]
fn plumb_line_and_water_level_turn_the_world_of_a_camera_that_rolls() {
    let camera = WallCamera::square();
    let found = corners_with_noise(&camera, &spread(&camera, CORNERS, SQUARE_M), DETECTOR_PX);
    // As if the camera had rolled by 10 degrees: up is elsewhere in the picture.
    let (origin, up) = ([0.01, 0.02], Rotation2::new(0.17) * Vector2::y());
    let seen = |off: Vector2<f64>| camera.seen([origin[0] + off.x, origin[1] + off.y]);
    let right = Vector2::new(up.y, -up.x);
    for upright in [
        Upright::Plumb([seen(-0.1 * up), seen(0.08 * up)]),
        Upright::Level([seen(0.05 * up - 0.2 * right), seen(0.05 * up + 0.2 * right)]),
    ] {
        let setup = Setup { upright, origin_px: seen(Vector2::zeros()), ..setup() };
        let plane = calibrated(&found, &setup).plane;
        let truth = |px: Place| {
            let off = Vector2::from(camera.traced(px, 0.0)) - Vector2::from(origin);
            [off.dot(&right), off.dot(&up)]
        };
        let errors = errors(&plane, truth, &covered(&found));
        eprintln!("rms {:.4} mm, worst {:.4} mm", rms(&errors) * 1e3, most(&errors) * 1e3);
        assert!(most(&errors) < 1e-4, "{}", most(&errors));
    }
}

#[test]
fn board_behind_the_mechanisms_plane_is_put_right_by_snells_law() {
    for degrees in [0.0, 3.0] {
        let camera = WallCamera { tilt_rad: [f64::to_radians(degrees), 0.0], ..WallCamera::square() };
        for behind_m in [0.02, -0.015] {
            let mut boards = spread(&camera, CORNERS, SQUARE_M);
            boards.iter_mut().for_each(|board| board.behind_m = behind_m);
            let found = corners_with_noise(&camera, &boards, DETECTOR_PX);
            let water_m = camera.water_m + behind_m;
            let port = format!("{}:{}:{water_m}", camera.air_m, camera.glass_m).parse().expect("a port");
            let truth = |px: Place| camera.traced(px, 0.0);
            let errors = |offset| {
                let plane = calibrated(&found, &Setup { offset, ..setup() }).plane;
                most(&shape_errors(&plane, truth, &covered(&found)))
            };
            let (without, with) = (errors(None), errors(Some((-behind_m, port))));
            eprintln!(
                "{degrees}° {behind_m} m: worst {:.2} mm, put right {:.3} mm",
                without * 1e3,
                with * 1e3
            );
            assert!(without > 1e-3 && with < 1e-4, "{without} {with}");
        }
    }
}

#[test]
fn picture_with_the_board_out_of_the_plane_is_named() {
    let camera = WallCamera::square();
    let mut boards = spread(&camera, CORNERS, SQUARE_M);
    boards[4].behind_m = 0.03;
    let found = corners_with_noise(&camera, &boards, DETECTOR_PX);
    let refused = calibrate(&found, &setup()).expect_err("a board that is out of the plane");
    assert!(matches!(&refused, CalibrateError::Error { picture, .. } if picture == "4.png"), "{refused}");
}

#[test]
fn single_misread_corners_are_set_aside() {
    let camera = WallCamera::square();
    let mut found = corners_with_noise(&camera, &spread(&camera, CORNERS, SQUARE_M), DETECTOR_PX);
    for (picture, corner) in [(1, 7), (5, 30)] {
        found[picture].corners.as_mut().expect("corners")[corner].px[0] += 2.0;
    }
    let calibrated = calibrated(&found, &setup());
    let misread: Vec<usize> = calibrated.quality.pictures.iter().map(|picture| picture.misread).collect();
    assert_eq!(misread, [0, 1, 0, 0, 0, 1, 0, 0, 0, 0]);
    let errors = errors(&calibrated.plane, from_origin(&camera, setup().origin_px), &covered(&found));
    assert!(most(&errors) < 5e-5, "{}", most(&errors));
}

#[test]
fn corners_are_found_in_hard_pictures() {
    let usual = Trouble::usual();
    let square = WallCamera::square();
    let tilted = WallCamera { tilt_rad: [0.35, 0.2], ..square };
    let small = WallCamera { size_px: [640, 480], focal_px: 600.0, ..square };
    let blurred = WallCamera { size_px: [1920, 1080], focal_px: 2600.0, ..square };
    let cases = [
        ("turned by an eighth", square, 0.02, 0.785, usual, 0, 0.08),
        ("seen at an angle", tilted, 0.02, 0.3, usual, 0, 0.08),
        ("squares of 12 px", small, 0.0145, 0.2, usual, 0, 0.13),
        ("little light", square, 0.02, 0.2, Trouble { white: 70.0, ..usual }, 0, 0.15),
        ("light from one side", square, 0.02, 0.2, Trouble { uneven: 0.8, ..usual }, 0, 0.15),
        ("out of focus", blurred, 0.03, 0.2, Trouble { blur_px: 4.0, ..usual }, 0, 0.15),
        (
            "a finger on it",
            square,
            0.02,
            0.2,
            Trouble { finger: Some(([560.0, 330.0], 30.0)), ..usual },
            6,
            0.1,
        ),
    ];
    for (name, camera, square_m, turn_rad, trouble, most_missing, most_px) in cases {
        let [width, height] = camera.size_px.map(f64::from);
        let middle = camera.traced([0.5 * width, 0.5 * height], 0.0);
        let placed = PlacedBoard { corners: CORNERS, square_m, middle, turn_rad, behind_m: 0.0 };
        let found = &pictures(&camera, &[placed], &trouble)[0];
        let (errors, missing) = detection(&camera, &placed, found);
        eprintln!("{name}: rms {:.3} px, worst {:.3} px, {missing} missing", rms(&errors), most(&errors));
        assert!(missing <= most_missing && rms(&errors) < most_px, "{name}");
    }
}

/// Renders what a user would have in a folder.
fn folder_of_pictures(folder: &Path) {
    let camera = WallCamera::square();
    for (i, board) in spread(&camera, CORNERS, SQUARE_M).iter().take(4).enumerate() {
        let picture = picture(&camera, Some(board), &Trouble::usual(), i as u64);
        picture.save(folder.join(format!("board-{i:02}.png"))).expect("a picture");
    }
}

fn rig_calibrate(images: &Path, out: &Path, more: &[&str]) -> std::process::Output {
    let mut arguments = vec!["calibrate".as_ref(), "camera".as_ref(), images.as_os_str()];
    arguments.extend(["--out".as_ref(), out.as_os_str()]);
    let needed = ["--board", "chessboard:9x6:0.02", "--origin-px", "640,80"];
    run_rig(arguments.into_iter().chain(needed.iter().chain(more).map(|argument| argument.as_ref())))
}

#[test]
fn verb_writes_a_file_that_a_config_can_name_and_refuses_bad_pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    let images = folder.path().join("images");
    std::fs::create_dir(&images).expect("a folder");
    folder_of_pictures(&images);
    // What also lies in such folders: nothing in it, half a file, no board, half a board.
    let camera = WallCamera::square();
    let whole = std::fs::read(images.join("board-00.png")).expect("a picture");
    std::fs::write(images.join("empty.png"), []).expect("a file");
    std::fs::write(images.join("truncated.png"), &whole[..whole.len() / 3]).expect("a file");
    picture(&camera, None, &Trouble::usual(), 9).save(images.join("no-board.png")).expect("a picture");
    let half = PlacedBoard {
        corners: CORNERS,
        square_m: SQUARE_M,
        middle: camera.traced([1280.0, 700.0], 0.0),
        turn_rad: 0.1,
        behind_m: 0.0,
    };
    picture(&camera, Some(&half), &Trouble::usual(), 9).save(images.join("half.png")).expect("a picture");

    let out = folder.path().join("tank.toml");
    let output = rig_calibrate(&images, &out, &["--camera", "left \"one\""]);
    let text = printed(&output);
    eprintln!("{text}");
    assert!(output.status.success(), "{text}");
    for said in ["board-00.png      54", "empty.png: left out", "truncated.png: left out", "no chessboard"] {
        assert!(text.contains(said), "{said}: {text}");
    }
    assert!(
        text.contains("half.png: left out: ") && text.contains("of the board's 54 inner corners"),
        "{text}"
    );
    eprintln!("{}", std::fs::read_to_string(&out).expect("the file"));
    let calibration = Calibration { file: Some("tank.toml".into()), ..Calibration::default() };
    let plane = calibration.plane(folder.path()).expect("a calibration");
    let truth = from_origin(&camera, [640.0, 80.0]);
    let places: Vec<Place> = (0..9).map(|i| [400.0 + 60.0 * f64::from(i), 250.0]).collect();
    assert!(most(&errors(&plane, truth, &places)) < 1e-4);
    assert!(matches!(plane.fits([640, 480]), Err(CalibrationError::Size { .. })));

    assert_eq!(plane.view(), View::Xz);
    let above = rig_calibrate(&images, &out, &["--view", "x-y"]);
    assert!(above.status.success(), "{}", printed(&above));
    let from_above = calibration.plane(folder.path()).expect("a calibration");
    assert_eq!(
        (from_above.view(), from_above.metres([400.0, 250.0])),
        (View::Xy, plane.metres([400.0, 250.0]))
    );

    let as_json = rig_calibrate(&images, &out, &["--json"]);
    let object: serde_json::Value = serde_json::from_slice(&as_json.stdout).expect("one object");
    assert_eq!((object["status"].as_str(), object["out"].as_str()), (Some("done"), out.to_str()));

    // A single picture, of a board that covers too little; no board at all; two sizes.
    let refused = |images: &Path, more: &[&str], code: i32, said: &str| {
        std::fs::remove_file(&out).ok();
        let output = rig_calibrate(images, &out, more);
        let text = printed(&output);
        assert!(output.status.code() == Some(code) && text.contains(said), "{said}: {text}");
        assert!(!out.exists(), "{text}");
    };
    refused(&images.join("board-00.png"), &[], 4, "% of its height; at least 30 %");
    refused(&images.join("no-board.png"), &[], 4, "none of 1 pictures shows the board");
    refused(&images.join("empty.png"), &[], 4, "none of 1 pictures shows the board");
    refused(&images.join("nothing.png"), &[], 2, "is neither a run, a folder of pictures, a picture");
    refused(&images, &["--most-rms-mm", "0.001"], 4, "mm rms");
    refused(&images, &["--up-px", "1,1,1,9"], 2, "at least 50 px make a direction");
    GrayImage::new(640, 480).save(images.join("other.png")).expect("a picture");
    refused(&images, &[], 2, "other.png 640x480 px");
}

#[test]
fn mistakes_of_the_command_line_are_explained() {
    let nowhere = Path::new("nowhere");
    for (more, said) in [
        (&["--port", "0.5:0.01:0.3"][..], "--plane-offset-m"),
        (&["--plane-offset-m", "0.02", "--port", "0.5:0.01"], "AIR_M:GLASS_M:WATER_M"),
        (&["--most-rms-mm", "0"], "a number above 0"),
        (&["--up-px", "1,2,3"], "4 numbers are wanted"),
        (&["--view", "y-z"], "possible values: x-z, x-y"),
        (&["--up-px", "1,2,3,nan"], "4 numbers are wanted"),
        (&["--up-px", "1,2,3,4", "--level-px", "1,2,3,4"], "cannot be used with"),
    ] {
        let output = rig_calibrate(nowhere, Path::new("out.toml"), more);
        assert!(output.status.code() == Some(2) && printed(&output).contains(said), "{}", printed(&output));
    }
}
