//! Camera images to pictures: damaged bytes are an error, never a panic and never a huge allocation.

use std::borrow::Cow;
use std::io::Cursor;

use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, ImageDecoder as _, ImageFormat, ImageReader, Limits};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{CameraImage, Encoding};

/// Why an image could not be decoded.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The number of bytes does not fit the size.
    #[error("{encoding:?} image of {width_px}x{height_px} px has {got} bytes instead of {wanted}")]
    Length {
        /// Layout.
        encoding: Encoding,
        /// Width \[px\].
        width_px: u32,
        /// Height \[px\].
        height_px: u32,
        /// Bytes expected.
        wanted: u64,
        /// Bytes there.
        got: usize,
    },
    /// A compressed image is damaged, too large, or of another kind than it says.
    #[error("compressed image is damaged")]
    Damaged(#[from] image::ImageError),
    /// A JPEG is damaged or too large.
    #[error("JPEG is damaged: {0}")]
    Jpeg(String),
    /// The compressed image has another size than the camera said.
    #[error("image is {got_width}x{got_height} px, the camera said {width_px}x{height_px}")]
    Size {
        /// Width the camera said \[px\].
        width_px: u32,
        /// Height the camera said \[px\].
        height_px: u32,
        /// Width found \[px\].
        got_width: u32,
        /// Height found \[px\].
        got_height: u32,
    },
    /// No pixels at all, or more than [`MAX_SIDE_PX`] a side.
    #[error("image of {width_px}x{height_px} px; sides from 1 to {MAX_SIDE_PX} px are read")]
    Sides {
        /// Width \[px\].
        width_px: u32,
        /// Height \[px\].
        height_px: u32,
    },
}

/// Longest side of an image that is decoded \[px\], chosen.
pub const MAX_SIDE_PX: u32 = 8192;
/// Most memory that a decoder may use \[bytes\], chosen: RGB of the largest picture and as much again.
const MAX_DECODER_BYTES: u64 = 512 << 20;

/// A picture as cameras code it: brightness and, where there is colour, two differences of colour, all from 0 to 255 and of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Brightness, Y.
    pub grey: GrayImage,
    /// Cb and Cr; 128 is no colour.
    pub chroma: Option<[GrayImage; 2]>,
}

/// The picture of a camera's image in grey.
///
/// # Errors
/// [`DecodeError`], with the sizes that do not agree.
pub fn grey(image: &CameraImage) -> Result<GrayImage, DecodeError> {
    picture(image).map(|picture| picture.grey)
}

/// The picture of a camera's image.
///
/// # Errors
/// [`DecodeError`], with the sizes that do not agree.
pub fn picture(image: &CameraImage) -> Result<Picture, DecodeError> {
    let CameraImage { width_px, height_px, encoding, ref data, .. } = *image;
    let sides = 1..=MAX_SIDE_PX;
    if !sides.contains(&width_px) || !sides.contains(&height_px) {
        return Err(DecodeError::Sides { width_px, height_px });
    }
    let pixels = u64::from(width_px) * u64::from(height_px);
    let plain = |per_pixel: u64, planes: &dyn Fn() -> (Vec<u8>, Option<[Vec<u8>; 2]>)| {
        let length = || DecodeError::Length {
            encoding,
            width_px,
            height_px,
            wanted: pixels * per_pixel,
            got: data.len(),
        };
        if data.len() as u64 != pixels * per_pixel {
            return Err(length());
        }
        let (grey, chroma) = planes();
        Picture::of(width_px, height_px, grey, chroma).ok_or_else(length)
    };
    let picture = match encoding {
        Encoding::Grey => return plain(1, &|| (data.clone(), None)),
        Encoding::Yuyv => {
            let every = |from: usize, by: usize| data.iter().skip(from).step_by(by).copied();
            // two pixels share their colour
            let twice = |from: usize| every(from, 4).flat_map(|value| [value; 2]).collect();
            let even = width_px % 2 == 0;
            return plain(2, &|| (every(0, 2).collect(), even.then(|| [twice(1), twice(3)])));
        }
        Encoding::Jpeg => jpeg(data)?.0,
        Encoding::Png => compressed(data, ImageFormat::Png)?.0,
    };
    let (got_width, got_height) = picture.grey.dimensions();
    if (got_width, got_height) == (width_px, height_px) {
        Ok(picture)
    } else {
        Err(DecodeError::Size { width_px, height_px, got_width, got_height })
    }
}

