//! Keypoints from rendered pictures, whose truth is known.

use std::path::Path;

use camera::calibration::{Plane, Px};
use ground::strict::{Finite, Positive};
use image::GrayImage;
use images::{SourceError, TimedImage};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tank::render::{Look, Renderer};
use vision::spline::{distance, moved};
use vision::{Extraction, Mask, Mode, SequenceError, Status, StoredRecord, Task, VisionConfig};

const SIDE_PX: u32 = 480;
/// Sensor noise of all renders, 1 sigma \[grey levels of 255\].
const NOISE_GREY: f64 = 6.0;
/// One pixel is one millimetre, so that metres are easy to read.
const METRES_PER_PIXEL: f64 = 0.001;

fn plane() -> Plane {
    Plane::square(METRES_PER_PIXEL, [0.0, 0.0])
}

fn noisy(mut image: GrayImage, seed: u64) -> GrayImage {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for pixel in image.iter_mut() {
        let noise: f64 = StandardNormal.sample(&mut random);
        *pixel = (f64::from(*pixel) + NOISE_GREY * noise).round().clamp(0.0, 255.0) as u8;
    }
    image
}

fn timed(images: Vec<GrayImage>) -> Vec<TimedImage> {
    let image = |(i, grey)| TimedImage {
        name: format!("{i:03}"),
        time_s: i as f64 * 0.01,
        chroma: None,
        grey: Ok(grey),
    };
    images.into_iter().enumerate().map(image).collect()
}

fn sequence(
    images: &[TimedImage],
    config: &VisionConfig,
    plane: &Plane,
    folder: &Path,
) -> Result<Extraction, SequenceError> {
    Task::new(config, None, plane.clone(), folder)?.extract(images, |_, _| Ok(()))
}

fn extracted(images: Vec<GrayImage>, config: &VisionConfig) -> Extraction {
    sequence(&timed(images), config, &plane(), Path::new("")).unwrap()
}

/// P0..P3 of three links of `length` pixels, the first at `angle` to the picture's right, each next one turned
/// by `bend`; counter-clockwise as seen, rows growing downward.
fn pivots(base: Px, length: f64, angle: f64, bend: f64) -> Vec<Px> {
    let mut points = vec![base];
    for i in 0..3 {
        let (sin, cos) = (angle + bend * f64::from(i)).sin_cos();
        points.push(moved(points[i as usize], [cos, -sin], length));
    }
    points
}

/// A bar of half width `half` from `a` to `b`.
fn bar(a: Px, b: Px, half: f64) -> Vec<Px> {
    let length = distance(a, b);
    let normal = [-(b[1] - a[1]) / length, (b[0] - a[0]) / length];
    vec![moved(a, normal, half), moved(b, normal, half), moved(b, normal, -half), moved(a, normal, -half)]
}

fn disc(centre: Px, radius: f64) -> Vec<Px> {
    (0..60)
        .map(|i| (f64::from(i) * std::f64::consts::TAU / 60.0).sin_cos())
        .map(|(s, c)| [centre[0] + radius * c, centre[1] + radius * s])
        .collect()
}

/// Bars from pivot to pivot with round knuckles: the shape on which the figures of the literature notes stand.
fn chain(points: &[Px], half: f64) -> Vec<Vec<Px>> {
    let bars = points.windows(2).map(|p| bar(p[0], p[1], half));
    bars.chain(points[1..points.len() - 1].iter().map(|p| disc(*p, half))).collect()
}

fn metres(value: f64) -> Positive {
    Positive::new(value).unwrap()
}

fn finite(px: Px) -> [Finite; 2] {
    px.map(|v| Finite::new(v).unwrap())
}

const LENGTH_PX: f64 = 110.0;
const HALF_PX: f64 = 11.0;
const POSES: usize = 9;

