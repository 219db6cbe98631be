//! A reduced picture for the live page, and the overlay of what was extracted from it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{DynamicImage, GrayImage};
use serde::Serialize;
use utoipa::ToSchema;

use super::outline::outline;
use camera::calibration::Px;
use vision::ImageRecord;
use vision::record::{Status, sparse};

/// Longer side of a picture at most \[px\]. Chosen.
const PICTURE_MAX_SIDE_PX: u32 = 640;
const JPEG_QUALITY: u8 = 70;

/// The camera's picture, reduced, with its overlay.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Picture {
    /// When it was taken, since the run began \[s\].
    pub time_s: f64,
    /// Width and height of the camera's picture \[px\]; the overlay uses these coordinates.
    pub size_px: [u32; 2],
    /// The picture, a JPEG file in base64; at most 640 px wide.
    pub jpeg: String,
    /// What was extracted from it; left out of a picture that is not processed yet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<Overlay>,
}

/// What was found in a picture, in the camera's pixels: the centre of the top left one is \[0, 0\].
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Overlay {
    /// `ok`, `doubtful` or `rejected`.
    #[schema(value_type = String)]
    pub status: Status,
    /// Why the status is not `ok`.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// The silhouette's edge: closed lines \[px\].
    #[schema(value_type = Vec<Vec<[f64; 2]>>)]
    pub outline: Vec<Vec<Px>>,
    /// The centreline, base first \[px\].
    #[schema(value_type = Vec<[f64; 2]>)]
    pub centreline: Vec<Px>,
    /// The keypoints that are visible.
    pub keypoints: Vec<Spot>,
}

/// A keypoint in a picture.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Spot {
    /// Its name.
    pub name: String,
    /// Where it is \[px\].
    #[schema(value_type = [f64; 2])]
    pub px: Px,
    /// Where it is in the plane of motion \[m\].
    pub metres: [f64; 2],
}

impl Picture {
    /// A picture of `grey`, taken at `time_s`; none of an empty image.
    pub(super) fn of(grey: &GrayImage, time_s: f64, found: Option<Overlay>) -> Option<Self> {
        let (width, height) = grey.dimensions();
        let most = width.max(height);
        let small = (most > PICTURE_MAX_SIDE_PX).then(|| {
            let side = |side: u32| (side * PICTURE_MAX_SIDE_PX / most).max(1);
            imageops::resize(grey, side(width), side(height), FilterType::Triangle)
        });
        let mut jpeg = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY);
        let small = DynamicImage::from(small.unwrap_or_else(|| grey.clone()));
        small.write_with_encoder(encoder).ok()?;
        Some(Self {
            time_s: rounded(time_s, 1e3),
            size_px: [width, height],
            jpeg: STANDARD.encode(jpeg),
            found,
        })
    }
}

impl Overlay {
    /// The overlay of `record`, whose keypoints are called `names`.
    pub(super) fn of(record: &ImageRecord, names: &[String]) -> Self {
        let tenth = |px: &Px| px.map(|c| rounded(c, 10.0));
        let spot = |(i, keypoint): (usize, &vision::Keypoint)| {
            keypoint.px.iter().all(|c| c.is_finite()).then(|| Spot {
                name: names.get(i).cloned().unwrap_or_else(|| format!("P{i}")),
                px: tenth(&keypoint.px),
                metres: keypoint.metres.map(|c| rounded(c, 1e5)),
            })
        };
        let lines = record.mask.as_ref().map(outline).unwrap_or_default();
        Self {
            status: record.status,
            reason: record.reason.clone(),
            outline: lines.iter().map(|line| line.iter().map(tenth).collect()).collect(),
            centreline: sparse(&record.centreline),
            keypoints: record.keypoints.iter().enumerate().filter_map(spot).collect(),
        }
    }
}

/// Rounds `value` to multiples of `1 / parts`: enough for display, and short to send five times a second.
pub(super) fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_picture_is_made_small_and_keeps_its_shape() {
        for (size, wanted) in
            [((1920, 1080), (640, 360)), ((480, 1280), (240, 640)), ((320, 200), (320, 200))]
        {
            let grey = GrayImage::from_fn(size.0, size.1, |x, _| {
                image::Luma([if x < size.0 / 2 { 40 } else { 200 }])
            });
            let picture = Picture::of(&grey, 1.23456, None).unwrap();
            assert_eq!((picture.size_px, picture.time_s), ([size.0, size.1], 1.235));
            let small = image::load_from_memory(&STANDARD.decode(&picture.jpeg).unwrap()).unwrap().to_luma8();
            assert_eq!(small.dimensions(), wanted);
            let at = |share: f64| small.get_pixel((f64::from(wanted.0) * share) as u32, wanted.1 / 2).0[0];
            assert!(at(0.25).abs_diff(40) < 4 && at(0.75).abs_diff(200) < 4);
        }
        assert!(Picture::of(&GrayImage::new(0, 0), 0.0, None).is_none());
    }
}