/// The picture in the bytes of a JPEG or PNG file, whichever it is, in grey.
///
/// # Errors
/// [`DecodeError::Damaged`].
pub fn grey_file(data: &[u8]) -> Result<GrayImage, DecodeError> {
    picture_file(data).map(|picture| picture.grey)
}

/// The picture in the bytes of a JPEG or PNG file, whichever it is, turned upright where its EXIF block says that it lies on its side.
///
/// # Errors
/// [`DecodeError::Damaged`].
pub fn picture_file(data: &[u8]) -> Result<Picture, DecodeError> {
    let (picture, orientation) = match image::guess_format(data)? {
        ImageFormat::Jpeg => jpeg(data)?,
        format => compressed(data, format)?,
    };
    Ok(picture.turned(orientation))
}

impl Picture {
    /// Of planes of `width` by `height` pixels, row after row; none where one has another size.
    fn of(width: u32, height: u32, grey: Vec<u8>, chroma: Option<[Vec<u8>; 2]>) -> Option<Self> {
        let plane = |bytes| GrayImage::from_raw(width, height, bytes);
        let chroma = match chroma {
            None => None,
            Some([cb, cr]) => Some([plane(cb)?, plane(cr)?]),
        };
        Some(Self { grey: plane(grey)?, chroma })
    }

    /// As whoever looks at it sees it.
    fn turned(self, orientation: Orientation) -> Self {
        let turn = |plane: GrayImage| {
            let mut plane = DynamicImage::ImageLuma8(plane);
            plane.apply_orientation(orientation);
            plane.into_luma8()
        };
        Self { grey: turn(self.grey), chroma: self.chroma.map(|planes| planes.map(turn)) }
    }

    /// Of red, green and blue, three bytes a pixel (ITU-T T.871).
    fn of_rgb(width: u32, height: u32, rgb: &[u8]) -> Option<Self> {
        let weighted = |weights: [f32; 3], offset: f32| -> Vec<u8> {
            let value = |pixel: &[u8]| {
                let sum: f32 =
                    weights.iter().zip(pixel).map(|(weight, &value)| weight * f32::from(value)).sum();
                (sum + offset).round() as u8
            };
            rgb.chunks_exact(3).map(value).collect()
        };
        let cb = weighted([-0.168_736, -0.331_264, 0.5], 128.0);
        let cr = weighted([0.5, -0.418_688, -0.081_312], 128.0);
        Self::of(width, height, weighted([0.299, 0.587, 0.114], 0.0), Some([cb, cr]))
    }
}

/// A JPEG's planes as they are coded, no detour over red, green and blue; and how it says that it is to be turned.
fn jpeg(data: &[u8]) -> Result<(Picture, Orientation), DecodeError> {
    let data = with_huffman_tables(data);
    let side = MAX_SIDE_PX as usize;
    let options = DecoderOptions::default().set_max_width(side).set_max_height(side);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&*data), options);
    let damaged = |error: DecodeErrors| DecodeError::Jpeg(error.to_string());
    decoder.decode_headers().map_err(damaged)?;
    let coded = decoder.input_colorspace();
    let as_coded = match coded {
        Some(ColorSpace::YCbCr) => ColorSpace::YCbCr,
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        _ => ColorSpace::RGB,
    };
    decoder.set_options(options.jpeg_set_out_colorspace(as_coded));
    let bytes = decoder.decode().map_err(damaged)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let (width, height) = (width as u32, height as u32);
    let every = |plane: usize| bytes.iter().skip(plane).step_by(3).copied().collect();
    let picture = match as_coded {
        ColorSpace::Luma => Picture::of(width, height, bytes, None),
        ColorSpace::YCbCr => Picture::of(width, height, every(0), Some([every(1), every(2)])),
        _ => Picture::of_rgb(width, height, &bytes),
    };
    let picture =
        picture.ok_or_else(|| DecodeError::Jpeg("its planes are of other sizes than it says".into()))?;
    let orientation = decoder.exif().and_then(|exif| Orientation::from_exif_chunk(exif));
    Ok((picture, orientation.unwrap_or(Orientation::NoTransforms)))
}

/// The picture of another format, and how it says that it is to be turned.
fn compressed(data: &[u8], format: ImageFormat) -> Result<(Picture, Orientation), DecodeError> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    let mut reader = ImageReader::with_format(Cursor::new(data), format);
    reader.limits(limits);
    let mut decoder = reader.into_decoder()?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let image = DynamicImage::from_decoder(decoder)?;
    if !image.color().has_color() {
        return Ok((Picture { grey: image.into_luma8(), chroma: None }, orientation));
    }
    let rgb = image.into_rgb8();
    let (width_px, height_px) = rgb.dimensions();
    let picture = Picture::of_rgb(width_px, height_px, rgb.as_raw());
    picture.map(|picture| (picture, orientation)).ok_or(DecodeError::Sides { width_px, height_px })
}

