//! A video file, decoded by ffmpeg.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use image::GrayImage;

use super::error::SourceError;
use super::source::{ImageSource, Images, TimedImage};

/// A video, decoded to grey pictures by ffmpeg in a process of its own.
#[derive(Debug)]
pub(super) struct Video {
    path: PathBuf,
    width: usize,
    height: usize,
    /// When each image was taken, by the file's own stamps.
    times_s: Vec<f64>,
}

impl Video {
    pub(super) fn open(path: &Path) -> Result<Self, SourceError> {
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
    fn images(&self) -> Result<Images<'_>, SourceError> {
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
