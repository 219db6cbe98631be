//! A video file, written by ffmpeg.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

use image::{GenericImage as _, RgbImage, imageops};

use super::error::FilmError;
use super::video::{last_lines, read_tail};
use record::files::Part;
use record::outputs::OutputFile;

/// An encoder of ffmpeg, and its options.
type Encoder = (&'static str, &'static [&'static str]);

/// Endings of video files, each with the encoders for it, the preferred one first, and their options.
const FILM_FORMATS: [(&str, &[Encoder]); 3] = [
    ("mp4", &[H264, MPEG4]),
    ("webm", &[VP9, ("libvpx", &["-b:v", "4M", "-deadline", "realtime", "-cpu-used", "8"])]),
    ("mkv", &[H264, MPEG4]),
];
const H264: Encoder = ("libx264", &["-preset", "veryfast", "-crf", "18"]);
const MPEG4: Encoder = ("mpeg4", &["-q:v", "3"]);
const VP9: Encoder =
    ("libvpx-vp9", &["-b:v", "0", "-crf", "24", "-deadline", "realtime", "-cpu-used", "8", "-row-mt", "1"]);

/// Longest gap between two images that is filled with a still picture \[s\], chosen; longer ones are cut to this.
const MAX_STILL_S: f64 = 10.0;

/// Whether a path names a video file that can be written.
pub fn is_film(path: &Path) -> bool {
    kind(path).is_some()
}

fn kind(path: &Path) -> Option<&'static [Encoder]> {
    let ending = path.extension()?;
    FILM_FORMATS.iter().find(|(known, _)| ending.eq_ignore_ascii_case(known)).map(|(_, encoders)| *encoders)
}

/// A film that can be written, as far as is known beforehand. A file that has its name stays until the film is whole.
#[derive(Debug)]
pub struct Film {
    path: PathBuf,
    part: Part,
    encoder: Encoder,
}

impl Film {
    /// One that is to be `out`.
    ///
    /// # Errors
    /// [`FilmError`]: its ending is none of a film, there is no ffmpeg or it cannot encode such a film, or the file cannot be created.
    pub fn plan(out: &OutputFile) -> Result<Self, FilmError> {
        let path = out.path();
        let encoders = kind(path).ok_or_else(|| FilmError::Ending { path: path.into() })?;
        let listed = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-encoders"])
            .stdin(Stdio::null())
            .output()
            .map_err(|_| FilmError::NoFfmpeg { path: path.into() })?;
        let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
        let has = |name: &str| listed.lines().any(|line| line.split_whitespace().nth(1) == Some(name));
        let encoder = encoders.iter().copied().find(|(name, _)| has(name)).ok_or_else(|| {
            let wanted = encoders.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(" nor ");
            FilmError::NoEncoder { path: path.into(), wanted }
        })?;
        Ok(Self { path: path.into(), part: out.begin()?, encoder })
    }

    /// Begins it: images of `width` by `height` pixels, `fps` a second of those times that are given with them, played `slowed` times
    /// slower than that.
    ///
    /// # Errors
    /// [`FilmError::NoFfmpeg`].
    pub fn begin(self, [width, height]: [u32; 2], fps: f64, slowed: f64) -> Result<FilmWriter, FilmError> {
        let (encoder, options) = self.encoder;
        let mut child = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &format!("{:.6}", fps / slowed), "-i", "-"])
            // Most players show only pictures with half as much colour as light, whose sides are even then.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", encoder])
            .args(options)
            .args(["-pix_fmt", "yuv420p", "-an"])
            .arg(self.part.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|_| FilmError::NoFfmpeg { path: self.path.clone() })?;
        let stderr = child.stderr.take().map(|mut pipe| std::thread::spawn(move || read_tail(&mut pipe)));
        let pixels = child.stdin.take();
        Ok(FilmWriter {
            path: self.path,
            part: self.part,
            child: Encoding(child),
            pixels,
            stderr,
            size: [width, height],
            fps,
            start_s: None,
            written: 0,
            last: None,
        })
    }
}

/// A film being written. Dropped before [`Self::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct FilmWriter {
    path: PathBuf,
    child: Encoding,
    part: Part,
    pixels: Option<ChildStdin>,
    stderr: Option<JoinHandle<String>>,
    size: [u32; 2],
    fps: f64,
    start_s: Option<f64>,
    written: u64,
    last: Option<RgbImage>,
}

