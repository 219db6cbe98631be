//! A video file, decoded by ffmpeg.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use image::GrayImage;

use camera::source::SourceError;
use camera::source::{ImageSource, Images, TimedImage};

/// A video, decoded to grey pictures by ffmpeg in a process of its own.
#[derive(Debug)]
pub(super) struct Video {
    path: PathBuf,
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
        let stamps = probe(&["-show_entries", "frame=best_effort_timestamp_time"])?;
        let times_s: Vec<f64> =
            stamps.lines().filter_map(|line| line.trim_end_matches(',').parse().ok()).collect();
        if times_s.is_empty() {
            return Err(failed("ffprobe", path, "it holds no pictures"));
        }
        if times_s.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(failed("ffprobe", path, "its images have no rising time stamps"));
        }
        Ok(Self { path: path.into(), times_s })
    }
}

impl ImageSource for Video {
    fn images(&self) -> Result<Images<'_>, SourceError> {
        let mut child = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-i"])
            .arg(&self.path)
            .args(["-map", "0:v:0", every_image(), "passthrough"])
            // Each picture says its own size: a telephone held upright films lying pictures, which ffmpeg turns.
            .args(["-f", "image2pipe", "-c:v", "pgm", "-pix_fmt", "gray", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|_| SourceError::NoFfmpeg { path: self.path.clone() })?;
        let pixels = child.stdout.take().map(BufReader::new);
        // Read as it comes: ffmpeg would wait for ever on a full pipe.
        let stderr = child.stderr.take().map(|mut pipe| std::thread::spawn(move || read_tail(&mut pipe)));
        Ok(Box::new(Decoded { video: self, child, pixels, stderr, next: 0 }))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.times_s.len())
    }
}

/// ffmpeg's option to hand on each image once, whatever its time; it has another name since version 5.1.
fn every_image() -> &'static str {
    let help = Command::new("ffmpeg").args(["-v", "quiet", "-h", "long"]).stdin(Stdio::null()).output();
    let new = help.is_ok_and(|help| String::from_utf8_lossy(&help.stdout).contains("-fps_mode"));
    if new { "-fps_mode" } else { "-vsync" }
}

/// Reads a program's error output to its end; returns the last part of it.
pub(super) fn read_tail(pipe: &mut impl Read) -> String {
    /// Length of the part that is returned \[bytes\], chosen.
    const MAX_TAIL_BYTES: usize = 4096;
    let (mut end, mut buffer) = (Vec::new(), [0; MAX_TAIL_BYTES]);
    while let Ok(count @ 1..) = pipe.read(&mut buffer) {
        end.extend_from_slice(&buffer[..count]);
        end.drain(..end.len().saturating_sub(MAX_TAIL_BYTES));
    }
    String::from_utf8_lossy(&end).into_owned()
}

/// A running ffmpeg and the pictures still to come from it.
struct Decoded<'a> {
    video: &'a Video,
    child: Child,
    pixels: Option<BufReader<ChildStdout>>,
    stderr: Option<JoinHandle<String>>,
    next: usize,
}

impl Iterator for Decoded<'_> {
    type Item = Result<TimedImage, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let Video { path, times_s } = self.video;
        let time_s = *times_s.get(self.next)?;
        let image = picture(self.pixels.as_mut()?);
        let name = format!("{:06}", self.next);
        self.next += 1;
        match image {
            Some(image) => Some(Ok(TimedImage { name, time_s, chroma: None, grey: Ok(image) })),
            None => {
                self.pixels = None;
                let stderr = self.stderr.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
                let given = format!("{stderr}\nit gave {} of {} images", self.next - 1, times_s.len());
                Some(Err(failed("ffmpeg", path, &given)))
            }
        }
    }
}

/// The next picture of a pipe of portable grey maps (`P5`, width, height, 255, then the pixels); none where it ends.
fn picture(pipe: &mut impl BufRead) -> Option<GrayImage> {
    /// Longest line of such a head that is read \[bytes\], chosen.
    const MAX_LINE_BYTES: u64 = 64;
    /// Most pixels of a picture that are read, chosen: no film has larger ones.
    const MAX_PIXELS: u64 = 1 << 28;
    let mut line = || {
        let mut line = String::new();
        pipe.by_ref().take(MAX_LINE_BYTES).read_line(&mut line).ok()?;
        Some(line.trim_end().to_owned())
    };
    let (kind, size, most) = (line()?, line()?, line()?);
    let (width, height) = size.split_once(' ')?;
    let (width, height): (u32, u32) = (width.parse().ok()?, height.parse().ok()?);
    if kind != "P5" || most != "255" || u64::from(width) * u64::from(height) > MAX_PIXELS {
        return None;
    }
    let mut grey = vec![0; width as usize * height as usize];
    pipe.read_exact(&mut grey).ok()?;
    GrayImage::from_raw(width, height, grey)
}

