//! `rig calibrate camera --board aprilgrid` on pictures of a ray-traced tank.

use std::time::Instant;

use calibrate::world::Upright;
use calibrate::{Board, Calibrated, Picture, Setup, calibrate, detect};
use camera::calibration::View;
use image::GrayImage;
use nalgebra::{Rotation2, Vector2};
use system_tests::planes::{covered, errors, from_origin, most, rms};
use system_tests::tags::PlacedTags;
use system_tests::wall::{Place, Sheet, Trouble, WallCamera, picture, ten_places};
use system_tests::{printed, run_rig};

const TAGS: [usize; 2] = [5, 4];
const TAG_M: f64 = 0.028;
const SPACING: f64 = 0.3;
const ORIGIN_PX: Place = [640.0, 80.0];
/// How far the plane may be off anywhere between the outermost corners \[m\].
const BAR_M: f64 = 5e-5;

fn board() -> Board {
    board_of(TAGS, TAG_M, SPACING)
}

fn board_of([columns, rows]: [usize; 2], tag_m: f64, spacing: f64) -> Board {
    format!("aprilgrid:{columns}x{rows}:{tag_m}:{spacing}").parse().expect("a board")
}

fn setup(board: Board) -> Setup {
    Setup {
        board,
        view: View::Xz,
        origin_px: ORIGIN_PX,
        upright: Upright::Rows,
        offset: None,
        most_rms_m: 3e-4,
    }
}

fn spread(camera: &WallCamera) -> Vec<PlacedTags> {
    let place = |(middle, turn_rad)| PlacedTags { turn_rad, ..PlacedTags::new(TAGS, TAG_M, SPACING, middle) };
    ten_places(camera).into_iter().map(place).collect()
}

/// What is found in a picture of the board.
fn look(camera: &WallCamera, placed: &PlacedTags, trouble: &Trouble, seed: u64) -> Picture {
    found_in(&picture(camera, Some(placed), trouble, seed), &board(), seed)
}

fn found_in(picture: &GrayImage, board: &Board, number: u64) -> Picture {
    let corners = detect(picture, board).map_err(|error| error.to_string());
    Picture { name: format!("{number}.png"), size_px: Some(picture.dimensions().into()), corners }
}

/// Errors of the corners \[px\]: each is where the very same corner of the very same tag is seen, not where some corner is.
fn detection(camera: &WallCamera, placed: &PlacedTags, found: &Picture) -> Vec<f64> {
    let truth = placed.corners();
    let corners = found.corners.as_ref().unwrap_or_else(|why| panic!("{}: {why}", found.name));
    let error = |corner: &calibrate::Corner| {
        let [x, y] = corner.place.map(|at| at as usize);
        let tag = (y / 2) * placed.tags[0] + x / 2;
        let true_px = camera.seen_behind(truth[4 * tag + 2 * (y % 2) + x % 2], placed.behind_m);
        (corner.px[0] - true_px[0]).hypot(corner.px[1] - true_px[1])
    };
    corners.iter().map(error).collect()
}

fn calibrated(pictures: &[Picture], setup: &Setup) -> Calibrated {
    calibrate(pictures, setup).unwrap_or_else(|error| panic!("{error}"))
}

/// The worst error of the plane between the outermost corners \[m\].
fn worst(camera: &WallCamera, found: &[Picture]) -> f64 {
    let plane = calibrated(found, &setup(board())).plane;
    most(&errors(&plane, from_origin(camera, ORIGIN_PX), &covered(found)))
}

#[test]
fn camera_square_to_the_wall_is_calibrated_to_a_twentieth_of_a_millimetre() {
    let camera = WallCamera::square();
    let boards = spread(&camera);
    let mut all = Vec::new();
    let mut found = Vec::new();
    for (i, placed) in boards.iter().enumerate() {
        let picture = look(&camera, placed, &Trouble::usual(), i as u64);
        let errors = detection(&camera, placed, &picture);
        eprintln!(
            "{}: {} corners, rms {:.3} px, worst {:.3} px",
            picture.name,
            errors.len(),
            rms(&errors),
            most(&errors)
        );
        assert!(errors.len() >= 78, "{}: {}", picture.name, errors.len());
        all.extend(errors);
        found.push(picture);
    }
    eprintln!("corners: rms {:.3} px, worst {:.3} px", rms(&all), most(&all));
    assert!(rms(&all) < 0.1);
    let worst = worst(&camera, &found);
    eprintln!("plane: worst {:.4} mm", worst * 1e3);
    assert!(worst < BAR_M, "{worst}");
}

