//! Video4Linux2 cameras.
//!
//! What the driver answers is compared with what was asked, and refused when it differs: an ioctl that succeeds says
//! nothing about the format it left behind. Times come from the driver's stamps only.
//!
//! The `v4l` crate is used around its traps: its `next` after a timeout gives the driver a buffer the driver already
//! has, so it is only called once `poll` has seen an image; it sends back the old row length unless asked with 0;
//! it panics on values it does not know and when a stream cannot be stopped, so those calls are fenced.

mod setup;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use v4l::Device;
use v4l::buffer::{Flags, Metadata, Type};
use v4l::io::mmap::Stream;
use v4l::io::traits::{CaptureStream, Stream as _};

use super::{Camera, CameraConfig, CameraError, CameraImage, CameraInfo, Encoding, IMAGE_BUFFERS};
use ground::clock::MonotonicNs;

/// More buffers than any driver gives, chosen.
const MAX_BUFFERS: usize = 64;
/// `poll`'s flag for "an image is ready".
const POLLIN: i16 = 1;
/// Longest wait for the first image, chosen: sensors need time to start.
const FIRST_IMAGE_TIMEOUT: Duration = Duration::from_secs(5);
/// A stamp further than this from the present is on another clock \[s\], chosen.
const STAMP_CLOCK_TOLERANCE_S: f64 = 10.0;

/// A camera behind `/dev/video*`.
pub struct V4lCamera {
    config: CameraConfig,
    info: CameraInfo,
    device: Device,
    /// Bytes from one row to the next in the driver's buffers.
    stride: usize,
    stream: Option<Stream<'static>>,
}

impl V4lCamera {
    /// Opens the camera and sets it up as `config` says.
    ///
    /// # Errors
    /// [`CameraError::Refused`] naming what was asked, what was answered and what to do.
    pub fn open(config: &CameraConfig) -> Result<Self, CameraError> {
        let path = config.device.as_ref().ok_or_else(|| config.missing("device"))?;
        let name = path.display().to_string();
        fenced(&name, || {
            let device = Device::with_path(path).map_err(|error| setup::open_error(&name, &error))?;
            let set = setup::configure(&device, config, &name)?;
            let info = CameraInfo {
                name: set.name,
                width_px: config.width_px,
                height_px: config.height_px,
                fps: set.fps,
                encoding: config.format,
                mid_exposure_offset_s: 0.0,
            };
            let config = CameraConfig { exposure_s: set.exposure_s, ..config.clone() };
            Ok(Self { config, info, device, stride: set.stride, stream: None })
        })
    }

    fn refused(&self, what: String) -> CameraError {
        CameraError::Refused { camera: self.info.name.clone(), what }
    }

    fn failed(&self, doing: &str, error: &std::io::Error) -> CameraError {
        let camera = self.info.name.clone();
        match error.raw_os_error().map(rustix::io::Errno::from_raw_os_error) {
            Some(rustix::io::Errno::NODEV | rustix::io::Errno::NXIO) => CameraError::Gone { camera },
            Some(rustix::io::Errno::BUSY) => CameraError::Refused {
                camera,
                what: format!("{doing}: another program uses the camera; end it (`fuser` names it)"),
            },
            _ => CameraError::Refused { camera, what: format!("{doing}: {error}; unplug and replug it") },
        }
    }

    fn begin(&mut self) -> Result<(), CameraError> {
        let mut stream = Stream::with_buffers(&self.device, Type::VideoCapture, IMAGE_BUFFERS)
            .map_err(|error| self.failed("asking for buffers", &error))?;
        // The crate keeps the number of buffers to itself; queueing one too many is refused. Buffer 0 is queued by
        // the first `next`.
        let queued =
            (1..MAX_BUFFERS).take_while(|&index| CaptureStream::queue(&mut stream, index).is_ok()).count();
        if queued == 0 {
            return Err(self.refused("the driver gave fewer than two buffers; free some memory".into()));
        }
        stream.start().map_err(|error| self.failed("starting the stream", &error))?;
        self.stream = Some(stream);

        // At least one image tells what the stamps mean.
        for _ in 0..self.config.discard.max(1) {
            let (_, meta) = self.take(FIRST_IMAGE_TIMEOUT)?;
            let age_s = MonotonicNs::now().seconds_since(stamp(&meta));
            if age_s.abs() > STAMP_CLOCK_TOLERANCE_S {
                return Err(self.refused(format!(
                    "image stamps are {age_s:.0} s off the monotonic clock; set the driver to monotonic stamps (uvcvideo: clock=CLOCK_MONOTONIC)"
                )));
            }
            self.info.mid_exposure_offset_s = mid_exposure_offset_s(meta.flags, &self.config);
        }
        Ok(())
    }

