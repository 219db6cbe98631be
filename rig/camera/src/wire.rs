//! One image as bytes: the message of a recording's camera channel and of a mock camera's socket.
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | u8 | version of this layout, 1 |
//! | 1 | u8 | encoding: 0 grey, 1 yuyv, 2 jpeg, 3 png |
//! | 2 | u8 | flags: bit 0 damaged |
//! | 3 | u8 | 0; in recordings the number of the filter that changed the data, see `record::filter` |
//! | 4 | u32 | sequence |
//! | 8 | u64 | stamp on CLOCK_MONOTONIC \[ns\] |
//! | 16 | u64 | mid-exposure on CLOCK_MONOTONIC \[ns\] |
//! | 24 | u32 | width \[px\] |
//! | 28 | u32 | height \[px\] |
//! | 32 | u32 | number of data bytes |
//! | 36 | | the data, as the camera sent them |
//!
//! Little endian throughout.

use super::{CameraImage, Encoding};
use ground::clock::MonotonicNs;

/// Bytes before the data.
pub const HEADER_BYTES: usize = 36;

/// Most data bytes of an image, chosen: far above any camera's, so that a corrupted length is noticed.
pub const MAX_DATA_BYTES: usize = 64 << 20;

/// Version of the layout, the header's first byte.
const LAYOUT_VERSION: u8 = 1;
/// The flag of a damaged image.
const DAMAGED_FLAG: u8 = 1;

/// Why bytes are not an image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Fewer bytes than stated.
    #[error("image message of {got} bytes, {wanted} expected")]
    Length {
        /// Bytes there.
        got: usize,
        /// Bytes stated.
        wanted: usize,
    },
    /// A header that no version of this program writes.
    #[error("image header with {field} {value}, which this version does not know")]
    Unknown {
        /// Which part of it.
        field: &'static str,
        /// What stands there.
        value: u64,
    },
}

/// The header of `image`.
pub fn header(image: &CameraImage) -> [u8; HEADER_BYTES] {
    let mut bytes = [0; HEADER_BYTES];
    bytes[0] = LAYOUT_VERSION;
    bytes[1] = match image.encoding {
        Encoding::Grey => 0,
        Encoding::Yuyv => 1,
        Encoding::Jpeg => 2,
        Encoding::Png => 3,
    };
    bytes[2] = if image.damaged { DAMAGED_FLAG } else { 0 };
    bytes[4..8].copy_from_slice(&image.sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&image.stamp.0.to_le_bytes());
    bytes[16..24].copy_from_slice(&image.mid_exposure.0.to_le_bytes());
    bytes[24..28].copy_from_slice(&image.width_px.to_le_bytes());
    bytes[28..32].copy_from_slice(&image.height_px.to_le_bytes());
    bytes[32..36].copy_from_slice(&(image.data.len() as u32).to_le_bytes());
    bytes
}

/// Reads a header: the image without its data, and how many bytes of data follow.
///
/// # Errors
/// [`WireError::Unknown`] naming the field.
pub fn read_header(bytes: &[u8; HEADER_BYTES]) -> Result<(CameraImage, usize), WireError> {
    let unknown = |field, value| WireError::Unknown { field, value };
    if bytes[0] != LAYOUT_VERSION {
        return Err(unknown("version", bytes[0].into()));
    }
    let encoding = match bytes[1] {
        0 => Encoding::Grey,
        1 => Encoding::Yuyv,
        2 => Encoding::Jpeg,
        3 => Encoding::Png,
        other => return Err(unknown("encoding", other.into())),
    };
    let u32_at = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let u64_at = |at: usize| u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32;
    let length = u32_at(32) as usize;
    if length > MAX_DATA_BYTES {
        return Err(unknown("data length", length as u64));
    }
    let image = CameraImage {
        sequence: u32_at(4),
        stamp: MonotonicNs(u64_at(8)),
        mid_exposure: MonotonicNs(u64_at(16)),
        damaged: bytes[2] & DAMAGED_FLAG != 0,
        width_px: u32_at(24),
        height_px: u32_at(28),
        encoding,
        data: Vec::new(),
    };
    Ok((image, length))
}

/// Reads a whole message: header and data.
///
/// # Errors
/// [`WireError`].
pub fn decode(bytes: &[u8]) -> Result<CameraImage, WireError> {
    let short = |wanted| WireError::Length { got: bytes.len(), wanted };
    let (head, data) = bytes.split_first_chunk().ok_or(short(HEADER_BYTES))?;
    let (image, length) = read_header(head)?;
    if data.len() != length {
        return Err(short(HEADER_BYTES + length));
    }
    Ok(CameraImage { data: data.to_vec(), ..image })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> CameraImage {
        CameraImage {
            sequence: 0x0102_0304,
            stamp: MonotonicNs(0x1122_3344_5566_7788),
            mid_exposure: MonotonicNs(5),
            damaged: true,
            width_px: 2,
            height_px: 1,
            encoding: Encoding::Yuyv,
            data: vec![9, 8, 7, 6],
        }
    }

    #[test]
    fn layout_is_pinned() {
        let expected = [
            1, 1, 1, 0, 4, 3, 2, 1, 0x88, 0x77, 0x66, 0x55, 0x44, 0x33, 0x22, 0x11, 5, 0, 0, 0, 0, 0, 0, 0,
            2, 0, 0, 0, 1, 0, 0, 0, 4, 0, 0, 0,
        ];
        assert_eq!(header(&image()), expected);
    }

    #[test]
    fn image_survives_the_round_trip_and_no_cut_of_it_is_taken_for_one() {
        let sent = image();
        let message = [header(&sent).as_slice(), &sent.data].concat();
        let got = decode(&message).unwrap();
        assert_eq!(header(&got), header(&sent));
        assert_eq!(got.data, sent.data);
        for cut in 0..message.len() {
            assert!(decode(&message[..cut]).is_err(), "{cut} bytes");
        }
    }

    #[test]
    fn absurd_length_is_refused_before_anything_is_allocated() {
        let mut bytes = header(&image());
        bytes[32..36].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read_header(&bytes), Err(WireError::Unknown { field: "data length", .. })));
    }
}