#[test]
fn boards_of_which_a_part_is_hidden_or_out_of_sight_do() {
    let camera = WallCamera::square();
    let hidden: [&[usize]; 4] = [&[0, 1, 5, 6], &[7], &[12, 13, 14, 17, 18, 19], &[0, 4, 15, 19]];
    // At the picture's edge it is farther from the middle than anything in the first test.
    for (name, at_edge, limit_m) in [("hidden", false, BAR_M), ("at the edge", true, 3.0 * BAR_M)] {
        let mut boards = spread(&camera);
        for (board, hidden) in boards.iter_mut().zip(hidden.into_iter().cycle()) {
            board.hidden = hidden.to_vec();
        }
        if at_edge {
            // A part of each is out of sight.
            for (board, px) in boards.iter_mut().skip(6).zip([[60.0, 300.0], [1230.0, 420.0], [500.0, 30.0]])
            {
                board.middle = camera.traced(px, 0.0);
            }
        }
        let look = |(i, placed): (usize, &PlacedTags)| {
            let picture = look(&camera, placed, &Trouble::usual(), i as u64);
            let errors = detection(&camera, placed, &picture);
            eprintln!("{name}, {}: {} corners, rms {:.3} px", picture.name, errors.len(), rms(&errors));
            assert!(errors.len() <= 4 * (TAGS[0] * TAGS[1] - placed.hidden.len()) && rms(&errors) < 0.15);
            picture
        };
        let found: Vec<Picture> = boards.iter().enumerate().map(look).collect();
        let worst = worst(&camera, &found);
        eprintln!("{name}: plane worst {:.4} mm", worst * 1e3);
        assert!(worst < limit_m, "{name}: {worst}");
    }
}

#[test]
fn tags_are_read_in_hard_pictures() {
    let usual = Trouble::usual();
    let square = WallCamera::square();
    let tilted = WallCamera { tilt_rad: [0.35, 0.2], ..square };
    let small = WallCamera { size_px: [640, 480], focal_px: 620.0, ..square };
    let large = WallCamera { size_px: [1920, 1080], focal_px: 2600.0, ..square };
    // Each with the fewest corners and the largest root mean square error.
    let cases = [
        ("turned by an eighth", square, 0.785, usual, 78, 0.08),
        ("seen at an angle", tilted, 0.3, usual, 78, 0.08),
        ("tags of 24 px", small, 0.2, usual, 55, 0.15),
        ("little light", square, 0.2, Trouble { white: 70.0, ..usual }, 70, 0.15),
        ("noise of 15 grey levels", square, 0.2, Trouble { noise: 15.0, ..usual }, 70, 0.15),
        ("light from one side", square, 0.2, Trouble { uneven: 0.8, ..usual }, 70, 0.15),
        ("out of focus", large, 0.2, Trouble { blur_px: 4.0, ..usual }, 70, 0.2),
        ("a finger on it", square, 0.2, Trouble { finger: Some(([560.0, 330.0], 30.0)), ..usual }, 64, 0.1),
    ];
    for (name, camera, turn_rad, trouble, fewest, most_px) in cases {
        let [width, height] = camera.size_px.map(f64::from);
        let middle = camera.traced([0.5 * width, 0.5 * height], 0.0);
        let placed = PlacedTags { turn_rad, ..PlacedTags::new(TAGS, TAG_M, SPACING, middle) };
        let found = look(&camera, &placed, &trouble, 0);
        let errors = detection(&camera, &placed, &found);
        eprintln!(
            "{name}: {} corners, rms {:.3} px, worst {:.3} px",
            errors.len(),
            rms(&errors),
            most(&errors)
        );
        assert!(errors.len() >= fewest && rms(&errors) < most_px, "{name}");
    }
}

