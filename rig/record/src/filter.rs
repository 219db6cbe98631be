//! A lossless filter of images: each pixel is replaced by its difference to a prediction from the rows above it, which zstd compresses
//! to less than half. Each image is filtered by itself, so none needs another one to be read.
//!
//! An image with filter 1 has its bytes in planes (grey: one; yuyv: all Y, then all U, then all V), each of shape (height, plane
//! width). The first row stands as it is. Of any other row the difference, modulo 256, to
//!
//! p(x) = ⌊(s(x−1) + 2 s(x) + s(x+1) + 4) / 8⌋, s(x) = above(x) + above2(x)
//!
//! where `above` and `above2` are the one and the two rows above (`above` twice in the second row), and s at the edges is continued
//! with its outermost value. Nothing to the left is used: a row is decoded many pixels at once, in numpy too (`docs/recording.md`).
//!
//! Neighbouring noise is independent, so a difference is noisier than its pixel; the mean over six pixels keeps that at 1.09 sigma,
//! 0.12 bit a pixel. Edges cost more, but a tank has few.

use camera::wire::{self, WireError};
use camera::{CameraImage, Encoding};

/// How an image's bytes were changed for the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Filter {
    /// As received.
    None = 0,
    /// Planes of differences to the rows above.
    Rows = 1,
}

/// Offset of the filter's number in an image's message \[bytes\]; the number is 0 in messages older than filters.
const FILTER_OFFSET_BYTES: usize = 3;

/// Appends the message of `image` to `out`: its header as in [`wire`], with the filter's number in it, and its bytes filtered.
pub fn encode(image: &CameraImage, out: &mut Vec<u8>) {
    let from = out.len();
    out.extend_from_slice(&wire::header(image));
    let filter = apply(image, out);
    out[from + FILTER_OFFSET_BYTES] = filter as u8;
}

/// The image of such a message, as received.
///
/// # Errors
/// [`WireError`].
pub fn decode(message: &[u8]) -> Result<CameraImage, WireError> {
    let image = wire::decode(message)?;
    let filter = message[FILTER_OFFSET_BYTES];
    let unknown = || WireError::Unknown { field: "filter", value: filter.into() };
    match filter {
        0 => Ok(image),
        1 => undo(image).ok_or_else(unknown),
        _ => Err(unknown()),
    }
}

/// Widths of the planes \[samples\]; none where the bytes are not whole rows of pixels: compressed or damaged images.
fn plane_widths(image: &CameraImage) -> Option<[usize; 3]> {
    let width = image.width_px as usize;
    let widths = match image.encoding {
        Encoding::Grey => [width, 0, 0],
        Encoding::Yuyv => [width, width.div_ceil(2), width / 2],
        Encoding::Jpeg | Encoding::Png => return None,
    };
    let row_bytes: usize = widths.iter().sum();
    let bytes = row_bytes.checked_mul(image.height_px as usize)?;
    (bytes != 0 && bytes == image.data.len()).then_some(widths)
}

/// Appends the bytes of `image` to `out`, filtered where that is possible; returns the filter used.
fn apply(image: &CameraImage, out: &mut Vec<u8>) -> Filter {
    let Some(widths) = plane_widths(image) else {
        out.extend_from_slice(&image.data);
        return Filter::None;
    };
    match image.encoding {
        Encoding::Yuyv => {
            let planar = to_planes(&image.data, widths);
            each_plane(&planar, widths, image.height_px, |plane, width| differences(plane, width, out));
        }
        _ => differences(&image.data, widths[0], out),
    }
    Filter::Rows
}

/// Gives `image`, whose bytes are filtered with [`Filter::Rows`], its bytes as received; none where they cannot be so filtered.
fn undo(mut image: CameraImage) -> Option<CameraImage> {
    let widths = plane_widths(&image)?;
    let mut rest = image.data.as_mut_slice();
    for width in widths.into_iter().filter(|&width| width != 0) {
        let (plane, after) = rest.split_at_mut(width * image.height_px as usize);
        sums_of_differences(plane, width);
        rest = after;
    }
    if image.encoding == Encoding::Yuyv {
        image.data = from_planes(&image.data, widths);
    }
    Some(image)
}

