//! Reads the records of a recording one after the other, also from a damaged file.
//!
//! A record counts as a whole or not at all: a chunk passes its own checksum before any of its messages is believed, and messages,
//! schemas and channels outside of chunks, where no checksum covers them, are not read. Other records have no checksum:
//! one that reaches into a chunk that is whole is none. What cannot be read is one piece, up to the next chunk that is whole, or to the
//! end of the data: no length in it is believed either.

use std::fs::File;
use std::io::Result;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::McapResult;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::recording::CHUNK_BYTES;
use camera::wire;

/// Longest record that is accepted \[bytes\]: a chunk that was nearly full when an image at its limit came, with room for headers.
pub(super) const MAX_RECORD_BYTES: usize = wire::MAX_DATA_BYTES + CHUNK_BYTES as usize + (1 << 20);
/// Length of a record's head, its number and its length \[bytes\]; as the MCAP specification says.
pub(super) const RECORD_HEAD_BYTES: u64 = 9;
/// The first number that is free for private records (<https://mcap.dev/spec>): a repair marks unreadable bytes with it.
pub(super) const SET_ASIDE_OPCODE: u8 = 0x80;

/// Bytes that are searched for a chunk at a time, chosen.
const SEARCH_WINDOW_BYTES: usize = 1 << 20;
/// Length of a chunk's head, in front of its messages, with the longest name of a compression \[bytes\].
const CHUNK_HEAD_BYTES: usize = 53;
/// The head of the record that ends the data.
const DATA_END_HEAD: [u8; RECORD_HEAD_BYTES as usize] = [op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0];

/// A piece of a recording's file.
#[derive(Debug)]
pub(super) struct Piece {
    /// Where it begins in the file \[bytes\].
    pub(super) at: u64,
    /// Its length \[bytes\].
    pub(super) bytes: u64,
    /// What it contains.
    pub(super) content: Content,
}

/// The content of a piece of a file.
#[derive(Debug)]
pub(super) enum Content {
    /// The file's first record.
    Header,
    /// A record with these messages and channels, possibly none.
    Records(Vec<Record<'static>>),
    /// Cannot be read.
    Unreadable,
    /// Unreadable bytes that an earlier repair has marked.
    SetAside,
    /// The end of the data. What follows says nothing that the records before do not say.
    End,
}

/// Reads a recording record by record, and counts what cannot be read.
#[derive(Debug)]
pub(super) struct Pieces {
    file: File,
    length: u64,
    at: u64,
    /// The file ends as a recording that was closed.
    is_ended: bool,
    is_over: bool,
}

impl Pieces {
    /// The pieces of the file at `path`.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let magic = mcap::MAGIC.len() as u64;
        let mut ends = [[0; mcap::MAGIC.len()]; 2];
        if length >= magic {
            file.read_exact_at(&mut ends[0], 0)?;
            file.read_exact_at(&mut ends[1], length - magic)?;
        }
        let [begins, is_ended] = ends.map(|end| end == mcap::MAGIC);
        Ok(Self { file, length, at: if begins { magic } else { 0 }, is_ended, is_over: false })
    }

    /// Whether the file begins as a recording does.
    pub(super) fn begins_well(path: &Path) -> bool {
        // one that is too short may have begun so
        let mut start = vec![0; mcap::MAGIC.len()];
        let read = File::open(path).and_then(|file| file.read_at(&mut start, 0)).unwrap_or(0);
        mcap::MAGIC.starts_with(&start[..read])
    }

    /// The record at `at`; `None` where no whole record begins there.
    fn record(&self, at: u64) -> Result<Option<Piece>> {
        let room = self.length.saturating_sub(at);
        if room < RECORD_HEAD_BYTES {
            return Ok(None);
        }
        let mut head = [0; RECORD_HEAD_BYTES as usize];
        self.file.read_exact_at(&mut head, at)?;
        let [number, body @ ..] = head;
        let body = u64::from_le_bytes(body);
        if body > room - RECORD_HEAD_BYTES || body > MAX_RECORD_BYTES as u64 {
            return Ok(None);
        }
        let bytes = RECORD_HEAD_BYTES + body;
        let content = match number {
            SET_ASIDE_OPCODE => Some(Content::SetAside),
            op::DATA_END => (self.is_ended && head == DATA_END_HEAD).then_some(Content::End),
            op::HEADER if at != mcap::MAGIC.len() as u64 => None,
            op::ATTACHMENT | op::METADATA => Some(Content::Records(Vec::new())),
            op::HEADER | op::MESSAGE_INDEX | op::CHUNK => {
                let mut record = vec![0; bytes as usize];
                self.file.read_exact_at(&mut record, at)?;
                whole(number, &record)
            }
            _ => None,
        };
        let is_torn = content.is_some()
            && ![op::CHUNK, op::DATA_END].contains(&number)
            && self.next_whole(at + 1, at + bytes, &[op::CHUNK])? < at + bytes;
        Ok(content.filter(|_| !is_torn).map(|content| Piece { at, bytes, content }))
    }

