//! A real robotic fish: markers that somebody else tracked, made ready for `rig fit`.
//!
//! Nine markers on a fish that swims under a camera, in pixels, 60 images a second: two on the head's rigid plate, one on the fin on its back, five
//! on the plates of its tail, one on the tip of its tail fin (`srl-ethz/fishsim`, MIT). What is wrong with them and why they are used as they are:
//! `docs/real-fish.md`.

mod spline;

use std::io;
use std::path::Path;

use sim::{BasePath, Command, Trajectory};

pub use spline::smooth;

/// The passive end of the tail, as published.
pub const MODEL: &str = include_str!("fish.xml");

/// The experiments of `docs/real-fish.md`, by file name.
pub const EXPERIMENTS: [(&str, &str); 3] = [
    ("published.toml", include_str!("published.toml")),
    ("paper.toml", include_str!("paper.toml")),
    ("ours.toml", include_str!("ours.toml")),
];

/// Nominal beats \[Hz\], as the files are called.
pub const RUNS: [&str; 8] = ["0_50", "0_75", "1_00", "1_25", "1_50", "1_75", "2_00", "2_25"];

/// Images a second, as the authors' program takes them.
const IMAGES_PER_S: f64 = 60.0;
/// Distance of the two markers on the head \[m\], measured by the authors: what makes metres of pixels.
const HEAD_M: f64 = 0.142;
/// Distances along the tail between the markers of its plates \[m\], from the published geometry: first to third, third to fourth, fourth to fifth.
const DRIVEN_M: f64 = 0.062;
const THIRD_TO_FOURTH_M: f64 = 0.029;
const FOURTH_TO_FIFTH_M: f64 = 0.021;
/// From the fifth plate's marker to the fin's \[m\].
const FIFTH_TO_FIN_M: f64 = 0.0625;
/// How much further the third plate is bent from the head than the line from the first one's marker to the third one's, as a share of that line's: by a
/// tendon 45, 35 and 25 mm off three equal hinges. The plates' turns are 45, 80 and 105 parts, the line's, by lengths of 15, 31 and 16 mm, 78.
const BEYOND_LINE: f64 = 105.0 / 77.97 - 1.0;
/// Distance of the knots of the smoothed paths \[s\]: 8 in the quickest beat.
const KNOTS_S: f64 = 0.09;
/// Rows of the tendon's table \[1/s\].
const SERVO_ROWS_PER_S: f64 = 240.0;
/// A run whose driven plates are seen in less than this share of the images says too little.
const LEAST_SEEN_SHARE: f64 = 0.8;

/// Markers by place: head, back, the tail's plates, fin.
const HEAD: [usize; 2] = [0, 1];
const BACK: usize = 2;
const PLATES: [usize; 5] = [3, 4, 5, 6, 7];
const FIN: usize = 8;
const MARKERS: usize = 9;

/// A run, ready.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// Path of the third plate of the tail.
    pub base: BasePath,
    /// The driven plates' bend, for both tendons.
    pub servo: Command,
    /// Markers of the fourth and fifth plates and of the fin: P1, P2, P3.
    pub trajectory: Trajectory,
    /// Images without each of them.
    pub gaps: [usize; 3],
}

/// Why a run is no use.
#[derive(Debug)]
pub struct Useless {
    /// Images that show the driven plates' markers apart, and images in all.
    pub usable_of_all: [usize; 2],
}

