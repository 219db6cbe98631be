//! Keypoints in films that the mock camera did not draw. `cargo run --release -p system-tests --example clips` has more of them.

use system_tests::clips::clip::{Level, body_clip, clip, octopus_clip};
use system_tests::clips::score::{Score, read, score};

const SECONDS: f64 = 1.2;

fn scores(level: Level, seeds: &[u64]) -> Vec<Score> {
    seeds.iter().map(|seed| score(&clip(level, *seed, SECONDS, false))).collect()
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

/// Over many films error and sigma are even (docs/vision-clips.md); one film of a few poses is within a half of that.
#[test]
fn a_film_drawn_again_tells_how_far_off_its_keypoints_are() {
    let (score, extraction) = read(&clip(Level::Clean, 300, 0.6, false), true);
    let check = extraction.and_then(|extraction| extraction.checked).expect("a check was asked for");
    let check = check.expect("every image is clear");
    assert!(check.lost == 0 && check.images > 100, "{check}");
    assert!(check.keypoints.iter().all(|one| one.white_px < 0.02 && one.pose_px < 0.02), "{check}");
    assert!((0.5..1.6).contains(&score.normalised), "{score:?}");
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

#[test]
fn bodies_that_nothing_holds_are_read_to_a_tenth_of_a_pixel() {
    for (level, seeds) in [(Level::Clean, [0, 3, 4]), (Level::Usual, [0, 1, 2]), (Level::Broken, [1, 2, 0])] {
        for seed in seeds {
            let score = score(&body_clip(level, seed, SECONDS, false));
            assert!(score.rms_px.iter().all(|rms| *rms < READ_PX), "{score:?}");
            assert!(score.answered > 0.95 && score.wrong_unflagged == 0, "{score:?}");
            assert_eq!(score.rms_px.len(), if seed == 4 { 1 } else { 2 }, "a disc has no heading");
        }
    }
}

#[test]
fn a_body_that_a_bar_covers_or_another_touches_is_flagged() {
    for score in [1, 6].map(|seed| score(&body_clip(Level::Hard, seed, SECONDS, false))) {
        assert_eq!(score.wrong_unflagged, 0, "{score:?}");
    }
}

/// The camera sees some of its arms one before the other: while they move alike they are read, apart they are left out.
#[test]
fn an_octopus_is_read_as_far_as_it_is_seen() {
    const SHORT: f64 = 0.24;
    /// Worst root mean square error of a keypoint; half of what tells P1 may be hidden by other arms [px].
    const OCTOPUS_PX: f64 = 0.3;
    let alike = score(&octopus_clip(Level::Clean, 1, SHORT, false));
    assert!(alike.rms_px.iter().all(|rms| *rms < OCTOPUS_PX), "{alike:?}");
    assert!(alike.answered > 0.5 && alike.wrong_unflagged == 0, "{alike:?}");
    let apart = score(&octopus_clip(Level::Clean, 2, SHORT, false));
    assert_eq!(apart.wrong_unflagged, 0, "{apart:?}");
}
