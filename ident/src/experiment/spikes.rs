//! Keypoints that were misread in single images: a reflection, another marker, a bubble.
//!
//! One such *spike* of 20 mm among keypoints read to 0.4 mm weighs as much as 2500 images, so it must not be fitted. A spike is
//! told from motion by the images around it alone, without any model: the keypoint leaves its path, which is smooth there, and is
//! back at once. What stays away for many images, jumps to a new place, or turns sharply as a joint does at its stop, is no spike.

use serde::{Deserialize, Serialize};
use sim::Trajectory;

use crate::noise::calm_noise_m;
use crate::text::millimetres;

/// A keypoint in one image that was set aside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spike {
    /// Time of the image \[s\].
    pub time_s: f64,
    /// Name of the keypoint.
    pub keypoint: String,
    /// How far it is from where the images around it have it \[m\].
    pub off_m: f64,
}

impl Spike {
    /// What was set aside of the run `id`, in a sentence; `None` where nothing was.
    pub fn sentence(id: &str, spikes: &[Self]) -> Option<String> {
        let farthest = spikes.iter().max_by(|a, b| a.off_m.total_cmp(&b.off_m))?;
        let (count, are) = match spikes.len() {
            1 => ("1 keypoint".to_owned(), "is"),
            many => (format!("{many} keypoints"), "are"),
        };
        Some(format!(
            "{count} of {id} {are} set aside as misread, at most {} mm off the path of the images around it ({} at {:.3} s)",
            millimetres(farthest.off_m),
            farthest.keypoint,
            farthest.time_s
        ))
    }
}

/// A keypoint is suspected beyond this many standard deviations off its path (chosen): its neighbours are not judged by it then.
const SUSPECTED_DEVIATION_Z: f64 = 5.0;
/// A keypoint is a spike beyond this many standard deviations off its path (chosen): noise of a million images stays below.
const SPIKE_DEVIATION_Z: f64 = 8.0;
/// A spike is off by at least this share of the room that the keypoint moves in (chosen): noise is not the same everywhere.
const SPIKE_ROOM_SHARE_MIN: f64 = 5e-3;
/// A path is smooth where its predictions from the nearest images and from the next ones agree to this share of the spike (chosen).
const SMOOTH_PATH_SHARE_MAX: f64 = 0.5;
/// A spike is at least this share of its own size away from the keypoint's places before and after (chosen).
const SPIKE_NEIGHBOUR_DISTANCE_SHARE_MIN: f64 = 0.5;
/// Images through which a path is laid: a cubic needs four.
const PATH_IMAGES: usize = 4;

/// Where a larger share of images is suspected, images are too few for the motion and nothing is set aside (chosen).
const SUSPECTED_SHARE_MAX: f64 = 0.1;
/// No spikes are sought for a keypoint observed in fewer images (chosen).
const KEYPOINT_IMAGES_MIN: usize = 16;

/// Takes the spikes out of `trajectory`, where they become gaps.
pub(super) fn set_aside(trajectory: &mut Trajectory) -> Vec<Spike> {
    let noise_m = calm_noise_m([&*trajectory]);
    let width = trajectory.keypoints.len();
    let mut list = Vec::new();
    for keypoint in 0..width {
        let path = Path::new(trajectory, keypoint);
        for (place, off_m) in path.spikes(noise_m) {
            let row = path.rows[place];
            trajectory.position_m[row * width + keypoint] = [f64::NAN; 3];
            let (time_s, keypoint) = (trajectory.time_s[row], trajectory.keypoints[keypoint].clone());
            list.push(Spike { time_s, keypoint, off_m });
        }
    }
    list.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    list
}

/// How far a keypoint is off its path \[m\], the path's point, and how far noise may put it \[m\].
struct Deviation {
    off_m: f64,
    path: [f64; 3],
    limit_m: f64,
}

impl Deviation {
    fn share(&self) -> f64 {
        self.off_m / self.limit_m
    }
}

/// The observed places of a keypoint: rows of the trajectory, times \[s\] and points \[m\].
struct Path {
    rows: Vec<usize>,
    time_s: Vec<f64>,
    /// 0 along an axis that was never observed.
    points: Vec<[f64; 3]>,
}

