//! Overlays of the extraction on the images: pictures or a film of all of them, and a contact sheet of the refused ones.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::Path;

use anyhow::anyhow;
use image::{DynamicImage, ImageFormat};

use super::Failure;
use analysis::stored;
use camera::calibration::{Plane, Px};
use images::film::{Film, FilmWriter, is_film};
use images::recording::RecordedImages;
use images::{FilmError, ImageSource, TimedImage};
use record::folder::RunFolder;
use record::outputs::{OutputFile, OutputFolder, Outputs};
use record::simulated::row_at;
use report::RunFigures;
use vision::captioned::Captioned;
use vision::contact_sheet::{MOST_SHOWN, contact_sheet};
use vision::refused::refused;
use vision::{Extraction, ImageRecord, overlay};

/// Endings of film formats that are not supported: such a name is refused, not made a folder.
const OTHER_FILMS: [&str; 8] = ["avi", "gif", "m4v", "mov", "mpeg", "mpg", "ogv", "wmv"];
/// Enlargement of overlays as pictures.
const OVERLAY_SCALE: u32 = 4;

/// Overlays being made.
pub enum Overlays {
    /// A folder of pictures.
    Folder(OutputFolder),
    /// A film.
    Film(Box<Filming>),
}

impl Overlays {
    /// To `path`, which is asked for of `outputs`: a film by its ending, else a folder of pictures; times are life's, of which the film shows
    /// a `slowed` copy.
    ///
    /// # Errors
    /// [`Failure::Input`] where no film can be written, or nothing at all.
    pub fn plan(path: &Path, slowed: f64, outputs: &mut Outputs) -> Result<Self, Failure> {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        if OTHER_FILMS.iter().any(|other| ending == *other) && !path.is_dir() {
            return Err(Failure::input(FilmError::Ending { path: path.into() }));
        }
        if !is_film(path) || path.is_dir() {
            return Ok(Self::Folder(outputs.folder(path, &["*"])?));
        }
        Ok(Self::Film(Box::new(Filming::plan(&outputs.file(path)?, slowed)?)))
    }

    /// The next images with what was found in them.
    ///
    /// # Errors
    /// [`Failure::Input`] where they cannot be written.
    pub fn draw(&mut self, images: &[TimedImage], records: &[ImageRecord]) -> Result<(), Failure> {
        match self {
            Self::Folder(folder) => pictures(folder, images, records).map_err(Failure::Input),
            Self::Film(film) => film.show(images, records, |_| None),
        }
    }

    /// Ends them.
    ///
    /// # Errors
    /// [`Failure::Input`] where a film cannot be written.
    pub fn finish(self) -> Result<(), Failure> {
        match self {
            Self::Folder(_) => Ok(()),
            Self::Film(film) => film.finish(),
        }
    }
}

fn pictures(folder: &OutputFolder, images: &[TimedImage], found: &[ImageRecord]) -> anyhow::Result<()> {
    folder.create()?;
    for (image, record) in images.iter().zip(found) {
        if let Ok(grey) = &image.grey {
            let name = Path::new(&image.name).with_extension("png");
            let picture = encoded(overlay::overlay(grey, record, OVERLAY_SCALE).into(), ImageFormat::Png)?;
            folder.write(&name.to_string_lossy(), &picture)?;
        }
    }
    Ok(())
}

fn encoded(picture: DynamicImage, format: ImageFormat) -> image::ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    picture.write_to(&mut Cursor::new(&mut bytes), format)?;
    Ok(bytes)
}

/// A film of images with what was found in them.
pub struct Filming {
    slowed: f64,
    state: State,
}

enum State {
    /// Size and rate of the images are not known yet.
    Planned(Option<Film>),
    Rolling(Captioned, FilmWriter),
}

impl Filming {
    /// One that is to be `out`, played `slowed` times slower than the images' times say.
    ///
    /// # Errors
    /// [`Failure::Input`] where no film can be written there.
    pub fn plan(out: &OutputFile, slowed: f64) -> Result<Self, Failure> {
        let film = Film::plan(out).map_err(Failure::input)?;
        Ok(Self { slowed, state: State::Planned(Some(film)) })
    }

