//! A folder of pictures as a camera: its files in the order of their names.
//!
//! A `frames.csv` (`file,time_s`) in the folder says which files and when; otherwise they are evenly spaced.

use std::path::{Path, PathBuf};
use std::time::Duration;

use image::ImageFormat;

use super::{Camera, CameraError, CameraImage, CameraInfo, Encoding};
use crate::clock::MonotonicNs;

/// Why a folder's pictures cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder or a file in it could not be read.
    #[error("reading {}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// `frames.csv` is not one.
    #[error("{} line {line}: {what}", path.display())]
    Frames {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// What is wrong.
        what: String,
    },
    /// No pictures.
    #[error("{} holds no .png, .jpg or .jpeg files", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// Nothing says when the pictures were taken.
    #[error("{} has no frames.csv: set [camera] fps", path.display())]
    NoTimes {
        /// The folder.
        path: PathBuf,
    },
}

/// A picture's file and its time.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The file.
    pub path: PathBuf,
    /// Mid-exposure \[s\].
    pub time_s: f64,
}

/// The pictures of `folder` in order of time.
///
/// `frames.csv` wins over `fps` (images per second); its other columns are ignored.
///
/// # Errors
/// [`FolderError`].
pub fn entries(folder: &Path, fps: Option<f64>) -> Result<Vec<Entry>, FolderError> {
    let table = folder.join("frames.csv");
    let found = if table.is_file() {
        listed(folder, &table)?
    } else {
        let files = files(folder)?;
        if files.is_empty() {
            return Err(FolderError::Empty { path: folder.into() });
        }
        let fps = fps.ok_or(FolderError::NoTimes { path: folder.into() })?;
        let entry = |(i, path)| Entry { path, time_s: i as f64 / fps };
        files.into_iter().enumerate().map(entry).collect()
    };
    if found.is_empty() { Err(FolderError::Empty { path: folder.into() }) } else { Ok(found) }
}

fn files(folder: &Path) -> Result<Vec<PathBuf>, FolderError> {
    let unreadable = |source| FolderError::Unreadable { path: folder.into(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if matches!(ending.as_deref(), Some("png" | "jpg" | "jpeg")) {
            files.push(path);
        }
    }
    files.sort_unstable();
    Ok(files)
}

fn listed(folder: &Path, table: &Path) -> Result<Vec<Entry>, FolderError> {
    let refuse = |line: u64, what: String| FolderError::Frames { path: table.into(), line, what };
    let mut csv = csv::Reader::from_path(table).map_err(|error| refuse(1, error.to_string()))?;
    let headers = csv.headers().map_err(|error| refuse(1, error.to_string()))?.clone();
    let column = |name: &str| {
        headers.iter().position(|h| h == name).ok_or_else(|| refuse(1, format!("no column {name}")))
    };
    let (file, time) = (column("file")?, column("time_s")?);
    let mut entries: Vec<Entry> = Vec::new();
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
        if entries.last().is_some_and(|last| last.time_s >= time_s) {
            return Err(refuse(line, format!("time_s {time_s} does not rise")));
        }
        entries.push(Entry { path: folder.join(name), time_s });
    }
    Ok(entries)
}

/// A folder of pictures behind the camera trait: hands them over as fast as they are asked for.
#[derive(Debug)]
pub struct FolderCamera {
    info: CameraInfo,
    entries: Vec<Entry>,
    next: usize,
    start: MonotonicNs,
}

impl FolderCamera {
    /// The pictures of `folder`, as [`entries`] lists them; stamps count from `start`.
    ///
    /// # Errors
    /// [`FolderError`], also when the first picture cannot be read.
    pub fn open(folder: &Path, fps: Option<f64>, start: MonotonicNs) -> Result<Self, FolderError> {
        let entries = entries(folder, fps)?;
        let path = &entries[0].path;
        let unreadable = |source: std::io::Error| FolderError::Unreadable { path: path.clone(), source };
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let (width_px, height_px) = size(&bytes).map_err(|e| unreadable(std::io::Error::other(e)))?;
        let span_s = entries[entries.len() - 1].time_s - entries[0].time_s;
        let counted = if span_s > 0.0 { (entries.len() - 1) as f64 / span_s } else { 0.0 };
        let info = CameraInfo {
            name: format!("folder {}", folder.display()),
            width_px,
            height_px,
            fps: fps.unwrap_or(counted),
            encoding: encoding(&bytes),
            mid_exposure_offset_s: 0.0,
        };
        Ok(Self { info, entries, next: 0, start })
    }
}

impl Camera for FolderCamera {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.next = 0;
        Ok(())
    }

    fn next_image(&mut self, _timeout: Duration) -> Result<CameraImage, CameraError> {
        let entry = self.entries.get(self.next).ok_or(CameraError::End)?;
        let refused = |what: String| CameraError::Refused {
            camera: self.info.name.clone(),
            what: format!("{}: {what}", entry.path.display()),
        };
        let data = std::fs::read(&entry.path).map_err(|error| refused(error.to_string()))?;
        // A damaged file keeps its place in the sequence; its decoder says what is wrong.
        let (width_px, height_px) = size(&data).unwrap_or((self.info.width_px, self.info.height_px));
        let at = self.start.plus_seconds(entry.time_s);
        let image = CameraImage {
            sequence: self.next as u32,
            stamp: at,
            mid_exposure: at,
            damaged: false,
            width_px,
            height_px,
            encoding: encoding(&data),
            data,
        };
        self.next += 1;
        Ok(image)
    }

    fn stop(&mut self) {
        self.next = self.entries.len();
    }
}

fn encoding(data: &[u8]) -> Encoding {
    match image::guess_format(data) {
        Ok(ImageFormat::Jpeg) => Encoding::Jpeg,
        _ => Encoding::Png,
    }
}

fn size(data: &[u8]) -> Result<(u32, u32), image::ImageError> {
    image::ImageReader::new(std::io::Cursor::new(data)).with_guessed_format()?.into_dimensions()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;

    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (i, name) in names.iter().enumerate() {
            GrayImage::new(4 + i as u32, 3).save(folder.path().join(name)).unwrap();
        }
        folder
    }

    #[test]
    fn files_come_in_order_of_name_evenly_spaced() {
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

    #[test]
    fn camera_hands_over_every_picture_with_its_own_size_and_then_ends() {
        let folder = folder_of(&["a.png", "b.png"]);
        let mut camera = FolderCamera::open(folder.path(), Some(10.0), MonotonicNs(1_000)).unwrap();
        camera.start().unwrap();
        let first = camera.next_image(Duration::ZERO).unwrap();
        let second = camera.next_image(Duration::ZERO).unwrap();
        assert_eq!((first.width_px, second.width_px, second.sequence), (4, 5, 1));
        assert_eq!(second.mid_exposure, MonotonicNs(100_001_000));
        assert_eq!(super::super::decode::grey(&second).unwrap().dimensions(), (5, 3));
        assert!(matches!(camera.next_image(Duration::ZERO), Err(CameraError::End)));
    }
}