impl Path {
    fn new(trajectory: &Trajectory, keypoint: usize) -> Self {
        let all = || 0..trajectory.time_s.len();
        let is_observed: [bool; 3] =
            std::array::from_fn(|axis| all().any(|row| trajectory.at(row, keypoint)[axis].is_finite()));
        let point = |row: usize| -> Option<(usize, [f64; 3])> {
            let observed = trajectory.at(row, keypoint);
            let is_whole = (0..3).all(|axis| observed[axis].is_finite() == is_observed[axis]);
            let is_usable = is_whole && is_observed.contains(&true);
            is_usable.then(|| (row, observed.map(|x| if x.is_finite() { x } else { 0.0 })))
        };
        let (rows, points): (Vec<usize>, Vec<[f64; 3]>) = all().filter_map(point).unzip();
        Self { time_s: rows.iter().map(|&row| trajectory.time_s[row]).collect(), rows, points }
    }

    /// Places of the spikes, and how far off they are \[m\].
    fn spikes(&self, noise_m: f64) -> Vec<(usize, f64)> {
        let all: Vec<usize> = (0..self.rows.len()).collect();
        if all.len() < KEYPOINT_IMAGES_MIN {
            return Vec::new();
        }
        let good = self.beyond_suspicion(all.clone(), SUSPECTED_DEVIATION_Z * noise_m);
        if ((all.len() - good.len()) as f64) > SUSPECTED_SHARE_MAX * all.len() as f64 {
            return Vec::new();
        }
        let least_m = SPIKE_ROOM_SHARE_MIN * self.room_m(&good);
        let leaves_smooth_path = |&place: &usize| {
            let Deviation { off_m, path, .. } = self
                .off(place, &good, SPIKE_DEVIATION_Z * noise_m)
                .filter(|off| off.share() > 1.0 && off.off_m > least_m)?;
            let after = good.partition_point(|&other| other < place);
            let wider = if after == 0 || after == good.len() {
                path
            } else if after < PATH_IMAGES || after + PATH_IMAGES > good.len() {
                // near its ends a path goes no further: it must rest there
                self.mean(&nearest(place, &good, 0)?)
            } else {
                self.predicted(place, &nearest(place, &good, PATH_IMAGES / 2)?)?.0
            };
            (distance(path, wider) < SMOOTH_PATH_SHARE_MAX * off_m).then_some((place, off_m))
        };
        let mut list: Vec<(usize, f64)> = all_but(&all, |place| good.binary_search(&place).is_ok())
            .iter()
            .filter_map(leaves_smooth_path)
            .collect();
        let rest = all_but(&all, |place| list.iter().any(|(off, _)| *off == place));
        list.retain(|&(place, off_m)| {
            let after = rest.partition_point(|&other| other < place);
            let neighbours =
                [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| rest.get(at));
            neighbours.into_iter().all(|&at| {
                distance(self.points[at], self.points[place]) > SPIKE_NEIGHBOUR_DISTANCE_SHARE_MIN * off_m
            })
        });
        // once some images of a sudden start are suspected, the path across them is none, and those after them are off it
        let stretches = list.chunk_by(|a, b| a.0 + 1 == b.0).filter(|stretch| stretch.len() <= PATH_IMAGES);
        stretches.flatten().copied().collect()
    }

    /// What of `all` is left when the one that is farthest off the path of the others is left out, and then the next, until none is
    /// off by more than noise with this `limit_m` is.
    fn beyond_suspicion(&self, all: Vec<usize>, limit_m: f64) -> Vec<usize> {
        let mut good = all;
        let share =
            |at: usize, good: &[usize]| self.off(good[at], good, limit_m).map_or(0.0, |off| off.share());
        let mut shares: Vec<f64> = (0..good.len()).map(|at| share(at, &good)).collect();
        while let Some(at) = (0..good.len()).max_by(|&a, &b| shares[a].total_cmp(&shares[b])) {
            if shares[at] <= 1.0 {
                break;
            }
            good.remove(at);
            shares.remove(at);
            let (first, last) = (at.saturating_sub(PATH_IMAGES), (at + PATH_IMAGES).min(good.len()));
            for (near, known) in (first..last).zip(&mut shares[first..last]) {
                *known = share(near, &good);
            }
        }
        good
    }

