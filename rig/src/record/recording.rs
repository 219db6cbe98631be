//! `recording.mcap`: images, servo telemetry and commands, written as they come by a thread of its own.
//!
//! | topic | message encoding | content |
//! |---|---|---|
//! | `camera` | `x-rig-image-1` | [`crate::camera::wire`]: the image as received, with its raw stamp, sequence and flags |
//! | `servo` | `json` | [`ServoEvent`]: telemetry and raw clock pings |
//! | `command` | `json` | [`ServoCommand`] |
//!
//! All times are CLOCK_MONOTONIC in ns: `log_time` is when the message was handed over, `publish_time` the image's raw
//! stamp. The camera channel's metadata hold [`CameraInfo`] as JSON under `info`.
//!
//! Chunks are closed at 1 MiB or after a second, written in one piece and then forced to the disk, so that a kill or a
//! power cut costs at most the last second. The queue in front of the writer is bounded: what does not fit is counted
//! and is a fault.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::{RecordError, ServoCommand};
use crate::camera::{CameraImage, CameraInfo, wire};
use crate::clock::MonotonicNs;
use crate::servo::ServoEvent;

/// Topic of the images.
pub const CAMERA_TOPIC: &str = "camera";
/// Topic of the board's events.
pub const SERVO_TOPIC: &str = "servo";
/// Topic of what the board was told.
pub const COMMAND_TOPIC: &str = "command";
/// Message encoding of the images.
pub const IMAGE_ENCODING: &str = "x-rig-image-1";

const IMAGE_LAYOUT: &str = "u8 version=1, u8 encoding (0 grey, 1 yuyv, 2 jpeg, 3 png), u8 flags (bit 0 damaged), u8 0, \
     u32 sequence, u64 stamp_ns, u64 mid_exposure_ns, u32 width_px, u32 height_px, u32 data_bytes, data; little endian";

/// A closed chunk is on the disk at most this long after its first message.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
const CHUNK_BYTES: u64 = 1 << 20;
/// The queue also holds small messages: this many at most.
const QUEUE_MESSAGES: usize = 4096;
/// What one message costs in the queue beside its data.
const MESSAGE_OVERHEAD_BYTES: usize = 64;