impl FilmWriter {
    /// The next image, taken at `time_s`; the one before stands still as long as none was taken. One of another size is cut or has black
    /// beside it.
    ///
    /// # Errors
    /// [`FilmError::Failed`] with what ffmpeg says.
    pub fn image(&mut self, image: RgbImage, time_s: f64) -> Result<(), FilmError> {
        let start_s = *self.start_s.get_or_insert(time_s);
        let place = ((time_s - start_s) * self.fps).round().max(0.0) as u64;
        let longest = (MAX_STILL_S * self.fps).ceil() as u64;
        let still = place.saturating_sub(self.written).min(longest);
        if let Some(last) = self.last.take() {
            for _ in 0..still {
                self.write(last.as_raw())?;
            }
        }
        let image = self.sized(image);
        self.write(image.as_raw())?;
        // After a cut gap places are counted from here.
        self.written = place + 1;
        self.last = Some(image);
        Ok(())
    }

    /// Ends the film, which has its name then.
    ///
    /// # Errors
    /// [`FilmError`].
    pub fn finish(mut self) -> Result<(), FilmError> {
        self.pixels = None;
        let ended = self.child.0.wait();
        if !ended.is_ok_and(|status| status.success()) {
            return Err(self.failed());
        }
        Ok(self.part.finish()?)
    }

    fn sized(&self, image: RgbImage) -> RgbImage {
        let [width, height] = self.size;
        if image.dimensions() == (width, height) {
            return image;
        }
        let mut sized = RgbImage::new(width, height);
        let part = imageops::crop_imm(&image, 0, 0, width.min(image.width()), height.min(image.height()));
        // It is no larger than what it is copied to.
        let _ = sized.copy_from(&*part, 0, 0);
        sized
    }

    fn write(&mut self, pixels: &[u8]) -> Result<(), FilmError> {
        let written = self.pixels.as_mut().map(|pipe| pipe.write_all(pixels));
        if written.is_some_and(|written| written.is_ok()) { Ok(()) } else { Err(self.failed()) }
    }

    fn failed(&mut self) -> FilmError {
        self.pixels = None;
        let _ = self.child.0.wait();
        let stderr = self.stderr.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        FilmError::Failed { path: self.path.clone(), message: last_lines(&stderr) }
    }
}

/// A running ffmpeg, which is ended when this is dropped.
#[derive(Debug)]
struct Encoding(Child);

impl Drop for Encoding {
    fn drop(&mut self) {
        // Either call only fails when it has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::TimedImage;
    use record::outputs::Outputs;

    fn planned(path: &Path) -> Result<Film, FilmError> {
        Film::plan(&Outputs::default().file(path).unwrap())
    }

    fn plan(path: &Path) -> Option<Film> {
        match planned(path) {
            Err(FilmError::NoFfmpeg { .. } | FilmError::NoEncoder { .. }) => {
                eprintln!("skipped: writing films (ffmpeg is not there, or cannot encode)");
                None
            }
            plan => Some(plan.unwrap()),
        }
    }

    #[test]
    fn a_written_film_has_each_image_at_its_time_and_stands_still_in_between() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.mp4", "b.webm", "c.MKV"] {
            let path = folder.path().join(name);
            let Some(film) = plan(&path) else { return };
            // Odd sides, every other image lost from the fourth on; one of another size.
            let mut film = film.begin([63, 47], 20.0, 2.0).unwrap();
            for k in [0_u32, 1, 2, 4, 6] {
                let side = if k == 1 { 80 } else { 63 };
                film.image(RgbImage::from_pixel(side, 47, Rgb([40 * k as u8; 3])), 5.0 + f64::from(k) / 20.0)
                    .unwrap();
            }
            assert!(!path.exists());
            film.finish().unwrap();
            let images: Vec<TimedImage> =
                crate::open(&path, None).unwrap().images().unwrap().map(Result::unwrap).collect();
            let grey = |image: &TimedImage| image.grey.as_ref().unwrap().get_pixel(20, 20).0[0];
            let levels: Vec<f64> =
                images.iter().map(|image| (f64::from(grey(image)) / 40.0).round()).collect();
            assert_eq!(levels, [0.0, 1.0, 2.0, 2.0, 4.0, 4.0, 6.0], "{name}");
            assert!((images[6].time_s - images[0].time_s - 0.6).abs() < 2e-3, "{name}: played at half speed");
            assert_eq!(images[0].grey.as_ref().unwrap().dimensions(), (64, 48));
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "no parts are left");
    }

    #[test]
    fn a_film_that_is_not_finished_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, "before").unwrap();
        let Some(film) = plan(&path) else { return };
        let mut film = film.begin([16, 16], 10.0, 1.0).unwrap();
        film.image(RgbImage::new(16, 16), 0.0).unwrap();
        drop(film);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "before");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_cannot_become_a_film_is_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        let error = planned(&folder.path().join("a.gif")).unwrap_err().to_string();
        assert!(error.contains(".mp4, .webm or .mkv"), "{error}");
        assert!(is_film(&folder.path().join("a.mp4")) && !is_film(folder.path()));
    }
}
