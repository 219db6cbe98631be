//! What SAM 2 remembers of the images it has seen, and how that is put together for the next one.
//!
//! The clicked image is remembered for good, of the others the latest [`LATEST`] as features and the latest [`POINTERS`] as pointers
//! (the clicked one's included).
//!
//! # Source
//! facebookresearch/sam2, `sam2/modeling/sam2_base.py`, as of commit 2b90b9f: the order in which the model was trained. Public loops around
//! ONNX exports number the images the other way round, or forget the clicked one.

use std::collections::VecDeque;

use super::array::Array;

/// Images remembered as features, beside the clicked one.
pub(super) const LATEST: usize = 6;
/// Pointers at most.
pub(super) const POINTERS: usize = 16;
/// Numbers of a pointer, and of one of its tokens.
pub(super) const POINTER: usize = 256;
const TOKEN: usize = 64;
/// Cells of features, and numbers a cell.
const CELLS: usize = 64 * 64;
const CHANNELS: usize = 64;

/// What is remembered of one image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Memory {
    /// The image's number.
    pub(super) image: usize,
    /// Shape (1, 64, 64, 64).
    pub(super) features: Array,
    /// Where its cells are, shape (4096, 1, 64).
    pub(super) position: Array,
    /// Shape (1, 256).
    pub(super) pointer: Array,
}

/// All that is remembered.
#[derive(Debug, Clone, Default)]
pub(super) struct Memories {
    clicked: Option<Memory>,
    /// The latest first.
    latest: VecDeque<Memory>,
    /// How long ago, 7 rows of 64 numbers; none where the export has no such code.
    age: Option<Vec<f32>>,
}

/// What the attention takes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Recalled {
    /// Pointers, shape (pointers, 256).
    pub(super) pointers: Array,
    /// Images from each pointer's to this one, shape (pointers).
    pub(super) offsets: Array,
    /// Features, shape (images, 64, 64, 64).
    pub(super) features: Array,
    /// Where and when the features are, shape (4096 images, 1, 64); where asked for, with four rows of 0 a pointer after them.
    pub(super) positions: Array,
}

impl Memories {
    /// Of the clicked image alone; `age` as the memory encoder gives it, shape (7, …, 64).
    pub(super) fn of_clicked(memory: Memory, age: Option<Array>) -> Self {
        Self { clicked: Some(memory), latest: VecDeque::new(), age: age.map(|age| age.values) }
    }

    /// Forgets all but the clicked image.
    pub(super) fn rewind(&mut self) {
        self.latest.clear();
    }

    /// Remembers the next image.
    pub(super) fn take(&mut self, memory: Memory) {
        self.latest.push_front(memory);
        self.latest.truncate(POINTERS - 1);
    }

