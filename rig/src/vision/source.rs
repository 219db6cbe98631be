//! Where a sequence of images comes from: a recorded run, a folder of pictures or a video file.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use image::GrayImage;

use super::record::TimedImage;
use crate::camera::decode::grey_file;
use crate::camera::folder::{self, Entry, FolderError};
use crate::camera::recorded::RecordedImages;
use crate::record::RecordError;
use crate::record::folder::{RunFolder, file};

/// A sequence of images that can be read more than once: first for a sample, then for good.
pub trait ImageSource {
    /// Reads from the beginning.
    ///
    /// # Errors
    /// [`SourceError`] when the sequence as a whole cannot be read. A single damaged image is an image with a
    /// reason instead of a picture.
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError>;

    /// How many images there are, where that is known beforehand.
    fn len_hint(&self) -> Option<usize>;
}

/// Why a sequence cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The folder's pictures cannot be listed.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// Neither a folder nor a file.
    #[error("{} is neither a run, a folder of pictures nor a video file", path.display())]
    Nothing {
        /// What was given.
        path: PathBuf,
    },
    /// Video files need ffmpeg.
    #[error("reading the video {} needs the programs ffmpeg and ffprobe: install the package ffmpeg", path.display())]
    NoFfmpeg {
        /// The video.
        path: PathBuf,
    },
    /// ffmpeg or ffprobe did not understand the file.
    #[error("{program} could not read {}: {said}", path.display())]
    Video {
        /// Which program.
        program: &'static str,
        /// The video.
        path: PathBuf,
        /// Its last words.
        said: String,
    },
}

/// The source that `path` is: a run folder, a recording, a folder of pictures, or a video file. `fps` is for pictures without times of their own.
///
/// # Errors
/// [`SourceError`].
pub fn open(path: &Path, fps: Option<f64>) -> Result<Box<dyn ImageSource>, SourceError> {
    if path.join(file::START).is_file() {
        let run = RunFolder::open(path)?;
        Ok(Box::new(RecordedImages::new(&run.file(file::RECORDING), Some(run.origin()))))
    } else if path.extension().is_some_and(|ending| ending == "mcap") {
        Ok(Box::new(RecordedImages::new(path, None)))
    } else if path.is_dir() {
        Ok(Box::new(Folder { entries: folder::entries(path, fps)? }))
    } else if path.is_file() {
        Ok(Box::new(Video::open(path)?))
    } else {
        Err(SourceError::Nothing { path: path.into() })
    }
}

/// At most `most` images spread evenly over the sequence, whatever its length: every image until there are too
/// many, then every second of those, and so on.
///
/// # Errors
/// [`SourceError`].
pub fn sample(source: &dyn ImageSource, most: usize) -> Result<Vec<TimedImage>, SourceError> {
    let mut kept: Vec<TimedImage> = Vec::new();
    let mut stride = source.len_hint().map_or(1, |len| len.div_ceil(most).max(1));
    for (i, image) in source.images()?.enumerate() {
        if i % stride != 0 {
            continue;
        }
        kept.push(image?);
        if kept.len() > most {
            let mut even = false;
            kept.retain(|_| {
                even = !even;
                even
            });
            stride *= 2;
        }
    }
    Ok(kept)
}

struct Folder {
    entries: Vec<Entry>,
}

impl ImageSource for Folder {
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
        Ok(Box::new(self.entries.iter().map(|entry| {
            let bytes = std::fs::read(&entry.path).map_err(|error| error.to_string());
            let name = entry.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let grey = bytes.and_then(|bytes| grey_file(&bytes).map_err(|error| chain(&error)));
            Ok(TimedImage { name, time_s: entry.time_s, grey })
        })))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.entries.len())
    }
}

/// A video, decoded to grey pictures by ffmpeg in a process of its own.
#[derive(Debug)]
struct Video {
    path: PathBuf,
    width: usize,
    height: usize,
    /// When each image was taken, by the file's own stamps.
    times_s: Vec<f64>,
}

