//! The images of a run folder's `recording.mcap`.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use camera::source::SourceError;
use camera::source::{ImageSource, Images, TimedImage};
use camera::{CameraImage, Rising};
use ground::clock::MonotonicNs;
use record::RecordError;
use record::folder::{RunFolder, file};
use record::reader::{Item, Recording};

/// The usable images of a recording: each later than all before.
#[derive(Debug)]
pub struct RecordedImages {
    path: PathBuf,
    /// Times count from here; from the first image where nobody says.
    origin: Option<MonotonicNs>,
    /// Which of the images received the empty tank is learned from; all, where nobody says.
    learn_from: Option<Range<u64>>,
    /// Places of the usable ones among all images received, where they are known.
    usable: Option<Vec<u64>>,
    /// How many images were received, where that is known.
    received: Option<u64>,
    /// What the recording does not give any more, once it was read to its end.
    shortfall: OnceLock<Option<String>>,
}

impl RecordedImages {
    /// The images of the recording at `path`; times count from the first.
    pub fn of_file(path: &Path) -> Self {
        Self {
            path: path.into(),
            origin: None,
            learn_from: None,
            usable: None,
            received: None,
            shortfall: OnceLock::new(),
        }
    }

    /// Those of `run`, in its time.
    pub fn of_run(run: &RunFolder) -> Self {
        Self {
            origin: Some(run.origin()),
            learn_from: run.stop().and_then(|stop| stop.learn_from.clone()),
            received: run.stop().map(|stop| stop.images),
            ..Self::of_file(&run.file(file::RECORDING))
        }
    }

    /// The same images with all times `late_s` earlier \[s\], where the recorded stamps turned out to be late by that.
    #[must_use]
    pub fn later_by(self, late_s: f64) -> Self {
        Self { origin: self.origin.map(|origin| origin.plus_seconds(late_s)), ..self }
    }

    /// The same images, with the places of the usable ones known from an earlier pass.
    #[must_use]
    pub fn usable_at(self, places: Vec<u64>) -> Self {
        Self { usable: Some(places), ..self }
    }

    /// The usable images with these numbers, from 0.
    ///
    /// # Errors
    /// [`SourceError`].
    pub fn numbered(&self, numbers: &BTreeSet<usize>) -> Result<Vec<TimedImage>, SourceError> {
        let end = numbers.last().map_or(0, |last| last + 1);
        self.chosen(end, |number, _| numbers.contains(&number))
    }

    /// The usable images that the camera counted so, as `frames.csv` has their `sequence`.
    ///
    /// # Errors
    /// [`SourceError`].
    pub fn counted(&self, sequences: &BTreeSet<u32>) -> Result<Vec<TimedImage>, SourceError> {
        self.chosen(usize::MAX, |_, sequence| sequences.contains(&sequence))
    }

    /// Those of the first `end` usable images that are `wanted` by their number and the camera's count.
    fn chosen(
        &self,
        end: usize,
        wanted: impl Fn(usize, u32) -> bool,
    ) -> Result<Vec<TimedImage>, SourceError> {
        let mut origin = self.origin;
        let mut images = Vec::new();
        for (number, received) in self.received()?.take(end).enumerate() {
            let (_, image) = received?;
            let origin = *origin.get_or_insert(image.mid_exposure);
            if wanted(number, image.sequence) {
                images.push(TimedImage::of(&image, origin));
            }
        }
        Ok(images)
    }

    /// The usable images, not decoded yet, with their places among all received.
    fn received(&self) -> Result<impl Iterator<Item = Result<(u64, CameraImage), SourceError>>, SourceError> {
        let mut recording = Recording::open(&self.path).map_err(failed)?;
        let (mut rising, mut place) = (Rising::default(), 0..);
        Ok(std::iter::from_fn(move || {
            loop {
                match recording.next() {
                    Some(Ok((_, Item::Image(image)))) => {
                        let place = place.next()?;
                        if rising.takes(image.mid_exposure) {
                            return Some(Ok((place, image)));
                        }
                    }
                    Some(Ok(_)) => {}
                    Some(Err(error)) => return Some(Err(failed(error))),
                    None => {
                        self.shortfall.get_or_init(|| self.missing(&recording, place.start));
                        let lacks_camera = place.start == 0 && recording.camera_info().is_none();
                        place.start += u64::from(lacks_camera);
                        return lacks_camera.then(|| {
                            Err(failed(RecordError::damaged(&self.path, "holds no camera's images")))
                        });
                    }
                }
            }
        }))
    }
}

