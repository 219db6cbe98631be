//! A part of another source, with slow motion converted to real time.

use camera::source::SourceError;
use camera::source::{ImageSource, Images, TimedImage, even_sample};

/// Which part of a source is wanted, and how much slower than life it plays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    from_s: f64,
    to_s: f64,
    slow_motion: f64,
}

impl Window {
    /// The images from `from_s` to `to_s` \[s\], both included and both in the source's own time; each time is then divided by
    /// `slow_motion`. Left out: from the beginning, to the end, as fast as life.
    ///
    /// # Errors
    /// [`SourceError::Window`] when the part ends before it begins, [`SourceError::SlowMotion`] when the factor is not a positive number.
    pub fn new(
        from_s: Option<f64>,
        to_s: Option<f64>,
        slow_motion: Option<f64>,
    ) -> Result<Self, SourceError> {
        let (from_s, to_s) = (from_s.unwrap_or(f64::NEG_INFINITY), to_s.unwrap_or(f64::INFINITY));
        let slow_motion = slow_motion.unwrap_or(1.0);
        if from_s.is_nan() || to_s.is_nan() || from_s > to_s {
            return Err(Self { from_s, to_s, slow_motion }.empty());
        }
        if !(slow_motion.is_finite() && slow_motion > 0.0) {
            return Err(SourceError::SlowMotion { factor: slow_motion });
        }
        Ok(Self { from_s, to_s, slow_motion })
    }

    fn empty(&self) -> SourceError {
        let bound = |s: f64, none: &str| if s.is_infinite() { none.into() } else { format!("{s} s") };
        SourceError::Window { from: bound(self.from_s, "the beginning"), to: bound(self.to_s, "the end") }
    }

    fn is_whole(&self) -> bool {
        self.from_s == f64::NEG_INFINITY && self.to_s == f64::INFINITY
    }
}

/// The images of a source that lie in a [`Window`].
pub struct Trimmed {
    source: Box<dyn ImageSource>,
    window: Window,
}

impl Trimmed {
    /// The part `window` of `source`.
    pub fn new(source: Box<dyn ImageSource>, window: Window) -> Self {
        Self { source, window }
    }
}

impl ImageSource for Trimmed {
    fn remarks(&self) -> Vec<String> {
        self.source.remarks()
    }

    fn images(&self) -> Result<Images<'_>, SourceError> {
        let Window { from_s, to_s, slow_motion } = self.window;
        let mut images = self
            .source
            .images()?
            .skip_while(move |image| image.as_ref().is_ok_and(|image| image.time_s < from_s))
            // An error is passed on; the first image behind the end ends the reading, so that a long film is not decoded.
            .take_while(move |image| !image.as_ref().is_ok_and(|image| image.time_s > to_s))
            .map(move |image| image.map(|image| TimedImage { time_s: image.time_s / slow_motion, ..image }))
            .peekable();
        if images.peek().is_none() && !self.window.is_whole() {
            return Err(self.window.empty());
        }
        Ok(Box::new(images))
    }

    fn len_hint(&self) -> Option<usize> {
        self.source.len_hint().filter(|_| self.window.is_whole())
    }

    /// A source that is used as a whole chooses its own sample.
    fn sample(&self, most: usize) -> Result<Vec<TimedImage>, SourceError> {
        if self.window.is_whole() { self.source.sample(most) } else { even_sample(self, most) }
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    /// Times of what is left of ten pictures, one a second.
    fn left(from_s: Option<f64>, to_s: Option<f64>, factor: Option<f64>) -> Result<Vec<f64>, SourceError> {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..10 {
            GrayImage::new(2, 2).save(folder.path().join(format!("{i}.png"))).unwrap();
        }
        let window = Window::new(from_s, to_s, factor)?;
        let source = Trimmed::new(crate::open(folder.path(), Some(1.0))?, window);
        // More than once, as extraction does.
        assert_eq!(source.sample(100)?.len(), source.images()?.count());
        source.images()?.map(|image| image.map(|image| image.time_s)).collect()
    }

    #[test]
    fn both_ends_are_included_and_count_in_the_sources_own_time() {
        assert_eq!(left(Some(2.0), Some(4.0), None).unwrap(), [2.0, 3.0, 4.0]);
        assert_eq!(left(Some(6.0), None, Some(8.0)).unwrap(), [0.75, 0.875, 1.0, 1.125]);
        assert_eq!(left(None, Some(1.5), Some(0.5)).unwrap(), [0.0, 2.0]);
        assert_eq!(left(None, None, None).unwrap().len(), 10);
    }

    #[test]
    fn an_empty_part_and_a_factor_that_is_none_are_refused() {
        for (from_s, to_s) in [(Some(4.0), Some(2.0)), (Some(20.0), None), (Some(f64::NAN), None)] {
            assert!(matches!(left(from_s, to_s, None), Err(SourceError::Window { .. })), "{from_s:?}");
        }
        for factor in [0.0, -8.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(left(None, None, Some(factor)), Err(SourceError::SlowMotion { .. })));
        }
    }
}