#[test]
fn what_is_another_board_is_refused_with_what_is_wrong() {
    let camera = WallCamera::square();
    let middle = camera.traced([640.0, 360.0], 0.0);
    let plain = PlacedTags { turn_rad: 0.1, ..PlacedTags::new(TAGS, TAG_M, SPACING, middle) };
    let refused = |placed: &PlacedTags, board: Board, said: &str| {
        let picture = picture(&camera, Some(placed), &Trouble::usual(), 0);
        let message = detect(&picture, &board).expect_err(said).to_string();
        eprintln!("{message}");
        assert!(message.contains(said), "{message}");
    };
    refused(&PlacedTags { mirrored: true, ..plain.clone() }, board(), "the tags are mirrored");
    refused(&plain, board_of([4, 4], TAG_M, SPACING), "tag 16 is none of aprilgrid:4x4");
    refused(&plain, board_of([4, 5], TAG_M, SPACING), "do not lie as on a board of 4 x 5");
    let few = PlacedTags { hidden: (3..20).collect(), ..plain.clone() };
    refused(&few, board(), "3 of the board's 20 tags; at least 4");
    refused(&PlacedTags { hidden: (0..20).collect(), ..plain.clone() }, board(), "no aprilgrid");
    let chessboard = "chessboard:9x6:0.02".parse().expect("a board");
    let picture = picture(&camera, Some(&plain), &Trouble::usual(), 0);
    assert!(detect(&picture, &chessboard).is_err());

    // Another gap than was said shows against the tags' own size, in the fit.
    let boards = spread(&camera);
    let wrong = board_of(TAGS, TAG_M, 0.25);
    let found: Vec<Picture> = boards
        .iter()
        .take(4)
        .enumerate()
        .map(|(i, placed)| {
            found_in(&self::picture(&camera, Some(placed), &Trouble::usual(), i as u64), &wrong, i as u64)
        })
        .collect();
    let message = calibrate(&found, &setup(wrong)).expect_err("another gap").to_string();
    assert!(message.contains("mm rms"), "{message}");
}

#[test]
fn tags_of_another_size_than_was_said_scale_everything_and_do_not_show() {
    let camera = WallCamera::square();
    let pictures: Vec<GrayImage> = spread(&camera)
        .iter()
        .take(4)
        .enumerate()
        .map(|(i, placed)| picture(&camera, Some(placed), &Trouble::usual(), i as u64))
        .collect();
    let [right, wrong] = [1.0, 1.05].map(|share| {
        let board = board_of(TAGS, share * TAG_M, SPACING);
        let found: Vec<Picture> =
            pictures.iter().enumerate().map(|(i, picture)| found_in(picture, &board, i as u64)).collect();
        calibrated(&found, &setup(board)).quality
    });
    for (a, b) in [(right.metres_per_px, wrong.metres_per_px), (right.rms_m, wrong.rms_m)] {
        assert!((b / a - 1.05).abs() < 1e-3, "{a} {b}");
    }
}

#[test]
fn camera_that_rolls_is_laid_upright_by_plumb_line_and_water_level() {
    let camera = WallCamera::square();
    let found: Vec<Picture> = spread(&camera)
        .iter()
        .enumerate()
        .map(|(i, placed)| look(&camera, placed, &Trouble::usual(), i as u64))
        .collect();
    let (origin, up) = ([0.01, 0.02], Rotation2::new(0.17) * Vector2::y());
    let right = Vector2::new(up.y, -up.x);
    let seen = |off: Vector2<f64>| camera.seen([origin[0] + off.x, origin[1] + off.y]);
    for upright in [
        Upright::Plumb([seen(-0.1 * up), seen(0.08 * up)]),
        Upright::Level([seen(0.05 * up - 0.2 * right), seen(0.05 * up + 0.2 * right)]),
    ] {
        let setup = Setup { upright, origin_px: seen(Vector2::zeros()), ..setup(board()) };
        let plane = calibrated(&found, &setup).plane;
        let truth = |px: Place| {
            let off = Vector2::from(camera.traced(px, 0.0)) - Vector2::from(origin);
            [off.dot(&right), off.dot(&up)]
        };
        let errors = errors(&plane, truth, &covered(&found));
        eprintln!("{upright:?}: worst {:.4} mm", most(&errors) * 1e3);
        assert!(most(&errors) < 1e-4, "{}", most(&errors));
    }
}