/// Where each marker is in each image, x to the right and z up \[m\], shape (images, 9).
pub fn markers(text: &str) -> io::Result<Vec<[[f64; 2]; MARKERS]>> {
    let wrong = |line: usize| {
        let reason = format!(
            "line {}: wanted are {} numbers, x and y of {MARKERS} markers in pixels",
            line + 1,
            2 * MARKERS
        );
        io::Error::new(io::ErrorKind::InvalidData, reason)
    };
    let mut images = Vec::new();
    for (line, row) in text.lines().enumerate() {
        let numbers: Vec<f64> = row
            .split(',')
            .map(|cell| cell.trim().parse())
            .collect::<Result<_, _>>()
            .map_err(|_| wrong(line))?;
        if numbers.len() != 2 * MARKERS || numbers.iter().any(|x| !x.is_finite()) {
            return Err(wrong(line));
        }
        // rows of a picture grow downward
        images.push(std::array::from_fn(|marker| [numbers[2 * marker], -numbers[2 * marker + 1]]));
    }
    let head: f64 =
        images.iter().map(|image: &[[f64; 2]; MARKERS]| distance(image[HEAD[0]], image[HEAD[1]])).sum();
    let metres_per_pixel = HEAD_M * images.len() as f64 / head;
    for image in &mut images {
        for place in image.iter_mut().flatten() {
            *place *= metres_per_pixel;
        }
    }
    Ok(images)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Whether two markers are about as far apart as they should be: trackers slip onto a neighbour.
fn apart(a: [f64; 2], b: [f64; 2], wanted_m: f64, share: f64) -> bool {
    (distance(a, b) / wanted_m - 1.0).abs() < share
}

/// Directions of lines from one marker to another, counter-clockwise from x, without jumps.
fn directions(images: &[[[f64; 2]; MARKERS]], from: usize, to: usize) -> Vec<f64> {
    let mut last: Option<f64> = None;
    let mut direction = |image: &[[f64; 2]; MARKERS]| {
        let raw = (image[to][1] - image[from][1]).atan2(image[to][0] - image[from][0]);
        let turns = last.map_or(0.0, |last| ((last - raw) / std::f64::consts::TAU).round());
        let on = raw + turns * std::f64::consts::TAU;
        last = Some(on);
        on
    };
    images.iter().map(&mut direction).collect()
}

/// Makes a run of the markers in `images`.
///
/// # Errors
/// [`Useless`] where the driven plates' markers lie on each other in too many images.
pub fn prepare(images: &[[[f64; 2]; MARKERS]]) -> Result<Prepared, Useless> {
    let time = |image: usize| image as f64 / IMAGES_PER_S;
    let [first, _, third, fourth, fifth] = PLATES;
    let driven: Vec<usize> =
        (0..images.len()).filter(|&k| apart(images[k][first], images[k][third], DRIVEN_M, 0.2)).collect();
    let useless = Useless { usable_of_all: [driven.len(), images.len()] };
    if (driven.len() as f64) < LEAST_SEEN_SHARE * images.len() as f64 {
        return Err(useless);
    }
    let (line, head) = (directions(images, first, third), directions(images, HEAD[1], BACK));
    let series = |value: &dyn Fn(usize) -> f64| -> (Vec<f64>, Vec<f64>) {
        driven.iter().map(|&k| (time(k), value(k))).unzip()
    };
    let rows: Vec<Vec<f64>> = {
        let bend = |k: usize| line[k] - head[k];
        let smoothed = |value: &dyn Fn(usize) -> f64| {
            let (at, values) = series(value);
            smooth(&at, &values, KNOTS_S)
        };
        let axes = [
            smoothed(&|k| images[k][third][0]),
            smoothed(&|k| images[k][third][1]),
            smoothed(&|k| line[k] + BEYOND_LINE * bend(k)),
            smoothed(&bend),
        ];
        let Some(knots) = axes[0].as_ref().map(|(knots, _)| knots.clone()) else { return Err(useless) };
        std::iter::once(knots).chain(axes.into_iter().flatten().map(|(_, values)| values)).collect()
    };
    let path = |columns: [usize; 3]| {
        let poses = (0..rows[0].len()).map(|row| columns.map(|column| rows[column][row]));
        BasePath::new(rows[0].clone(), poses.collect())
    };
    let (Ok(base), Ok(bend)) = (path([1, 2, 3]), path([4, 4, 4])) else { return Err(useless) };

    let (from_s, to_s) = (rows[0][0], rows[0][rows[0].len() - 1]);
    let servo_rows = ((to_s - from_s) * SERVO_ROWS_PER_S).floor() as usize;
    let servo_s: Vec<f64> = (0..=servo_rows).map(|row| from_s + row as f64 / SERVO_ROWS_PER_S).collect();
    let servo = Command {
        actuators: vec!["tendon3".into(), "tendon4".into()],
        angle_rad: servo_s.iter().flat_map(|&t| [-bend.at(t).pose[0]; 2]).collect(),
        time_s: servo_s,
    };
    let shown: Vec<usize> = (0..images.len()).filter(|&k| (from_s..=to_s).contains(&time(k))).collect();
    let (points, gaps) = passive(images, &shown, [third, fourth, fifth]);
    let trajectory = Trajectory {
        time_s: shown.iter().map(|&k| time(k)).collect(),
        keypoints: ["P1", "P2", "P3"].map(str::to_owned).to_vec(),
        position_m: points,
        std_m: None,
        pose_std_m: None,
    };
    Ok(Prepared { base, servo, trajectory, gaps })
}

/// The keypoints in the images `shown`, and how many are gaps: where a marker has slipped onto a neighbour. The fin's is put where it belongs
/// on the line to it, which is turned by what it is off on average: it stands higher than the others, and the camera looks at it aslant.
fn passive(
    images: &[[[f64; 2]; MARKERS]],
    shown: &[usize],
    [third, fourth, fifth]: [usize; 3],
) -> (Vec<[f64; 3]>, [usize; 3]) {
    let place = |[x, z]: [f64; 2]| [x, f64::NAN, z];
    let hidden = [f64::NAN; 3];
    let end_is_seen = |image: &[[f64; 2]; MARKERS]| {
        apart(image[third], image[fifth], THIRD_TO_FOURTH_M + FOURTH_TO_FIFTH_M, 0.25)
    };
    let fin_is_seen = |image: &[[f64; 2]; MARKERS]| {
        end_is_seen(image) && apart(image[fifth], image[FIN], 1.25 * FIFTH_TO_FIN_M, 0.3)
    };
    let (end, fin) = (directions(images, third, fifth), directions(images, fifth, FIN));
    let seen: Vec<usize> = shown.iter().copied().filter(|&k| fin_is_seen(&images[k])).collect();
    let aslant = seen.iter().map(|&k| (fin[k] - end[k]).sin()).sum::<f64>() / seen.len().max(1) as f64;
    let mut points = Vec::with_capacity(3 * shown.len());
    let mut gaps = [0; 3];
    for &k in shown {
        let image = &images[k];
        let fourth_is_seen = apart(image[third], image[fourth], THIRD_TO_FOURTH_M, 0.3)
            && apart(image[fourth], image[fifth], 1.2 * FOURTH_TO_FIFTH_M, 0.35);
        let (sin, cos) = (fin[k] - aslant.asin()).sin_cos();
        let tip = [image[fifth][0] + FIFTH_TO_FIN_M * cos, image[fifth][1] + FIFTH_TO_FIN_M * sin];
        let own =
            [(fourth_is_seen, image[fourth]), (end_is_seen(image), image[fifth]), (fin_is_seen(image), tip)];
        for (gap, (is_seen, at)) in gaps.iter_mut().zip(own) {
            *gap += usize::from(!is_seen);
            points.push(if is_seen { place(at) } else { hidden });
        }
    }
    (points, gaps)
}

/// Writes what `rig fit` reads of a run to files in `folder` whose names begin with `name`.
pub fn write(prepared: &Prepared, folder: &Path, name: &str) -> Result<(), ident::table::TableError> {
    ident::table::write_base(&folder.join(format!("{name}-base.csv")), &prepared.base)?;
    ident::table::write_command(&folder.join(format!("{name}-servo.csv")), &prepared.servo)?;
    ident::table::write_trajectory(&folder.join(format!("{name}.csv")), &prepared.trajectory)
}