    /// The next images with what was found in them, and where a simulation has the keypoints at a time, if it is known.
    fn show(
        &mut self,
        images: &[TimedImage],
        records: &[ImageRecord],
        simulated: impl Fn(f64) -> Option<Vec<Px>>,
    ) -> Result<(), Failure> {
        if let State::Planned(film) = &mut self.state {
            // A film begins with its first readable picture: none before it says how large they are.
            let Some(first) = images.iter().find_map(|image| image.grey.as_ref().ok()) else { return Ok(()) };
            let captioned = Captioned::new(first.dimensions().into());
            let Some(film) = film.take() else { return Ok(()) };
            let writer =
                film.begin(captioned.size_px(), rate(images), self.slowed).map_err(Failure::input)?;
            self.state = State::Rolling(captioned, writer);
        }
        let State::Rolling(captioned, writer) = &mut self.state else { return Ok(()) };
        for (image, record) in images.iter().zip(records) {
            let picture = captioned.picture(image, record, simulated(image.time_s).as_deref());
            writer.image(picture, image.time_s).map_err(Failure::input)?;
        }
        Ok(())
    }

    /// All of a recorded run, what was found in it as it stands in the folder of results `out`, and what the simulation of
    /// `figures` does, where there is one.
    ///
    /// # Errors
    /// [`Failure::Input`] where the recording cannot be read or the film not written.
    pub fn run(
        mut self,
        run: &RunFolder,
        out: &Path,
        plane: &Plane,
        figures: Option<&RunFigures>,
    ) -> Result<(), Failure> {
        /// Images in memory at a time. Chosen.
        const IMAGES_AT_ONCE: usize = 32;
        let records = stored::found(out, plane).map_err(Failure::input)?;
        let source = RecordedImages::of_run(run);
        let mut images = source.images().map_err(Failure::input)?;
        let mut left = &records[..];
        while !left.is_empty() {
            let portion: Vec<TimedImage> =
                images.by_ref().take(IMAGES_AT_ONCE).collect::<Result<_, _>>().map_err(Failure::input)?;
            if portion.is_empty() {
                break;
            }
            let (now, later) = left.split_at(portion.len().min(left.len()));
            self.show(&portion, now, |time_s| simulated_px(figures?, plane, time_s))?;
            left = later;
        }
        self.finish()
    }

    /// Ends the film.
    fn finish(self) -> Result<(), Failure> {
        match self.state {
            State::Rolling(_, writer) => writer.finish().map_err(Failure::input),
            State::Planned(_) => {
                Err(Failure::Data(anyhow!("no film of overlays: not one image can be read")))
            }
        }
    }
}

/// Where the simulation has the keypoints at the image of `time_s`, its base first.
fn simulated_px(figures: &RunFigures, plane: &Plane, time_s: f64) -> Option<Vec<Px>> {
    let row = row_at(&figures.simulated.time_s, time_s)?;
    let keypoints = figures.simulated.keypoints.len();
    let base = figures.base_m.filter(|_| figures.simulated.keypoints.iter().all(|name| name != "P0"));
    let points = figures.simulated.position_m.get(row * keypoints..(row + 1) * keypoints)?;
    let view = plane.view();
    Some(base.iter().chain(points).map(|&point| plane.pixel(view.seen(point))).collect())
}

/// Images a second, by the usual time between two.
fn rate(images: &[TimedImage]) -> f64 {
    /// Image rate above which an interval counts as an error \[1/s\]. Chosen.
    const IMAGE_RATE_MAX_HZ: f64 = 10_000.0;
    let mut steps: Vec<f64> = images.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
    steps.retain(|step| *step > 1.0 / IMAGE_RATE_MAX_HZ);
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map_or(1.0, |step| 1.0 / step)
}

/// The picture format that a contact sheet's name says.
///
/// # Errors
/// [`Failure::Input`] for another ending than those of PNG and JPEG.
pub fn sheet_format(path: &Path) -> Result<ImageFormat, Failure> {
    ImageFormat::from_path(path)
        .ok()
        .filter(|format| matches!(format, ImageFormat::Png | ImageFormat::Jpeg))
        .ok_or_else(|| {
            Failure::Input(anyhow!("contact sheet {}: end its name in .png or .jpg", path.display()))
        })
}

