//! Camera images with mask, centreline and keypoints drawn over them.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, GrayImage, Rgb, RgbImage};
use maud::{Markup, html};

use super::chart::KEYPOINTS;
use super::data::{Overlay, to_rgb};

/// The mask's tint.
const MASK_RGB: [f64; 3] = [64.0, 160.0, 255.0];
/// JPEG quality: a sensor's noise would make a lossless picture six times as large.
const JPEG_QUALITY: u8 = 85;
/// How much of the tint shows.
const TINT_SHARE: f64 = 0.35;

/// A picture as an inline image.
pub(super) struct Picture(String);

impl Picture {
    /// `image` with what `mask` covers tinted; nothing when it cannot be encoded, which only an empty one cannot.
    pub(super) fn of(image: &GrayImage, mask: Option<&GrayImage>) -> Option<Self> {
        let picture: DynamicImage = match mask {
            Some(mask) => tinted(image, Some(mask)).into(),
            None => image.clone().into(),
        };
        let mut jpeg = Vec::new();
        picture.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)).ok()?;
        Some(Self(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg))))
    }

    /// What stands for the file in the page.
    pub(super) fn source(&self) -> &str {
        &self.0
    }

    /// What it takes of the page.
    pub(super) fn bytes(&self) -> usize {
        self.0.len()
    }
}

/// The image with masked pixels tinted.
fn tinted(image: &GrayImage, mask: Option<&GrayImage>) -> RgbImage {
    let mut rgb = to_rgb(image);
    let Some(mask) = mask.filter(|mask| mask.dimensions() == image.dimensions()) else { return rgb };
    for (pixel, seen) in rgb.pixels_mut().zip(mask.pixels()) {
        if seen.0[0] > 0 {
            let mix = |c: usize| {
                (f64::from(pixel.0[c]) * (1.0 - TINT_SHARE) + MASK_RGB[c] * TINT_SHARE).round() as u8
            };
            *pixel = Rgb([mix(0), mix(1), mix(2)]);
        }
    }
    rgb
}

/// An image with what vision found; lines and labels are vectors and stay sharp.
pub(super) fn overlay(overlay: &Overlay) -> Markup {
    let Some(picture) = Picture::of(&overlay.image, overlay.mask.as_ref()) else { return html! {} };
    let alt = format!("image at {:.3} s, {}", overlay.time_s, overlay.status);
    let caption = html! {
        (format!("{:.3} s", overlay.time_s)) @if !overlay.status.is_empty() { " · " (overlay.status) }
    };
    drawn_over(overlay, &picture, 1.0, &alt, &caption)
}

/// `picture`, which shows the image of `overlay` at any size, with the rest of it drawn over, its marks `larger` than usual; `alt` says the
/// picture to whom cannot see.
pub(super) fn drawn_over(
    overlay: &Overlay,
    picture: &Picture,
    larger: f64,
    alt: &str,
    caption: &Markup,
) -> Markup {
    let (width, height) = overlay.image.dimensions();
    // The centre of the top left pixel is (0, 0) here and (0.5, 0.5) in SVG.
    let at = |p: &[f64; 2]| format!("{:.2},{:.2} ", p[0] + 0.5, p[1] + 0.5);
    let line: String = overlay.centreline_px.iter().map(at).collect();
    let keypoints = overlay.keypoints_px.iter().filter(|(_, p)| p[0].is_finite() && p[1].is_finite());
    let radius = larger * f64::from(width) / 100.0;
    html! {
        figure.picture {
            svg viewBox={ "0 0 " (width) " " (height) } role="img" aria-label={ (alt) (found(overlay)) } {
                image href=(picture.0) width=(width) height=(height) {}
                @if !line.is_empty() { polyline.centreline points=(line) {} }
                @for (k, (name, p)) in keypoints.enumerate() {
                    @let colour = KEYPOINTS[k % KEYPOINTS.len()];
                    circle.keypoint cx=(format!("{:.2}", p[0] + 0.5)) cy=(format!("{:.2}", p[1] + 0.5))
                        r=(radius) fill=(format!("#{:02X}{:02X}{:02X}", colour.0, colour.1, colour.2)) {}
                    text.keypoint x=(format!("{:.1}", p[0] + 2.2 * radius)) y=(format!("{:.1}", p[1] - radius))
                        font-size=(3.2 * radius) { (name) }
                }
            }
            figcaption { (caption) }
        }
    }
}

/// What is drawn over the picture, in words.
fn found(overlay: &Overlay) -> String {
    let keypoints = match &overlay.keypoints_px[..] {
        [] => None,
        [(only, _)] => Some(format!("keypoint {only}")),
        [(first, _), .., (last, _)] => Some(format!("keypoints {first} to {last}")),
    };
    let parts: Vec<String> = [
        overlay.mask.is_some().then(|| "silhouette".to_owned()),
        (!overlay.centreline_px.is_empty()).then(|| "centreline".to_owned()),
        keypoints,
    ]
    .into_iter()
    .flatten()
    .collect();
    match parts.is_empty() {
        true => "; nothing found in it".into(),
        false => format!("; drawn over it: {}", parts.join(", ")),
    }
}

/// A plain picture with a caption.
pub(super) fn plain(image: &GrayImage, caption: &str) -> Markup {
    let Some(picture) = Picture::of(image, None) else { return html! {} };
    html! {
        figure.picture { img src=(picture.0) alt=(caption); figcaption { (caption) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mask_tints_only_the_pixels_it_covers() {
        let image = GrayImage::from_pixel(4, 2, image::Luma([100]));
        let mut mask = GrayImage::new(4, 2);
        mask.put_pixel(1, 1, image::Luma([255]));
        let tinted = tinted(&image, Some(&mask));
        assert_eq!(tinted.get_pixel(0, 0).0, [100; 3]);
        assert_ne!(tinted.get_pixel(1, 1).0, [100; 3]);
        let wrong_size = GrayImage::from_pixel(2, 2, image::Luma([255]));
        assert_eq!(super::tinted(&image, Some(&wrong_size)).get_pixel(0, 0).0, [100; 3]);
    }
}
