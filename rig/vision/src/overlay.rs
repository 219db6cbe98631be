//! Mask, centreline and keypoints drawn over the image they came from.

use image::imageops::{self, FilterType};
use image::{GrayImage, Rgb, RgbImage};

use super::Mask;
use super::record::{ImageRecord, Status};
use super::spline::{distance, moved, unit};
use camera::calibration::Px;

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
/// What a simulation does.
pub(super) const SIMULATED_RGB: Rgb<u8> = Rgb([90, 140, 255]);

/// A picture to draw on, `scale` of its pixels for one of the camera's.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) picture: RgbImage,
    scale: f64,
    /// Width of lines \[px\].
    pen: u8,
}

/// `image` enlarged `zoom` times with what `record` found in it.
pub fn overlay(image: &GrayImage, record: &ImageRecord, zoom: u32) -> RgbImage {
    let mut canvas = Canvas::enlarged(image, zoom);
    canvas.found(record);
    canvas.picture
}

impl Canvas {
    /// `image` with each pixel `zoom` times as large each way, at least once.
    pub(super) fn enlarged(image: &GrayImage, zoom: u32) -> Self {
        let zoom = zoom.max(1);
        let picture = RgbImage::from_fn(image.width() * zoom, image.height() * zoom, |x, y| {
            let [grey] = image.get_pixel(x / zoom, y / zoom).0;
            Rgb([grey; 3])
        });
        Self { picture, scale: f64::from(zoom), pen: 1 }
    }

    /// `image` made as large as fits into `width` by `height` pixels.
    pub(super) fn fitted(image: &GrayImage, width: u32, height: u32) -> Self {
        let [w, h] = [image.width(), image.height()].map(|side| f64::from(side.max(1)));
        let scale = (f64::from(width) / w).min(f64::from(height) / h);
        let side = |side: f64| ((side * scale).round() as u32).max(1);
        let grey = imageops::resize(image, side(w), side(h), FilterType::Triangle);
        Self {
            picture: RgbImage::from_fn(grey.width(), grey.height(), |x, y| {
                Rgb([grey.get_pixel(x, y).0[0]; 3])
            }),
            scale,
            pen: 1,
        }
    }

    /// The same with lines of another width.
    pub(super) fn with_pen(self, pen: u8) -> Self {
        Self { pen, ..self }
    }

    /// Draws straight lines between the keypoints, where the middle line is not known any more.
    pub(super) fn links(&mut self, record: &ImageRecord) {
        let points: Vec<Px> = record.keypoints.iter().map(|keypoint| keypoint.px).collect();
        self.line(&points, CENTRELINE_RGB);
    }

    /// Draws what `record` found: the silhouette's rim, the middle line, the keypoints.
    pub(super) fn found(&mut self, record: &ImageRecord) {
        if let Some(mask) = &record.mask {
            let colour = if record.status == Status::Rejected { REJECTED_RGB } else { RIM_RGB };
            self.rim(mask, colour);
        }
        self.line(&record.centreline, CENTRELINE_RGB);
        for (i, keypoint) in record.keypoints.iter().enumerate() {
            if !keypoint.px.iter().all(|px| px.is_finite()) {
                continue;
            }
            let colour = if i == 0 || i + 1 == record.keypoints.len() { END_RGB } else { INNER_RGB };
            let radius = (1.0 + 0.6 * self.scale.max(2.0)) * f64::from(self.pen);
            self.ring(keypoint.px, 0.0, radius, colour);
        }
    }

    /// Draws a line through `points`.
    pub(super) fn line(&mut self, points: &[Px], colour: Rgb<u8>) {
        for pair in points.windows(2) {
            self.segment(pair[0], pair[1], colour);
        }
    }

    /// Fills what is between two distances from `centre`, which are in pixels of the drawing.
    pub(super) fn ring(&mut self, centre: Px, inner: f64, outer: f64, colour: Rgb<u8>) {
        let [x, y] = self.place(centre);
        let reach = outer.ceil() as i32;
        for dy in (-reach..=reach).map(f64::from) {
            for dx in (-reach..=reach).map(f64::from) {
                if (inner..=outer).contains(&dx.hypot(dy)) {
                    self.put([x + dx, y + dy], colour);
                }
            }
        }
    }