    /// How far `place` is off the path that `others` tell, and how far noise with this `limit_m` may put it.
    fn off(&self, place: usize, others: &[usize], limit_m: f64) -> Option<Deviation> {
        let nodes = nearest(place, others, 0)?;
        let is_between = nodes[0] < place && place < nodes[PATH_IMAGES - 1];
        let (path, limit_m) = if is_between {
            let (cubic, spread) = self.predicted(place, &nodes)?;
            (cubic, limit_m * spread)
        } else {
            // beyond the last image a cubic makes too much of noise; a line is as wrong as the path bends
            let next =
                |count: usize| if place < nodes[0] { &nodes[..count] } else { &nodes[PATH_IMAGES - count..] };
            let ((line, spread), (quadratic, _)) =
                (self.predicted(place, next(2))?, self.predicted(place, next(3))?);
            (line, limit_m * spread + 2.0 * distance(line, quadratic))
        };
        Some(Deviation { off_m: distance(self.points[place], path), path, limit_m })
    }

    /// The diagonal of the box about `places`.
    fn room_m(&self, places: &[usize]) -> f64 {
        let along = |axis: usize| places.iter().map(move |&place| self.points[place][axis]);
        let corner = |axis: usize, pick: fn(f64, f64) -> f64| along(axis).reduce(pick).unwrap_or(0.0);
        let [low, high] = [f64::min, f64::max].map(|pick| std::array::from_fn(|axis| corner(axis, pick)));
        distance(low, high)
    }

    fn mean(&self, nodes: &[usize]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            nodes.iter().map(|&node| self.points[node][axis]).sum::<f64>() / nodes.len() as f64
        })
    }

    /// Where the polynomial through `nodes` has the keypoint at `place`, and how much noise of 1 makes of the distance to it.
    fn predicted(&self, place: usize, nodes: &[usize]) -> Option<([f64; 3], f64)> {
        let (mut point, mut squares) = ([0.0; 3], 1.0);
        for &node in nodes {
            let others = nodes.iter().filter(|&&other| other != node);
            let weight: f64 = others
                .map(|&other| {
                    (self.time_s[place] - self.time_s[other]) / (self.time_s[node] - self.time_s[other])
                })
                .product();
            point.iter_mut().zip(self.points[node]).for_each(|(sum, x)| *sum += weight * x);
            squares += weight * weight;
        }
        point.iter().all(|x| x.is_finite()).then_some((point, squares.sqrt()))
    }
}

/// [`PATH_IMAGES`] places of `list`, which rises, about `place`: the nearest two of each side but the first `skipped`, more of one where
/// the other has ended.
fn nearest(place: usize, list: &[usize], skipped: usize) -> Option<Vec<usize>> {
    let before = list.partition_point(|&other| other < place).saturating_sub(skipped);
    let after = list.partition_point(|&other| other <= place) + skipped;
    let (left, right) = (&list[..before], list.get(after..)?);
    let from_left = left.len().min((PATH_IMAGES / 2).max(PATH_IMAGES.saturating_sub(right.len())));
    let right = right.get(..PATH_IMAGES - from_left)?;
    Some(left[left.len() - from_left..].iter().chain(right).copied().collect())
}

