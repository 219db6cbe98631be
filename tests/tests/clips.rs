//! Keypoints in films that the mock camera did not draw. `cargo run --release -p system-tests --example clips` has more of them.

use system_tests::clips::clip::{Level, clip};
use system_tests::clips::score::{Score, score};

const SECONDS: f64 = 1.2;

fn scores(level: Level, seeds: &[u64]) -> Vec<Score> {
    seeds.iter().map(|seed| score(&clip(level, *seed, SECONDS, false))).collect()
}

#[test]
fn clean_films_are_read_to_a_fraction_of_a_pixel_though_nobody_states_the_overhang() {
    for score in scores(Level::Clean, &[0, 1, 4]) {
        let arm = score.rms_px.len() == 3;
        let bar_px = if arm { 0.25 } else { 0.08 };
        assert!(score.rms_px.iter().all(|rms| *rms < bar_px), "{score:?}");
        assert!(score.answered > 0.95 && score.wrong_unflagged == 0, "{score:?}");
    }
}

#[test]
fn no_broken_image_gives_a_wrong_point_without_a_flag() {
    for score in scores(Level::Broken, &[2, 3]) {
        assert!(score.answered > 0.95 && score.wrong_unflagged == 0, "{score:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_film() {
    let film = |seed: u64| clip(Level::Hard, seed, 0.1, false);
    let pixels = |seed: u64| film(seed).images[3].grey.clone().expect("a picture");
    assert!(pixels(4) == pixels(4) && pixels(4) != pixels(10));
}
