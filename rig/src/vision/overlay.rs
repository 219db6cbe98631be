//! Mask, centreline and keypoints drawn over the image they came from.

use image::{GrayImage, Rgb, RgbImage};

use super::Mask;
use super::record::{ImageRecord, Status};
use super::spline::{distance, moved, unit};
use crate::calibration::Px;

/// Rim of the silhouette.
const RIM_RGB: Rgb<u8> = Rgb([40, 200, 80]);
/// Centreline.
const CENTRELINE_RGB: Rgb<u8> = Rgb([255, 160, 0]);
/// P0 and Pn.
const END_RGB: Rgb<u8> = Rgb([230, 30, 30]);
/// P1..Pn-1.
const INNER_RGB: Rgb<u8> = Rgb([30, 220, 255]);
/// Rim of a silhouette that was rejected.
const REJECTED_RGB: Rgb<u8> = Rgb([220, 60, 220]);

/// `image` enlarged `zoom` times with what `record` found in it.
pub fn overlay(image: &GrayImage, record: &ImageRecord, zoom: u32) -> RgbImage {
    let zoom = zoom.max(1);
    let mut out = RgbImage::from_fn(image.width() * zoom, image.height() * zoom, |x, y| {
        let [grey] = image.get_pixel(x / zoom, y / zoom).0;
        Rgb([grey; 3])
    });
    if let Some(mask) = &record.mask {
        let colour = if record.status == Status::Rejected { REJECTED_RGB } else { RIM_RGB };
        draw_rim(&mut out, mask, zoom, colour);
    }
    for pair in record.centreline.windows(2) {
        draw_segment(&mut out, pair[0], pair[1], zoom, CENTRELINE_RGB);
    }
    for (i, keypoint) in record.keypoints.iter().enumerate() {
        if !keypoint.px.iter().all(|px| px.is_finite()) {
            continue;
        }
        let colour = if i == 0 || i + 1 == record.keypoints.len() { END_RGB } else { INNER_RGB };
        let radius = 1.0 + 0.6 * f64::from(zoom);
        let [x, y] = keypoint.px.map(|c| (c + 0.5) * f64::from(zoom));
        let reach = radius.ceil() as i64;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if (dx as f64).hypot(dy as f64) <= radius {
                    put(&mut out, x as i64 + dx, y as i64 + dy, colour);
                }
            }
        }
    }
    out
}

/// The sides of the silhouette's pixels that face the background.
fn draw_rim(out: &mut RgbImage, mask: &Mask, zoom: u32, colour: Rgb<u8>) {
    let z = i64::from(zoom);
    for (column, row) in mask.pixels() {
        let (x, y) = (column as isize, row as isize);
        for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
            if mask.at(x + dx, y + dy) {
                continue;
            }
            for k in 0..z {
                let (px, py) = match (dx, dy) {
                    (1, _) => (z - 1, k),
                    (-1, _) => (0, k),
                    (_, 1) => (k, z - 1),
                    _ => (k, 0),
                };
                put(out, x as i64 * z + px, y as i64 * z + py, colour);
            }
        }
    }
}

fn draw_segment(out: &mut RgbImage, a: Px, b: Px, zoom: u32, colour: Rgb<u8>) {
    let length = distance(a, b);
    let steps = (length * f64::from(zoom)).ceil() as usize;
    for i in 0..=steps {
        let [x, y] = moved(a, unit(a, b), length * i as f64 / steps.max(1) as f64);
        put(out, ((x + 0.5) * f64::from(zoom)) as i64, ((y + 0.5) * f64::from(zoom)) as i64, colour);
    }
}

fn put(out: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>) {
    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
        && let Some(pixel) = out.get_pixel_mut_checked(x, y)
    {
        *pixel = colour;
    }
}