/// How a recording is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecorderOptions {
    /// Bytes that may wait for the disk. The default, 128 MiB, is four seconds of 640 by 480 grey images at 100 a
    /// second.
    pub queue_bytes: usize,
    /// Bytes kept free on the disk for journal, `stop.json` and report.
    pub reserve_bytes: u64,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self { queue_bytes: 128 << 20, reserve_bytes: 64 << 20 }
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
        Self::on(file, path, info, options)
    }

    fn on(
        file: File,
        path: &Path,
        info: Option<&CameraInfo>,
        options: RecorderOptions,
    ) -> Result<Self, RecordError> {
        let mut writer = Writer::new(file, path, info, options.reserve_bytes)?;
        let (queue, messages) = sync_channel(QUEUE_MESSAGES);
        let waiting_bytes = Arc::new(AtomicUsize::new(0));
        let released = Arc::clone(&waiting_bytes);
        let writer = std::thread::Builder::new()
            .name("recording".into())
            .spawn(move || writer.run(&messages, &released))
            .map_err(RecordError::io("starting the writer of", path))?;
        Ok(Self {
            path: path.into(),
            options,
            waiting_bytes,
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

    /// Records what the board was told.
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

    /// Writes what waits, closes the file and forces it to the disk.
    ///
    /// # Errors
    /// What the writer failed with, unless said before.
    pub fn finish(self) -> Result<Recorded, RecordError> {
        let dropped = self.dropped();
        match self.close() {
            Some(result) => result.map(|recorded| Recorded { dropped, ..recorded }),
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
            Ok(()) => Ok(()),
            Err(std::sync::mpsc::TrySendError::Full(_)) => {
                self.waiting_bytes.fetch_sub(bytes, Ordering::AcqRel);
                let dropped = self.dropped.fetch_add(1, Ordering::Relaxed) as u64 + 1;
                let queue_mib = self.options.queue_bytes >> 20;
                Err(RecordError::Overflow { path: self.path.clone(), queue_mib, dropped })
            }
            // The writer lets go of its end only when it failed.
            Err(std::sync::mpsc::TrySendError::Disconnected(_)) => match self.close() {
                Some(Err(error)) => Err(error),
                _ => Err(RecordError::Ended { path: self.path.clone() }),
            },
        }
    }

    fn close(&self) -> Option<Result<Recorded, RecordError>> {
        let link = self.link.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        drop(link.queue);
        Some(link.writer.join().unwrap_or_else(|_| Err(RecordError::Ended { path: self.path.clone() })))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.close() {
            tracing::error!("{error}");
        }
    }
}

/// The writer's side of the queue.
struct Writer {
    path: PathBuf,
    file: File,
    mcap: Option<mcap::Writer<NoSeek<BufWriter<File>>>>,
    reserve_bytes: u64,
    camera: u16,
    servo: u16,
    command: u16,
    scratch: Vec<u8>,
    recorded: Recorded,
}

impl Writer {
    fn new(
        file: File,
        path: &Path,
        info: Option<&CameraInfo>,
        reserve_bytes: u64,
    ) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Write { path: path.into(), source };
        let own = file.try_clone().map_err(RecordError::io("opening", path))?;
        let mut mcap = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            // Chunks reach the file in one piece: a kill leaves no chunk whose length is still to be filled in.
            .disable_seeking(true)
            .calculate_data_section_crc(false)
            .profile("rig")
            .library(concat!("rig ", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(failed)?;
        let mut channels = || -> mcap::McapResult<[u16; 3]> {
            let schema = mcap.add_schema("rig.CameraImage", "x-layout", IMAGE_LAYOUT.as_bytes())?;
            let metadata: BTreeMap<String, String> = info
                .and_then(|info| serde_json::to_string(info).ok())
                .map(|json| ("info".into(), json))
                .into_iter()
                .collect();
            let none = BTreeMap::new();
            let ids = [
                mcap.add_channel(schema, CAMERA_TOPIC, IMAGE_ENCODING, &metadata)?,
                mcap.add_channel(0, SERVO_TOPIC, "json", &none)?,
                mcap.add_channel(0, COMMAND_TOPIC, "json", &none)?,
            ];
            mcap.flush()?;
            Ok(ids)
        };
        let [camera, servo, command] = channels().map_err(failed)?;
        Ok(Self {
            path: path.into(),
            file: own,
            mcap: Some(mcap),
            reserve_bytes,
            camera,
            servo,
            command,
            scratch: Vec::new(),
            recorded: Recorded::default(),
        })
    }

    fn run(&mut self, queue: &Receiver<Queued>, waiting: &AtomicUsize) -> Result<Recorded, RecordError> {
        let mut flush_at = Instant::now() + FLUSH_EVERY;
        let result = loop {
            match queue.recv_timeout(flush_at.saturating_duration_since(Instant::now())) {
                Ok(queued) => {
                    let written = self.write(&queued);
                    waiting.fetch_sub(queued.bytes(), Ordering::AcqRel);
                    if let Err(error) = written {
                        break Err(error);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break self.finish(),
            }
            if Instant::now() >= flush_at {
                if let Err(error) = self.flush() {
                    break Err(error);
                }
                flush_at = Instant::now() + FLUSH_EVERY;
            }
        };
        // After a failure the file is left as it is: a summary on a broken file would only hide where it broke.
        if let Some(broken) = self.mcap.take() {
            let _ = broken.into_inner().into_inner().into_parts();
        }
        result.map(|()| self.recorded)
    }

    fn writer(&mut self) -> Result<&mut mcap::Writer<NoSeek<BufWriter<File>>>, RecordError> {
        self.mcap.as_mut().ok_or_else(|| RecordError::Ended { path: self.path.clone() })
    }

    fn write(&mut self, queued: &Queued) -> Result<(), RecordError> {
        let log_time = queued.log_time.0;
        let header = |channel_id, sequence, publish_time| MessageHeader {
            channel_id,
            sequence,
            log_time,
            publish_time,
        };
        let path = self.path.clone();
        let failed = |source| RecordError::Write { path, source };
        match &queued.message {
            Message::Image(image) => {
                let mut bytes = std::mem::take(&mut self.scratch);
                bytes.clear();
                bytes.extend_from_slice(&wire::header(image));
                bytes.extend_from_slice(&image.data);
                let header = header(self.camera, image.sequence, image.stamp.0);
                let written = self.writer()?.write_to_known_channel(&header, &bytes);
                self.scratch = bytes;
                written.map_err(failed)?;
                self.recorded.images += 1;
            }
            Message::Json(channel, text) => {
                let id = match channel {
                    Channel::Servo => self.servo,
                    Channel::Command => self.command,
                };
                self.writer()?.write_to_known_channel(&header(id, 0, log_time), text).map_err(failed)?;
            }
        }
        self.recorded.messages += 1;
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        let path = self.path.clone();
        self.writer()?.flush().map_err(|source| RecordError::Write { path, source })?;
        self.file.sync_data().map_err(RecordError::io("forcing to the disk", &self.path))?;
        let disk = rustix::fs::fstatvfs(&self.file)
            .map_err(|error| RecordError::io("asking the free space for", &self.path)(error.into()))?;
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        if free < self.reserve_bytes {
            return Err(RecordError::DiskFull {
                path: self.path.clone(),
                free_mib: free >> 20,
                reserve_mib: self.reserve_bytes >> 20,
            });
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), RecordError> {
        let path = self.path.clone();
        let mut failed = |source| RecordError::Write { path: path.clone(), source };
        let mut writer = self.mcap.take().ok_or_else(|| RecordError::Ended { path: self.path.clone() })?;
        writer.finish().map_err(&mut failed)?;
        writer.into_inner().into_inner().flush().map_err(RecordError::io("writing", &self.path))?;
        self.file.sync_all().map_err(RecordError::io("forcing to the disk", &self.path))
    }
}

#[cfg(test)]
mod tests;