impl Video {
    fn open(path: &Path) -> Result<Self, SourceError> {
        let probe = |arguments: &[&str]| -> Result<String, SourceError> {
            let out = Command::new("ffprobe")
                .args(["-v", "error", "-select_streams", "v:0", "-of", "csv=p=0"])
                .args(arguments)
                .arg(path)
                .output()
                .map_err(|_| SourceError::NoFfmpeg { path: path.into() })?;
            if out.status.success() {
                Ok(String::from_utf8_lossy(&out.stdout).into_owned())
            } else {
                Err(failed("ffprobe", path, &String::from_utf8_lossy(&out.stderr)))
            }
        };
        let size = probe(&["-show_entries", "stream=width,height"])?;
        let sides: Vec<usize> = size.trim().split(',').filter_map(|side| side.parse().ok()).collect();
        let [width, height] = sides[..] else {
            return Err(failed("ffprobe", path, &format!("no picture size in `{}`", size.trim())));
        };
        let stamps = probe(&["-show_entries", "frame=best_effort_timestamp_time"])?;
        let times_s: Vec<f64> =
            stamps.lines().filter_map(|line| line.trim_end_matches(',').parse().ok()).collect();
        if times_s.is_empty() || times_s.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(failed("ffprobe", path, "its images have no rising time stamps"));
        }
        Ok(Self { path: path.into(), width, height, times_s })
    }
}

impl ImageSource for Video {
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
        let mut child = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-noautorotate", "-i"])
            .arg(&self.path)
            .args(["-map", "0:v:0", "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "gray", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|_| SourceError::NoFfmpeg { path: self.path.clone() })?;
        let pixels = child.stdout.take().map(BufReader::new);
        Ok(Box::new(Decoded { video: self, child, pixels, next: 0 }))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.times_s.len())
    }
}

/// A running ffmpeg and the pictures still to come from it.
struct Decoded<'a> {
    video: &'a Video,
    child: Child,
    pixels: Option<BufReader<ChildStdout>>,
    next: usize,
}

impl Iterator for Decoded<'_> {
    type Item = Result<TimedImage, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let Video { path, width, height, times_s } = self.video;
        let time_s = *times_s.get(self.next)?;
        let mut grey = vec![0; width * height];
        let read = self.pixels.as_mut()?.read_exact(&mut grey);
        let image = GrayImage::from_raw(*width as u32, *height as u32, grey);
        let name = format!("{:06}", self.next);
        self.next += 1;
        match (read, image) {
            (Ok(()), Some(image)) => Some(Ok(TimedImage { name, time_s, grey: Ok(image) })),
            _ => {
                self.pixels = None;
                let said = format!("it gave {} of {} images", self.next - 1, times_s.len());
                Some(Err(failed("ffmpeg", path, &said)))
            }
        }
    }
}

impl Drop for Decoded<'_> {
    fn drop(&mut self) {
        // A reader that stops early leaves ffmpeg blocked on its pipe; either call only fails when it has ended.
        self.pixels = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn failed(program: &'static str, path: &Path, said: &str) -> SourceError {
    let last = said.lines().last().unwrap_or("no reason given").to_owned();
    SourceError::Video { program, path: path.into(), said: last }
}

/// An error and its causes on one line.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text.push_str(&format!(": {cause}"));
        source = cause.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counted(usize, bool);

    impl ImageSource for Counted {
        fn images(
            &self,
        ) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
            let image = |i| TimedImage { name: format!("{i}"), time_s: i as f64, grey: Err(String::new()) };
            Ok(Box::new((0..self.0).map(move |i| Ok(image(i)))))
        }

        fn len_hint(&self) -> Option<usize> {
            self.1.then_some(self.0)
        }
    }

    #[test]
    fn sample_is_even_and_spans_the_sequence_known_length_or_not() {
        for known in [true, false] {
            for length in [1, 7, 8, 9, 100, 1000] {
                let kept = sample(&Counted(length, known), 8).unwrap();
                assert!((4..=8).contains(&kept.len()) || kept.len() == length, "{length}: {}", kept.len());
                let steps: Vec<f64> = kept.windows(2).map(|p| p[1].time_s - p[0].time_s).collect();
                assert!(steps.windows(2).all(|s| s[0] == s[1]), "{steps:?}");
                assert!(kept.last().unwrap().time_s >= 0.74 * (length - 1) as f64, "{length} {known}");
            }
        }
    }

    #[test]
    fn damaged_picture_keeps_its_row_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        GrayImage::new(4, 3).save(folder.path().join("a.png")).unwrap();
        std::fs::write(folder.path().join("b.png"), b"\x89PNG\r\n\x1a\nnonsense").unwrap();
        let source = open(folder.path(), Some(10.0)).unwrap();
        let images: Vec<TimedImage> = source.images().unwrap().map(Result::unwrap).collect();
        assert!(images[0].grey.is_ok() && images[1].grey.as_ref().is_err_and(|why| !why.is_empty()));
    }
}
