//! Gives a recording that was cut off its end, where it stands: whoever reads MCAP then reads it without complaint.
//!
//! Nothing is taken out of the file. What cannot be read, a chunk that fails its checksum or the piece of one at the end, gets the
//! number of a private record, which readers pass over (<https://mcap.dev/spec>); then data end, footer and magic are appended,
//! without an index. A repair that is killed leaves a recording that is cut off, and is done again.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::read::ChunkReader;
use mcap::records::{Record, op};

use super::RecordError;
use super::reader::MAX_RECORD_BYTES;

/// Number and length in front of each record.
const HEAD_BYTES: u64 = 9;
/// The first number that is free for private records; what cannot be read is put aside under it.
const ASIDE: u8 = 0x80;

/// What was found in a recording, and what was done about it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Repaired {
    /// It had its end before.
    pub was_whole: bool,
    /// Bytes that cannot be read; they stay in the file.
    pub unreadable_bytes: u64,
}

/// A record of a file.
struct Place {
    at: u64,
    bytes: u64,
}

/// What a walk through a recording finds.
struct Found {
    /// Chunks that fail their checksum.
    broken: Vec<Place>,
    /// Chunks that an earlier repair has put aside.
    aside_bytes: u64,
    /// Where the records end that can be told from each other.
    end: u64,
    is_closed: bool,
}

/// Repairs the recording at `path`. One that has its end is left alone, and so is one that ends before its first record.
///
/// # Errors
/// [`RecordError`] when it cannot be read or written.
pub fn repair(path: &Path) -> Result<Repaired, RecordError> {
    let file = File::options().read(true).write(true).open(path).map_err(RecordError::io("opening", path))?;
    let length = file.metadata().map_err(RecordError::io("asking the length of", path))?.len();
    let found = walk(&file, length).map_err(RecordError::io("reading", path))?;
    if found.is_closed {
        return Ok(Repaired { was_whole: true, unreadable_bytes: found.aside_bytes });
    }
    let broken_bytes: u64 = found.broken.iter().map(|place| place.bytes).sum();
    let tail_bytes = length - found.end;
    let repaired =
        Repaired { was_whole: false, unreadable_bytes: found.aside_bytes + broken_bytes + tail_bytes };
    if found.end <= mcap::MAGIC.len() as u64 {
        return Ok(repaired);
    }
    let put_aside = || -> std::io::Result<()> {
        for place in &found.broken {
            file.write_all_at(&[ASIDE], place.at)?;
        }
        let mut at = found.end;
        while length - at >= HEAD_BYTES {
            let body = (length - at - HEAD_BYTES).min(MAX_RECORD_BYTES as u64);
            let mut head = [ASIDE; HEAD_BYTES as usize];
            head[1..].copy_from_slice(&body.to_le_bytes());
            file.write_all_at(&head, at)?;
            at += HEAD_BYTES + body;
        }
        // fewer bytes than a record's head say nothing
        file.write_all_at(&end_of_file(), at)?;
        file.sync_all()
    };
    put_aside().map_err(RecordError::io("repairing", path))?;
    Ok(repaired)
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

fn walk(file: &File, length: u64) -> std::io::Result<Found> {
    let magic = mcap::MAGIC.len() as u64;
    let mut found = Found { broken: Vec::new(), aside_bytes: 0, end: 0, is_closed: false };
    let mut reader = BufReader::new(file);
    let mut start = [0; mcap::MAGIC.len()];
    reader.seek(SeekFrom::Start(0))?;
    if length < magic || reader.read_exact(&mut start).is_err() || start != mcap::MAGIC {
        return Ok(found);
    }
    found.end = magic;
    let mut body = Vec::new();
    while length - found.end >= HEAD_BYTES {
        let mut head = [0; HEAD_BYTES as usize];
        reader.read_exact(&mut head)?;
        let [number, bytes @ ..] = head;
        let bytes = u64::from_le_bytes(bytes);
        if bytes > length - found.end - HEAD_BYTES || bytes > MAX_RECORD_BYTES as u64 {
            break;
        }
        body.resize(bytes as usize, 0);
        reader.read_exact(&mut body)?;
        let place = Place { at: found.end, bytes: HEAD_BYTES + bytes };
        match number {
            op::DATA_END => {
                // what follows it says nothing that the records before do not say
                found.is_closed = ends_with_magic(file, length)?;
                break;
            }
            ASIDE => found.aside_bytes += place.bytes,
            op::CHUNK if !is_whole(&body) => found.broken.push(place),
            op::CHUNK => {}
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE_INDEX
                if mcap::parse_record(number, &body).is_ok() => {}
            _ => break,
        }
        found.end += HEAD_BYTES + bytes;
    }
    Ok(found)
}

/// Whether a chunk passes its own checksum.
fn is_whole(chunk: &[u8]) -> bool {
    let Ok(Record::Chunk { header, data }) = mcap::parse_record(op::CHUNK, chunk) else { return false };
    ChunkReader::new(header, &data).is_ok_and(|mut records| records.all(|record| record.is_ok()))
}

fn ends_with_magic(file: &File, length: u64) -> std::io::Result<bool> {
    let mut end = [0; mcap::MAGIC.len()];
    file.read_exact_at(&mut end, length - mcap::MAGIC.len() as u64)?;
    Ok(end == mcap::MAGIC)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::fixtures;
    use crate::clock::MonotonicNs;
    use crate::record::reader::{End, Item, Recording};
    use crate::record::recording::{Recorder, RecorderOptions};
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
            .map(|item| match item.unwrap().1 {
                Item::Image(image) => image.sequence,
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
                let repaired = repair(&path).unwrap();
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
                assert!(repair(&path).unwrap().was_whole);
                assert_eq!(std::fs::read(&path).unwrap(), after);
            }
        }

        // one byte of the second chunk, in the middle of the file
        let mut bytes = whole.clone();
        bytes[ends[1] - 3] ^= 0xFF;
        std::fs::write(&path, &bytes).unwrap();
        assert!(repair(&path).unwrap().unreadable_bytes > 0);
        assert_eq!(closed(&path), [0, 2]);

        // a repair that was killed at any byte of what it writes
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        repair(&path).unwrap();
        let whole_repair = std::fs::read(&path).unwrap();
        for cut in whole.len() - 5..whole_repair.len() {
            std::fs::write(&path, &whole_repair[..cut]).unwrap();
            repair(&path).unwrap();
            assert_eq!(closed(&path), [0, 1, 2]);
        }
    }
}
