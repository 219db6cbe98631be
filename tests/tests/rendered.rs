//! Films by ray tracing, read by the model's pose: nothing of what renders them is shared with what reads them. The bars are three times
//! what a first look at other seeds gave; `--example rendered` shows more of them.

use system_tests::optics::score::{Score, score};
use system_tests::optics::{Film, Kind};

fn read(kind: Kind, scene: &str, seed: u64) -> Score {
    let folder = tempfile::tempdir().expect("a folder");
    let film = Film { kind, scene: scene.into(), seed, images: 40, size_px: (640, 480) };
    film.write(folder.path(), false).expect("a film");
    let score = score(folder.path(), 1).expect("it is read");
    eprintln!("{}: {score}", film.name());
    score
}

fn holds(score: &Score, rms_px: f64) {
    assert_eq!(score.wrong, 0, "{score}");
    assert!(score.answered * 100 >= 90 * score.images, "{score}");
    assert!(score.rms_px.iter().all(|rms| *rms < rms_px), "{score}");
    assert!(score.normalised.iter().all(|normalised| *normalised < 3.0), "{score}");
}

#[test]
fn chain_before_tiles_and_behind_its_holder() {
    holds(&read(Kind::Chain, "usual", 22), 1.2);
}

#[test]
fn arm_that_is_not_as_wide_as_its_model_among_rods() {
    holds(&read(Kind::Arm, "clutter", 25), 2.0);
}
