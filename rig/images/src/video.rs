//! A video file, decoded by ffmpeg; what it says of itself is compared with what it holds.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use image::GrayImage;
use serde::Deserialize;

use super::repeats::Repeats;
use camera::decode::Picture;
use camera::source::SourceError;
use camera::source::{ImageSource, Images, TimedImage};

/// A video, decoded by ffmpeg in a process of its own.
#[derive(Debug)]
pub(super) struct Video {
    path: PathBuf,
    /// When each image was taken, by the file's own stamps.
    times_s: Vec<f64>,
    /// What is to be known of the file, each as a sentence without its full stop.
    remarks: Vec<String>,
    repeats: Repeats,
}

/// What ffprobe tells of a file. Numbers are texts in it.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Told {
    streams: Vec<Stream>,
    format: Format,
    frames: Vec<Frame>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Stream {
    sample_aspect_ratio: Option<String>,
    field_order: Option<String>,
    nb_frames: Option<String>,
    duration: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Format {
    start_time: Option<String>,
    duration: Option<String>,
}

#[derive(Debug, Deserialize)]
struct Frame {
    best_effort_timestamp_time: Option<String>,
}

/// What ffprobe is asked for: the fields above.
const ASKED: &str = "stream=sample_aspect_ratio,field_order,nb_frames,duration:format=start_time,duration:frame=best_effort_timestamp_time";

/// Departure of a pixel's sides from each other, as a share, from which a film is refused, chosen: others are what a ratio of small numbers rounds.
const MAX_PIXEL_DEPARTURE: f64 = 0.002;

impl Video {
    pub(super) fn open(path: &Path) -> Result<Self, SourceError> {
        let out = Command::new("ffprobe")
            .args(["-v", "error", "-select_streams", "v:0", "-of", "json", "-show_entries", ASKED])
            .arg(path)
            .output()
            .map_err(|_| SourceError::NoFfmpeg { path: path.into() })?;
        let said = String::from_utf8_lossy(&out.stderr);
        if !out.status.success() {
            return Err(failed("ffprobe", path, &said));
        }
        let told: Told = serde_json::from_slice(&out.stdout)
            .map_err(|error| failed("ffprobe", path, &error.to_string()))?;
        let stamp = |frame: &Frame| number(frame.best_effort_timestamp_time.as_ref());
        let times_s: Vec<f64> = told.frames.iter().filter_map(stamp).collect();
        if times_s.is_empty() {
            return Err(failed("ffprobe", path, "it holds no pictures"));
        }
        if times_s.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(failed("ffprobe", path, "its images have no rising time stamps"));
        }
        let stream = told.streams.into_iter().next().unwrap_or_default();
        if let Some(ratio) = stream.sample_aspect_ratio.as_deref().filter(|ratio| !is_square(ratio)) {
            return Err(SourceError::Pixels { path: path.into(), ratio: ratio.to_owned() });
        }
        let says = |what: String| format!("the film {} {what}", path.display());
        let remarks = [
            shortfall(&stream, &told.format, &times_s).map(says),
            is_interlaced(&stream).then(|| {
                says("is interlaced: each picture shows two moments, line by line; make two of each with ffmpeg -i IN -vf bwdif OUT".into())
            }),
            (!said.trim().is_empty()).then(|| says(format!("is read with complaints of ffprobe: {}", last_lines(&said)))),
        ];
        let remarks = remarks.into_iter().flatten().collect();
        Ok(Self { path: path.into(), times_s, remarks, repeats: Repeats::default() })
    }
}

fn number(text: Option<&String>) -> Option<f64> {
    text?.parse().ok()
}

/// Whether pixels of this ratio, `width:height`, are square as far as anybody says.
fn is_square(ratio: &str) -> bool {
    let Some((Ok(width), Ok(height))) = ratio.split_once(':').map(|(w, h)| (w.parse(), h.parse())) else {
        return true;
    };
    let (width, height): (f64, f64) = (width, height);
    width == 0.0 || height == 0.0 || (width / height - 1.0).abs() < MAX_PIXEL_DEPARTURE
}

