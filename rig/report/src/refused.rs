//! Images that were refused or doubted, by reason: what to look at when keypoints are missing.

use image::imageops::{self, FilterType};
use maud::{Markup, html};

use super::data::{Overlay, RefusedImages, ReportData};
use super::format::counted;
use super::picture::{self, Picture};

/// The longer side of a small picture \[px\].
const THUMBNAIL_SIDE_PX: u32 = 288;
/// Enlargement of the marks on a small picture. Chosen.
const THUMBNAIL_MARK_SCALE: f64 = 1.7;
/// Size of all small pictures together at most \[bytes\]. Chosen.
const THUMBNAILS_LIMIT_BYTES: usize = 360_000;
/// The most small pictures on a page.
const THUMBNAILS_MAX: usize = 24;

/// The section; none where nothing was refused.
pub(super) fn section(data: &ReportData) -> Markup {
    if data.refused.is_empty() {
        return html! {};
    }
    let total = data.images.as_ref().map(|images| images.received);
    let mut room = Room { bytes: THUMBNAILS_LIMIT_BYTES, pictures: THUMBNAILS_MAX };
    html! {
        section #refused {
            h2 { "Refused and doubtful images" }
            p.lead {
                "A refused image is a gap in the trajectory; a doubtful one has keypoints that may mislead. What was found is drawn \
                 over each: silhouette tinted blue, centreline in yellow, keypoints as dots."
            }
            @for group in &data.refused { (reason(group, total, &mut room)) }
        }
    }
}

/// What the page still has room for.
struct Room {
    bytes: usize,
    pictures: usize,
}

impl Room {
    fn takes(&mut self, picture: &Picture) -> bool {
        let fits = self.pictures > 0 && picture.bytes() <= self.bytes;
        if fits {
            self.bytes -= picture.bytes();
            self.pictures -= 1;
        }
        fits
    }
}

fn reason(group: &RefusedImages, total: Option<usize>, room: &mut Room) -> Markup {
    let (word, tone) = if group.doubtful { ("doubtful", "caution") } else { ("refused", "bad") };
    let small: Vec<(&Overlay, Picture)> = group
        .shown
        .iter()
        .filter_map(|shown| Some((shown, small(shown)?)))
        .filter(|(_, picture)| room.takes(picture))
        .collect();
    html! {
        div.reason {
            h3 { span class={ "flag " (tone) } { (word) } " " (group.reason) }
            p.legend {
                (counted(group.count, "image"))
                @if let Some(total) = total { " of " (total) }
                @if small.is_empty() { "; none can be shown" }
                @else if small.len() < group.count { "; " (small.len()) " of them:" }
                @else { ":" }
                @if group.unreadable > 0 && !small.is_empty() { " " (group.unreadable) " more cannot be read." }
            }
            @if !small.is_empty() {
                div.contact {
                    @for (shown, picture) in &small {
                        (thumbnail(group, shown, picture, word))
                    }
                }
            }
        }
    }
}

fn thumbnail(group: &RefusedImages, shown: &Overlay, picture: &Picture, word: &str) -> Markup {
    let alt = format!("image {}, {word}: {}", shown.name, shown.status);
    let caption = html! {
        (format!("{:.3} s", shown.time_s)) " · image " (shown.name)
        @if shown.status != group.reason { span.why { (shown.status) } }
    };
    picture::drawn_over(shown, picture, THUMBNAIL_MARK_SCALE, &alt, &caption)
}

/// The image as small as it is shown, with its mask.
fn small(shown: &Overlay) -> Option<Picture> {
    let (width, height) = shown.image.dimensions();
    let scale = (f64::from(THUMBNAIL_SIDE_PX) / f64::from(width.max(height).max(1))).min(1.0);
    let [w, h] = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    let image = imageops::resize(&shown.image, w, h, FilterType::Triangle);
    let mask = shown.mask.as_ref().map(|mask| imageops::resize(mask, w, h, FilterType::Nearest));
    Picture::of(&image, mask.as_ref())
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};

    use super::*;

    fn group(pictures: usize, image: &GrayImage) -> RefusedImages {
        let shown = Overlay {
            name: "7".into(),
            time_s: 0.07,
            image: image.clone(),
            mask: None,
            centreline_px: Vec::new(),
            keypoints_px: Vec::new(),
            status: "dark: 3".into(),
        };
        RefusedImages {
            reason: "dark: 3 to 5".into(),
            doubtful: false,
            count: 50,
            shown: vec![shown; pictures],
            unreadable: 0,
        }
    }

    #[test]
    fn pictures_take_no_more_of_the_page_than_they_may() {
        let mut grey = 7_u32;
        // Nothing compresses worse.
        let noise = GrayImage::from_fn(640, 640, |_, _| {
            grey = grey.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Luma([(grey >> 24) as u8])
        });
        let plain = GrayImage::from_pixel(640, 480, Luma([9]));
        for (image, most) in [(&noise, 23), (&plain, THUMBNAILS_MAX)] {
            let refused = vec![group(10, image), group(10, image), group(10, image)];
            let page = section(&ReportData { refused, ..ReportData::default() }).into_string();
            let pictures = page.matches("data:image/jpeg").count();
            assert!((1..=most).contains(&pictures), "{pictures}");
            assert!(page.len() < 400_000, "{} bytes", page.len());
        }
        assert_eq!(section(&ReportData::default()).into_string(), "");
    }

    #[test]
    fn a_reason_without_a_readable_picture_is_still_told() {
        let refused = vec![RefusedImages { unreadable: 4, ..group(0, &GrayImage::new(1, 1)) }];
        let page = section(&ReportData { refused, ..ReportData::default() }).into_string();
        assert!(page.contains("dark: 3 to 5") && page.contains("50 images; none can be shown"), "{page}");
        assert!(!page.contains("<svg"));
    }
}