    /// Waits for an image, then takes its bytes and what the driver says about it.
    fn take(&mut self, timeout: Duration) -> Result<(Vec<u8>, Metadata), CameraError> {
        let deadline = Instant::now() + timeout;
        let Some(stream) = &mut self.stream else {
            return Err(self.refused("was asked for images before it was started".into()));
        };
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let left_ms = i32::try_from(left.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
            match stream.handle().poll(POLLIN, left_ms) {
                Ok(0) => {
                    return Err(CameraError::Stalled {
                        camera: self.info.name.clone(),
                        waited_ms: timeout.as_millis() as u64,
                    });
                }
                Ok(_) => break,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.failed("waiting for an image", &error)),
            }
        }
        match CaptureStream::next(stream) {
            Ok((buffer, meta)) => {
                let used = buffer.get(..meta.bytesused as usize).unwrap_or(buffer);
                let row = match self.info.encoding {
                    Encoding::Grey => self.info.width_px as usize,
                    Encoding::Yuyv => 2 * self.info.width_px as usize,
                    Encoding::Jpeg | Encoding::Png => 0,
                };
                Ok((without_padding(used, row, self.stride, self.info.height_px as usize), *meta))
            }
            Err(error) => Err(self.failed("taking an image", &error)),
        }
    }
}

impl Camera for V4lCamera {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        let name = self.info.name.clone();
        let begun = fenced(&name, || self.begin());
        if begun.is_err() {
            self.stop();
        }
        begun
    }

    fn next_image(&mut self, timeout: Duration) -> Result<CameraImage, CameraError> {
        let (data, meta) = self.take(timeout)?;
        let stamp = stamp(&meta);
        let whole = is_whole(&data, &self.info);
        Ok(CameraImage {
            sequence: meta.sequence,
            stamp,
            mid_exposure: stamp.plus_seconds(self.info.mid_exposure_offset_s),
            damaged: meta.flags.contains(Flags::ERROR) || !whole,
            width_px: self.info.width_px,
            height_px: self.info.height_px,
            encoding: self.info.encoding,
            data,
        })
    }

    fn stop(&mut self) {
        let stream = self.stream.take();
        // Dropping panics where the driver no longer answers.
        if catch_unwind(AssertUnwindSafe(|| drop(stream))).is_err() {
            tracing::warn!("camera {}: stream could not be stopped", self.info.name);
        }
    }
}

