//! Images that are the one before again: a film saved at more images a second than it was filmed with, or a camera's driver that hands one out
//! twice.

use std::sync::{Mutex, MutexGuard, PoisonError};

use camera::source::{SourceError, TimedImage};
use image::GrayImage;

/// Looks for them while a sequence is read.
#[derive(Debug, Default)]
pub(super) struct Repeats {
    /// How far each image is from the one before: the mean difference of their grey levels; none across images that could not be read.
    steps: Mutex<Vec<f32>>,
}

/// A step that is smaller than this share of both beside it is none of the mechanism's, which cannot stop for one image; chosen. Lossy coding
/// makes the same image a little different.
const MAX_REPEATED_SHARE: f32 = 0.25;

impl Repeats {
    /// The same `images`, from the sequence's beginning on.
    pub(super) fn watch<'a>(
        &'a self,
        images: impl Iterator<Item = Result<TimedImage, SourceError>> + 'a,
    ) -> impl Iterator<Item = Result<TimedImage, SourceError>> + 'a {
        let (mut before, mut count) = (None::<GrayImage>, 0);
        images.inspect(move |image| {
            let grey = image.as_ref().ok().and_then(|image| image.grey.as_ref().ok());
            if let (Some(grey), Some(before)) = (grey, &before)
                && grey.dimensions() == before.dimensions()
            {
                // A sequence is the same in each reading, and some end early.
                let mut steps = self.steps();
                if steps.len() == count {
                    steps.push(mean_difference(grey, before));
                }
                count += 1;
            }
            before = grey.cloned();
        })
    }

    /// What is to be said of those that were read, as a sentence without its full stop.
    pub(super) fn remark(&self) -> Option<String> {
        let steps = self.steps();
        let is_alone = |i: usize| match steps.get(i.wrapping_sub(1)..=i + 1) {
            Some(&[before, own, after]) => own < MAX_REPEATED_SHARE * before.min(after),
            _ => false,
        };
        let repeated = steps.iter().enumerate().filter(|&(i, &step)| step == 0.0 || is_alone(i)).count();
        (repeated > 0).then(|| {
            format!(
                "{repeated} of {} images are the one before again: where the mechanism moved meanwhile, the film was saved at more images a \
                 second than it was filmed with, and the times of these are wrong",
                steps.len() + 1
            )
        })
    }

    fn steps(&self) -> MutexGuard<'_, Vec<f32>> {
        self.steps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn mean_difference(a: &GrayImage, b: &GrayImage) -> f32 {
    let sum: u64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f32 / a.as_raw().len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(levels: &[u8]) -> Option<String> {
        let image = |grey: &u8| {
            let grey = GrayImage::from_pixel(2, 2, image::Luma([*grey]));
            Ok(TimedImage { name: String::new(), time_s: 0.0, grey: Ok(grey), chroma: None })
        };
        let repeats = Repeats::default();
        // As extraction reads: more than once, and not to the end at last.
        for _ in 0..2 {
            assert_eq!(repeats.watch(levels.iter().map(image)).count(), levels.len());
        }
        repeats.watch(levels.iter().map(image)).take(2).for_each(drop);
        repeats.remark()
    }

    #[test]
    fn images_that_are_the_one_before_again_to_the_bit_or_nearly_are_counted() {
        assert!(said(&[1, 1, 2, 3, 3, 1]).unwrap().starts_with("2 of 6 images are the one before again"));
        assert!(said(&[10, 20, 21, 31, 32, 42, 43, 53]).unwrap().starts_with("3 of 8 images"));
        assert_eq!(said(&[1, 2, 1, 3, 5]), None);
        // A film that begins and ends slowly.
        assert_eq!(said(&[10, 11, 12, 15, 20, 30, 40, 45, 48, 49, 50]), None);
        assert_eq!(said(&[]), None);
    }
}