fn all_but(all: &[usize], is_out: impl Fn(usize) -> bool) -> Vec<usize> {
    all.iter().copied().filter(|&place| !is_out(place)).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, Normal};

    use super::*;

    const NOISE_M: f64 = 4e-4;

    /// Two keypoints on `path`, half as far from the origin the second, with noise; `per_s` images a second for 2.5 s.
    fn filmed(per_s: f64, path: impl Fn(f64) -> [f64; 2]) -> Trajectory {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let normal = Normal::new(0.0, NOISE_M).expect("a deviation");
        let time_s: Vec<f64> = (0..(2.5 * per_s) as usize).map(|image| image as f64 / per_s).collect();
        let mut position_m = Vec::new();
        for &time_s in &time_s {
            let [x, z] = path(time_s);
            for share in [1.0, 0.5] {
                let mut measured = |at: f64| share * at + normal.sample(&mut random);
                position_m.push([measured(x), f64::NAN, measured(z)]);
            }
        }
        Trajectory {
            time_s,
            keypoints: vec!["P1".into(), "P2".into()],
            position_m,
            std_m: None,
            pose_std_m: None,
        }
    }

    /// Swings on a circle of 80 mm at `hz`.
    fn swing(hz: f64) -> impl Fn(f64) -> [f64; 2] {
        move |time_s| {
            let angle = 0.8 * (std::f64::consts::TAU * hz * time_s).sin();
            [0.08 * angle.sin(), -0.08 * angle.cos()]
        }
    }

    fn misread(trajectory: &mut Trajectory, row: usize, keypoint: usize, by_m: [f64; 2]) {
        let point = &mut trajectory.position_m[2 * row + keypoint];
        *point = [point[0] + by_m[0], f64::NAN, point[2] + by_m[1]];
    }

    fn found(mut trajectory: Trajectory) -> Vec<(usize, String)> {
        let per_s = 1.0 / trajectory.time_s[1];
        let spikes = set_aside(&mut trajectory);
        let gaps = trajectory.position_m.iter().filter(|p| p[0].is_nan()).count();
        assert_eq!(gaps, spikes.len());
        spikes.into_iter().map(|s| ((s.time_s * per_s).round() as usize, s.keypoint)).collect()
    }

    #[test]
    fn spikes_are_set_aside_alone_in_pairs_and_at_the_ends() {
        let mut trajectory = filmed(100.0, at_rest_first(swing(2.0)));
        misread(&mut trajectory, 0, 1, [0.015, 0.0]);
        misread(&mut trajectory, 1, 0, [0.03, 0.0]);
        misread(&mut trajectory, 60, 1, [0.006, -0.004]);
        misread(&mut trajectory, 100, 0, [-0.03, 0.02]);
        misread(&mut trajectory, 101, 0, [0.01, 0.03]);
        misread(&mut trajectory, 200, 1, [0.05, 0.0]);
        misread(&mut trajectory, 203, 1, [0.05, 0.0]);
        misread(&mut trajectory, 249, 1, [0.01, 0.015]);
        let wanted = [
            (0, "P2"),
            (1, "P1"),
            (60, "P2"),
            (100, "P1"),
            (101, "P1"),
            (200, "P2"),
            (203, "P2"),
            (249, "P2"),
        ];
        assert_eq!(found(trajectory), wanted.map(|(row, name)| (row, name.to_owned())));
    }

    /// The first images show a mechanism at rest.
    fn at_rest_first(path: impl Fn(f64) -> [f64; 2]) -> impl Fn(f64) -> [f64; 2] {
        move |time_s| path((time_s - 0.2).max(0.0))
    }

    #[test]
    fn motion_is_no_spike_however_sudden() {
        let bounce = |time_s: f64| {
            let turned = swing(2.0)(time_s);
            [turned[0].abs(), turned[1]]
        };
        let jump = |time_s: f64| if time_s < 1.0 { [0.0, -0.08] } else { [0.03, -0.08] };
        let elsewhere = |time_s: f64| if (1.0..1.1).contains(&time_s) { [0.05, -0.02] } else { [0.0, -0.08] };
        for per_s in [8.0, 15.0, 30.0, 50.0, 100.0, 500.0] {
            for hz in [0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0] {
                assert_eq!(found(filmed(per_s, swing(hz))), [], "swinging at {hz}, {per_s}");
                assert_eq!(found(filmed(per_s, at_rest_first(swing(hz)))), [], "started at {hz}, {per_s}");
            }
            assert_eq!(found(filmed(per_s, bounce)), [], "bouncing, {per_s}");
            assert_eq!(found(filmed(per_s, jump)), [], "jumping, {per_s}");
        }
        assert_eq!(found(filmed(100.0, elsewhere)), [], "read elsewhere for long");
    }

    #[test]
    fn what_is_set_aside_is_reported() {
        let mut trajectory = filmed(100.0, swing(1.0));
        misread(&mut trajectory, 123, 1, [0.02, 0.0]);
        let spikes = set_aside(&mut trajectory);
        let sentence = Spike::sentence("drop-1", &spikes).expect("one is");
        assert!(sentence.starts_with("1 keypoint of drop-1 is set aside as misread, at most "), "{sentence}");
        assert!(sentence.ends_with("(P2 at 1.230 s)"), "{sentence}");
        assert_eq!(Spike::sentence("drop-1", &[]), None);
    }
}
