//! A table as a Parquet file, for pandas, R, DuckDB and the like.
//!
//! The least that the format knows: flat columns, each of which may be empty, plain values, nothing compressed. The crate `parquet` would bring ten
//! others, among them second versions of some that are here; what is needed of the format is this page.
//!
//! # Source
//! <https://parquet.apache.org/docs/file-format/>: `parquet.thrift` by name and field number; Thrift's compact protocol; the hybrid of runs and packed
//! bits for definition levels, of which only the latter is used.

use std::io::{Result, Write};

/// A column's name and what it holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column(pub &'static str, pub Kind);

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// UTF-8.
    Text,
    /// A double.
    Number,
    /// 64 bits.
    Integer,
}

impl Kind {
    /// `Type` of `parquet.thrift`.
    fn code(self) -> i64 {
        match self {
            Self::Integer => 2,
            Self::Number => 5,
            Self::Text => 6,
        }
    }
}

/// A cell; `None` is an empty one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cell<'a> {
    /// UTF-8.
    Text(Option<&'a str>),
    /// A double.
    Number(Option<f64>),
    /// 64 bits.
    Integer(Option<i64>),
}

impl<'a> Cell<'a> {
    /// A text.
    pub fn text(text: Option<&'a str>) -> Self {
        Self::Text(text)
    }

    /// A number; one that is none is left out.
    pub fn number(number: Option<f64>) -> Self {
        Self::Number(number.filter(|number| !number.is_nan()))
    }

    /// An integer.
    pub fn integer(integer: Option<i64>) -> Self {
        Self::Integer(integer)
    }

    /// As a CSV has it: numbers with as many digits as give the same double again.
    pub fn csv(&self) -> String {
        match self {
            Self::Text(text) => text.unwrap_or_default().to_owned(),
            Self::Number(number) => number.map_or_else(String::new, |number| number.to_string()),
            Self::Integer(integer) => integer.map_or_else(String::new, |integer| integer.to_string()),
        }
    }
}

/// Rows that are written together, chosen: some megabytes.
const ROWS_PER_GROUP: usize = 20_000;
const MAGIC: &[u8] = b"PAR1";

/// Writes a file, some thousand rows at a time.
#[derive(Debug)]
pub struct Writer<W: Write> {
    to: W,
    written: u64,
    columns: Vec<Column>,
    pending: Vec<Pending>,
    rows: usize,
    groups: Vec<Group>,
}

/// Of one column, rows that are not written yet.
#[derive(Debug, Default)]
struct Pending {
    /// Whether each row has a value.
    is_there: Vec<bool>,
    values: Vec<u8>,
}

#[derive(Debug)]
struct Group {
    rows: usize,
    /// Where each column is, and how long.
    places: Vec<(u64, usize)>,
}

impl<W: Write> Writer<W> {
    /// Begins a file with these columns.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn begin(mut to: W, columns: &[Column]) -> Result<Self> {
        to.write_all(MAGIC)?;
        let pending = columns.iter().map(|_| Pending::default()).collect();
        let written = MAGIC.len() as u64;
        Ok(Self { to, written, columns: columns.to_vec(), pending, rows: 0, groups: Vec::new() })
    }

    /// Adds a row, a cell for each column.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn add(&mut self, row: &[Cell<'_>]) -> Result<()> {
        assert_eq!(row.len(), self.columns.len(), "a cell for each column");
        for (cell, pending) in row.iter().zip(&mut self.pending) {
            let values = &mut pending.values;
            let before = values.len();
            match cell {
                Cell::Text(Some(text)) => {
                    values.extend(u32::try_from(text.len()).unwrap_or(u32::MAX).to_le_bytes());
                    values.extend(text.as_bytes());
                }
                Cell::Number(Some(number)) => values.extend(number.to_le_bytes()),
                Cell::Integer(Some(integer)) => values.extend(integer.to_le_bytes()),
                Cell::Text(None) | Cell::Number(None) | Cell::Integer(None) => {}
            }
            pending.is_there.push(values.len() > before);
        }
        self.rows += 1;
        if self.rows == ROWS_PER_GROUP { self.write_group() } else { Ok(()) }
    }

    fn write_group(&mut self) -> Result<()> {
        let rows = std::mem::take(&mut self.rows);
        let mut places = Vec::new();
        for pending in &mut self.pending {
            let Pending { is_there, values } = std::mem::take(pending);
            let levels = levels(&is_there);
            let size = 4 + levels.len() + values.len();
            let mut header = Thrift::default();
            // PageHeader: type (a data page), both sizes, DataPageHeader: values, encodings (plain, levels as RLE)
            header.integer(1, I32, 0);
            header.integer(2, I32, size as i64);
            header.integer(3, I32, size as i64);
            header.open(5);
            header.integer(1, I32, rows as i64);
            header.integer(2, I32, 0);
            header.integer(3, I32, 3);
            header.integer(4, I32, 3);
            header.close();
            header.stop();
            let length = u32::try_from(levels.len()).unwrap_or(u32::MAX).to_le_bytes();
            for part in [&header.bytes, &length[..], &levels, &values] {
                self.to.write_all(part)?;
            }
            let whole = header.bytes.len() + size;
            places.push((self.written, whole));
            self.written += whole as u64;
        }
        self.groups.push(Group { rows, places });
        Ok(())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn finish(mut self) -> Result<W> {
        if self.rows > 0 {
            self.write_group()?;
        }
        let footer = self.footer();
        self.to.write_all(&footer)?;
        self.to.write_all(&u32::try_from(footer.len()).unwrap_or(u32::MAX).to_le_bytes())?;
        self.to.write_all(MAGIC)?;
        Ok(self.to)
    }

    /// FileMetaData.
    fn footer(&self) -> Vec<u8> {
        let mut meta = Thrift::default();
        meta.integer(1, I32, 1);
        meta.list(2, STRUCT, self.columns.len() + 1);
        meta.element(|root| {
            root.text(4, "table");
            root.integer(5, I32, self.columns.len() as i64);
        });
        for Column(name, kind) in &self.columns {
            meta.element(|schema| {
                schema.integer(1, I32, kind.code());
                // may be empty
                schema.integer(3, I32, 1);
                schema.text(4, name);
                if *kind == Kind::Text {
                    schema.integer(6, I32, 0);
                }
            });
        }
        let rows: usize = self.groups.iter().map(|group| group.rows).sum();
        meta.integer(3, I64, rows as i64);
        meta.list(4, STRUCT, self.groups.len());
        for group in &self.groups {
            meta.element(|part| {
                part.list(1, STRUCT, group.places.len());
                for (Column(name, kind), &(at, size)) in self.columns.iter().zip(&group.places) {
                    part.element(|chunk| {
                        chunk.integer(2, I64, at as i64);
                        chunk.open(3);
                        chunk.integer(1, I32, kind.code());
                        chunk.list(2, I32, 2);
                        chunk.zigzag(0);
                        chunk.zigzag(3);
                        chunk.list(3, COMPACT_BINARY_TYPE, 1);
                        chunk.bare_text(name);
                        chunk.integer(4, I32, 0);
                        chunk.integer(5, I64, group.rows as i64);
                        chunk.integer(6, I64, size as i64);
                        chunk.integer(7, I64, size as i64);
                        chunk.integer(9, I64, at as i64);
                        chunk.close();
                    });
                }
                let bytes: usize = group.places.iter().map(|&(_, size)| size).sum();
                part.integer(2, I64, bytes as i64);
                part.integer(3, I64, group.rows as i64);
            });
        }
        meta.text(6, "rig");
        meta.stop();
        meta.bytes
    }
}

