//! Films by ray tracing, read by the model's pose: nothing of what renders them is shared with what reads them. The bars are three times
//! what a first look at other seeds gave; `--example rendered` shows more of them.

use std::path::Path;

use system_tests::optics::score::{Score, score};
use system_tests::optics::{Film, Kind};

fn written(kind: Kind, scene: &str, seed: u64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let film = Film { kind, scene: scene.into(), seed, images: 40, size_px: (640, 480) };
    film.write(folder.path(), false).expect("a film");
    folder
}

fn read(folder: &Path) -> Score {
    let score = score(folder, 1).expect("it is read");
    eprintln!("{score}");
    score
}

/// Why the film is refused where P0 is expected so far to the side \[px\].
fn refused(folder: &Path, by_px: f64) -> String {
    let path = folder.join("extract.toml");
    let right = std::fs::read_to_string(&path).expect("a config");
    let mut config: toml::Table = right.parse().expect("it is TOML");
    let x = config["vision"]["base_px"][0].as_float().expect("it is a number");
    config["vision"]["base_px"][0] = toml::Value::Float(x + by_px);
    std::fs::write(&path, config.to_string()).expect("it is written");
    let refused = score(folder, 1).expect_err("P0 is not there");
    std::fs::write(&path, right).expect("it is written");
    ground::error_chain::with_causes(&*refused)
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
    for by_px in [-60.0, 40.0] {
        let why = refused(folder.path(), by_px);
        assert!(why.contains("correct `base_px`"), "{by_px}: {why}");
    }
}

#[test]
fn arm_that_is_not_as_wide_as_its_model_among_rods() {
    holds(&read(written(Kind::Arm, "clutter", 25).path()), 2.0);
}
