//! Marks that a tracker writes where it has lost a keypoint: again and again the same place to the last digit, such as 0, 0 or -1, -1.

use std::cmp::Reverse;
use std::collections::HashMap;

use serde::{Deserialize, Serialize};
use sim::Trajectory;
use sim::model::encoded_joint;

use ground::statistics::median;

/// A place that a keypoint jumps to and comes back from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LostMark {
    /// Name of the keypoint.
    pub keypoint: String,
    /// The place along the axes that are observed \[m\].
    pub at_m: Vec<f64>,
    /// Images with it, which became gaps.
    pub images: usize,
}

impl LostMark {
    /// What became of it in the run `id`, in a sentence.
    pub fn sentence(&self, id: &str) -> String {
        let place: Vec<String> = self.at_m.iter().map(f64::to_string).collect();
        format!(
            "{} of {id} stands at exactly ({}) in {} images, which it jumps to and back: these are taken as lost, not as seen there",
            self.keypoint,
            place.join(", "),
            self.images
        )
    }
}

/// Fewest visits after which a place is no chance (chosen): a keypoint may stand still for long, but it does not come back to the last digit.
const VISITS_MIN: usize = 3;
/// A visit is a jump of at least this share of the room that the keypoint moves in (chosen), in and out, from one image to the next ...
const JUMP_ROOM_SHARE_MIN: f64 = 0.2;
/// ... and this many times as far as it usually goes between two images (chosen).
const JUMP_STEP_RATIO_MIN: f64 = 5.0;

/// Makes gaps of the marks in `trajectory` that say that a keypoint was lost.
pub(super) fn make_gaps(trajectory: &mut Trajectory) -> Vec<LostMark> {
    let width = trajectory.keypoints.len();
    let mut list = Vec::new();
    for keypoint in 0..width {
        if encoded_joint(&trajectory.keypoints[keypoint]).is_some() {
            continue;
        }
        for (at_m, rows) in lost(trajectory, keypoint) {
            for row in &rows {
                trajectory.position_m[row * width + keypoint] = [f64::NAN; 3];
            }
            let keypoint = trajectory.keypoints[keypoint].clone();
            let at_m = at_m.into_iter().filter(|x| x.is_finite()).collect();
            list.push(LostMark { keypoint, at_m, images: rows.len() });
        }
    }
    list
}

/// The places at which `keypoint` was lost, with their rows: the one that it jumps to most often first, since rest between two jumps looks
/// like a place that it jumps to itself.
fn lost(trajectory: &Trajectory, keypoint: usize) -> Vec<([f64; 3], Vec<usize>)> {
    let at = |row: usize| trajectory.at(row, keypoint);
    let is_seen = |row: &usize| at(*row).iter().any(|x| x.is_finite());
    let mut seen: Vec<usize> = (0..trajectory.time_s.len()).filter(is_seen).collect();
    let mut by_place: HashMap<[u64; 3], Vec<usize>> = HashMap::new();
    for &row in &seen {
        by_place.entry(at(row).map(f64::to_bits)).or_default().push(row);
    }
    let mut repeated: Vec<Vec<usize>> =
        by_place.into_values().filter(|rows| rows.len() >= VISITS_MIN).collect();
    repeated.sort();
    let mut list = Vec::new();
    while let Some((visits, place)) = (0..repeated.len())
        .map(|place| (visits(&seen, &repeated[place], at), place))
        .max_by_key(|&(visits, place)| (visits, Reverse(place)))
        && visits >= VISITS_MIN
    {
        let rows = repeated.swap_remove(place);
        seen.retain(|row| !rows.contains(row));
        list.push((at(rows[0]), rows));
    }
    list
}

/// How often a keypoint that is seen in the rows `seen` at the places `at` jumps to where it is in `rows`, and back; 0 where it also
/// slides in or out.
fn visits(seen: &[usize], rows: &[usize], at: impl Fn(usize) -> [f64; 3]) -> usize {
    let mut steps_m: Vec<f64> = seen.windows(2).map(|pair| distance_m(at(pair[0]), at(pair[1]))).collect();
    let usual_m = median(&mut steps_m, f64::total_cmp).unwrap_or(0.0);
    let others: Vec<[f64; 3]> = seen.iter().filter(|row| !rows.contains(row)).map(|&row| at(row)).collect();
    let jump_m = (JUMP_ROOM_SHARE_MIN * room_m(&others)).max(JUMP_STEP_RATIO_MIN * usual_m);
    // the image before or after one that is there, where it is elsewhere
    let elsewhere = |row: &usize, step: isize| {
        let own = seen.binary_search(row).ok()?;
        seen.get(own.checked_add_signed(step)?).filter(|other| !rows.contains(other)).copied()
    };
    let is_far = |row: usize| distance_m(at(row), at(rows[0])) > jump_m;
    let ways = [-1, 1].map(|step| rows.iter().filter_map(|row| elsewhere(row, step)).collect::<Vec<usize>>());
    match ways.iter().flatten().all(|&row| is_far(row)) {
        true => ways.iter().map(Vec::len).min().unwrap_or(0),
        false => 0,
    }
}

/// The diagonal of the box about `places`.
fn room_m(places: &[[f64; 3]]) -> f64 {
    let span = |axis: usize| {
        let all = || places.iter().map(|place| place[axis]).filter(|x| x.is_finite());
        all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
    };
    (0..3).map(span).filter(|span| span.is_finite()).map(|span| span * span).sum::<f64>().sqrt()
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] - b[axis]).filter(|x| x.is_finite()).map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A keypoint on a circle of 80 mm, 100 images a second, each coordinate rounded to 0.1 mm as trackers do; `lost` says where it is not seen.
    fn filmed(lost: impl Fn(usize) -> Option<[f64; 2]>) -> Trajectory {
        let place = |image: usize| {
            // at rest for the first half second
            let angle = 0.8 * (6.0 * (image as f64 / 100.0 - 0.5).max(0.0)).sin();
            let rounded = |x: f64| (x * 1e4).round() / 1e4;
            let [x, z] = lost(image).unwrap_or([rounded(0.08 * angle.sin()), rounded(-0.08 * angle.cos())]);
            [x, f64::NAN, z]
        };
        Trajectory {
            time_s: (0..250).map(|image| image as f64 / 100.0).collect(),
            keypoints: vec!["P1".into()],
            position_m: (0..250).map(place).collect(),
            std_m: None,
            pose_std_m: None,
        }
    }

    #[test]
    fn a_place_that_a_keypoint_jumps_to_again_and_again_is_a_lost_mark() {
        for place in [[0.0, 0.0], [-1.0, -1.0]] {
            let mut trajectory = filmed(|image| (image % 8 == 3).then_some(place));
            let lost = make_gaps(&mut trajectory);
            assert_eq!(lost.len(), 1, "{lost:?}");
            assert_eq!(lost[0].images, 31);
            let gaps = trajectory.position_m.iter().filter(|place| place[0].is_nan()).count();
            assert_eq!(gaps, 31);
            let sentence = lost[0].sentence("drop-1");
            assert!(
                sentence.starts_with(&format!("P1 of drop-1 stands at exactly ({}, {})", place[0], place[1]))
            );
        }
    }

    #[test]
    fn rest_and_turning_points_are_none() {
        let mut trajectory = filmed(|_| None);
        let before = trajectory.position_m.len();
        assert_eq!(make_gaps(&mut trajectory), []);
        assert_eq!(trajectory.position_m.iter().filter(|place| place[0].is_finite()).count(), before);
    }
}