fn each_plane(planar: &[u8], widths: [usize; 3], height_px: u32, mut use_plane: impl FnMut(&[u8], usize)) {
    let mut rest = planar;
    for width in widths.into_iter().filter(|&width| width != 0) {
        let (plane, after) = rest.split_at(width * height_px as usize);
        use_plane(plane, width);
        rest = after;
    }
}

/// Y U Y V to all Y, all U, all V.
fn to_planes(packed: &[u8], widths: [usize; 3]) -> Vec<u8> {
    let mut planar = Vec::with_capacity(packed.len());
    let row_bytes = widths.iter().sum();
    for (first, step) in [(0, 2), (1, 4), (3, 4)] {
        for row in packed.chunks_exact(row_bytes) {
            planar.extend(row.iter().skip(first).step_by(step));
        }
    }
    planar
}

/// All Y, all U, all V to Y U Y V.
fn from_planes(planar: &[u8], widths: [usize; 3]) -> Vec<u8> {
    let mut packed = vec![0; planar.len()];
    let row_bytes = widths.iter().sum();
    let mut samples = planar.iter();
    for (first, step) in [(0, 2), (1, 4), (3, 4)] {
        for row in packed.chunks_exact_mut(row_bytes) {
            row.iter_mut().skip(first).step_by(step).zip(&mut samples).for_each(|(to, from)| *to = *from);
        }
    }
    packed
}

/// Predicts each row from the rows above it, with the buffer that this takes.
struct RowPredictor {
    /// Sums of the two rows above, shape (width + 2): continued by one at each end.
    sums: Vec<u16>,
}

impl RowPredictor {
    fn new(width: usize) -> Self {
        Self { sums: vec![0; width + 2] }
    }

    /// `change(pixel, predicted)` for each pixel of `row`, under the rows `above` of the same plane, of which there is at least one.
    fn each(&mut self, above: &[u8], row: &mut [u8], change: impl Fn(u8, u8) -> u8) {
        let width = row.len();
        let one = &above[above.len() - width..];
        let two = if above.len() >= 2 * width { &above[above.len() - 2 * width..][..width] } else { one };
        for ((sum, &one), &two) in self.sums[1..=width].iter_mut().zip(one).zip(two) {
            *sum = u16::from(one) + u16::from(two);
        }
        self.sums[0] = self.sums[1];
        self.sums[width + 1] = self.sums[width];
        // Slices of one length let the compiler take many pixels at once.
        let (left, here, right) = (&self.sums[..width], &self.sums[1..][..width], &self.sums[2..][..width]);
        for x in 0..width {
            let predicted = (left[x] + 2 * here[x] + right[x] + 4) >> 3;
            row[x] = change(row[x], predicted as u8);
        }
    }
}

/// Appends the filtered form of a plane.
fn differences(plane: &[u8], width: usize, out: &mut Vec<u8>) {
    let from = out.len();
    out.extend_from_slice(plane);
    let mut predictor = RowPredictor::new(width);
    for (above, row) in (width..plane.len()).step_by(width).zip(out[from..].chunks_exact_mut(width).skip(1)) {
        predictor.each(&plane[..above], row, u8::wrapping_sub);
    }
}

