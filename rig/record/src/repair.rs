//! Repairs a recording, so that any MCAP reader reads it without an error.
//!
//! Nothing is removed. Unreadable bytes are put into private records, which readers skip (<https://mcap.dev/spec>). A recording that was
//! only cut off gets its end in place: data end, footer and magic, without an index. One that is damaged before its end is written to
//! a second file, record by record, which then replaces it. A repair that is killed leaves the recording as it was or cut
//! off, and is done again.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{Record, op};

use super::RecordError;
use super::files::{containing, sync_folder};
use super::pieces::{Content, MAX_RECORD_BYTES, Piece, Pieces, RECORD_HEAD_BYTES, SET_ASIDE_OPCODE};
use super::recording::beginning;
use camera::CameraInfo;

/// What was found in a recording, and what was done about it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Repaired {
    /// Whether it had its end before, and everything in front of it could be read or was marked already.
    pub was_whole: bool,
    /// Bytes that cannot be read; they stay in the file.
    pub unreadable_bytes: u64,
}

/// A part of a file that is to be repaired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Whole records, copied as they are.
    Whole,
    /// Cannot be read.
    Unreadable,
}

/// The structure of a recording, as found by reading through it.
#[derive(Default)]
struct Found {
    /// The parts behind magic and header: length \[bytes\] and kind.
    parts: Vec<(u64, Part)>,
    /// Where they begin.
    from: u64,
    /// Where those end that are whole, with nothing between them that is not.
    whole_until: u64,
    /// It begins as it should.
    has_header: bool,
    /// Channels that are declared.
    channels: BTreeSet<u16>,
    /// The channel of some message is not declared before it.
    lacks_channels: bool,
    is_closed: bool,
    /// Bytes that cannot be read, and those that an earlier repair has marked so.
    unreadable_bytes: u64,
    set_aside_bytes: u64,
}

/// Repairs the recording at `path`, of the camera `info` (if one took part). One that is whole is left alone, and so is one that ends before
/// its first record.
///
/// # Errors
/// [`RecordError`] when it cannot be read or written.
pub fn repair(path: &Path, info: Option<&CameraInfo>) -> Result<Repaired, RecordError> {
    let found = walk(path).map_err(RecordError::io("reading", path))?;
    let repaired = Repaired {
        was_whole: found.is_closed && found.begins_well() && found.unreadable_bytes == 0,
        unreadable_bytes: found.unreadable_bytes + found.set_aside_bytes,
    };
    if repaired.was_whole || !found.has_header && !found.has_records() {
        return Ok(repaired);
    }
    if found.is_only_cut_off() {
        end(path, found.whole_until).map_err(RecordError::io("repairing", path))?;
    } else {
        let begins = beginning(info).map_err(|source| RecordError::Write { path: path.into(), source })?;
        write_again(path, &found, &begins).map_err(RecordError::io("repairing", path))?;
        sync_folder(containing(path))?;
    }
    Ok(repaired)
}

impl Found {
    /// It has a header, and the channel of each message before it.
    fn begins_well(&self) -> bool {
        self.has_header && !self.lacks_channels
    }

    fn has_records(&self) -> bool {
        self.parts.iter().any(|(_, part)| *part == Part::Whole)
    }

    /// Whether nothing that cannot be read stands in front of what can.
    fn is_only_cut_off(&self) -> bool {
        let whole = self.parts.iter().take_while(|(_, part)| *part == Part::Whole).count();
        let lost = self.parts.len() - whole;
        self.begins_well() && !self.is_closed && lost <= 1
    }
}

