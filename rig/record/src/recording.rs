//! `recording.mcap`: images, servo telemetry and commands, written as they come by a thread of its own.
//!
//! | topic | message encoding | content |
//! |---|---|---|
//! | `camera` | `x-rig-image-2` | [`super::filter`]: the image with its raw stamp, sequence and flags; jpeg and png as received |
//! | `servo` | `json` | [`ServoEvent`]: telemetry and raw clock pings |
//! | `command` | `json` | [`ServoCommand`] |
//!
//! All times are CLOCK_MONOTONIC in ns: `log_time` is when the message was handed over, `publish_time` the image's raw
//! stamp. The camera channel's metadata hold [`CameraInfo`] as JSON under `info`.
//!
//! Chunks are compressed with zstd, closed at 8 MiB of messages or after a second, written in one piece and then forced to the
//! disk, so that a kill or a power cut costs at most the last second. What zstd makes of images, and how fast: `docs/recording.md`.
//! The queue in front of the writer is bounded: what does not fit is counted and is a fault.

mod writer;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::files::{containing, sync_folder};
use super::sums::Sum;
use super::{RecordError, ServoCommand};
use camera::{CameraImage, CameraInfo};
use ground::clock::MonotonicNs;
use ground::urgency::Urgency;
use servo::ServoEvent;
use writer::Writer;
pub(crate) use writer::{CHUNK_BYTES, beginning};

/// Topic of the images.
pub const CAMERA_TOPIC: &str = "camera";
/// Topic of the board's events.
pub const SERVO_TOPIC: &str = "servo";
/// Topic of the commands to the board.
pub const COMMAND_TOPIC: &str = "command";
/// The channels of every recording, in the order in which they are made.
pub(crate) const CHANNELS: [(u16, &str); 3] = [(1, CAMERA_TOPIC), (2, SERVO_TOPIC), (3, COMMAND_TOPIC)];
/// Message encoding of the images.
pub const IMAGE_ENCODING: &str = "x-rig-image-2";
/// The same without filters, in recordings before 2026-11-25.
pub const UNFILTERED_IMAGE_ENCODING: &str = "x-rig-image-1";

/// Most messages in the queue, chosen; its size in bytes is limited too.
const MAX_QUEUED_MESSAGES: usize = 4096;
/// Assumed memory of a queued message in addition to its data \[bytes\], chosen.
const MESSAGE_OVERHEAD_BYTES: usize = 64;

/// How a recording is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecorderOptions {
    /// Bytes that may wait for zstd and the disk. Default 128 MiB.
    pub queue_bytes: usize,
    /// Bytes kept free on the disk for journal, `stop.json` and report.
    pub reserve_bytes: u64,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self { queue_bytes: 128 << 20, reserve_bytes: 64 << 20 }
    }
}

/// How long the disk may pause before images are lost \[s\], where memory allows; chosen.
const DISK_PAUSE_S: f64 = 4.0;
/// Most memory for images that wait for the disk \[bytes\], chosen: two seconds of the largest and fastest images.
const MAX_QUEUE_BYTES: usize = 512 << 20;

impl RecorderOptions {
    /// For the images of this camera: room for four seconds of them, between 128 and 512 MiB.
    pub fn of(info: &CameraInfo) -> Self {
        let least = Self::default();
        let wanted = (DISK_PAUSE_S * info.bytes_per_s()) as usize;
        Self { queue_bytes: wanted.clamp(least.queue_bytes, MAX_QUEUE_BYTES), ..least }
    }
}

/// What a finished recording holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Recorded {
    /// Images written.
    pub images: u64,
    /// Messages written, images included.
    pub messages: u64,
    /// Messages that did not fit into the queue.
    pub dropped: u64,
    /// Length of the file \[bytes\].
    pub bytes: u64,
    /// The most that waited for zstd and the disk \[bytes\].
    pub most_waiting_bytes: u64,
    /// Checksum of all that was written, where the file was closed.
    pub sum: Option<Sum>,
}