/// Mean error of P0..P3 over many poses of one bend, and the share of errors within two stated sigmas \[px\].
fn mean_errors(config: &VisionConfig, bend: f64) -> ([f64; 4], f64) {
    let renderer = Renderer::new(plane(), Look::plain(SIDE_PX, SIDE_PX));
    let (mut sums, mut within, mut count) = ([0.0; 4], 0.0, 0.0);
    for pose in 0..POSES {
        let angle = 0.41 * pose as f64;
        let shape = pivots([0.0, 0.0], LENGTH_PX, angle, bend);
        let middle = [0, 1].map(|axis| shape.iter().map(|p| p[axis]).sum::<f64>() / 4.0);
        let offset = [240.3 + 0.37 * pose as f64 - middle[0], 239.1 + 0.61 * pose as f64 - middle[1]];
        let truth: Vec<Px> = shape.iter().map(|p| [p[0] + offset[0], p[1] + offset[1]]).collect();
        let mut config = config.clone();
        config.base_px = Some(finite(truth[0]));
        let image = noisy(renderer.draw_polygons(&chain(&truth, HALF_PX)), 100 + pose as u64);
        let found = extracted(vec![image], &config);
        let record = &found.records[0];
        assert_ne!(record.status, Status::Rejected, "pose {pose}: {}", record.reason);
        for (i, (keypoint, truth)) in record.keypoints.iter().zip(&truth).enumerate() {
            let off = distance(keypoint.px, *truth);
            sums[i] += off / POSES as f64;
            // Both axes together: 2.45 sigma hold 95 % of a round normal distribution.
            within += f64::from(off < 2.45 * keypoint.std_px);
            count += 1.0;
        }
    }
    (sums, within / count)
}

#[test]
fn rigid_links_are_found_to_a_tenth_of_a_pixel_where_shares_of_the_length_are_not() {
    // Square ends at the pivots: with lengths free, a straight chain could as well be shorter and reach past them.
    let links = VisionConfig {
        overhang_m: ground::strict::NonNegative::new(0.0),
        end_rounding: ground::strict::Share::new(0.0),
        ..VisionConfig::new(3, Mode::Links)
    };
    let known =
        VisionConfig { link_lengths_m: Some(vec![metres(LENGTH_PX * METRES_PER_PIXEL); 3]), ..links.clone() };
    let end_to_end =
        VisionConfig { end_inset: ground::strict::NonNegative::new(0.0), ..VisionConfig::new(3, Mode::Arc) };
    let rows = [
        ("paper", VisionConfig::new(3, Mode::Paper), [14.0, 8.0]),
        ("arc", end_to_end, [0.8, 6.0]),
        ("links, length free", links, [0.25, 0.25]),
        ("links, length known", known, [0.2, 0.2]),
    ];
    for (name, config, [ends, joints]) in rows {
        for bend_deg in [0.0f64, 40.0, 90.0] {
            let (mean, within) = mean_errors(&config, bend_deg.to_radians());
            println!(
                "{name:20} {bend_deg:3} deg: P0 {:.2}  P1 {:.2}  P2 {:.2}  P3 {:.2} px, {:.0} % within 95 % ellipse",
                mean[0],
                mean[1],
                mean[2],
                mean[3],
                100.0 * within
            );
            assert!(
                mean[0] < ends && mean[3] < ends && mean[1] < joints && mean[2] < joints,
                "{name} {mean:?}"
            );
        }
    }
}

/// What nobody has said of the links' ends is told by the images where they can, and where they cannot the keypoints' sigmas say so.
#[test]
fn ends_of_links_that_nobody_has_stated_are_estimated_or_doubted() {
    let renderer = Renderer::new(tank_plane(), Look::plain(640, 480));
    let (swinging, truth) = swing(&renderer, 12);
    let config = VisionConfig { overhang_m: None, end_rounding: None, ..chain_config() };
    let found = sequence(&timed(swinging), &config, &tank_plane(), Path::new("")).unwrap();
    let learned = |key: &str| found.learned.iter().find(|learned| learned.key == key).unwrap();
    let (overhang, rounding) = (learned("overhang_m"), learned("end_rounding"));
    println!("{overhang:?} {rounding:?}");
    assert!((overhang.value - 0.0025).abs() < 3.0 * overhang.std && overhang.std < 5e-5, "{overhang:?}");
    assert_eq!(rounding.value, 0.0);
    for (record, truth) in found.records.iter().zip(&truth) {
        for (keypoint, truth) in record.keypoints.iter().zip(truth) {
            assert!(distance(keypoint.metres, *truth) < 1e-4, "{:?} {truth:?}", keypoint.metres);
        }
    }

    let straight = VisionConfig { overhang_m: None, ..VisionConfig::new(3, Mode::Links) };
    let (mean, within) = mean_errors(&straight, 0.0);
    assert!(within > 0.9, "{mean:?} are not within what is said of them: {within}");
}

