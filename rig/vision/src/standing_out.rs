//! What stands out in a single picture, for someone who sets a camera up: no sequence has to be learned from.

use std::path::Path;

use image::GrayImage;

use super::background::{Background, Still};
use super::component::components;
use super::config::{Background as Method, VisionConfig, picture};
use super::{Mask, VisionError, static_mask};

/// What a picture shows apart from an even background.
#[derive(Debug, Clone)]
pub struct StandingOut {
    /// Parts of at least the config's smallest silhouette, of the whole picture's size; or why nothing can be told.
    pub parts: Result<Mask, String>,
    /// Where the mechanism never is, where the config says it; of the whole picture's size.
    pub masked: Option<Mask>,
}

/// Looks at `image` as `config` says, whose paths start at `folder`; without a picture of the empty tank its background is taken to be even.
///
/// # Errors
/// [`VisionError::Picture`].
pub fn standing_out(
    image: &GrayImage,
    config: &VisionConfig,
    folder: &Path,
) -> Result<StandingOut, VisionError> {
    let size = image.dimensions();
    let (method, empty) = match &config.background {
        Method::Picture(path) => {
            (config.background.clone(), Some(picture("background", folder, path, size)?.grey))
        }
        _ => (Method::Flat, None),
    };
    let masked = config.static_mask.as_ref().map(|path| static_mask::read(folder, path, size)).transpose()?;
    let config = VisionConfig { background: method, ..config.clone() };
    let parts = || -> Result<Mask, String> {
        let background = Background::learn(&[image], &config, empty.as_ref(), masked.clone(), Still::Foreign)
            .map_err(|error| error.to_string())?;
        let silhouette = background.contrast(image).map_err(|why| why.to_string())?.silhouette();
        let mut parts = Mask::empty(0, 0, silhouette.width, silhouette.height);
        for part in components(&silhouette, config.min_area_px.get() as usize) {
            part.mask.pixels().for_each(|(column, row)| parts.set(column as isize, row as isize));
        }
        Ok(parts)
    };
    Ok(StandingOut { parts: parts(), masked })
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    fn scene(dark: bool) -> GrayImage {
        GrayImage::from_fn(80, 60, |x, y| {
            let noise = ((x * 7 + y * 13) % 5) as u8;
            let bar = (30..40).contains(&x) && (10..50).contains(&y);
            Luma([if dark && bar { 60 + noise } else { 180 + noise }])
        })
    }

    #[test]
    fn bar_stands_out_and_an_empty_picture_says_why_nothing_does() {
        let config: VisionConfig = toml::from_str("").unwrap();
        let found = standing_out(&scene(true), &config, Path::new(".")).unwrap();
        let area = found.parts.unwrap().area();
        assert!((360..=440).contains(&area), "{area}");
        assert!(found.masked.is_none());
        let nothing = standing_out(&scene(false), &config, Path::new(".")).unwrap().parts;
        assert!(nothing.is_err_and(|why| !why.is_empty()));
    }

    #[test]
    fn static_mask_hides_what_it_covers_and_a_missing_one_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let mask = GrayImage::from_fn(80, 60, |_, y| Luma([if y < 30 { 255 } else { 0 }]));
        mask.save(folder.path().join("static.png")).unwrap();
        let config: VisionConfig = toml::from_str("static_mask = \"static.png\"").unwrap();
        let found = standing_out(&scene(true), &config, folder.path()).unwrap();
        let area = found.parts.unwrap().area();
        assert!((160..=240).contains(&area), "{area}");
        assert_eq!(found.masked.unwrap().area(), 80 * 30);
        assert!(standing_out(&scene(true), &config, Path::new("/nowhere")).is_err());
    }
}
