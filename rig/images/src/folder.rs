//! A folder of pictures: a `frames.csv` (`file,time_s`) in it says which files and when; otherwise the numbers in their names.

use std::path::{Path, PathBuf};

use camera::decode::picture_file;
use camera::source::{FolderError, SourceError};
use camera::source::{ImageSource, Images, TimedImage};
use ground::error_chain::with_causes;

use super::numbers::{Numbered, in_order};
use super::repeats::Repeats;

/// A picture's file and its time.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The file.
    pub path: PathBuf,
    /// Mid-exposure \[s\].
    pub time_s: f64,
}

/// The pictures of a folder, in order of time.
#[derive(Debug)]
pub struct Folder {
    /// The pictures.
    pub entries: Vec<Entry>,
    /// What is to be known of their order and times, as a sentence without its full stop.
    remark: Option<String>,
    repeats: Repeats,
}

/// Whether the file is a picture, by its ending.
pub(super) fn is_picture(file: &Path) -> bool {
    let ending = file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    matches!(ending.as_deref(), Some("png" | "jpg" | "jpeg"))
}

/// The folder's pictures, of which there is one at least.
fn files(folder: &Path) -> Result<Vec<PathBuf>, FolderError> {
    let unreadable = |source| FolderError::Unreadable { path: folder.into(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if is_picture(&path) {
            files.push(path);
        }
    }
    if files.is_empty() { Err(FolderError::Empty { path: folder.into() }) } else { Ok(files) }
}

/// The rows of a table `file,time_s` \[s\] in order of time; its other columns are ignored.
///
/// # Errors
/// [`FolderError`] with the line.
pub fn table(table: &Path) -> Result<Vec<(String, f64)>, FolderError> {
    let refuse = |line: u64, what: String| FolderError::Frames { path: table.into(), line, what };
    let mut csv = csv::Reader::from_path(table).map_err(|error| refuse(1, error.to_string()))?;
    let headers = csv.headers().map_err(|error| refuse(1, error.to_string()))?.clone();
    let column = |name: &str| {
        headers.iter().position(|h| h == name).ok_or_else(|| refuse(1, format!("no column {name}")))
    };
    let (file, time) = (column("file")?, column("time_s")?);
    let mut rows: Vec<(String, f64)> = Vec::new();
    for row in csv.records() {
        let row = row.map_err(|error| refuse(error.position().map_or(0, |p| p.line()), error.to_string()))?;
        let line = row.position().map_or(0, |p| p.line());
        let cell = |i: usize| row.get(i).unwrap_or_default();
        let name = Path::new(cell(file));
        if name.components().count() != 1
            || !name.components().all(|c| matches!(c, std::path::Component::Normal(_)))
        {
            return Err(refuse(line, format!("`{}` is not the name of a file in this folder", cell(file))));
        }
        let time_s = cell(time).parse::<f64>().ok().filter(|t| t.is_finite());
        let time_s =
            time_s.ok_or_else(|| refuse(line, format!("time_s `{}` is not a number", cell(time))))?;
        if rows.last().is_some_and(|(_, last_s)| *last_s >= time_s) {
            return Err(refuse(line, format!("time_s {time_s} does not rise")));
        }
        rows.push((cell(file).to_owned(), time_s));
    }
    Ok(rows)
}

impl Folder {
    /// The pictures of `folder`. Its `frames.csv` wins over `fps` (images per second); other columns of that are ignored.
    ///
    /// # Errors
    /// [`FolderError`].
    pub fn open(folder: &Path, fps: Option<f64>) -> Result<Self, FolderError> {
        let listed = folder.join("frames.csv");
        let (entries, remark) = if listed.is_file() {
            let entry = |(name, time_s)| Entry { path: folder.join::<String>(name), time_s };
            (table(&listed)?.into_iter().map(entry).collect(), None)
        } else {
            let files = files(folder)?;
            let fps = fps.ok_or(FolderError::NoTimes { path: folder.into() })?;
            let Numbered { files, remark } = in_order(folder, files)?;
            let entry = |(path, place)| Entry { path, time_s: place as f64 / fps };
            (files.into_iter().map(entry).collect::<Vec<_>>(), remark)
        };
        if entries.is_empty() {
            return Err(FolderError::Empty { path: folder.into() });
        }
        Ok(Self { entries, remark, repeats: Repeats::default() })
    }

    /// The pictures of `folder` in the order of their names, a second apart: when they were taken does not matter.
    ///
    /// # Errors
    /// [`FolderError`].
    pub(super) fn untimed(folder: &Path) -> Result<Self, FolderError> {
        let mut files = files(folder)?;
        files.sort_unstable();
        let entry = |(i, path)| Entry { path, time_s: i as f64 };
        let entries = files.into_iter().enumerate().map(entry).collect();
        Ok(Self { entries, remark: None, repeats: Repeats::default() })
    }

    /// A single picture.
    pub(super) fn of_one(path: &Path) -> Self {
        let entries = vec![Entry { path: path.into(), time_s: 0.0 }];
        Self { entries, remark: None, repeats: Repeats::default() }
    }
}

impl ImageSource for Folder {
    fn images(&self) -> Result<Images<'_>, SourceError> {
        Ok(Box::new(self.repeats.watch(self.entries.iter().map(|entry| {
            let bytes = std::fs::read(&entry.path).map_err(|error| error.to_string());
            let name = entry.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let picture = bytes.and_then(|bytes| picture_file(&bytes).map_err(|error| with_causes(&error)));
            Ok(TimedImage::new(name, entry.time_s, picture))
        }))))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.entries.len())
    }

    fn remarks(&self) -> Vec<String> {
        self.remark.iter().cloned().chain(self.repeats.remark()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;

    fn entries(folder: &Path, fps: Option<f64>) -> Result<Vec<Entry>, FolderError> {
        Folder::open(folder, fps).map(|folder| folder.entries)
    }

    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (i, name) in names.iter().enumerate() {
            GrayImage::new(4 + i as u32, 3).save(folder.path().join(name)).unwrap();
        }
        folder
    }

    #[test]
    fn pictures_without_numbers_come_in_order_of_name_evenly_spaced() {
        let folder = folder_of(&["b.png", "a.png", "c.jpg"]);
        std::fs::write(folder.path().join("notes.txt"), "no picture").unwrap();
        let found = entries(folder.path(), Some(50.0)).unwrap();
        let names: Vec<_> = found.iter().map(|e| e.path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a.png", "b.png", "c.jpg"]);
        assert_eq!(found[2].time_s, 0.04);
        assert!(matches!(entries(folder.path(), None), Err(FolderError::NoTimes { .. })));
    }

    #[test]
    fn frames_csv_wins_over_fps_and_its_mistakes_are_named() {
        let folder = folder_of(&["a.png", "b.png"]);
        let table = folder.path().join("frames.csv");
        std::fs::write(&table, "file,time_s,status\nb.png,0.5,ok\na.png,0.75,ok\n").unwrap();
        let found = entries(folder.path(), Some(50.0)).unwrap();
        assert_eq!((found[0].path.ends_with("b.png"), found[1].time_s), (true, 0.75));
        for (text, what) in [
            ("file,time_s\na.png,1\nb.png,1\n", "does not rise"),
            ("file,time_s\n../a.png,1\n", "not the name of a file"),
            ("file,time_s\na.png,nan\n", "not a number"),
            ("file\na.png\n", "no column time_s"),
        ] {
            std::fs::write(&table, text).unwrap();
            let message = entries(folder.path(), None).unwrap_err().to_string();
            assert!(message.contains(what), "{message}");
        }
    }
}