/// The three-link mechanism of the shipped experiments: links of 30 mm overlapping by 5 mm, P0 at the motor.
const CHAIN: &str = "<mujoco><default><geom type='box' size='0.005 0.0025 0.015' pos='0 0 -0.0125' density='1240'/></default>
  <worldbody><body name='l1'><joint name='q1' axis='0 -1 0'/><geom name='g1'/><site name='P0'/><site name='P1' pos='0 0 -0.025'/>
    <body name='l2' pos='0 0 -0.025'><joint name='q2' axis='0 -1 0'/><geom name='g2'/><site name='P2' pos='0 0 -0.025'/>
      <body name='l3' pos='0 0 -0.025'><joint name='q3' axis='0 -1 0'/><geom name='g3'/><site name='P3' pos='0 0 -0.0275'/></body>
    </body></body></worldbody></mujoco>";

/// The tank's camera: 0.25 mm a pixel.
fn tank_plane() -> Plane {
    Plane::square(0.00025, [320.0, 60.0])
}

fn chain_config() -> VisionConfig {
    VisionConfig {
        link_lengths_m: Some([0.025, 0.025, 0.0275].map(metres).to_vec()),
        overhang_m: ground::strict::NonNegative::new(0.0025),
        base_px: Some(finite([320.0, 60.0])),
        ..VisionConfig::new(3, Mode::Links)
    }
}

/// A swing of the chain: image `i` of `n`, and where its keypoints are \[m\].
fn swing(renderer: &Renderer, n: usize) -> (Vec<GrayImage>, Vec<Vec<[f64; 2]>>) {
    let model = sim::Model::from_mjcf(CHAIN).unwrap();
    let mut images = Vec::new();
    let mut truth = Vec::new();
    for i in 0..n {
        // The first fifth stands still, as before any run.
        let phase = (i as f64 / n as f64 - 0.2).max(0.0) * 9.0;
        let qpos = [0.5 * phase.sin() + 0.2, 0.7 * (1.3 * phase).sin() - 0.1, 0.6 * (0.7 * phase).sin()];
        images.push(noisy(renderer.draw(&model, &qpos), i as u64));
        let poses = model.poses(&qpos);
        truth.push(
            model.keypoint_sites().iter().map(|s| poses.site_pos[*s].0).map(|[x, _, z]| [x, z]).collect(),
        );
    }
    (images, truth)
}

fn bracket() -> Vec<Vec<Px>> {
    let rectangle = |x0: f64, y0: f64, x1: f64, y1: f64| vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    vec![rectangle(250.0, 0.0, 390.0, 62.0), disc([560.0, 400.0], 9.0), disc([80.0, 380.0], 7.0)]
}

fn errors(found: &Extraction, truth: &[Vec<[f64; 2]>]) -> Vec<f64> {
    let mut sums = vec![0.0; truth[0].len()];
    for (record, truth) in found.records.iter().zip(truth) {
        assert_eq!(record.status, Status::Ok, "{}: {}", record.name, record.reason);
        for ((sum, keypoint), truth) in sums.iter_mut().zip(&record.keypoints).zip(truth) {
            *sum += distance(keypoint.metres, *truth) / found.records.len() as f64;
        }
    }
    sums
}

#[test]
fn mechanism_at_its_bracket_is_followed_and_its_hidden_pivot_inferred() {
    let folder = tempfile::tempdir().unwrap();
    let look = Look { scenery: bracket(), falloff: 0.3, ..Look::plain(640, 480) };
    let renderer = Renderer::new(tank_plane(), look);
    renderer.static_mask(4).save(folder.path().join("static.png")).unwrap();
    let config = VisionConfig { static_mask: Some("static.png".into()), ..chain_config() };
    let (images, truth) = swing(&renderer, 40);
    let images = timed(images);
    let started = std::time::Instant::now();
    let found = sequence(&images, &config, &tank_plane(), folder.path()).unwrap();
    let mean = errors(&found, &truth);
    let std = found.records[0].keypoints.iter().map(|k| k.std_m * 1e6).collect::<Vec<_>>();
    println!(
        "hidden base: mean error {:?} um, stated sigma {std:.0?} um; {:.1} ms an image on one thread, learning included",
        mean.iter().map(|e| (e * 1e6).round()).collect::<Vec<_>>(),
        started.elapsed().as_secs_f64() * 1e3 / images.len() as f64
    );
    // A tenth of a pixel.
    assert!(mean.iter().all(|e| *e < 25e-6), "{mean:?}");
}