/// Marker bytes after 0xFF.
const START_OF_IMAGE: u8 = 0xD8;
const START_OF_SCAN: u8 = 0xDA;
const HUFFMAN_TABLES: u8 = 0xC4;

/// A JPEG that brings no Huffman tables, as motion-JPEG cameras may send it, gets the standard ones before its
/// scan; any other passes as it is.
///
/// # Source
/// ITU-T T.81 annex K.3 (tables), USB Video Class motion-JPEG payload 1.1 (the tables may be left out).
fn with_huffman_tables(data: &[u8]) -> Cow<'_, [u8]> {
    if data.get(..2) != Some(&[0xFF, START_OF_IMAGE]) {
        return Cow::Borrowed(data);
    }
    let mut at = 2;
    loop {
        let Some(&[0xFF, marker, high, low]) = data.get(at..at + 4) else { return Cow::Borrowed(data) };
        match marker {
            HUFFMAN_TABLES => return Cow::Borrowed(data),
            START_OF_SCAN => break,
            // A fill byte may stand before any marker.
            0xFF => at += 1,
            _ => at += 2 + usize::from(u16::from_be_bytes([high, low])),
        }
    }
    let mut whole = data[..at].to_vec();
    for (class, counts, symbols) in standard_tables() {
        let length = 2 + 1 + counts.len() + symbols.len();
        whole.extend([0xFF, HUFFMAN_TABLES]);
        whole.extend((length as u16).to_be_bytes());
        whole.push(class);
        whole.extend(counts);
        whole.extend(symbols);
    }
    whole.extend(&data[at..]);
    Cow::Owned(whole)
}

