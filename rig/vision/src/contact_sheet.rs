//! Refused and doubtful images on one picture, by their reasons.

use std::collections::BTreeMap;

use image::{GrayImage, Rgb, RgbImage, imageops};

use super::overlay::Canvas;
use super::record::{ImageRecord, Status};
use super::refused::Refused;
use crate::lettering::{self, Size};
use camera::source::TimedImage;

/// Most images on one sheet.
pub const MOST_SHOWN: usize = 24;
/// Images side by side.
const COLUMNS: u32 = 4;
/// The box an image is fitted into \[px\].
const CELL_PX: [u32; 2] = [320, 240];
/// Between images, and around all \[px\].
const GAP_PX: u32 = 20;
/// Lines that a reason may take.
const REASON_LINES: usize = 3;

const PAPER: Rgb<u8> = Rgb([238, 240, 243]);
const INK: Rgb<u8> = Rgb([28, 36, 48]);
const SOFT: Rgb<u8> = Rgb([91, 102, 117]);
const REJECTED: Rgb<u8> = Rgb([163, 35, 27]);
const DOUBTFUL: Rgb<u8> = Rgb([138, 90, 0]);
/// Where an image is that cannot be shown.
const BLANK: u8 = 220;

/// An image on the sheet.
type Shown<'a> = (&'a TimedImage, &'a ImageRecord);

/// One picture of all `groups`, as [`super::refused::refused`] gives them for `records`, with the `images` that they show, by their
/// places; nothing where there is no group.
pub fn contact_sheet(
    groups: &[Refused],
    records: &[ImageRecord],
    images: &BTreeMap<usize, TimedImage>,
) -> Option<RgbImage> {
    let width = COLUMNS * (CELL_PX[0] + GAP_PX) + GAP_PX;
    let mut strips: Vec<RgbImage> = Vec::new();
    for group in groups {
        strips.push(heading(group, records.len(), width));
        let shown = group.shown.iter().filter_map(|place| Some((images.get(place)?, records.get(*place)?)));
        let shown: Vec<Shown> = shown.collect();
        strips.extend(shown.chunks(COLUMNS as usize).map(|row| pictures(row, width)));
    }
    let height: u32 = strips.iter().map(RgbImage::height).sum();
    let mut sheet = RgbImage::from_pixel(width, height + GAP_PX, PAPER);
    let mut row = 0;
    for strip in &strips {
        imageops::replace(&mut sheet, strip, 0, row);
        row += i64::from(strip.height());
    }
    (!strips.is_empty()).then_some(sheet)
}

/// How many images have the reason, and the reason.
fn heading(group: &Refused, total: usize, width: u32) -> RgbImage {
    let letters = (width - 2 * GAP_PX) / Size::Large.letter_px();
    let reason = lettering::wrapped(&group.reason, letters as usize, REASON_LINES);
    let lines = 1 + reason.len() as u32;
    let mut strip = RgbImage::from_pixel(width, GAP_PX + lines * Size::Large.line_px() + GAP_PX / 2, PAPER);
    let (word, colour) = match group.status {
        Status::Rejected => ("rejected", REJECTED),
        _ => ("doubtful", DOUBTFUL),
    };
    let count = format!("{} of {total} images {word}", group.count);
    lettering::write(&mut strip, (GAP_PX, GAP_PX), &count, Size::Large, colour);
    for (line, row) in reason.iter().zip(1..) {
        let row = GAP_PX + row * Size::Large.line_px();
        lettering::write(&mut strip, (GAP_PX, row), line, Size::Large, INK);
    }
    strip
}

/// Images side by side, each with its name and time below.
fn pictures(shown: &[Shown<'_>], width: u32) -> RgbImage {
    let line = Size::Small.line_px();
    let mut strip = RgbImage::from_pixel(width, CELL_PX[1] + 2 * line, PAPER);
    for ((image, record), column) in shown.iter().zip(0..) {
        let left = GAP_PX + column * (CELL_PX[0] + GAP_PX);
        let blank = GrayImage::from_pixel(CELL_PX[0], CELL_PX[1], image::Luma([BLANK]));
        let mut canvas = Canvas::fitted(image.grey.as_ref().unwrap_or(&blank), CELL_PX[0], CELL_PX[1]);
        if image.grey.is_ok() {
            canvas.found(record);
        } else {
            let middle = (CELL_PX[1] - line) / 2;
            lettering::write(&mut canvas.picture, (GAP_PX, middle), "no picture to show", Size::Small, SOFT);
        }
        imageops::replace(&mut strip, &canvas.picture, i64::from(left), 0);
        let letters = CELL_PX[0] / Size::Small.letter_px();
        let caption = format!("{:.3} s  {}", record.time_s, record.name);
        for text in lettering::wrapped(&caption, letters as usize, 1) {
            lettering::write(&mut strip, (left, CELL_PX[1] + line / 4), &text, Size::Small, SOFT);
        }
    }
    strip
}

#[cfg(test)]
mod tests {
    use super::super::refused::refused;
    use super::*;

    fn record(i: usize, reason: &str) -> ImageRecord {
        ImageRecord {
            name: format!("{i:06}"),
            time_s: i as f64 / 100.0,
            status: Status::Rejected,
            reason: reason.into(),
            keypoints: Vec::new(),
            mask: None,
            centreline: Vec::new(),
        }
    }

    #[test]
    fn sheet_has_a_row_for_each_reason_and_one_without_refusals_is_none() {
        let records: Vec<ImageRecord> = (0..40)
            .map(|i| record(i, if i < 30 { "dark: level 3" } else { "unreadable: cut short" }))
            .collect();
        let image = |record: &ImageRecord| TimedImage {
            name: record.name.clone(),
            time_s: record.time_s,
            chroma: None,
            grey: if record.reason.starts_with("dark") {
                Ok(GrayImage::new(64, 48))
            } else {
                Err("cut".into())
            },
        };
        let groups = refused(&records, MOST_SHOWN);
        let shown = groups.iter().flat_map(|group| &group.shown);
        let images: BTreeMap<usize, TimedImage> = shown.map(|&i| (i, image(&records[i]))).collect();
        assert_eq!(images.len(), 8);
        let sheet = contact_sheet(&groups, &records, &images).unwrap();
        let black = sheet.pixels().filter(|pixel| pixel.0 == [0; 3]).count();
        assert_eq!(black, 4 * 320 * 240, "four dark pictures, as large as their cells");
        assert!(sheet.pixels().any(|pixel| pixel.0 == [BLANK; 3]));
        if let Ok(path) = std::env::var("RIG_SHEET_SAMPLE") {
            sheet.save(path).unwrap();
        }
        assert!(contact_sheet(&[], &records, &images).is_none());
    }
}
