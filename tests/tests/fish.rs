//! What is made of a fish's markers: of drawn ones everywhere, of the real ones where they lie.
#![allow(clippy::unwrap_used, reason = "a test stops where it cannot go on")]

use std::f64::consts::TAU;

use ident::experiment::Experiment;
use system_tests::fish::{EXPERIMENTS, MODEL, Prepared, RUNS, markers, prepare, write};
use system_tests::shared;

/// Bend of the driven plates \[rad\], and the tail's further on.
fn bend(t: f64) -> f64 {
    0.4 * (TAU * t).sin()
}

/// Nine markers in pixels of a millimetre, 60 images a second: the fish swims to the left and turns, its tail bends; what `slip` says of an image and a marker
/// takes another marker's place.
fn drawn(seconds: f64, slip: impl Fn(usize, usize) -> usize) -> String {
    let mut text = String::new();
    for image in 0..(60.0 * seconds) as usize {
        let t = image as f64 / 60.0;
        let heading = 0.1 * t;
        let along = |from: [f64; 2], angle: f64, length_m: f64| {
            [from[0] + length_m * angle.cos(), from[1] + length_m * angle.sin()]
        };
        let mut places = vec![[2.0 - 0.2 * t, 1.0]];
        for length_m in [0.142, 0.215, 0.02] {
            places.push(along(places[places.len() - 1], heading, length_m));
        }
        let line = heading + bend(t);
        places.push(along(places[3], line, 0.03));
        places.push(along(places[3], line, 0.062));
        for (angle, length_m) in [(0.0, 0.029), (0.0, 0.021), (0.3, 0.08)] {
            places.push(along(places[places.len() - 1], line + angle, length_m));
        }
        let cells = (0..9).map(|marker| places[slip(image, marker)]).flat_map(|[x, z]| [1e3 * x, -1e3 * z]);
        text += &cells.map(|x| x.to_string()).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

fn made(text: &str) -> Result<Prepared, [usize; 2]> {
    prepare(&markers(text).unwrap()).map_err(|useless| useless.usable_of_all)
}

#[test]
fn drawn_markers_become_the_paths_that_they_were_drawn_by() {
    let fish = made(&drawn(3.0, |_, marker| marker)).unwrap();
    assert_eq!(fish.gaps, [0; 3]);
    for image in 10..170 {
        let t = image as f64 / 60.0;
        let at = fish.base.at(t);
        // by the published tendon, the third plate is bent a third further than the line to it; knots of 90 ms leave 1 mrad
        let wanted = 0.1 * t + bend(t) * 105.0 / 77.97;
        assert!((at.pose[2] - wanted).abs() < 2e-3, "{t} {} {wanted}", at.pose[2]);
        assert!((fish.servo.at(0, t) + bend(t)).abs() < 2e-3 && fish.servo.actuators.len() == 2);
        let [x, _, z] = at.back(fish.trajectory.at(image, 0));
        assert!((x.hypot(z) - 0.029).abs() < 1e-3, "{t} {x} {z}");
        // the fin's marker, which stands askew on average, on the line through the last plate again
        let [a, b] = [1, 2].map(|point| fish.trajectory.at(image, point));
        let angle = (b[2] - a[2]).atan2(b[0] - a[0]);
        assert!((angle - 0.1 * t - bend(t)).abs() < 1e-6, "{t} {angle}");
    }
}

#[test]
fn a_marker_that_slipped_is_a_gap_and_a_run_without_driven_plates_is_left_out() {
    let slipped =
        made(&drawn(3.0, |image, marker| if image > 100 && marker == 7 { 6 } else { marker })).unwrap();
    assert_eq!(slipped.gaps, [79, 79, 79], "the fifth plate's tracker sits on the fourth plate");
    let fallen = made(&drawn(3.0, |image, marker| if image > 60 && marker == 5 { 7 } else { marker }));
    assert_eq!(fallen.unwrap_err(), [61, 180]);
    let short = markers("1,2,3\n").unwrap_err().to_string();
    assert!(short.contains("line 1: wanted are 18 numbers"), "{short}");
}

#[test]
fn the_published_markers_give_six_runs_that_the_experiments_read() {
    let Some(shared) = shared("the robotic fish's markers") else { return };
    let data = shared.join("data/fish/Data/Markers");
    if !data.exists() {
        eprintln!("skipped: {} is not there", data.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("fish.xml"), MODEL).unwrap();
    let mut left_out = Vec::new();
    for run in RUNS {
        let text = std::fs::read_to_string(data.join(format!("markers_f{run}.csv"))).unwrap();
        match made(&text) {
            Ok(prepared) => write(&prepared, folder.path(), &format!("f{}", run.replace('_', ""))).unwrap(),
            Err(seen) => left_out.push((run, seen)),
        }
    }
    // their trackers sit on one marker
    assert_eq!(left_out, [("2_00", [79, 281]), ("2_25", [2, 301])]);
    for (name, text) in EXPERIMENTS {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let experiment = Experiment::read(&path).unwrap();
        assert!(experiment.runs.iter().all(|run| run.base.is_some() && run.command.is_some()));
        assert_eq!(experiment.runs.len(), 6);
    }
}