#[test]
fn background_is_learnt_around_a_mechanism_that_hardly_moves_or_never() {
    for (moving, scenery) in [(true, bracket()), (false, Vec::new())] {
        let look = Look {
            scenery: scenery[..scenery.len().min(3)].iter().skip(1).cloned().collect(),
            ..Look::plain(640, 480)
        };
        let renderer = Renderer::new(tank_plane(), look);
        let (mut images, mut truth) = swing(&renderer, 30);
        if !moving {
            images.truncate(6);
            truth.truncate(6);
        }
        let found = sequence(&timed(images), &chain_config(), &tank_plane(), Path::new("")).unwrap();
        let mean = errors(&found, &truth);
        println!("moving {moving}: {mean:?} m");
        assert!(mean.iter().all(|e| *e < 25e-6), "{mean:?}");
    }
}

#[test]
fn positive_angle_turns_counter_clockwise_in_the_picture_and_up_is_positive() {
    let model = sim::Model::from_mjcf(CHAIN).unwrap();
    let renderer = Renderer::new(tank_plane(), Look::plain(640, 480));
    let image = noisy(renderer.draw(&model, &[0.5, 0.0, 0.0]), 1);
    let found = sequence(&timed(vec![image]), &chain_config(), &tank_plane(), Path::new("")).unwrap();
    let [x, y, z] = found.trajectory.at(0, 3);
    // Hanging down and turned counter-clockwise the tip goes to the right and stays below the pivot.
    assert!((x - 0.0775 * 0.5f64.sin()).abs() < 1e-4 && (z + 0.0775 * 0.5f64.cos()).abs() < 1e-4, "{x} {z}");
    assert!(y.is_nan());
}

#[test]
fn tapered_arm_is_followed_between_its_edges_to_its_tip() {
    let renderer = Renderer::new(plane(), Look::plain(SIDE_PX, SIDE_PX));
    let (mut squared, mut worst, mut tips, mut count) = (0.0, 0.0f64, 0.0, 0.0);
    for pose in 0..POSES {
        // An arc of varying curvature, 13 px to 2.5 px half width.
        let (mut at, mut angle): (Px, f64) = ([90.0 + 1.7 * pose as f64, 120.0], 0.3);
        let mut line = vec![at];
        let turn = 0.0015 * pose as f64;
        for i in 0..360 {
            angle += turn * (1.0 - f64::from(i) / 120.0);
            at = moved(at, [angle.cos(), angle.sin()], 1.0);
            line.push(at);
        }
        let half = |i: usize| 13.0 - 10.5 * i as f64 / 360.0;
        let pieces: Vec<Vec<Px>> = (0..360)
            .map(|i| {
                let across = |k: usize| {
                    let (a, b) = (line[k.saturating_sub(1)], line[(k + 1).min(360)]);
                    let length = distance(a, b);
                    [-(b[1] - a[1]) / length, (b[0] - a[0]) / length]
                };
                let (n, m) = (across(i), across(i + 1));
                let (h, k) = (half(i), half(i + 1));
                vec![
                    moved(line[i], n, h),
                    moved(line[i + 1], m, k),
                    moved(line[i + 1], m, -k),
                    moved(line[i], n, -h),
                ]
            })
            .collect();
        let config = VisionConfig { base_px: Some(finite(line[0])), ..VisionConfig::new(2, Mode::Arc) };
        let found = extracted(vec![noisy(renderer.draw_polygons(&pieces), pose as u64)], &config);
        let record = &found.records[0];
        assert_eq!(record.status, Status::Ok, "{pose}: {}", record.reason);
        tips += distance(record.keypoints[2].px, line[360]) / POSES as f64;
        for p in &record.centreline {
            let off = line.windows(2).map(|s| to_segment(*p, s[0], s[1])).fold(f64::INFINITY, f64::min);
            squared += off * off;
            worst = worst.max(off);
            count += 1.0;
        }
    }
    let rms = f64::sqrt(squared / count);
    println!("tapered arm: rms {rms:.3} px, worst {worst:.2} px, tip {tips:.2} px");
    assert!(rms < 0.1 && worst < 1.5 && tips < 0.6);
}

fn to_segment(p: Px, a: Px, b: Px) -> f64 {
    let length = distance(a, b);
    let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    let s = ((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]).clamp(0.0, length);
    distance(p, moved(a, along, s))
}