fn walk(path: &Path) -> std::io::Result<Found> {
    let mut found = Found::default();
    for piece in Pieces::open(path)? {
        let Piece { at, bytes, content } = piece?;
        let part = match content {
            Content::Header => {
                found.has_header = true;
                found.from = at + bytes;
                found.whole_until = at + bytes;
                continue;
            }
            Content::End => {
                found.is_closed = true;
                continue;
            }
            Content::Records(records) => {
                for record in &records {
                    match record {
                        Record::Channel(channel) => drop(found.channels.insert(channel.id)),
                        Record::Message { header, .. } => {
                            found.lacks_channels |= !found.channels.contains(&header.channel_id);
                        }
                        _ => {}
                    }
                }
                Part::Whole
            }
            Content::SetAside => {
                found.set_aside_bytes += bytes;
                Part::Whole
            }
            Content::Unreadable => {
                found.unreadable_bytes += bytes;
                Part::Unreadable
            }
        };
        if part == Part::Whole && found.unreadable_bytes == 0 {
            found.whole_until = at + bytes;
        }
        if found.parts.is_empty() {
            found.from = at;
        }
        found.parts.push((bytes, part));
    }
    Ok(found)
}

/// Marks the bytes behind `from` as unreadable, and ends the file.
fn end(path: &Path, from: u64) -> std::io::Result<()> {
    let file = File::options().write(true).open(path)?;
    let length = file.metadata()?.len();
    let mut at = from;
    while length - at >= RECORD_HEAD_BYTES {
        let body = (length - at - RECORD_HEAD_BYTES).min(MAX_RECORD_BYTES as u64);
        file.write_all_at(&set_aside_head(body), at)?;
        at += RECORD_HEAD_BYTES + body;
    }
    // the rest is shorter than a record's head and is overwritten
    file.write_all_at(&end_of_file(), at)?;
    file.sync_all()
}

/// Writes the recording again, with unreadable bytes in private records. `begins`: the first bytes of a recording.
fn write_again(path: &Path, found: &Found, begins: &[u8]) -> std::io::Result<()> {
    let mut from = File::open(path)?;
    from.seek(SeekFrom::Start(found.from))?;
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let mut to = BufWriter::new(File::create(&part)?);
    // a header is shorter than 256 bytes
    let header_bytes = RECORD_HEAD_BYTES as usize + usize::from(begins[mcap::MAGIC.len() + 1]);
    // channels that the file declares itself are not declared twice
    to.write_all(if found.lacks_channels { begins } else { &begins[..mcap::MAGIC.len() + header_bytes] })?;
    for &(bytes, part) in &found.parts {
        let mut left = bytes;
        while left > 0 {
            let body = match part {
                Part::Whole => left,
                Part::Unreadable => left.min(MAX_RECORD_BYTES as u64),
            };
            if part == Part::Unreadable {
                to.write_all(&set_aside_head(body))?;
            }
            std::io::copy(&mut Read::by_ref(&mut from).take(body), &mut to)?;
            left -= body;
        }
    }
    to.write_all(&end_of_file())?;
    to.into_inner()?.sync_all()?;
    std::fs::rename(&part, path)
}

/// The head of a private record whose body has `bytes` bytes.
fn set_aside_head(bytes: u64) -> [u8; RECORD_HEAD_BYTES as usize] {
    let mut head = [SET_ASIDE_OPCODE; RECORD_HEAD_BYTES as usize];
    head[1..].copy_from_slice(&bytes.to_le_bytes());
    head
}

