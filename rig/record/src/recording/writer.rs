//! The writer's side of the queue: one thread, which compresses too.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::{CAMERA_TOPIC, COMMAND_TOPIC, Channel, IMAGE_ENCODING, Message, Queued, Recorded, SERVO_TOPIC};
use crate::sums::Summed;
use crate::{RecordError, filter};
use camera::CameraInfo;

const IMAGE_LAYOUT: &str = "u8 version=1, u8 encoding (0 grey, 1 yuyv, 2 jpeg, 3 png), u8 flags (bit 0 damaged), \
     u8 filter (0 none, 1 rows), u32 sequence, u64 stamp_ns, u64 mid_exposure_ns, u32 width_px, u32 height_px, u32 data_bytes, data; \
     little endian. Filter rows: planes (yuyv: Y, U, V), first row as is, every other row minus \
     (s[x-1] + 2 s[x] + s[x+1] + 4) >> 3 modulo 256, s the sum of the two rows above (in the second row: twice the first), \
     continued by its outermost value at the edges";

/// Longest time from a chunk's first message until the chunk is on the disk, chosen.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);
/// Messages in a chunk \[bytes\], before compression, chosen. The summary keeps a few hundred bytes a chunk in memory: 10 minutes of 1280 by 720 at
/// 120 a second are 8000 chunks.
pub(crate) const CHUNK_BYTES: u64 = 8 << 20;
/// Compression level, chosen: on images with sensor noise, higher levels take three times as long and give more bytes.
const ZSTD_LEVEL: u32 = 1;

/// Begins a recording on `out`: the writer, with the channels written, and the numbers of the channels.
fn begin<W: Write>(
    out: W,
    info: Option<&CameraInfo>,
) -> mcap::McapResult<(mcap::Writer<NoSeek<W>>, [u16; 3])> {
    let mut mcap = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Zstd))
        .compression_level(ZSTD_LEVEL)
        // Compressed on this thread, since the fit uses the other cores.
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        // Chunks reach the file in one piece: a kill leaves no chunk whose length is still to be filled in.
        .disable_seeking(true)
        .calculate_data_section_crc(false)
        .profile("rig")
        .library(concat!("rig ", env!("CARGO_PKG_VERSION")))
        .create(NoSeek::new(out))?;
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
    Ok((mcap, ids))
}

/// The first bytes of a recording of the camera `info`: the magic, the header, a chunk with the channels.
pub(crate) fn beginning(info: Option<&CameraInfo>) -> mcap::McapResult<Vec<u8>> {
    let (mcap, _) = begin(Vec::new(), info)?;
    Ok(mcap.into_inner().into_inner())
}

/// Writes messages into the chunks of one recording, and its index at the end.
pub(super) struct Writer {
    path: PathBuf,
    file: File,
    mcap: Option<mcap::Writer<NoSeek<BufWriter<Summed>>>>,
    reserve_bytes: u64,
    camera: u16,
    servo: u16,
    command: u16,
    scratch: Vec<u8>,
    recorded: Recorded,
}

impl Writer {
    pub(super) fn new(
        file: File,
        path: &Path,
        info: Option<&CameraInfo>,
        reserve_bytes: u64,
    ) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Write { path: path.into(), source };
        let sync_handle = file.try_clone().map_err(RecordError::io("opening", path))?;
        let begun = begin(BufWriter::new(Summed::new(file)), info);
        let (mcap, [camera, servo, command]) = begun.map_err(failed)?;
        Ok(Self {
            path: path.into(),
            file: sync_handle,
            mcap: Some(mcap),
            reserve_bytes,
            camera,
            servo,
            command,
            scratch: Vec::new(),
            recorded: Recorded::default(),
        })
    }

    pub(super) fn run(
        &mut self,
        queue: &Receiver<Queued>,
        waiting: &AtomicUsize,
    ) -> Result<Recorded, RecordError> {
        let mut flush_at = Instant::now() + FLUSH_PERIOD;
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
                flush_at = Instant::now() + FLUSH_PERIOD;
            }
        };
        // After a failure the file is left as it is: a summary on a broken file would only hide where it broke.
        if let Some(broken) = self.mcap.take() {
            let _ = broken.into_inner().into_inner().into_parts();
        }
        result.map(|()| self.recorded)
    }

    fn writer(&mut self) -> Result<&mut mcap::Writer<NoSeek<BufWriter<Summed>>>, RecordError> {
        self.mcap.as_mut().ok_or_else(|| RecordError::Ended { path: self.path.clone() })
    }

    pub(super) fn write(&mut self, queued: &Queued) -> Result<(), RecordError> {
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
                filter::encode(image, &mut bytes);
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

    pub(super) fn flush(&mut self) -> Result<(), RecordError> {
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

    pub(super) fn finish(&mut self) -> Result<(), RecordError> {
        let path = self.path.clone();
        let mut failed = |source| RecordError::Write { path: path.clone(), source };
        let mut writer = self.mcap.take().ok_or_else(|| RecordError::Ended { path: self.path.clone() })?;
        writer.finish().map_err(&mut failed)?;
        let mut written = writer.into_inner().into_inner();
        written.flush().map_err(RecordError::io("writing", &self.path))?;
        self.recorded.sum = Some(written.get_ref().sum());
        self.file.sync_all().map_err(RecordError::io("forcing to the disk", &self.path))?;
        let metadata = self.file.metadata().map_err(RecordError::io("asking the length of", &self.path))?;
        self.recorded.bytes = metadata.len();
        Ok(())
    }
}