/// Writes the refused and doubtful images of `source`, in which `extraction` was found, to `out`; whether there were any. An old sheet is removed
/// where there are none.
///
/// # Errors
/// [`Failure::Input`] where images cannot be read again or the sheet not written.
pub fn write_sheet(
    out: &OutputFile,
    source: &dyn ImageSource,
    extraction: &Extraction,
) -> Result<bool, Failure> {
    let format = sheet_format(out.path())?;
    let groups = refused(&extraction.records, MOST_SHOWN);
    let wanted: BTreeSet<usize> = groups.iter().flat_map(|group| group.shown.iter().copied()).collect();
    let mut images = BTreeMap::new();
    if let Some(&last) = wanted.last() {
        for (i, image) in source.images().map_err(Failure::input)?.take(last + 1).enumerate() {
            let image = image.map_err(Failure::input)?;
            if wanted.contains(&i) {
                images.insert(i, image);
            }
        }
    }
    let Some(sheet) = contact_sheet(&groups, &extraction.records, &images) else {
        out.remove();
        return Ok(false);
    };
    let bytes = encoded(sheet.into(), format).map_err(Failure::internal)?;
    out.write(&bytes).map_err(Failure::input)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use sim::Trajectory;

    use super::*;

    fn images(times_s: &[f64]) -> Vec<TimedImage> {
        let image = |&time_s: &f64| TimedImage {
            name: String::new(),
            time_s,
            chroma: None,
            grey: Err(String::new()),
        };
        times_s.iter().map(image).collect()
    }

    #[test]
    fn rate_is_that_of_most_images_and_one_image_is_shown_for_a_second() {
        assert!((rate(&images(&[0.0, 0.0201, 0.04, 0.0599, 0.5, 0.52])) - 50.0).abs() < 1.0);
        for odd in [&[][..], &[3.0], &[3.0, 3.0], &[3.0, f64::NAN]] {
            assert_eq!(rate(&images(odd)), 1.0, "{odd:?}");
        }
    }

    #[test]
    fn simulation_is_drawn_from_its_base_at_the_images_own_time_only() {
        let figures = RunFigures {
            base_m: Some([0.0, 0.0, 0.0]),
            simulated: Trajectory {
                time_s: vec![0.1, 0.2],
                keypoints: vec!["P1".into()],
                position_m: vec![[0.01, 0.0, -0.02], [0.03, 0.0, -0.01]],
                ..Trajectory::default()
            },
            ..RunFigures::default()
        };
        let plane = Plane::square(0.001, [100.0, 50.0]);
        let at = |time_s| simulated_px(&figures, &plane, time_s);
        let near = |got: Option<Vec<Px>>, wanted: [Px; 2]| {
            let got = got.unwrap();
            got.len() == 2
                && got.iter().flatten().zip(wanted.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-9)
        };
        assert!(near(at(0.2 + 1e-7), [[100.0, 50.0], [130.0, 60.0]]));
        assert!(near(at(0.1), [[100.0, 50.0], [110.0, 70.0]]));
        assert_eq!((at(0.0), at(0.15), at(0.3)), (None, None, None));
    }

    #[test]
    fn names_of_other_films_and_pictures_are_refused_and_folders_are_folders() {
        let folder = tempfile::tempdir().unwrap();
        let plan = |name: &str| Overlays::plan(&folder.path().join(name), 1.0, &mut Outputs::default());
        assert!(matches!(plan("look"), Ok(Overlays::Folder(_))));
        assert!(matches!(plan("look.2026.11.24"), Ok(Overlays::Folder(_))));
        assert!(plan("look.avi").is_err_and(|failure| failure.exit_code() == 2));
        assert!(sheet_format(Path::new("a.PNG")).is_ok() && sheet_format(Path::new("a.jpeg")).is_ok());
        assert!(sheet_format(Path::new("a.pdf")).is_err() && sheet_format(Path::new("a")).is_err());
    }
}