#[test]
fn specks_and_a_bright_mechanism_change_nothing() {
    let look = Look { water: 60.0, mechanism: 190.0, ..Look::plain(640, 480) };
    let renderer = Renderer::new(tank_plane(), look);
    let (mut images, truth) = swing(&renderer, 20);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for image in &mut images {
        for _ in 0..200 {
            let mut place = |size: u32| {
                let z: f64 = StandardNormal.sample(&mut random);
                ((z * 0.3 + 0.5).clamp(0.0, 0.999) * f64::from(size)) as u32
            };
            let (x, y) = (place(640), place(480));
            image.put_pixel(x, y, image::Luma([if (x + y) % 2 == 0 { 255 } else { 0 }]));
        }
    }
    let found = sequence(&timed(images), &chain_config(), &tank_plane(), Path::new("")).unwrap();
    let mean = errors(&found, &truth);
    println!("specks: {mean:?} m");
    assert!(mean.iter().all(|e| *e < 50e-6), "{mean:?}");
}

#[test]
fn a_mechanism_that_touches_itself_or_is_half_gone_is_a_row_of_gaps() {
    let renderer = Renderer::new(plane(), Look::plain(SIDE_PX, SIDE_PX));
    let base = [200.0, 120.0];
    let open = chain(&pivots(base, LENGTH_PX, -0.4, 0.5), HALF_PX);
    let closed = chain(&pivots(base, LENGTH_PX, -0.4, std::f64::consts::TAU / 3.0), HALF_PX);
    // The ends leave a gap of 1.5 px, which two blurred edges bridge.
    let near = chain(&pivots(base, LENGTH_PX, -0.4, std::f64::consts::TAU / 3.0 - 0.11), HALF_PX);
    let half: Vec<Vec<Px>> = open[..2].to_vec();
    let images = [&open, &open, &open, &closed, &half, &open, &near]
        .map(|shape| noisy(renderer.draw_polygons(shape), 3));
    let empty = noisy(renderer.draw_polygons(&[]), 4);
    let config = VisionConfig { base_px: Some(finite(base)), ..VisionConfig::new(3, Mode::Arc) };
    let images: Vec<_> = images.into_iter().chain([empty]).collect();
    let found = extracted(images, &config);
    let status: Vec<Status> = found.records.iter().map(|r| r.status).collect();
    use Status::{Ok, Rejected};
    assert_eq!(status, [Ok, Ok, Ok, Rejected, Rejected, Ok, Rejected, Rejected]);
    for row in [3, 4, 6, 7] {
        assert!((0..4).all(|k| found.trajectory.at(row, k).iter().all(|v| v.is_nan())));
        assert!(!found.records[row].reason.is_empty());
    }
    assert!(found.records[6].reason.contains("nearly touches itself"), "{}", found.records[6].reason);
}

#[test]
fn images_without_anything_in_them_are_an_error_that_says_so() {
    let renderer = Renderer::new(plane(), Look::plain(SIDE_PX, SIDE_PX));
    let empty = timed(vec![noisy(renderer.draw_polygons(&[]), 4)]);
    let error = sequence(&empty, &VisionConfig::new(3, Mode::Arc), &plane(), Path::new("")).unwrap_err();
    let said = ground::error_chain::with_causes(&error);
    assert!(said.contains("background"), "{said}");
}

#[test]
fn result_depends_neither_on_threads_nor_on_how_images_are_handed_over() {
    let renderer = Renderer::new(tank_plane(), Look::plain(640, 480));
    let images = timed(swing(&renderer, 12).0);
    let config = chain_config();
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| sequence(&images, &config, &tank_plane(), Path::new(""))).unwrap()
    };
    let (whole, threads) = (by(1), by(3));
    let mut live = Task::new(&config, None, tank_plane(), Path::new("")).unwrap().learn(&images).unwrap();
    let mut one_by_one = images.iter().cloned().map(Ok::<_, SourceError>);
    while live.take(&mut one_by_one, 1).unwrap().is_some() {}
    let live = Extraction::of(live.records().to_vec(), 3, tank_plane());
    assert_eq!(bits(&whole), bits(&threads));
    assert_eq!(bits(&whole), bits(&live));
}

/// Positions as bits: NaN is equal to itself.
fn bits(e: &Extraction) -> Vec<[u64; 3]> {
    e.trajectory.position_m.iter().map(|p| p.map(f64::to_bits)).collect()
}

