//! Reads `recording.mcap` by its message stream: neither summary nor footer is needed, and a record that was cut off is
//! the end.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::sans_io::LinearReaderOptions;

use super::recording::{
    CAMERA_TOPIC, CHUNK_BYTES, COMMAND_TOPIC, IMAGE_ENCODING, SERVO_TOPIC, UNFILTERED_IMAGE_ENCODING,
};
use super::{RecordError, ServoCommand, filter};
use crate::camera::{CameraImage, CameraInfo, wire};
use crate::clock::MonotonicNs;
use crate::servo::ServoEvent;

/// Longest record believed: a chunk that was nearly full when an image at its limit came, with room for headers.
pub(super) const MAX_RECORD_BYTES: usize = wire::MAX_DATA_BYTES + CHUNK_BYTES as usize + (1 << 20);

/// One recorded thing.
#[derive(Debug, Clone)]
pub enum Item {
    /// An image as received.
    Image(CameraImage),
    /// An event of the board.
    Servo(ServoEvent),
    /// What the board was told.
    Command(ServoCommand),
}

/// How a recording ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Not read so far yet.
    NotReached,
    /// Closed properly.
    Closed,
    /// Cut off, by a kill or a power cut; all that was read before is whole.
    CutOff,
}

/// The messages of a recording in the order they were handed over: the item, and when that was.
pub struct Recording {
    path: PathBuf,
    messages: Option<mcap::io::MessageReader<BufReader<File>>>,
    ahead: Option<mcap::McapResult<mcap::Message<'static>>>,
    info: Option<CameraInfo>,
    end: End,
}

impl Recording {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be read or is no recording of this program.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let file = File::open(path).map_err(RecordError::io("opening", path))?;
        // A chunk's checksum is tested before any of its messages is believed.
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        let messages = mcap::io::MessageReader::new_with_options(BufReader::new(file), options);
        let mut recording = Self {
            path: path.into(),
            messages: Some(messages),
            ahead: None,
            info: None,
            end: End::NotReached,
        };
        // The channels stand before the first message, so that its reader knows them from here on.
        recording.ahead = recording.messages.as_mut().and_then(Iterator::next);
        recording.info = recording.camera_channel()?;
        Ok(recording)
    }

    /// The camera's own description; none when no camera took part or the file ends before it.
    pub fn camera_info(&self) -> Option<&CameraInfo> {
        self.info.as_ref()
    }

    /// How it ended, once [`Iterator::next`] has given nothing.
    pub fn end(&self) -> End {
        self.end
    }

    /// Says so where the recording, read to its end, was cut off. The verbs that read one all say it alike.
    pub fn warn_if_cut_off(&self) {
        if self.end == End::CutOff {
            tracing::warn!(
                "{}: cut off, by a kill or a power cut; what was written before is whole and is used",
                self.path.display()
            );
        }
    }

    fn camera_channel(&self) -> Result<Option<CameraInfo>, RecordError> {
        let Some(messages) = &self.messages else { return Ok(None) };
        let channels = (1..=u8::MAX).map_while(|id| messages.get_channel(id.into()));
        let Some(channel) = channels.into_iter().find(|channel| channel.topic == CAMERA_TOPIC) else {
            return Ok(None);
        };
        let encoding = channel.message_encoding.as_str();
        if ![IMAGE_ENCODING, UNFILTERED_IMAGE_ENCODING].contains(&encoding) {
            let why = format!(
                "images are in `{encoding}`, this version reads `{UNFILTERED_IMAGE_ENCODING}` and `{IMAGE_ENCODING}`"
            );
            return Err(RecordError::damaged(&self.path, why));
        }
        channel
            .metadata
            .get("info")
            .map(|json| serde_json::from_str(json).map_err(|error| RecordError::damaged(&self.path, error)))
            .transpose()
    }

    fn message(&mut self) -> Result<Option<mcap::Message<'static>>, RecordError> {
        let next = self.ahead.take().or_else(|| self.messages.as_mut().and_then(Iterator::next));
        match next {
            Some(Ok(message)) => Ok(Some(message)),
            Some(Err(McapError::UnexpectedEof)) => {
                self.end = End::CutOff;
                Ok(None)
            }
            Some(Err(error)) => {
                self.messages = None;
                self.end = End::CutOff;
                Err(RecordError::damaged(
                    &self.path,
                    format!("not readable from here on ({error}); what came before is whole"),
                ))
            }
            None => {
                if self.end == End::NotReached {
                    self.end = End::Closed;
                }
                Ok(None)
            }
        }
    }

    fn item(&self, message: &mcap::Message<'_>) -> Result<Option<Item>, RecordError> {
        let damaged = |error: &dyn std::fmt::Display| {
            RecordError::damaged(&self.path, format!("message on `{}`: {error}", message.channel.topic))
        };
        Ok(match message.channel.topic.as_str() {
            CAMERA_TOPIC => {
                Some(Item::Image(filter::decode(&message.data).map_err(|error| damaged(&error))?))
            }
            SERVO_TOPIC => {
                Some(Item::Servo(serde_json::from_slice(&message.data).map_err(|error| damaged(&error))?))
            }
            COMMAND_TOPIC => {
                Some(Item::Command(serde_json::from_slice(&message.data).map_err(|error| damaged(&error))?))
            }
            _ => None,
        })
    }
}

impl Iterator for Recording {
    type Item = Result<(MonotonicNs, Item), RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let message = match self.message() {
                Ok(message) => message?,
                Err(error) => return Some(Err(error)),
            };
            match self.item(&message) {
                Ok(Some(item)) => return Some(Ok((MonotonicNs(message.log_time), item))),
                Ok(None) => {}
                Err(error) => return Some(Err(error)),
            }
        }
    }
}