#[test]
fn one_picture_thirty_pictures_and_pictures_on_their_side() {
    let camera = WallCamera::square();
    let upright = WallCamera { size_px: [720, 1280], ..camera };
    for (name, camera, count) in [("1", camera, 1), ("30", camera, 30), ("10 upright", upright, 10)] {
        let boards: Vec<PlacedTags> = match count {
            // One that fills the picture.
            1 => {
                let middle = camera.traced([640.0, 360.0], 0.0);
                vec![PlacedTags { turn_rad: 0.02, ..PlacedTags::new(TAGS, 0.04, SPACING, middle) }]
            }
            _ => spread(&camera).into_iter().cycle().take(count).collect(),
        };
        let board = board_of(TAGS, boards[0].tag_m, SPACING);
        let setup = Setup { origin_px: [360.0, 80.0], ..setup(board) };
        let pictures: Vec<GrayImage> = boards
            .iter()
            .enumerate()
            .map(|(i, placed)| picture(&camera, Some(placed), &Trouble::usual(), i as u64))
            .collect();
        let began = Instant::now();
        let found: Vec<Picture> =
            pictures.iter().enumerate().map(|(i, picture)| found_in(picture, &board, i as u64)).collect();
        let looked = began.elapsed();
        let calibrated = calibrated(&found, &setup);
        let fitted = began.elapsed() - looked;
        let errors = errors(&calibrated.plane, from_origin(&camera, setup.origin_px), &covered(&found));
        eprintln!(
            "{name}: looking {:.2} s, fit {:.3} s, plane worst {:.4} mm",
            looked.as_secs_f64(),
            fitted.as_secs_f64(),
            most(&errors) * 1e3
        );
        assert!(most(&errors) < 2.0 * BAR_M, "{name}: {}", most(&errors));
    }
}

#[test]
fn verb_takes_an_aprilgrid() {
    let folder = tempfile::tempdir().expect("a folder");
    let images = folder.path().join("images");
    std::fs::create_dir(&images).expect("a folder");
    let camera = WallCamera::square();
    for (i, placed) in spread(&camera).iter().take(4).enumerate() {
        let picture = picture(&camera, Some(placed), &Trouble::usual(), i as u64);
        picture.save(images.join(format!("board-{i:02}.png"))).expect("a picture");
    }
    let out = folder.path().join("tank.toml");
    let text = |board: &str| {
        let paths = [images.as_os_str(), "--out".as_ref(), out.as_os_str()];
        let words = ["--board", board, "--origin-px", "640,80"].map(AsRef::<std::ffi::OsStr>::as_ref);
        let verb = ["calibrate", "camera"].map(AsRef::<std::ffi::OsStr>::as_ref);
        let output = run_rig(verb.into_iter().chain(paths).chain(words));
        (output.status.code(), printed(&output))
    };
    let (code, said) = text(&board().to_string());
    assert!(code == Some(0) && said.contains("board-00.png      80"), "{said}");
    let file = std::fs::read_to_string(&out).expect("the file");
    assert!(file.contains("board = \"aprilgrid:5x4:0.028:0.3\""), "{file}");
    let (code, said) = text("aprilgrid:4x5:0.028:0.3");
    assert!(code == Some(4) && said.contains("do not lie as on a board of 4 x 5"), "{said}");
    let (code, said) = text("aprilgrid:5x4:28:0.3");
    assert!(code == Some(2) && said.contains("20 mm are 0.020"), "{said}");
}