/// Class and destination, number of codes of each length from 1 to 16 bits, symbols by rising code.
fn standard_tables() -> [(u8, [u8; 16], Vec<u8>); 4] {
    const DC_LUMA: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
    const DC_CHROMA: [u8; 16] = [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0];
    const AC_LUMA: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d];
    const AC_CHROMA: [u8; 16] = [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77];
    // The symbols with codes of fewer than 16 bits; the rest follow in rising order.
    const AC_LUMA_SHORT: [u8; 37] = [
        0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22,
        0x71, 0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33,
        0x62, 0x72, 0x82,
    ];
    const AC_CHROMA_SHORT: [u8; 43] = [
        0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13,
        0x22, 0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62,
        0x72, 0xd1, 0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1,
    ];
    let whole = |short: &[u8]| {
        let all = (0..16u8).flat_map(|run| (1..=10u8).map(move |size| run << 4 | size));
        short.iter().copied().chain(all.filter(|symbol| !short.contains(symbol))).collect()
    };
    [
        (0x00, DC_LUMA, (0..12).collect()),
        (0x10, AC_LUMA, whole(&AC_LUMA_SHORT)),
        (0x01, DC_CHROMA, (0..12).collect()),
        (0x11, AC_CHROMA, whole(&AC_CHROMA_SHORT)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::clock::MonotonicNs;
    use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

    const WIDTH: u32 = 40;
    const HEIGHT: u32 = 24;

    fn ramp() -> GrayImage {
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| image::Luma([(40 + 3 * x + 2 * y) as u8]))
    }

    fn received(encoding: Encoding, data: Vec<u8>) -> CameraImage {
        let at = MonotonicNs(0);
        CameraImage {
            sequence: 0,
            stamp: at,
            mid_exposure: at,
            damaged: false,
            width_px: WIDTH,
            height_px: HEIGHT,
            encoding,
            data,
        }
    }

    fn jpeg() -> Vec<u8> {
        let mut out = Vec::new();
        JpegEncoder::new_with_quality(&mut out, 90)
            .write_image(ramp().as_raw(), WIDTH, HEIGHT, ExtendedColorType::L8)
            .unwrap();
        out
    }

    /// `jpeg` without any of its Huffman table segments.
    fn bare(jpeg: &[u8]) -> Vec<u8> {
        let mut out = jpeg[..2].to_vec();
        let mut at = 2;
        while jpeg[at + 1] != START_OF_SCAN {
            let length = 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
            if jpeg[at + 1] != HUFFMAN_TABLES {
                out.extend(&jpeg[at..at + length]);
            }
            at += length;
        }
        out.extend(&jpeg[at..]);
        out
    }

    #[test]
    fn plain_layouts_give_their_luminance_and_refuse_other_lengths() {
        let picture = ramp();
        assert_eq!(grey(&received(Encoding::Grey, picture.as_raw().clone())).unwrap(), picture);
        let yuyv: Vec<u8> = picture.as_raw().iter().flat_map(|&y| [y, 128]).collect();
        assert_eq!(grey(&received(Encoding::Yuyv, yuyv.clone())).unwrap(), picture);
        for data in [yuyv[1..].to_vec(), Vec::new()] {
            assert!(matches!(grey(&received(Encoding::Yuyv, data)), Err(DecodeError::Length { .. })));
        }
    }

    #[test]
    fn colour_is_what_was_coded_and_grey_has_none() {
        let rgb = image::RgbImage::from_pixel(WIDTH, HEIGHT, image::Rgb([200, 80, 40]));
        // ITU-T T.871 of that colour
        let coded = [111u8, 88, 191];
        let near = |picture: &Picture| {
            let [cb, cr] = picture.chroma.as_ref().unwrap();
            let seen = [&picture.grey, cb, cr].map(|plane| plane.get_pixel(20, 12).0[0]);
            assert!(seen.iter().zip(coded).all(|(seen, coded)| seen.abs_diff(coded) <= 2), "{seen:?}");
        };
        for format in [ImageFormat::Jpeg, ImageFormat::Png] {
            let mut file = Cursor::new(Vec::new());
            rgb.write_to(&mut file, format).unwrap();
            near(&picture_file(file.get_ref()).unwrap());
        }
        let yuyv = [coded[0], coded[1], coded[0], coded[2]].repeat((WIDTH * HEIGHT / 2) as usize);
        near(&picture(&received(Encoding::Yuyv, yuyv)).unwrap());
        assert_eq!(picture(&received(Encoding::Jpeg, jpeg())).unwrap().chroma, None);
        assert_eq!(picture_file(&jpeg()).unwrap().grey.dimensions(), (WIDTH, HEIGHT));
    }

    #[test]
    fn file_that_lies_on_its_side_is_turned_upright_by_its_exif_block() {
        // TIFF head, one field: orientation (0x0112), a short, 6: the first row is seen on the right.
        let exif = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        let mut file = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut file, 90);
        encoder.set_exif_metadata(exif.to_vec()).unwrap();
        encoder.write_image(ramp().as_raw(), WIDTH, HEIGHT, ExtendedColorType::L8).unwrap();
        let turned = image::imageops::rotate90(&grey(&received(Encoding::Jpeg, jpeg())).unwrap());
        assert_eq!(grey_file(&file).unwrap(), turned);
        assert_eq!(grey(&received(Encoding::Jpeg, file)).unwrap().dimensions(), (WIDTH, HEIGHT));
    }

    #[test]
    fn jpeg_without_huffman_tables_decodes_like_the_whole_one() {
        let whole = grey(&received(Encoding::Jpeg, jpeg())).unwrap();
        let stripped = bare(&jpeg());
        assert!(stripped.len() < jpeg().len() - 100);
        assert_eq!(grey(&received(Encoding::Jpeg, stripped)).unwrap(), whole);
    }

    #[test]
    fn jpeg_cut_anywhere_never_panics() {
        for data in [jpeg(), bare(&jpeg())] {
            let whole = grey(&received(Encoding::Jpeg, data.clone())).unwrap();
            for length in 0..data.len() {
                if let Ok(picture) = grey(&received(Encoding::Jpeg, data[..length].to_vec())) {
                    assert_eq!(picture.dimensions(), whole.dimensions());
                }
            }
        }
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let data = jpeg();
        for i in 0..data.len() {
            let mut bad = data.clone();
            bad[i] ^= 0xFF;
            let _ = grey(&received(Encoding::Jpeg, bad));
        }
    }

    #[test]
    fn size_that_contradicts_the_camera_is_refused() {
        let image = CameraImage { width_px: WIDTH + 1, ..received(Encoding::Jpeg, jpeg()) };
        assert!(matches!(grey(&image), Err(DecodeError::Size { .. })));
        let image = CameraImage { width_px: 0, ..received(Encoding::Grey, Vec::new()) };
        assert!(matches!(grey(&image), Err(DecodeError::Sides { .. })));
    }
}