impl Drop for V4lCamera {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Turns the crate's panics on unexpected answers of a driver into an error.
fn fenced<T>(camera: &str, calls: impl FnOnce() -> Result<T, CameraError>) -> Result<T, CameraError> {
    catch_unwind(AssertUnwindSafe(calls)).unwrap_or_else(|_| {
        Err(CameraError::Refused {
            camera: camera.into(),
            what: "its driver gave an answer that the v4l library cannot read; try another `format`".into(),
        })
    })
}

fn stamp(meta: &Metadata) -> MonotonicNs {
    let seconds = u64::try_from(meta.timestamp.sec).unwrap_or(0);
    let micros = u64::try_from(meta.timestamp.usec).unwrap_or(0);
    MonotonicNs(seconds * 1_000_000_000 + micros * 1_000)
}

/// Seconds from a stamp to mid-exposure: half an exposure on from its start, or readout and half an exposure back from
/// its end; less what the stamp is late by.
fn mid_exposure_offset_s(flags: Flags, config: &CameraConfig) -> f64 {
    let half_exposure_s = config.exposure_s.map_or(0.0, |exposure| exposure.get() / 2.0);
    let from_claimed = if flags.intersects(Flags::TSTAMP_SRC_SOE) {
        half_exposure_s
    } else {
        -config.readout_s.get() - half_exposure_s
    };
    from_claimed - config.latency_s.get()
}

/// Rows of `row` bytes each, out of rows of `stride` bytes; all of it where `row` is 0.
fn without_padding(buffer: &[u8], row: usize, stride: usize, rows: usize) -> Vec<u8> {
    if row == 0 || stride <= row {
        let all = if row == 0 { buffer.len() } else { (row * rows).min(buffer.len()) };
        return buffer[..all].to_vec();
    }
    buffer.chunks(stride).take(rows).flat_map(|padded| &padded[..row.min(padded.len())]).copied().collect()
}

/// Whether all of an image is there, as far as its bytes show without decoding.
fn is_whole(data: &[u8], info: &CameraInfo) -> bool {
    let pixels = info.width_px as usize * info.height_px as usize;
    match info.encoding {
        Encoding::Grey => data.len() == pixels,
        Encoding::Yuyv => data.len() == 2 * pixels,
        Encoding::Jpeg => {
            let end = data.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
            data.starts_with(&[0xff, 0xd8]) && data[..end].ends_with(&[0xff, 0xd9])
        }
        Encoding::Png => data.starts_with(b"\x89PNG"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::strict::{Finite, NonNegative, Positive};

    fn info(encoding: Encoding) -> CameraInfo {
        CameraInfo {
            name: "test".into(),
            width_px: 3,
            height_px: 2,
            fps: 30.0,
            encoding,
            mid_exposure_offset_s: 0.0,
        }
    }

    #[test]
    fn mid_exposure_lies_after_a_start_stamp_and_before_an_end_stamp() {
        let config = CameraConfig {
            exposure_s: Positive::new(0.008),
            readout_s: NonNegative::new(0.010).unwrap(),
            latency_s: Finite::new(0.020).unwrap(),
            ..CameraConfig::default()
        };
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(mid_exposure_offset_s(Flags::TSTAMP_SRC_SOE, &config), 0.004 - 0.020));
        assert!(close(mid_exposure_offset_s(Flags::TIMESTAMP_MONOTONIC, &config), -0.010 - 0.004 - 0.020));
    }

    #[test]
    fn row_padding_is_removed_and_a_short_buffer_shows() {
        let padded = [1, 2, 3, 0, 4, 5, 6, 0];
        assert_eq!(without_padding(&padded, 3, 4, 2), [1, 2, 3, 4, 5, 6]);
        assert_eq!(without_padding(&padded[..7], 3, 4, 2), [1, 2, 3, 4, 5, 6]);
        let short = without_padding(&padded[..6], 3, 4, 2);
        assert!(!is_whole(&short, &info(Encoding::Grey)));
        assert_eq!(without_padding(&[1, 2, 3, 4, 5, 6, 7], 3, 3, 2), [1, 2, 3, 4, 5, 6]);
        assert_eq!(without_padding(&[1, 2, 3], 0, 99, 2), [1, 2, 3]);
    }

    #[test]
    fn jpeg_is_whole_with_both_its_markers_and_padding_after() {
        let info = info(Encoding::Jpeg);
        assert!(is_whole(&[0xff, 0xd8, 7, 0xff, 0xd9, 0, 0], &info));
        assert!(!is_whole(&[0xff, 0xd8, 7, 0xff], &info));
        assert!(!is_whole(&[7, 0xff, 0xd9], &info));
        assert!(!is_whole(&[], &info));
    }

    #[test]
    fn missing_device_is_named_with_what_to_do() {
        let config = CameraConfig { device: Some("/dev/no-such-camera".into()), ..CameraConfig::default() };
        let error = V4lCamera::open(&config).err().unwrap().to_string();
        assert!(error.contains("/dev/no-such-camera") && error.contains("rig list"), "{error}");
    }

    /// Environment variable that names the camera to test with, which gives 640x480 YUYV at 25 images a second.
    const BENCH_CAMERA_VARIABLE: &str = "RIG_V4L_DEVICE";

    #[test]
    #[ignore = "needs a camera: RIG_V4L_DEVICE=/dev/video0"]
    fn camera_on_the_bench_streams_stalls_and_restarts() {
        let config = CameraConfig {
            device: Some(std::env::var_os(BENCH_CAMERA_VARIABLE).unwrap().into()),
            fps: Positive::new(25.0),
            format: Encoding::Yuyv,
            ..CameraConfig::default()
        };
        let mut camera = V4lCamera::open(&config).unwrap();
        for _ in 0..2 {
            camera.start().unwrap();
            let mut last = camera.next_image(FIRST_IMAGE_TIMEOUT).unwrap();
            // Too short for an image: the next one comes all the same.
            for _ in 0..5 {
                let _ = camera.next_image(Duration::from_millis(1));
            }
            for _ in 0..25 {
                let image = camera.next_image(Duration::from_secs(1)).unwrap();
                assert!(image.sequence > last.sequence && image.stamp > last.stamp);
                assert!(!image.damaged);
                last = image;
            }
            camera.stop();
        }
    }
}
