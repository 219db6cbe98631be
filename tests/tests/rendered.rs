//! Films by ray tracing, read by the model's pose: nothing of what renders them is shared with what reads them. The bars are three times
//! what a first look at other seeds gave; `--example rendered` shows more of them.

use std::path::Path;

use system_tests::optics::score::{Score, score};
use system_tests::optics::{Film, Kind};

fn written(kind: Kind, scene: &str, seed: u64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let film = Film { kind, scene: scene.into(), seed, images: 40, size_px: (640, 480) };
    film.write(folder.path(), true).expect("a film");
    folder
}

fn read(folder: &Path) -> Score {
    let score = score(folder, 1).expect("it is read");
    eprintln!("{score}");
    score
}

/// Reads every `stride`-th image of the film, `[vision] key` of its config being `value` instead.
fn read_with(
    folder: &Path,
    key: &str,
    value: impl Into<toml::Value>,
    stride: usize,
) -> Result<Score, String> {
    let path = folder.join("extract.toml");
    let right = std::fs::read_to_string(&path).expect("a config");
    let mut config: toml::Table = right.parse().expect("it is TOML");
    config["vision"].as_table_mut().expect("a table").insert(key.into(), value.into());
    std::fs::write(&path, config.to_string()).expect("it is written");
    let score = score(folder, stride).map_err(|error| ground::error_chain::with_causes(&*error));
    std::fs::write(&path, right).expect("it is written");
    score
}

/// Makes all images of the film the one with this number.
fn stand_still(folder: &Path, number: usize) {
    let frames = std::fs::read_dir(folder.join("frames")).expect("a folder");
    let mut frames: Vec<_> = frames.map(|entry| entry.expect("an entry").path()).collect();
    frames.sort();
    let image = std::fs::read(&frames[number]).expect("an image");
    frames.iter().for_each(|frame| std::fs::write(frame, &image).expect("it is written"));
    let truth = std::fs::read_to_string(folder.join("truth.csv")).expect("a table");
    let mut lines = truth.lines().filter(|line| !line.starts_with('#'));
    let head = lines.next().expect("a head");
    let row = lines.nth(number).expect("a row");
    let rows = format!("{row}\n").repeat(frames.len());
    std::fs::write(folder.join("truth.csv"), format!("{head}\n{rows}")).expect("it is written");
}

fn holds(score: &Score, rms_px: f64) {
    assert_eq!(score.wrong, 0, "{score}");
    assert!(score.answered * 100 >= 90 * score.images, "{score}");
    assert!(score.rms_px.iter().all(|rms| *rms < rms_px), "{score}");
    assert!(score.normalised.iter().all(|normalised| *normalised < 3.0), "{score}");
}

#[test]
fn chain_before_tiles_and_behind_its_holder() {
    let folder = written(Kind::Chain, "usual", 22);
    holds(&read(folder.path()), 1.2);
    let config = std::fs::read_to_string(folder.path().join("extract.toml")).expect("a config");
    let config: toml::Table = config.parse().expect("it is TOML");
    let [x, y] = [0, 1].map(|axis| config["vision"]["base_px"][axis].as_float().expect("it is a number"));
    for by_px in [-60.0, 40.0] {
        let why = read_with(folder.path(), "base_px", vec![x + by_px, y], 1).expect_err("P0 is not there");
        assert!(why.contains("correct `base_px`"), "{by_px}: {why}");
    }
}

#[test]
fn one_pose_alone_is_told_by_a_picture_of_the_empty_tank() {
    let folder = written(Kind::Chain, "usual", 22);
    stand_still(folder.path(), 20);
    let why = read_with(folder.path(), "background", "auto", 1).expect_err("nothing tells it from the tank");
    assert!(why.contains("give a picture of the empty tank"), "{why}");
    let score = read_with(folder.path(), "background", "empty.png", 1).expect("it is read");
    assert_eq!((score.answered, score.wrong), (score.images, 0), "{score}");
}

#[test]
fn arm_that_is_not_as_wide_as_its_model_among_rods() {
    holds(&read(written(Kind::Arm, "clutter", 25).path()), 2.0);
}