#[test]
fn extraction_starts_again_from_its_stored_silhouettes_or_keypoints_with_the_same_result() {
    let look = Look { scenery: bracket()[1..].to_vec(), ..Look::plain(640, 480) };
    let renderer = Renderer::new(tank_plane(), look);
    let mut images = swing(&renderer, 12).0;
    images.push(noisy(renderer.draw_polygons(&[]), 7));
    let images = timed(images);
    let free = VisionConfig { base_px: None, ..VisionConfig::new(3, Mode::Arc) };
    for config in [chain_config(), free] {
        let whole = sequence(&images, &config, &tank_plane(), Path::new("")).unwrap();
        assert_eq!(whole.count(Status::Ok), 12);
        let stored: Vec<String> = whole
            .records
            .iter()
            .map(|record| serde_json::to_string(&StoredRecord::from(record)).unwrap())
            .collect();
        let stored: Vec<StoredRecord> =
            stored.iter().map(|text| serde_json::from_str(text).unwrap()).collect();

        let masks: Vec<Option<Mask>> = stored.iter().map(|record| record.mask.clone()).collect();
        let mut task =
            Task { masks: Some(masks), ..Task::new(&config, None, tank_plane(), Path::new("")).unwrap() };
        let mut again = task.learn(&images).unwrap();
        let mut source = images.iter().cloned().map(Ok::<_, SourceError>);
        again.take(&mut source, images.len()).unwrap();
        for (again, before) in again.records().iter().zip(&whole.records) {
            assert_eq!(
                (again.status, &again.reason, &again.mask),
                (before.status, &before.reason, &before.mask)
            );
        }
        assert_eq!(bits(&Extraction::of(again.records().to_vec(), 3, tank_plane())), bits(&whole));

        let records = stored.into_iter().map(|record| record.record(&tank_plane())).collect();
        assert_eq!(bits(&Extraction::of(records, 3, tank_plane())), bits(&whole));
    }
}

#[test]
fn without_a_base_images_are_refused_while_another_object_is_at_the_border() {
    let renderer = Renderer::new(plane(), Look::plain(SIDE_PX, SIDE_PX));
    let arm = |i: usize| chain(&pivots([200.0 + i as f64, 150.0], LENGTH_PX, -0.4, 0.3), HALF_PX);
    // Radius of a disc centred on the border, and whether its image is refused.
    let visit = [(0.0, false), (3.0, false), (12.0, true), (5.0, true), (0.0, false), (5.0, false)];
    let images = visit.iter().enumerate().map(|(i, (radius, _))| {
        let mut shapes = arm(i);
        if *radius > 0.0 {
            shapes.push(disc([0.0, 400.0], *radius));
        }
        noisy(renderer.draw_polygons(&shapes), i as u64)
    });
    let images: Vec<GrayImage> = images.collect();
    // The object would be part of a background learnt from so few images.
    let config =
        VisionConfig { background: vision::config::Background::Flat, ..VisionConfig::new(2, Mode::Arc) };
    let refused = |e: &Extraction| e.records.iter().map(|r| r.status == Status::Rejected).collect::<Vec<_>>();
    let found = extracted(images.clone(), &config);
    assert_eq!(refused(&found), visit.map(|(_, refused)| refused));
    assert!(found.records[2].reason.contains("another object"), "{}", found.records[2].reason);
    assert_eq!(found.records[4].status, Status::Ok, "{}", found.records[4].reason);

    let anchored = VisionConfig { base_px: Some(finite([200.0, 150.0])), ..config };
    let found = extracted(images, &anchored);
    assert_eq!(refused(&found), [false; 6]);
}

#[test]
fn rendering_is_quick_enough_for_a_camera_of_100_images_a_second() {
    let model = sim::Model::from_mjcf(CHAIN).unwrap();
    let renderer =
        Renderer::new(tank_plane(), Look { scenery: bracket(), falloff: 0.3, ..Look::plain(640, 480) });
    // The best of many: other work on the machine only ever adds.
    let best = (0..50)
        .map(|i| {
            let started = std::time::Instant::now();
            std::hint::black_box(renderer.draw(&model, &[0.02 * f64::from(i), 0.5, 0.5]));
            started.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    println!("rendering 640x480: {:.2} ms", best * 1e3);
    assert!(best < 0.003, "{best}");
}
