//! Keypoints in films that the mock camera did not draw. `cargo run --release -p system-tests --example clips` has more of them.

use system_tests::clips::clip::{Level, clip};
use system_tests::clips::score::{Score, score};

const SECONDS: f64 = 1.2;

fn scores(level: Level, seeds: &[u64]) -> Vec<Score> {
    seeds.iter().map(|seed| score(&clip(level, *seed, SECONDS, false)).0).collect()
}

/// Worst root mean square error of a keypoint [px]: what three times the films of the example's first ten seeds reach.
const READ_PX: f64 = 0.15;

fn are_read(level: Level, seeds: &[u64]) {
    for score in scores(level, seeds) {
        assert!(score.rms_px.iter().all(|rms| *rms < READ_PX), "{score:?}");
        assert!(score.answered > 0.95 && score.wrong_unflagged == 0, "{score:?}");
    }
}

#[test]
fn clean_films_are_read_to_a_fraction_of_a_pixel_though_nobody_states_the_overhang() {
    are_read(Level::Clean, &[0, 1, 4]);
}

#[test]
fn a_motor_before_the_root_dirt_and_uneven_light_hide_no_chain() {
    are_read(Level::Usual, &[0, 4]);
}

#[test]
fn bars_bubbles_caustics_flicker_and_little_contrast_mislead_nobody() {
    are_read(Level::Hard, &[0, 1, 3, 4, 7, 8]);
}

/// How well the place of a hidden root is known depends on how far the arm swings; what is said of it must hold.
#[test]
fn an_arm_whose_root_is_hidden_says_how_well_it_is_known() {
    for score in scores(Level::Usual, &[3, 5]) {
        assert!(score.wrong_unflagged == 0 && score.normalised < 3.0, "{score:?}");
        assert!(score.rms_px.last().is_some_and(|tip| *tip < READ_PX), "{score:?}");
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