/// The reverse of [`differences`], in place.
fn sums_of_differences(plane: &mut [u8], width: usize) {
    let mut predictor = RowPredictor::new(width);
    for at in (width..plane.len()).step_by(width) {
        let (above, rest) = plane.split_at_mut(at);
        predictor.each(above, &mut rest[..width], u8::wrapping_add);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use camera::fixtures;
    use ground::clock::MonotonicNs;

    fn image(encoding: Encoding, (width_px, height_px): (u32, u32), data: Vec<u8>) -> CameraImage {
        CameraImage { encoding, width_px, height_px, data, ..fixtures::image(0, MonotonicNs(0), (1, 1)) }
    }

    /// The filter's number in the message of `image`, the filtered bytes, and the bytes that come back of them.
    fn there_and_back(image: &CameraImage) -> (u8, Vec<u8>, Vec<u8>) {
        let mut message = vec![77];
        encode(image, &mut message);
        let back = decode(&message[1..]).unwrap();
        assert_eq!(wire::header(&back), wire::header(image));
        (message[1 + FILTER_OFFSET_BYTES], message[1 + wire::HEADER_BYTES..].to_vec(), back.data)
    }

    #[test]
    fn filtered_bytes_are_pinned() {
        let rows = [[10, 20, 30], [11, 19, 33], [0, 255, 30]];
        let (filter, bytes, _) = there_and_back(&image(Encoding::Grey, (3, 3), rows.concat()));
        // Sums above the second row are 20, 40, 60; above the third 21, 39, 63.
        let second = [(20 + 2 * 20 + 40 + 4) / 8, (20 + 2 * 40 + 60 + 4) / 8, (40 + 2 * 60 + 60 + 4) / 8];
        let third = [(21 + 2 * 21 + 39 + 4) / 8, (21 + 2 * 39 + 63 + 4) / 8, (39 + 2 * 63 + 63 + 4) / 8];
        assert_eq!((second, third), ([13, 20, 28], [13, 20, 29]));
        let second = [254, 255, 5];
        let third = [243, 235, 1];
        assert_eq!((filter, bytes), (1, [[10, 20, 30], second, third].concat()));

        let packed = vec![1, 2, 3, 4, 5, 6, 7, 8];
        let (filter, planes, _) = there_and_back(&image(Encoding::Yuyv, (4, 1), packed));
        assert_eq!((filter, planes), (1, vec![1, 3, 5, 7, 2, 6, 4, 8]));
    }

    #[test]
    fn an_evenly_lit_picture_becomes_zeros() {
        for (encoding, bytes_per_pixel) in [(Encoding::Grey, 1), (Encoding::Yuyv, 2)] {
            let even = image(encoding, (16, 9), vec![131; 16 * 9 * bytes_per_pixel]);
            let (_, bytes, _) = there_and_back(&even);
            let others = bytes.iter().filter(|&&byte| byte != 0).count();
            assert_eq!(others, 16 * bytes_per_pixel, "the first row of each plane, nothing else");
        }
    }

    #[test]
    fn what_is_no_picture_of_whole_rows_stays_as_received() {
        for unfit in [
            image(Encoding::Jpeg, (2, 2), vec![1, 2, 3, 4]),
            image(Encoding::Png, (2, 2), vec![1, 2, 3, 4]),
            image(Encoding::Grey, (2, 2), vec![1, 2, 3]),
            image(Encoding::Yuyv, (2, 2), vec![1; 9]),
            image(Encoding::Grey, (0, 7), Vec::new()),
            image(Encoding::Yuyv, (u32::MAX, u32::MAX), vec![1; 9]),
        ] {
            let (filter, bytes, _) = there_and_back(&unfit);
            assert_eq!((filter, &bytes), (0, &unfit.data));
            // A message that claims otherwise is refused, not believed.
            let mut message = Vec::new();
            encode(&unfit, &mut message);
            message[FILTER_OFFSET_BYTES] = 1;
            assert!(matches!(decode(&message), Err(WireError::Unknown { field: "filter", value: 1 })));
        }
    }

    proptest! {
        #[test]
        fn every_image_comes_back_to_the_byte(
            width_px in 1u32..40,
            height_px in 1u32..12,
            yuyv in any::<bool>(),
            noise in proptest::collection::vec(any::<u8>(), 40 * 12 * 2),
        ) {
            let encoding = if yuyv { Encoding::Yuyv } else { Encoding::Grey };
            let bytes = (width_px * height_px) as usize * if yuyv { 2 } else { 1 };
            let sent = image(encoding, (width_px, height_px), noise[..bytes].to_vec());
            let (filter, _, back) = there_and_back(&sent);
            prop_assert_eq!(filter, 1);
            prop_assert_eq!(back, sent.data);
        }
    }
}