/// The end of a file without a summary.
fn end_of_file() -> Vec<u8> {
    let mut bytes = Vec::new();
    for (op, body) in [(op::DATA_END, 4_usize), (op::FOOTER, 20)] {
        bytes.push(op);
        bytes.extend((body as u64).to_le_bytes());
        // no checksum, no summary
        bytes.resize(bytes.len() + body, 0);
    }
    bytes.extend(mcap::MAGIC);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reader::{End, Item, Recording};
    use crate::recording::{Recorder, RecorderOptions};
    use camera::fixtures;
    use ground::clock::MonotonicNs;
    use std::sync::Arc;

    const SIZE_PX: (u32, u32) = (8, 4);

    /// A recording with a chunk for each of `images` images, without its end, and where each chunk ends.
    fn cut_off(path: &Path, images: u32) -> (Vec<u8>, Vec<usize>) {
        let recorder =
            Recorder::create(path, Some(&fixtures::info(SIZE_PX)), RecorderOptions::default()).unwrap();
        for sequence in 0..images {
            let image = fixtures::image(sequence, MonotonicNs(1_000_000 * u64::from(sequence + 1)), SIZE_PX);
            recorder.image(Arc::new(image)).unwrap();
            // a chunk is closed after a second
            std::thread::sleep(std::time::Duration::from_millis(1100));
        }
        recorder.finish().unwrap();
        let mut bytes = std::fs::read(path).unwrap();
        // the first chunk holds the channels
        let ends: Vec<usize> = fixtures::chunks(&bytes).iter().skip(1).map(|chunk| chunk.end).collect();
        let data_end = ends[ends.len() - 1]
            + bytes[ends[ends.len() - 1]..]
                .windows(9)
                .position(|head| head == [15, 4, 0, 0, 0, 0, 0, 0, 0])
                .unwrap();
        bytes.truncate(data_end);
        (bytes, ends)
    }

    /// The counts of the images in the recording at `path`, which must be closed as any.
    fn closed(path: &Path) -> Vec<u32> {
        let bytes = std::fs::read(path).unwrap();
        // the library's own reader has no complaint either
        let strict: Vec<_> =
            mcap::MessageStream::new(&bytes).unwrap().collect::<mcap::McapResult<_>>().unwrap();
        let mut recording = Recording::open(path).unwrap();
        let images: Vec<u32> = recording
            .by_ref()
            .filter_map(|item| match item.unwrap().1 {
                Item::Image(image) => Some(image.sequence),
                Item::Gap => None,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!((recording.end(), images.len()), (End::Closed, strict.len()));
        images
    }

    #[test]
    fn recording_cut_at_any_byte_or_torn_anywhere_is_repaired_with_every_whole_chunk() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording.mcap");
        let (whole, ends) = cut_off(&path, 3);
        let expected = |cut: usize| ends.iter().filter(|&&end| end <= cut).count() as u32;
        for cut in 0..=whole.len() {
            for garbage in [&b""[..], &[0; 100], &[0xA5; 5000]] {
                let mut bytes = whole[..cut].to_vec();
                bytes.extend(garbage);
                std::fs::write(&path, &bytes).unwrap();
                let repaired = repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap();
                assert!(!repaired.was_whole);
                let after = std::fs::read(&path).unwrap();
                if after == bytes {
                    // not even a header: nothing was recorded
                    assert_eq!(expected(cut), 0, "cut at {cut}");
                    continue;
                }
                assert!(after.len() >= bytes.len(), "nothing is taken out");
                let images = closed(&path);
                assert!(
                    images.len() as u32 >= expected(cut),
                    "cut at {cut}, {} bytes of garbage",
                    garbage.len()
                );
                assert!(images.iter().copied().eq(0..images.len() as u32));
                // again, and nothing changes
                assert!(repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap().was_whole);
                assert_eq!(std::fs::read(&path).unwrap(), after);
            }
        }

        // one byte of the second chunk, in the middle of the file
        let mut bytes = whole.clone();
        bytes[ends[1] - 3] ^= 0xFF;
        std::fs::write(&path, &bytes).unwrap();
        assert!(repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap().unreadable_bytes > 0);
        assert_eq!(closed(&path), [0, 2]);

        // a repair that was killed at any byte of what it writes
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap();
        let whole_repair = std::fs::read(&path).unwrap();
        for cut in whole.len() - 5..whole_repair.len() {
            std::fs::write(&path, &whole_repair[..cut]).unwrap();
            repair(&path, Some(&fixtures::info(SIZE_PX))).unwrap();
            assert_eq!(closed(&path), [0, 1, 2]);
        }
    }
}