impl Drop for Decoded<'_> {
    fn drop(&mut self) {
        // A reader that stops early leaves ffmpeg blocked on its pipe; either call only fails when it has ended.
        self.pixels = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn failed(program: &'static str, path: &Path, output: &str) -> SourceError {
    SourceError::Video { program, path: path.into(), message: last_lines(output) }
}

/// The last lines of a program's error output, as one line.
pub(super) fn last_lines(output: &str) -> String {
    /// Number of lines that are used, chosen: the last one alone often states only that it failed.
    const MESSAGE_LINES: usize = 2;
    let lines: Vec<&str> = output.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match lines.len() {
        0 => "no reason given".to_owned(),
        count => lines[count.saturating_sub(MESSAGE_LINES)..].join("; "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two seconds of a test picture with some images left out.
    fn film(folder: &Path) -> Option<PathBuf> {
        let film = folder.join("film.mp4");
        let made = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-f", "lavfi", "-i", "testsrc=duration=2:size=64x48:rate=25"])
            .args(["-vf", "select=mod(n\\,5)", every_image(), "vfr", "-pix_fmt", "yuv420p"])
            .arg(&film)
            .output();
        let made = made.is_ok_and(|made| made.status.success());
        if !made {
            eprintln!("skipped: films as files (ffmpeg is not there, or cannot encode)");
        }
        made.then_some(film)
    }

    #[test]
    fn images_have_the_times_of_their_stamps_and_a_lost_end_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let Some(path) = film(folder.path()) else { return };
        let mut film = Video::open(&path).unwrap();
        let images: Vec<TimedImage> = film.images().unwrap().map(Result::unwrap).collect();
        assert_eq!(images.len(), 40);
        let steps: Vec<f64> = images.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        let near = |step: &f64, wanted: f64| (step - wanted).abs() < 1e-5;
        assert!(steps.iter().all(|step| near(step, 0.04) || near(step, 0.08)), "{steps:?}");
        assert_eq!(steps.iter().filter(|step| near(step, 0.08)).count(), 9, "{steps:?}");
        assert_eq!(images[0].grey.as_ref().unwrap().dimensions(), (64, 48));

        film.times_s.push(100.0);
        let error = film.images().unwrap().last().unwrap().unwrap_err().to_string();
        assert!(
            error.contains("ffmpeg could not read") && error.contains("it gave 40 of 41 images"),
            "{error}"
        );
    }

    #[test]
    fn a_film_of_a_telephone_held_upright_stands_upright() {
        let folder = tempfile::tempdir().unwrap();
        let Some(path) = film(folder.path()) else { return };
        let turned = folder.path().join("turned.mp4");
        let copy = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-i"])
            .arg(&path)
            .args(["-c", "copy", "-metadata:s:v:0", "rotate=90"])
            .arg(&turned)
            .output();
        let image = |path: &Path| {
            let film = Video::open(path).unwrap();
            film.images().unwrap().next().unwrap().unwrap().grey.unwrap()
        };
        let lying = image(&path);
        match image(&turned) {
            // ffmpeg since version 6 marks no film as turned that way.
            same if same == lying => eprintln!("skipped: a turned film ({:?})", copy.map(|copy| copy.status)),
            upright => {
                assert_eq!(upright.dimensions(), (48, 64));
                let turns = [image::imageops::rotate90(&lying), image::imageops::rotate270(&lying)];
                assert!(turns.contains(&upright));
            }
        }
    }

    #[test]
    fn what_is_no_picture_is_none() {
        assert_eq!(picture(&mut &b"P5\n2 1\n255\n\x01\x02"[..]).unwrap().into_raw(), [1, 2]);
        let huge = "P5\n4000000000 4000000000\n255\n";
        for bytes in
            ["", huge, "P5\n2 1\n255\n\u{1}", "P6\n2 1\n255\nab", "P5\n2\n255\nab", "P5\n2 1\n65535\nab"]
        {
            assert_eq!(picture(&mut bytes.as_bytes()), None, "{bytes:?}");
        }
    }

    #[test]
    fn files_without_pictures_are_refused_with_what_ffprobe_says() {
        let folder = tempfile::tempdir().unwrap();
        let Some(path) = film(folder.path()) else { return };
        let whole = std::fs::read(&path).unwrap();
        let cut = folder.path().join("cut.mp4");
        std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
        let error = Video::open(&cut).unwrap_err().to_string();
        assert!(error.contains("moov atom not found"), "{error}");
        std::fs::write(&cut, "hello").unwrap();
        let error = Video::open(&cut).unwrap_err().to_string();
        assert!(error.contains("Invalid data found"), "{error}");
    }
}
