//! `SHA256SUMS` of a run folder: a line for each file, as `sha256sum -c SHA256SUMS` reads them.
//!
//! What was recorded gets its lines just before `stop.json`, which is among them: a run that has ended has them. The recording's is
//! counted while it is written, so that it tells of what the disk made of it too. Results get theirs when the report is written.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use sha2::{Digest, Sha256};

use super::RecordError;
use super::files::{is_part, write_whole};
use super::folder::file;

/// What a run's analysis writes, and writes again when it is done again.
pub const RESULTS: [&str; 11] = [
    file::FRAMES,
    file::SERVO,
    file::EXTRACTION,
    file::TRAJECTORY,
    file::WARM_START,
    file::FIT,
    file::DIAGNOSIS,
    file::MODEL,
    file::SIMULATED,
    file::TIMING,
    file::REPORT,
];

/// Whether the analysis makes the file of this name, and can make it again.
pub fn is_result(name: &str) -> bool {
    RESULTS.contains(&name)
}

/// SHA-256 of some bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sum([u8; 32]);

impl Sum {
    /// The sum of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// The sum of the file at `path`.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn of_file(path: &Path) -> Result<Self, RecordError> {
        const BLOCK_BYTES: usize = 1 << 20;
        let read = || -> std::io::Result<Self> {
            let mut file = File::open(path)?;
            let (mut sum, mut block) = (Sha256::new(), vec![0; BLOCK_BYTES]);
            loop {
                match file.read(&mut block)? {
                    0 => return Ok(Self(sum.finalize().into())),
                    n => sum.update(&block[..n]),
                }
            }
        };
        read().map_err(RecordError::io("reading", path))
    }

    fn parse(hex: &str) -> Option<Self> {
        let mut sum = [0; 32];
        if hex.len() != 64 {
            return None;
        }
        for (place, byte) in sum.iter_mut().enumerate() {
            *byte = u8::from_str_radix(hex.get(2 * place..2 * place + 2)?, 16).ok()?;
        }
        Some(Self(sum))
    }
}

impl std::fmt::Display for Sum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// A file, and the sum of all that was written to it.
#[derive(Debug)]
pub(super) struct Summed {
    file: File,
    sum: Sha256,
}

impl Summed {
    /// Begins with an empty file.
    pub(super) fn new(file: File) -> Self {
        Self { file, sum: Sha256::new() }
    }

    /// The sum of all that was written.
    pub(super) fn sum(&self) -> Sum {
        Sum(self.sum.clone().finalize().into())
    }
}

impl Write for Summed {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.sum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// The sums of a run folder's files, by their names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sums(pub BTreeMap<String, Sum>);

impl Sums {
    /// Reads those of the run folder `folder`; none where it has none.
    ///
    /// # Errors
    /// [`RecordError`] where they cannot be read, with the line.
    pub fn read(folder: &Path) -> Result<Option<Self>, RecordError> {
        let path = folder.join(file::SUMS);
        if !path.exists() {
            return Ok(None);
        }
        let bytes = std::fs::read(&path).map_err(RecordError::io("reading", &path))?;
        let text = String::from_utf8_lossy(&bytes);
        let entry = |line: &str| {
            let (sum, name) = line.split_once("  ")?;
            Some((name.to_owned(), Sum::parse(sum)?))
        };
        let entries = text.lines().enumerate().map(|(number, line)| {
            entry(line).ok_or_else(|| {
                let why =
                    format!("line {}: 64 hexadecimal digits, two spaces and a name are wanted", number + 1);
                RecordError::damaged(&path, why)
            })
        });
        Ok(Some(Self(entries.collect::<Result<_, _>>()?)))
    }

    /// Of the files in `folder` as they are, apart from those whose sums are `known`.
    pub(super) fn of_folder(folder: &Path, mut known: Self) -> Result<Self, RecordError> {
        for name in names(folder)? {
            if let Entry::Vacant(place) = known.0.entry(name) {
                let sum = Sum::of_file(&folder.join(place.key()))?;
                place.insert(sum);
            }
        }
        Ok(known)
    }

    /// Brings those of the run folder `folder` up to date with its results. A run that has not ended gets none.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn add_results(folder: &Path) -> Result<(), RecordError> {
        let Some(mut sums) = Self::read(folder)? else { return Ok(()) };
        sums.0.retain(|name, _| !is_result(name));
        for name in RESULTS.iter().filter(|name| folder.join(name).exists()) {
            sums.0.insert((*name).to_owned(), Sum::of_file(&folder.join(name))?);
        }
        sums.write(folder)
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), RecordError> {
        let lines: String = self.0.iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect();
        write_whole(&folder.join(file::SUMS), lines.as_bytes())
    }
}

/// The files in `folder` that get a sum.
fn names(folder: &Path) -> Result<Vec<String>, RecordError> {
    let io = || RecordError::io("reading", folder);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io())? {
        let entry = entry.map_err(io())?;
        let is_file = entry.file_type().map_err(io())?.is_file();
        // a name that is no text gets no line
        let Ok(name) = entry.file_name().into_string() else { continue };
        if is_file && name != file::SUMS && !is_part(&name) && !name.contains('\n') {
            names.push(name);
        }
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_sha256sum_and_come_back_from_their_file() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.txt"), "abc").unwrap();
        std::fs::write(folder.path().join(".part-3fG9sa-b.txt"), "half").unwrap();
        let sums = Sums::of_folder(folder.path(), Sums::default()).unwrap();
        sums.write(folder.path()).unwrap();
        // FIPS 180-4's own example
        let line = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  a.txt\n";
        assert_eq!(std::fs::read_to_string(folder.path().join(file::SUMS)).unwrap(), line);
        assert_eq!(Sums::read(folder.path()).unwrap(), Some(sums.clone()));

        std::fs::write(folder.path().join(file::FIT), "{}").unwrap();
        Sums::add_results(folder.path()).unwrap();
        let after = Sums::read(folder.path()).unwrap().unwrap();
        assert_eq!((after.0.get("a.txt"), after.0.len()), (sums.0.get("a.txt"), 2));

        std::fs::write(folder.path().join(file::SUMS), "ba78  a.txt\n").unwrap();
        assert!(Sums::read(folder.path()).unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn what_is_written_in_pieces_has_the_sum_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let mut file = Summed::new(File::create(&path).unwrap());
        for piece in [&b"ab"[..], b"", b"c"] {
            file.write_all(piece).unwrap();
        }
        assert_eq!(file.sum(), Sum::of(b"abc"));
        assert_eq!(file.sum(), Sum::of_file(&path).unwrap());
    }
}