fn is_interlaced(stream: &Stream) -> bool {
    matches!(stream.field_order.as_deref(), Some("tt" | "bb" | "tb" | "bt"))
}

/// What a film with images at `times_s` holds less than its head says.
fn shortfall(stream: &Stream, format: &Format, times_s: &[f64]) -> Option<String> {
    let count = times_s.len();
    if let Some(told) = number(stream.nb_frames.as_ref())
        && told > count as f64
    {
        return Some(format!(
            "says that it holds {told} images, and {count} of them can be read: it is cut or damaged"
        ));
    }
    let mut steps: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let step_s = *steps.get(steps.len() / 2)?;
    let length_s = number(stream.duration.as_ref()).or_else(|| number(format.duration.as_ref()))?;
    let told_end_s = number(format.start_time.as_ref()).unwrap_or(0.0) + length_s;
    let end_s = times_s[count - 1] + step_s;
    // Half an image for what is rounded.
    (told_end_s > end_s + 1.5 * step_s).then(|| {
        format!(
            "says that it lasts {told_end_s:.3} s, and its images end at {end_s:.3} s: it is cut (an interrupted copy?), unless it has \
             sound that goes on"
        )
    })
}

impl ImageSource for Video {
    fn images(&self) -> Result<Images<'_>, SourceError> {
        let mut child = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-i"])
            .arg(&self.path)
            .args(["-map", "0:v:0", every_image(), "passthrough"])
            // Their head says how large they are: a telephone held upright films lying pictures, which ffmpeg turns. Levels from 0 to 255.
            .args(["-pix_fmt", "yuvj444p", "-strict", "-1", "-f", "yuv4mpegpipe", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|_| SourceError::NoFfmpeg { path: self.path.clone() })?;
        let pixels = child.stdout.take().map(BufReader::new);
        // Read as it comes: ffmpeg would wait for ever on a full pipe.
        let stderr = child.stderr.take().map(|mut pipe| std::thread::spawn(move || read_tail(&mut pipe)));
        let decoded = Decoded { video: self, child, pixels, stderr, size: None, next: 0 };
        Ok(Box::new(self.repeats.watch(decoded)))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.times_s.len())
    }

    fn remarks(&self) -> Vec<String> {
        self.remarks.iter().cloned().chain(self.repeats.remark()).collect()
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
    /// Width and height of all pictures, once the pipe's head is read \[px\].
    size: Option<[u32; 2]>,
    next: usize,
}

impl Iterator for Decoded<'_> {
    type Item = Result<TimedImage, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let Video { path, times_s, .. } = self.video;
        let time_s = *times_s.get(self.next)?;
        let pipe = self.pixels.as_mut()?;
        self.size = self.size.or_else(|| size(pipe));
        let picture = self.size.and_then(|size| picture(pipe, size));
        let name = format!("{:06}", self.next);
        self.next += 1;
        match picture {
            Some(picture) => Some(Ok(TimedImage::new(name, time_s, Ok(picture)))),
            None => {
                self.pixels = None;
                let stderr = self.stderr.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
                let given = format!("{stderr}\nit gave {} of {} images", self.next - 1, times_s.len());
                Some(Err(failed("ffmpeg", path, &given)))
            }
        }
    }
}

/// Longest line in a stream of pictures that is read \[bytes\], chosen.
const MAX_LINE_BYTES: u64 = 1024;

fn line(pipe: &mut impl BufRead) -> Option<String> {
    let mut line = String::new();
    pipe.by_ref().take(MAX_LINE_BYTES).read_line(&mut line).ok()?;
    Some(line.trim_end().to_owned())
}

