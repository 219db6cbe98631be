//! Whether an image is one of its own. Drivers and lines that fall behind hand out a picture twice, or the upper part of one
//! with the lower part of another; both look as sound as any.

use std::collections::VecDeque;

use image::GrayImage;

use super::rejection::Rejection;

/// A number for each row of a picture, the same for the same bytes; none for a row of one grey level, which says nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Marks(Vec<Option<u64>>);

/// Rows in a row that are those of an image before and make an image torn: noise repeats none.
const TORN_ROWS: usize = 12;
/// Share of the rows by which an image is the one before again.
const REPEATED_SHARE: f64 = 0.95;
/// Where more than this share of the rows is usually the same from image to image, as without noise or much compressed, the
/// same rows say nothing.
const USUAL_SHARE: f64 = 0.01;
/// Images seen before the usual share is believed.
const SEEN_BEFORE: u32 = 5;
/// Images before that parts may come from: a driver's buffers are used in turn.
const LOOKED_BACK: usize = 3;
/// What one image counts in the usual share.
const FORGETTING: f64 = 0.1;

impl Marks {
    pub(super) fn of(image: &GrayImage) -> Self {
        /// An odd number with many ones, as multiplicative hashes want it.
        const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
        let mark = |row: &[u8]| {
            let (words, rest) = row.as_chunks::<8>();
            let mixed = |mark: u64, word: u64| (mark.rotate_left(23) ^ word).wrapping_mul(FACTOR);
            let mark = words.iter().fold(0, |mark, word| mixed(mark, u64::from_le_bytes(*word)));
            let mark = rest.iter().fold(mark, |mark, byte| mixed(mark, u64::from(*byte)));
            (row.iter().any(|grey| *grey != row[0])).then_some(mark)
        };
        Self(image.as_raw().chunks_exact((image.width() as usize).max(1)).map(mark).collect())
    }

    /// Share of the rows that are the same as in `other`, and how many in a row at most.
    fn same(&self, other: &Self) -> (f64, usize) {
        let (mut marked, mut same, mut run, mut longest) = (0, 0, 0, 0);
        for (own, other) in self.0.iter().zip(&other.0).filter(|(own, _)| own.is_some()) {
            marked += 1;
            run = if own == other { run + 1 } else { 0 };
            same += usize::from(run > 0);
            longest = longest.max(run);
        }
        (f64::from(same as u32) / f64::from(marked.max(1) as u32), longest)
    }
}

/// Follows a sequence.
#[derive(Debug, Default)]
pub(super) struct Continuity {
    /// The newest first.
    before: VecDeque<Marks>,
    usual_share: f64,
    seen: u32,
}

impl Continuity {
    /// Takes the next image in.
    ///
    /// # Errors
    /// [`Rejection::Repeated`] and [`Rejection::Torn`].
    pub(super) fn take(&mut self, marks: Marks) -> Result<(), Rejection> {
        let alike: Vec<(f64, usize)> = self.before.iter().map(|before| marks.same(before)).collect();
        let latest = alike.first().map_or(0.0, |(share, _)| *share);
        let share = alike.iter().map(|(share, _)| *share).fold(0.0, f64::max);
        let rows = alike.iter().map(|(_, rows)| *rows).max().unwrap_or(0);
        let judged = self.seen >= SEEN_BEFORE && self.usual_share < USUAL_SHARE;
        self.before.push_front(marks);
        self.before.truncate(LOOKED_BACK);
        if judged && share >= REPEATED_SHARE {
            return Err(Rejection::Repeated);
        }
        if judged && rows >= TORN_ROWS {
            return Err(Rejection::Torn { rows });
        }
        self.seen += 1;
        self.usual_share += FORGETTING.max(1.0 / f64::from(self.seen)) * (latest - self.usual_share);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    fn noisy(seed: u32, noise: u32) -> GrayImage {
        GrayImage::from_fn(64, 48, |x, y| {
            let mixed = (x * 7919 + y * 104_729 + seed * 1_299_709).wrapping_mul(2_654_435_761) >> 16;
            Luma([100 + (mixed % (noise + 1)) as u8 + (x / 8) as u8])
        })
    }

    fn reasons(images: &[GrayImage]) -> Vec<Option<Rejection>> {
        let mut continuity = Continuity::default();
        images.iter().map(|image| continuity.take(Marks::of(image)).err()).collect()
    }

    #[test]
    fn repeated_and_torn_images_of_a_noisy_camera_are_told() {
        let mut images: Vec<GrayImage> = (0..12).map(|seed| noisy(seed, 5)).collect();
        images[8] = images[7].clone();
        let torn = GrayImage::from_fn(64, 48, |x, y| *images[if y < 20 { 9 } else { 10 }].get_pixel(x, y));
        images[10] = torn;
        let told = reasons(&images);
        assert_eq!(told[8], Some(Rejection::Repeated));
        assert_eq!(told[10], Some(Rejection::Torn { rows: 20 }));
        let sound = told.iter().enumerate().filter(|(i, _)| ![8, 10].contains(i));
        assert!(sound.clone().all(|(_, why)| why.is_none()), "{told:?}");
    }

    #[test]
    fn without_noise_nothing_is_told_from_the_same_rows() {
        let images: Vec<GrayImage> = (0..20).map(|i| noisy(i / 4, 0)).collect();
        assert!(reasons(&images).iter().all(Option::is_none));
    }
}
