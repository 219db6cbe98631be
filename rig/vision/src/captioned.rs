//! An image with what was found in it, what a simulation does, its status and time: one picture of a film to be looked at.

use image::{GrayImage, Rgb, RgbImage, imageops};

use super::overlay::{Canvas, SIMULATED_RGB};
use super::record::{ImageRecord, Status};
use crate::lettering::{self, Size};
use camera::calibration::Px;
use camera::source::TimedImage;

/// Small pictures are enlarged to at least this width \[px\]: lines a pixel wide hardly survive a film's compression.
const LEAST_WIDTH_PX: u32 = 960;
/// Width of the lines of what was found \[px\].
const PEN_PX: u8 = 2;
/// Around the words \[px\].
const MARGIN_PX: u32 = 8;
/// Lines that a reason may take.
const REASON_LINES: u32 = 2;

const STRIP: Rgb<u8> = Rgb([18, 22, 28]);
const INK: Rgb<u8> = Rgb([230, 234, 240]);
const OK: Rgb<u8> = Rgb([127, 214, 160]);
const DOUBTFUL: Rgb<u8> = Rgb([240, 197, 106]);
const REJECTED: Rgb<u8> = Rgb([255, 154, 144]);
/// Where an image is that cannot be shown.
const BLANK: u8 = 60;

/// Draws the pictures of one film, all of one size.
#[derive(Debug)]
pub struct Captioned {
    image_px: [u32; 2],
    zoom: u32,
}

impl Captioned {
    /// For images of this width and height \[px\].
    pub fn new(image_px: [u32; 2]) -> Self {
        Self { image_px, zoom: LEAST_WIDTH_PX.div_ceil(image_px[0].max(1)).clamp(1, 16) }
    }

    /// Width and height of its pictures \[px\].
    pub fn size_px(&self) -> [u32; 2] {
        let [width, height] = self.image_px.map(|side| side * self.zoom);
        [width, height + strip_px()]
    }

    /// One picture; `simulated` is where a simulation has the keypoints \[px\], from the base, where it is known.
    pub fn picture(&self, image: &TimedImage, record: &ImageRecord, simulated: Option<&[Px]>) -> RgbImage {
        let [width, height] = self.size_px();
        let blank = GrayImage::from_pixel(self.image_px[0], self.image_px[1], image::Luma([BLANK]));
        let mut canvas = Canvas::enlarged(image.grey.as_ref().unwrap_or(&blank), self.zoom);
        if image.grey.is_ok() {
            if let Some(simulated) = simulated {
                // Wider and below: where both agree what was found lies within it.
                canvas = canvas.with_pen(3 * PEN_PX);
                canvas.line(simulated, SIMULATED_RGB);
                let outer = 5.0 + 2.0 * f64::from(self.zoom);
                simulated.iter().for_each(|&px| canvas.ring(px, outer - 2.5, outer, SIMULATED_RGB));
            }
            canvas = canvas.with_pen(PEN_PX);
            if record.centreline.is_empty() {
                canvas.links(record);
            }
            canvas.found(record);
        }
        let mut picture = RgbImage::from_pixel(width, height, STRIP);
        // One of another size than the film's must not cover the strip.
        let shown_px = self.image_px[1] * self.zoom;
        let shown = imageops::crop_imm(&canvas.picture, 0, 0, width, shown_px.min(canvas.picture.height()));
        imageops::replace(&mut picture, &*shown, 0, 0);
        caption(&mut picture, shown_px + MARGIN_PX, record, simulated.is_some());
        picture
    }
}

/// Height of the strip with the words \[px\].
fn strip_px() -> u32 {
    2 * MARGIN_PX + Size::Large.line_px() + REASON_LINES * Size::Small.line_px()
}

fn caption(picture: &mut RgbImage, top: u32, record: &ImageRecord, simulated: bool) {
    let (word, colour) = match record.status {
        Status::Ok => ("ok", OK),
        Status::Doubtful => ("doubtful", DOUBTFUL),
        Status::Rejected => ("rejected", REJECTED),
    };
    let time = format!("{:.3} s  ", record.time_s);
    let mut column = MARGIN_PX;
    let mut put = |text: &str, colour| {
        lettering::write(picture, (column, top), text, Size::Large, colour);
        column += text.chars().count() as u32 * Size::Large.letter_px();
    };
    put(&time, INK);
    put(word, colour);
    if simulated {
        put("  simulated", SIMULATED_RGB);
    }
    put(&format!("  image {}", record.name), INK);
    let letters = picture.width().saturating_sub(2 * MARGIN_PX) / Size::Small.letter_px();
    let reason = lettering::wrapped(&record.reason, letters as usize, REASON_LINES as usize);
    for (line, row) in reason.iter().zip(0..) {
        let top = top + Size::Large.line_px() + row * Size::Small.line_px();
        lettering::write(picture, (MARGIN_PX, top), line, Size::Small, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Keypoint;
    use crate::keypoints::Sigma;
    use camera::calibration::Plane;

    fn record(status: Status, reason: &str) -> ImageRecord {
        let plane = Plane::square(0.001, [0.0, 0.0]);
        ImageRecord {
            name: "000012".into(),
            time_s: 0.12,
            status,
            reason: reason.into(),
            keypoints: [[20.0, 10.0], [20.0, 40.0]]
                .map(|px| Keypoint::seen(px, Sigma::untold(0.1), &plane))
                .to_vec(),
            mask: None,
            centreline: Vec::new(),
        }
    }

    fn image(grey: Result<GrayImage, String>) -> TimedImage {
        TimedImage { name: "000012".into(), time_s: 0.12, chroma: None, grey }
    }

    #[test]
    fn every_picture_of_a_film_has_its_size_and_words_below_the_image() {
        let film = Captioned::new([64, 48]);
        let dark = image(Ok(GrayImage::new(64, 48)));
        let words = |picture: &RgbImage, ink: Rgb<u8>| picture.pixels().any(|pixel| *pixel == ink);
        let ok = film.picture(&dark, &record(Status::Ok, ""), None);
        assert_eq!([ok.width(), ok.height()], film.size_px());
        assert_eq!(ok.width(), 960);
        assert!(words(&ok, OK) && !words(&ok, SIMULATED_RGB));
        let long = "a reason of many words ".repeat(40);
        let rejected =
            film.picture(&dark, &record(Status::Rejected, &long), Some(&[[20.0, 10.0], [30.0, 40.0]]));
        assert!(words(&rejected, REJECTED) && words(&rejected, SIMULATED_RGB));
        assert_eq!(
            rejected.get_pixel(30 * 15 + 7 + 34, 40 * 15 + 7),
            &SIMULATED_RGB,
            "a ring around the point"
        );
        for odd in [Err("cut".to_owned()), Ok(GrayImage::new(200, 300)), Ok(GrayImage::new(3, 3))] {
            let picture = film.picture(&image(odd), &record(Status::Rejected, "unreadable"), None);
            assert_eq!(picture.dimensions(), ok.dimensions());
            assert!(words(&picture, REJECTED));
        }
    }
}