/// How far the disk is behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Behind {
    /// Data that wait for the disk \[MiB\].
    pub waiting_mib: usize,
    /// Data that may wait before images are lost \[MiB\].
    pub queue_mib: usize,
}

impl std::fmt::Display for Behind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { waiting_mib, queue_mib } = self;
        write!(
            f,
            "the recording falls behind: {waiting_mib} of {queue_mib} MiB wait for the disk, and the run ends when all are full; \
             `rig doctor` measures the disk"
        )
    }
}

enum Message {
    Image(Arc<CameraImage>),
    Json(Channel, Vec<u8>),
}

#[derive(Clone, Copy)]
enum Channel {
    Servo,
    Command,
}

struct Queued {
    log_time: MonotonicNs,
    message: Message,
}

impl Queued {
    fn bytes(&self) -> usize {
        MESSAGE_OVERHEAD_BYTES
            + match &self.message {
                Message::Image(image) => image.data.len(),
                Message::Json(_, text) => text.len(),
            }
    }
}

/// Takes messages from any thread and never waits for the disk.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    options: RecorderOptions,
    waiting_bytes: Arc<AtomicUsize>,
    most_waiting_bytes: AtomicUsize,
    behind_reported: AtomicBool,
    dropped: AtomicUsize,
    link: Mutex<Option<Link>>,
}

#[derive(Debug)]
struct Link {
    queue: SyncSender<Queued>,
    writer: JoinHandle<Result<Recorded, RecordError>>,
}

impl Recorder {
    /// Creates the recording at `path`, which must not exist, of the camera `info` (if one takes part).
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be created or written.
    pub fn create(
        path: &Path,
        info: Option<&CameraInfo>,
        options: RecorderOptions,
    ) -> Result<Self, RecordError> {
        let file = File::create_new(path).map_err(RecordError::io("creating", path))?;
        sync_folder(containing(path))?;
        Self::on(file, path, info, options)
    }

    fn on(
        file: File,
        path: &Path,
        info: Option<&CameraInfo>,
        options: RecorderOptions,
    ) -> Result<Self, RecordError> {
        let mut writer = Writer::new(file, path, info, options.reserve_bytes)?;
        let (queue, messages) = sync_channel(MAX_QUEUED_MESSAGES);
        let waiting_bytes = Arc::new(AtomicUsize::new(0));
        let released = Arc::clone(&waiting_bytes);
        let writer = std::thread::Builder::new()
            .name("recording".into())
            .spawn(move || {
                Urgency::Pictures.take();
                writer.run(&messages, &released)
            })
            .map_err(RecordError::io("starting the writer of", path))?;
        Ok(Self {
            path: path.into(),
            options,
            waiting_bytes,
            most_waiting_bytes: AtomicUsize::new(0),
            behind_reported: AtomicBool::new(false),
            dropped: AtomicUsize::new(0),
            link: Mutex::new(Some(Link { queue, writer })),
        })
    }

    /// Records an image as received.
    ///
    /// # Errors
    /// [`RecordError::Overflow`] when the queue is full, or what the writer failed with: once, then
    /// [`RecordError::Ended`].
    pub fn image(&self, image: Arc<CameraImage>) -> Result<(), RecordError> {
        self.send(Message::Image(image))
    }

    /// Records an event of the servo board.
    ///
    /// # Errors
    /// As [`Recorder::image`].
    pub fn servo(&self, event: &ServoEvent) -> Result<(), RecordError> {
        self.send(Message::Json(Channel::Servo, self.json(event)?))
    }

    /// Records a command to the board.
    ///
    /// # Errors
    /// As [`Recorder::image`].
    pub fn command(&self, command: &ServoCommand) -> Result<(), RecordError> {
        self.send(Message::Json(Channel::Command, self.json(command)?))
    }