    /// What there is to remember for the image of number `image`; `with_pointers`: positions have rows for pointers too.
    pub(super) fn recalled(&self, image: usize, with_pointers: bool) -> Recalled {
        let away = |memory: &Memory| memory.image.abs_diff(image);
        let latest =
            |within: usize| self.latest.iter().filter(move |memory| (1..=within).contains(&away(memory)));
        // The oldest first.
        let mut remembered: Vec<&Memory> = latest(LATEST).collect();
        remembered.reverse();
        let (mut features, mut positions) = (Vec::new(), Vec::new());
        for (row, memory) in self.clicked.iter().map(|memory| (LATEST, memory)).chain(
            // The image before this is the first row, whichever way the film is gone through.
            remembered.into_iter().map(|memory| (away(memory) - 1, memory)),
        ) {
            features.extend_from_slice(&memory.features.values);
            match self.age.as_ref().map(|age| &age[row * CHANNELS..(row + 1) * CHANNELS]) {
                Some(age) => {
                    let cells = memory.position.values.chunks_exact(CHANNELS);
                    positions
                        .extend(cells.flat_map(|cell| cell.iter().zip(age).map(|(place, age)| place + age)));
                }
                None => positions.extend_from_slice(&memory.position.values),
            }
        }
        let (mut pointers, mut offsets) = (Vec::new(), Vec::new());
        for memory in self.clicked.iter().chain(latest(POINTERS - 1)).take(POINTERS) {
            pointers.extend_from_slice(&memory.pointer.values);
            offsets.push(away(memory) as f32);
        }
        if with_pointers {
            let tokens = offsets.len() * POINTER / TOKEN;
            positions.resize(positions.len() + tokens * CHANNELS, 0.0);
        }
        Recalled {
            pointers: Array::new([offsets.len(), POINTER], pointers),
            offsets: Array::new([offsets.len()], offsets),
            features: Array::new([features.len() / (CELLS * CHANNELS), CHANNELS, 64, 64], features),
            positions: Array::new([positions.len() / CHANNELS, 1, CHANNELS], positions),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of image `n` are `n`, its pointer is `-n`, its cells' places 1000.
    fn memory(n: usize) -> Memory {
        let filled = |shape: [usize; 4], value: f32| Array::new(shape, vec![value; shape.iter().product()]);
        Memory {
            image: n,
            features: filled([1, CHANNELS, 64, 64], n as f32),
            position: Array::new([CELLS, 1, CHANNELS], vec![1000.0; CELLS * CHANNELS]),
            pointer: Array::new([1, POINTER], vec![-(n as f32); POINTER]),
        }
    }

    /// Row r of the code of age is r + c / 100 at number c.
    fn age() -> Array {
        let values =
            (0..7 * CHANNELS).map(|i| (i / CHANNELS) as f32 + (i % CHANNELS) as f32 / 100.0).collect();
        Array::new([7, 1, 1, CHANNELS], values)
    }

    /// Images and rows of age, pointers' images and offsets, as assembled for `image`.
    fn assembled(memories: &Memories, image: usize) -> [Vec<(f32, f32)>; 2] {
        let Recalled { pointers, offsets, features, positions } = memories.recalled(image, true);
        let (images, pointed) = (features.shape[0], pointers.shape[0]);
        assert_eq!(features.shape, [images, 64, 64, 64]);
        assert_eq!(positions.shape, [CELLS * images + 4 * pointed, 1, CHANNELS]);
        assert_eq!(offsets.shape, [pointed]);
        let seen = (0..images).map(|m| {
            let of = &features.values[m * CELLS * CHANNELS..(m + 1) * CELLS * CHANNELS];
            assert!(of.iter().all(|value| *value == of[0]), "one image's features stay together");
            let place = &positions.values[m * CELLS * CHANNELS..(m + 1) * CELLS * CHANNELS];
            let row = place[0] - 1000.0;
            for cell in place.chunks_exact(CHANNELS) {
                for (c, value) in cell.iter().enumerate() {
                    assert!((value - 1000.0 - row - c as f32 / 100.0).abs() < 1e-3, "{m} {c} {value}");
                }
            }
            (of[0], row)
        });
        let tail = &positions.values[images * CELLS * CHANNELS..];
        assert!(tail.len() == 4 * pointed * CHANNELS && tail.iter().all(|value| *value == 0.0));
        let pointers = pointers.values.chunks_exact(POINTER).zip(&offsets.values);
        [seen.collect(), pointers.map(|(pointer, offset)| (-pointer[7], *offset)).collect()]
    }

    #[test]
    fn memories_are_put_together_as_the_model_was_trained() {
        let mut memories = Memories::of_clicked(memory(10), Some(age()));
        // The first image after the click knows only that.
        assert_eq!(assembled(&memories, 11), [[(10.0, 6.0)], [(10.0, 1.0)]]);
        memories.take(memory(11));
        let [seen, pointed] = assembled(&memories, 12);
        assert_eq!(seen, [(10.0, 6.0), (11.0, 0.0)], "the image before has the first row of age");
        assert_eq!(pointed, [(10.0, 2.0), (11.0, 1.0)]);
        for n in 12..40 {
            memories.take(memory(n));
            let [seen, pointed] = assembled(&memories, n + 1);
            let latest = (0..LATEST.min(n - 10)).rev().map(|k| ((n - k) as f32, k as f32));
            assert_eq!(seen, std::iter::once((10.0, 6.0)).chain(latest).collect::<Vec<_>>(), "{n}");
            let latest = (0..(POINTERS - 1).min(n - 10)).map(|k| ((n - k) as f32, (k + 1) as f32));
            let clicked = (10.0, (n + 1 - 10) as f32);
            assert_eq!(pointed, std::iter::once(clicked).chain(latest).collect::<Vec<_>>(), "{n}");
        }
    }

    #[test]
    fn backwards_the_image_after_is_the_one_before() {
        let mut memories = Memories::of_clicked(memory(30), Some(age()));
        memories.take(memory(31));
        memories.rewind();
        for n in (21..30).rev() {
            memories.take(memory(n));
        }
        let [seen, pointed] = assembled(&memories, 20);
        let rows: Vec<(f32, f32)> = (0..6).rev().map(|k| ((21 + k) as f32, k as f32)).collect();
        assert_eq!(seen[0], (30.0, 6.0));
        assert_eq!(seen[1..], rows);
        assert_eq!(pointed.len(), 10);
        assert_eq!(pointed[..2], [(30.0, 10.0), (21.0, 1.0)]);
    }

    #[test]
    fn an_image_that_was_left_out_keeps_its_row_of_age() {
        let mut memories = Memories::of_clicked(memory(0), Some(age()));
        for n in [1, 2, 4, 5] {
            memories.take(memory(n));
        }
        let [seen, _] = assembled(&memories, 8);
        assert_eq!(seen, [(0.0, 6.0), (2.0, 5.0), (4.0, 3.0), (5.0, 2.0)]);
    }

    #[test]
    fn exports_without_a_code_of_age_or_with_offsets_get_their_own_arrays() {
        let memories = Memories::of_clicked(memory(3), None);
        let recalled = memories.recalled(4, false);
        assert_eq!(recalled.positions.shape, [CELLS, 1, CHANNELS]);
        assert!(recalled.positions.values.iter().all(|value| *value == 1000.0));
        assert_eq!(recalled.offsets.values, [1.0]);
    }
}