impl RecordedImages {
    /// What is missing in the `recording` that was read to its end and gave `images` images; logs it as a warning too.
    fn missing(&self, recording: &Recording, images: u64) -> Option<String> {
        recording.warn_of_shortfall();
        let missing = self.received.map_or(0, |received| received.saturating_sub(images));
        let missing =
            (missing > 0).then(|| format!("{missing} of {} images are lost from it", missing + images));
        let parts: Vec<String> = recording.shortfall().into_iter().chain(missing).collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// The error of a recording that cannot be read.
pub(super) fn failed(error: RecordError) -> SourceError {
    SourceError::Recording(Box::new(error))
}

impl ImageSource for RecordedImages {
    /// A recording that was cut off or is damaged gives what is whole in it, with a warning.
    fn images(&self) -> Result<Images<'_>, SourceError> {
        let mut origin = self.origin;
        Ok(Box::new(self.received()?.map(move |received| {
            let (_, image) = received?;
            Ok(TimedImage::of(&image, *origin.get_or_insert(image.mid_exposure)))
        })))
    }

    fn len_hint(&self) -> Option<usize> {
        self.usable.as_ref().map(Vec::len)
    }

    fn remarks(&self) -> Vec<String> {
        self.shortfall.get().cloned().flatten().into_iter().collect()
    }

    /// The same sample as the run itself took while it was filmed.
    fn sample(&self, most: usize) -> Result<Vec<TimedImage>, SourceError> {
        let places = match &self.usable {
            Some(places) => places.clone(),
            None => self.received()?.map(|next| Ok(next?.0)).collect::<Result<_, SourceError>>()?,
        };
        self.numbered(&even(&places, most, self.learn_from.as_ref()).collect())
    }
}

/// The numbers of at most `most` of `places`, which rise, spread evenly over those of them that are in `range`, or over all where
/// none is.
pub(super) fn even(
    places: &[u64],
    most: usize,
    range: Option<&Range<u64>>,
) -> impl Iterator<Item = usize> + use<> {
    let start = |end: u64| places.partition_point(|&place| place < end);
    let within = range.map(|range| start(range.start)..start(range.end)).filter(|within| !within.is_empty());
    let within = within.unwrap_or(0..places.len());
    let stride = within.len().div_ceil(most).max(1);
    within.step_by(stride)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camera::fixtures;
    use record::recording::{Recorder, RecorderOptions};

    /// A recording of three images 10 ms apart, the first one at `at`, each as `changed`.
    fn record(path: &Path, at: MonotonicNs, size: (u32, u32), changed: impl Fn(CameraImage) -> CameraImage) {
        let recorder =
            Recorder::create(path, Some(&fixtures::info(size)), RecorderOptions::default()).unwrap();
        for sequence in 0..3 {
            let at = at.plus_seconds(0.01 * f64::from(sequence));
            recorder.image(changed(fixtures::image(sequence, at, size)).into()).unwrap();
        }
        recorder.finish().unwrap();
    }

    #[test]
    fn recording_is_a_source_of_timed_pictures_and_damaged_images_keep_their_place() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recording.mcap");
        record(&path, MonotonicNs(5_000_000_000), (4, 2), |image| CameraImage {
            mid_exposure: image.stamp.plus_seconds(0.001),
            damaged: image.sequence == 1,
            ..image
        });

        let source = crate::open(&path, None).unwrap();
        // More than once, as extraction does.
        for _ in 0..2 {
            let images: Vec<_> = source.images().unwrap().map(|image| image.unwrap()).collect();
            let times: Vec<_> = images.iter().map(|image| image.time_s).collect();
            assert_eq!(times, [0.0, 0.01, 0.02]);
            assert_eq!(images[2].grey.as_ref().unwrap().as_raw(), &[2; 8]);
            assert!(images[1].grey.as_ref().unwrap_err().contains("damaged"));
        }
        let from_start =
            RecordedImages { origin: Some(MonotonicNs(4_000_000_000)), ..RecordedImages::of_file(&path) };
        let first = from_start.images().unwrap().next().unwrap().unwrap();
        assert!((first.time_s - 1.001).abs() < 1e-12);
    }

    #[test]
    fn a_damaged_or_cut_recording_gives_what_is_whole_and_says_so() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recording.mcap");
        // Images larger than a chunk: each has one of its own, after that of the channels.
        record(&path, MonotonicNs(1), (4096, 2100), |image| image);
        let whole = std::fs::read(&path).unwrap();
        let second = fixtures::chunks(&whole)[2].clone();
        let read = |bytes: &[u8]| -> (Vec<String>, Vec<String>) {
            std::fs::write(&path, bytes).unwrap();
            let source = crate::open(&path, None).unwrap();
            let names = source.images().unwrap().map(|image| image.unwrap().name).collect();
            (names, source.remarks())
        };

        assert_eq!(read(&whole), (["0", "1", "2"].map(String::from).to_vec(), Vec::new()));
        let mut damaged = whole.clone();
        damaged[second.start + second.len() / 2] ^= 1;
        let (names, said) = read(&damaged);
        assert_eq!(names, ["0", "2"]);
        assert!(said[0].contains("in 1 place cannot be read"));
        let (names, said) = read(&whole[..second.end - 1]);
        assert_eq!(names, ["0"]);
        assert!(said[0].contains("cut off"));
    }
}