    /// Messages lost so far because the queue was full.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed) as u64
    }

    /// How far the disk is behind now.
    pub fn behind(&self) -> Behind {
        let waiting = self.waiting_bytes.load(Ordering::Relaxed);
        Behind { waiting_mib: waiting >> 20, queue_mib: self.options.queue_bytes >> 20 }
    }

    /// Returns once how far the disk is behind when half of the queue is full, and again only after three quarters were free in between.
    pub fn falls_behind(&self) -> Option<Behind> {
        let (waiting, most) = (self.waiting_bytes.load(Ordering::Relaxed), self.options.queue_bytes);
        if waiting < most / 4 {
            self.behind_reported.store(false, Ordering::Relaxed);
        }
        let behind = waiting > most / 2 && !self.behind_reported.swap(true, Ordering::Relaxed);
        behind.then(|| self.behind())
    }

    /// Writes what waits, closes the file and forces it to the disk.
    ///
    /// # Errors
    /// What the writer failed with, unless returned before.
    pub fn finish(self) -> Result<Recorded, RecordError> {
        let dropped = self.dropped();
        let most_waiting_bytes = self.most_waiting_bytes.load(Ordering::Relaxed) as u64;
        match self.close() {
            Some(result) => result.map(|recorded| Recorded { dropped, most_waiting_bytes, ..recorded }),
            None => Err(RecordError::Ended { path: self.path.clone() }),
        }
    }

    fn json(&self, value: &impl serde::Serialize) -> Result<Vec<u8>, RecordError> {
        serde_json::to_vec(value).map_err(|error| RecordError::damaged(&self.path, error))
    }

    fn send(&self, message: Message) -> Result<(), RecordError> {
        let queued = Queued { log_time: MonotonicNs::now(), message };
        let bytes = queued.bytes();
        let before = self.waiting_bytes.fetch_add(bytes, Ordering::AcqRel);
        let sent = {
            let link = self.link.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(link) = link.as_ref() else {
                return Err(RecordError::Ended { path: self.path.clone() });
            };
            if before != 0 && before + bytes > self.options.queue_bytes {
                Err(std::sync::mpsc::TrySendError::Full(queued))
            } else {
                link.queue.try_send(queued)
            }
        };
        match sent {
            Ok(()) => {
                self.most_waiting_bytes.fetch_max(before + bytes, Ordering::Relaxed);
                Ok(())
            }
            Err(std::sync::mpsc::TrySendError::Full(_)) => {
                self.waiting_bytes.fetch_sub(bytes, Ordering::AcqRel);
                let dropped = self.dropped.fetch_add(1, Ordering::Relaxed) as u64 + 1;
                let queue_mib = self.options.queue_bytes >> 20;
                Err(RecordError::Overflow { path: self.path.clone(), queue_mib, dropped })
            }
            // The writer closes its end of the queue only when it has failed.
            Err(std::sync::mpsc::TrySendError::Disconnected(_)) => match self.close() {
                Some(Err(error)) => Err(error),
                _ => Err(RecordError::Ended { path: self.path.clone() }),
            },
        }
    }

    /// A recorder whose thread panics at the first message, for tests.
    #[doc(hidden)]
    pub fn panicking(path: &Path) -> Self {
        let (queue, messages) = sync_channel(MAX_QUEUED_MESSAGES);
        let writer = std::thread::spawn(move || match messages.recv() {
            Ok(Queued { .. }) => panic!("a test"),
            Err(_) => Ok(Recorded::default()),
        });
        Self {
            path: path.into(),
            options: RecorderOptions::default(),
            waiting_bytes: Arc::default(),
            most_waiting_bytes: AtomicUsize::new(0),
            behind_reported: AtomicBool::new(false),
            dropped: AtomicUsize::new(0),
            link: Mutex::new(Some(Link { queue, writer })),
        }
    }

    fn close(&self) -> Option<Result<Recorded, RecordError>> {
        let link = self.link.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        drop(link.queue);
        Some(link.writer.join().unwrap_or_else(|_| Err(RecordError::Panicked { path: self.path.clone() })))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.close() {
            tracing::error!("{error}");
        }
    }
}

#[cfg(test)]
mod tests;