    /// The sides of the silhouette's pixels that face the background, drawn inside of it.
    fn rim(&mut self, mask: &Mask, colour: Rgb<u8>) {
        let (near, far) = (-0.5 + 0.5 / self.scale, 0.5 - 0.5 / self.scale);
        for (column, row) in mask.pixels() {
            for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                if mask.at(column as isize + dx, row as isize + dy) {
                    continue;
                }
                let end = |along: f64| match (dx, dy) {
                    (1, _) => [far, along],
                    (-1, _) => [near, along],
                    (_, 1) => [along, far],
                    _ => [along, near],
                };
                let [a, b] = [near, far].map(|along| {
                    let [x, y] = end(along);
                    [column as f64 + x, row as f64 + y]
                });
                self.segment(a, b, colour);
            }
        }
    }

    fn segment(&mut self, a: Px, b: Px, colour: Rgb<u8>) {
        /// No picture is larger: keeps what is not in it from taking for ever \[px\].
        const MOST_STEPS: f64 = 65_536.0;
        let length = distance(a, b);
        let steps = (length * self.scale).ceil().min(MOST_STEPS) as usize;
        for i in 0..=steps {
            let along = length * i as f64 / steps.max(1) as f64;
            let at = if length > 0.0 { moved(a, unit(a, b), along) } else { a };
            let [x, y] = self.place(at);
            let pen = i16::from(self.pen);
            let width = (1 - pen) / 2..=pen / 2;
            for dx in width.clone() {
                for dy in width.clone() {
                    self.put([x + f64::from(dx), y + f64::from(dy)], colour);
                }
            }
        }
    }

    /// Where on the drawing the camera's place `px` is.
    fn place(&self, px: Px) -> [f64; 2] {
        px.map(|c| ((c + 0.5) * self.scale).floor())
    }

    fn put(&mut self, [x, y]: [f64; 2], colour: Rgb<u8>) {
        let [width, height] = [self.picture.width(), self.picture.height()].map(f64::from);
        if (0.0..width).contains(&x) && (0.0..height).contains(&y) {
            self.picture.put_pixel(x as u32, y as u32, colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Keypoint;
    use crate::keypoints::Sigma;
    use camera::calibration::Plane;

    /// A bar from (4, 2) to (6, 9) with its middle line and both ends.
    fn record(status: Status) -> ImageRecord {
        let mut mask = Mask::empty(4, 2, 3, 8);
        mask.bits.fill(true);
        let plane = Plane::square(0.001, [0.0, 0.0]);
        ImageRecord {
            name: "a".into(),
            time_s: 0.0,
            status,
            reason: String::new(),
            keypoints: [[5.0, 2.0], [5.0, 9.0]]
                .map(|px| Keypoint::seen(px, Sigma::untold(0.1), &plane))
                .to_vec(),
            mask: Some(mask),
            centreline: vec![[5.0, 2.0], [5.0, 9.0]],
        }
    }

    #[test]
    fn what_was_found_lies_where_it_was_found_at_any_scale() {
        let image = GrayImage::from_pixel(12, 14, image::Luma([100]));
        let grey = Rgb([100; 3]);
        for zoom in [2, 4, 7] {
            let drawn = overlay(&image, &record(Status::Ok), zoom);
            assert_eq!(drawn.dimensions(), (12 * zoom, 14 * zoom));
            let of_pixel = |x: u32, y: u32| drawn.get_pixel(x * zoom, y * zoom + zoom / 2);
            assert_eq!(of_pixel(4, 5), &RIM_RGB, "{zoom}");
            assert_eq!(of_pixel(3, 5), &grey);
            assert_eq!(drawn.get_pixel(7 * zoom - 1, 5 * zoom), &RIM_RGB);
            assert_eq!(drawn.get_pixel(5 * zoom + zoom / 2, 5 * zoom + zoom / 2), &CENTRELINE_RGB);
            assert_eq!(drawn.get_pixel(5 * zoom + zoom / 2, 9 * zoom + zoom / 2), &END_RGB);
        }
        let rejected = overlay(&image, &record(Status::Rejected), 4);
        assert!(rejected.pixels().any(|p| *p == REJECTED_RGB) && !rejected.pixels().any(|p| *p == RIM_RGB));
    }

    #[test]
    fn fitted_picture_keeps_its_shape_and_what_lies_outside_of_it_is_left_out() {
        let image = GrayImage::from_pixel(120, 140, image::Luma([100]));
        let mut canvas = Canvas::fitted(&image, 60, 60);
        assert_eq!(canvas.picture.dimensions(), (51, 60));
        // The keypoints' dots would cover the rim of something so small.
        canvas.found(&ImageRecord { keypoints: Vec::new(), ..record(Status::Ok) });
        assert!(canvas.picture.pixels().any(|p| *p == RIM_RGB));
        let before = canvas.picture.clone();
        canvas.line(&[[-1e12, -50.0], [-1e12, 1e12]], END_RGB);
        canvas.ring([f64::NAN, f64::INFINITY], 0.0, 3.0, RIM_RGB);
        canvas.ring([-500.0, 1e300], 0.0, 3.0, RIM_RGB);
        assert!(
            canvas.picture.enumerate_pixels().filter(|(x, y, p)| before.get_pixel(*x, *y) != *p).count() < 30
        );
        assert_eq!(Canvas::fitted(&GrayImage::new(0, 0), 9, 9).picture.dimensions(), (9, 9));
    }
}