/// Width and height by the head of a stream in the format YUV4MPEG2, whose pictures have as much colour as light \[px\].
fn size(pipe: &mut impl BufRead) -> Option<[u32; 2]> {
    /// Most pixels of a picture that are read, chosen: no film has larger ones.
    const MAX_PIXELS: u64 = 1 << 28;
    let head = line(pipe)?;
    let mut fields = head.split(' ');
    let is_known = fields.next() == Some("YUV4MPEG2") && head.split(' ').any(|field| field == "C444");
    let value = |key: char| head.split(' ').find_map(|field| field.strip_prefix(key)?.parse::<u32>().ok());
    let (width, height) = (value('W')?, value('H')?);
    (is_known && u64::from(width) * u64::from(height) <= MAX_PIXELS).then_some([width, height])
}

/// The next picture of such a stream, whose sides are `width` and `height` \[px\]; none where it ends.
fn picture(pipe: &mut impl BufRead, [width, height]: [u32; 2]) -> Option<Picture> {
    /// What both differences of colour are where there is none.
    const NO_COLOUR: u8 = 128;
    if !line(pipe)?.starts_with("FRAME") {
        return None;
    }
    let mut plane = || {
        let mut plane = vec![0; width as usize * height as usize];
        pipe.read_exact(&mut plane).ok()?;
        GrayImage::from_raw(width, height, plane)
    };
    let (grey, chroma) = (plane()?, [plane()?, plane()?]);
    let has_colour = chroma.iter().any(|plane| plane.iter().any(|&value| value != NO_COLOUR));
    Some(Picture { grey, chroma: has_colour.then_some(chroma) })
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
    fn a_films_head_is_compared_with_what_it_holds() {
        let text = |text: &str| Some(text.to_owned());
        let times_s = [0.0, 0.02, 0.04, 0.08];
        let format = |duration| Format { start_time: text("0.000"), duration: text(duration) };
        let said = |stream: &Stream, duration| shortfall(stream, &format(duration), &times_s);
        let stream = Stream::default();
        assert_eq!(said(&stream, "0.10"), None);
        assert!(said(&stream, "0.20").unwrap().contains("lasts 0.200 s, and its images end at 0.100 s"));
        let stream = Stream { nb_frames: text("6"), ..Stream::default() };
        assert!(said(&stream, "0.10").unwrap().contains("holds 6 images, and 4 of them"));
        assert!(["1:1", "0:1", "N/A", "3200:3201"].iter().all(|ratio| is_square(ratio)));
        assert!(["2:1", "10:11", "1:2"].iter().all(|ratio| !is_square(ratio)));
        assert!(is_interlaced(&Stream { field_order: text("tt"), ..Stream::default() }));
        assert!(!is_interlaced(&Stream { field_order: text("progressive"), ..Stream::default() }));
    }

    #[test]
    fn what_is_no_picture_is_none() {
        let read = |bytes: &[u8]| {
            let mut pipe = bytes;
            let size = size(&mut pipe)?;
            picture(&mut pipe, size)
        };
        let grey = read(b"YUV4MPEG2 W2 H1 F25:1 Ip C444\nFRAME\n\x01\x02\x80\x80\x80\x80").unwrap();
        assert_eq!((grey.grey.into_raw(), grey.chroma), (vec![1, 2], None));
        let colour = read(b"YUV4MPEG2 W2 H1 C444\nFRAME Ip\n\x01\x02\x80\x81\x82\x83").unwrap();
        assert_eq!(colour.chroma.unwrap().map(GrayImage::into_raw), [[0x80, 0x81], [0x82, 0x83]]);
        let huge = "YUV4MPEG2 W4000000000 H4000000000 C444\nFRAME\n";
        for bytes in [
            "",
            huge,
            "YUV4MPEG2 W2 H1 C444\nFRAME\nab",
            "YUV4MPEG2 W2 H1 C420\nFRAME\nababab",
            "YUV4MPEG2 W2 C444\nFRAME\nababab",
            "YUV4MPEG2 W2 H1 C444\nIMAGE\nababab",
            "P5 W2 H1 C444\nFRAME\nababab",
        ] {
            assert_eq!(read(bytes.as_bytes()), None, "{bytes:?}");
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
