//! Keypoints from rendered pictures, whose truth is known.

use std::path::Path;

use ident::strict::{Finite, Positive};
use image::GrayImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rig::tank::render::{Look, Renderer};
use rig::vision::spline::{distance, moved};
use rig::vision::{
    Extraction, Mode, Plane, Px, Status, TimedImage, VisionConfig, extract_sequence,
};

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
    let image = |(i, grey)| TimedImage { name: format!("{i:03}"), time_s: i as f64 * 0.01, grey: Ok(grey) };
    images.into_iter().enumerate().map(image).collect()
}

fn extracted(images: Vec<GrayImage>, config: &VisionConfig) -> Extraction {
    extract_sequence(&timed(images), config, &plane(), Path::new(""), 2).unwrap()
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
    (0..60).map(|i| (f64::from(i) * std::f64::consts::TAU / 60.0).sin_cos()).map(|(s, c)| [centre[0] + radius * c, centre[1] + radius * s]).collect()
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
const POSES: usize = 15;

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
    let known = VisionConfig {
        link_lengths_m: Some(vec![metres(LENGTH_PX * METRES_PER_PIXEL); 3]),
        ..VisionConfig::new(3, Mode::Links)
    };
    let rows = [
        ("paper", VisionConfig::new(3, Mode::Paper), [14.0, 8.0]),
        ("arc", VisionConfig::new(3, Mode::Arc), [0.8, 6.0]),
        ("links, length free", VisionConfig::new(3, Mode::Links), [0.25, 0.25]),
        ("links, length known", known, [0.2, 0.2]),
    ];
    for (name, config, [ends, joints]) in rows {
        for bend_deg in [0.0f64, 40.0, 90.0] {
            let (mean, within) = mean_errors(&config, bend_deg.to_radians());
            println!(
                "{name:20} {bend_deg:3} deg: P0 {:.2}  P1 {:.2}  P2 {:.2}  P3 {:.2} px, {:.0} % within 95 % ellipse",
                mean[0], mean[1], mean[2], mean[3], 100.0 * within
            );
            assert!(mean[0] < ends && mean[3] < ends && mean[1] < joints && mean[2] < joints, "{name} {mean:?}");
        }
    }
}