/// Definition levels of one bit: groups of eight, packed, the first in the lowest bit.
fn levels(is_there: &[bool]) -> Vec<u8> {
    let mut bytes = Vec::new();
    varint(&mut bytes, ((is_there.len().div_ceil(8) as u64) << 1) | 1);
    bytes.extend(is_there.chunks(8).map(|eight| {
        eight.iter().enumerate().fold(0_u8, |byte, (place, &there)| byte | (u8::from(there) << place))
    }));
    bytes
}

fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

// Types of Thrift's compact protocol.
const I32: u8 = 5;
const I64: u8 = 6;
const COMPACT_BINARY_TYPE: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// A structure in Thrift's compact protocol.
#[derive(Debug, Default)]
struct Thrift {
    bytes: Vec<u8>,
    last: u8,
    outer: Vec<u8>,
}

impl Thrift {
    fn field(&mut self, number: u8, kind: u8) {
        self.bytes.push(((number - self.last) << 4) | kind);
        self.last = number;
    }

    fn zigzag(&mut self, value: i64) {
        varint(&mut self.bytes, ((value << 1) ^ (value >> 63)) as u64);
    }

    fn integer(&mut self, number: u8, kind: u8, value: i64) {
        self.field(number, kind);
        self.zigzag(value);
    }

    fn bare_text(&mut self, text: &str) {
        varint(&mut self.bytes, text.len() as u64);
        self.bytes.extend(text.as_bytes());
    }

    fn text(&mut self, number: u8, text: &str) {
        self.field(number, COMPACT_BINARY_TYPE);
        self.bare_text(text);
    }

    fn list(&mut self, number: u8, kind: u8, length: usize) {
        self.field(number, LIST);
        match length {
            0..15 => self.bytes.push(((length as u8) << 4) | kind),
            _ => {
                self.bytes.push(0xf0 | kind);
                varint(&mut self.bytes, length as u64);
            }
        }
    }

    /// A structure of a list.
    fn element(&mut self, fill: impl FnOnce(&mut Self)) {
        self.outer.push(self.last);
        self.last = 0;
        fill(self);
        self.close();
    }

    fn open(&mut self, number: u8) {
        self.field(number, STRUCT);
        self.outer.push(self.last);
        self.last = 0;
    }

    fn close(&mut self) {
        self.stop();
        self.last = self.outer.pop().unwrap_or_default();
    }

    fn stop(&mut self) {
        self.bytes.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_cells_take_one_bit_and_numbers_their_bytes() {
        assert_eq!(levels(&[true, false, true]), [0b11, 0b101]);
        assert_eq!(levels(&[true; 9]), [0b101, 0xff, 0b1]);
        let columns = [Column("a", Kind::Number), Column("b", Kind::Text)];
        let mut writer = Writer::begin(Vec::new(), &columns).unwrap();
        writer.add(&[Cell::number(Some(1.5)), Cell::text(None)]).unwrap();
        writer.add(&[Cell::number(Some(f64::NAN)), Cell::text(Some("é"))]).unwrap();
        let bytes = writer.finish().unwrap();
        assert!(bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC));
        let holds = |part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
        assert!(holds(&1.5_f64.to_le_bytes()) && holds(&[2, 0, 0, 0, 0xc3, 0xa9]));
        let footer = u32::from_le_bytes(bytes[bytes.len() - 8..bytes.len() - 4].try_into().unwrap());
        assert!((footer as usize) < bytes.len() - 12);
    }
}