    /// Where the next record begins, from `at` on, that is whole and a chunk or the end of the data, as `numbers` say; `until` where none
    /// begins before it.
    fn next_whole(&self, mut at: u64, until: u64, numbers: &[u8]) -> Result<u64> {
        // a head that begins before `until` may end behind it
        let reach = (until + CHUNK_HEAD_BYTES as u64).min(self.length);
        let mut window = vec![0; SEARCH_WINDOW_BYTES.min(reach.saturating_sub(at) as usize)];
        while at < until {
            let read = (reach - at).min(SEARCH_WINDOW_BYTES as u64) as usize;
            self.file.read_exact_at(&mut window[..read], at)?;
            // where the file goes on, a head at the window's end is left to the next one
            let is_last = at + read as u64 == self.length;
            let searched = if is_last { (until - at) as usize } else { read - CHUNK_HEAD_BYTES };
            for place in 0..searched {
                let found = &window[place..read];
                let may_be = match found[0] {
                    op::CHUNK => is_chunk_head(found),
                    op::DATA_END => self.is_ended && found.starts_with(&DATA_END_HEAD),
                    _ => false,
                };
                if may_be && numbers.contains(&found[0]) && self.record(at + place as u64)?.is_some() {
                    return Ok(at + place as u64);
                }
            }
            at += searched as u64;
        }
        Ok(until)
    }
}

impl Iterator for Pieces {
    type Item = Result<Piece>;

    fn next(&mut self) -> Option<Self::Item> {
        let at = self.at;
        if self.is_over || at == self.length {
            return None;
        }
        let piece = self.record(at).and_then(|record| match record {
            Some(piece) => Ok(piece),
            None => Ok(Piece {
                at,
                bytes: self.next_whole(at + 1, self.length, &[op::CHUNK, op::DATA_END])? - at,
                content: Content::Unreadable,
            }),
        });
        match &piece {
            Ok(piece) => {
                self.at += piece.bytes;
                self.is_over = matches!(piece.content, Content::End);
            }
            Err(_) => self.is_over = true,
        }
        Some(piece)
    }
}

/// The content of the record with this number, given with its head; `None` where it is damaged.
fn whole(number: u8, record: &[u8]) -> Option<Content> {
    let body = &record[RECORD_HEAD_BYTES as usize..];
    if number == op::CHUNK {
        return is_chunk_head(record).then(|| chunk(record).ok()).flatten().map(Content::Records);
    }
    Some(match mcap::parse_record(number, body).ok()? {
        Record::Header(_) => Content::Header,
        // 2 bytes for the channel, 4 for the length, 16 for each message; one that has something else behind is none
        Record::MessageIndex(index) if body.len() != 6 + 16 * index.records.len() => return None,
        _ => Content::Records(Vec::new()),
    })
}

/// Whether `bytes` begin as a chunk: its lengths agree, and its compression is one that there is.
fn is_chunk_head(bytes: &[u8]) -> bool {
    let number = |at: usize, width: usize| {
        let bytes = bytes.get(at..at + width)?;
        Some(bytes.iter().rev().fold(0_u64, |number, &byte| number << 8 | u64::from(byte)))
    };
    let agrees = || {
        let (body, uncompressed, name) = (number(1, 8)?, number(25, 8)?, number(37, 4)?);
        let name = bytes.get(41..41 + usize::try_from(name).ok().filter(|&name| name <= 4)?)?;
        let messages = number(41 + name.len(), 8)?;
        let lengths = body == messages.checked_add(40 + name.len() as u64)?;
        let named = [&b""[..], b"lz4", b"zstd"].contains(&name);
        Some(lengths && named && uncompressed <= MAX_RECORD_BYTES as u64)
    };
    agrees().unwrap_or(false)
}

/// The messages and channels of a chunk; none of them is looked at before all of it has passed its checksum.
fn chunk(record: &[u8]) -> McapResult<Vec<Record<'static>>> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = LinearReader::new_with_options(options);
    let (mut rest, mut records) = (record, Vec::new());
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(need) => {
                let (read, after) = rest.split_at(need.min(rest.len()));
                reader.insert(read.len()).copy_from_slice(read);
                reader.notify_read(read.len());
                rest = after;
            }
            LinearReadEvent::Record { data, opcode: opcode @ (op::CHANNEL | op::MESSAGE) } => {
                records.push(mcap::parse_record(opcode, data)?.into_owned());
            }
            LinearReadEvent::Record { .. } => {}
        }
    }
    Ok(records)
}
