//! Reads `recording.mcap` by its message stream: neither summary nor footer is needed, and what cannot be read is passed over and
//! counted.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use mcap::records::{Channel, Record};

use super::pieces::{Content, Pieces};
use super::recording::{
    CAMERA_TOPIC, CHANNELS, COMMAND_TOPIC, IMAGE_ENCODING, SERVO_TOPIC, UNFILTERED_IMAGE_ENCODING,
};
use super::{RecordError, ServoCommand, filter};
use camera::{CameraImage, CameraInfo, images_lost};
use ground::clock::MonotonicNs;
use servo::ServoEvent;

/// One item of a recording.
#[derive(Debug, Clone)]
pub enum Item {
    /// An image as received.
    Image(CameraImage),
    /// An event of the board.
    Servo(ServoEvent),
    /// A command to the board.
    Command(ServoCommand),
    /// A part that cannot be read, see [`Recording::unread`].
    Gap,
}

/// How a recording ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The end was not reached yet.
    NotReached,
    /// Closed properly.
    Closed,
    /// Cut off, by a kill or a power cut; all that was read before is whole.
    CutOff,
}

/// The parts of a recording that could not be read so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Unread {
    /// Number of such places.
    pub places: u64,
    /// Their length in all \[bytes\].
    pub bytes: u64,
    /// Images missing there by the camera's count; those before the first and after the last image read are not known.
    pub images: u64,
    /// Why the first unreadable message of a whole chunk cannot be read.
    why: Option<String>,
}

/// The messages of a recording in the order they were handed over: the item, and when that was.
pub struct Recording {
    path: PathBuf,
    pieces: Pieces,
    /// Messages that were read and not returned yet.
    ahead: VecDeque<Ahead>,
    channels: Vec<Channel>,
    info: Option<CameraInfo>,
    /// When the last message was handed over.
    at: MonotonicNs,
    /// The camera's count of the last image, and whether something since could not be read.
    last: Option<u32>,
    is_interrupted: bool,
    unread: Unread,
    end: End,
}

enum Ahead {
    Message { channel: u16, at: MonotonicNs, data: Vec<u8> },
    Gap { bytes: u64 },
}

impl Recording {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be read or is no recording of this program.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let mut recording = Self {
            path: path.into(),
            pieces: Pieces::open(path).map_err(RecordError::io("opening", path))?,
            ahead: VecDeque::new(),
            channels: Vec::new(),
            info: None,
            at: MonotonicNs(0),
            last: None,
            is_interrupted: false,
            unread: Unread::default(),
            end: End::NotReached,
        };
        // The channels stand before the first message, so that its reader knows them from here on.
        let mut has_message = false;
        while !has_message && recording.read_on()? {
            has_message = recording.ahead.iter().any(|one| matches!(one, Ahead::Message { .. }));
        }
        if !has_message && !Pieces::begins_well(path) {
            let why = "is no recording, or nothing of it can be read: there is no whole chunk in it";
            return Err(RecordError::damaged(path, why));
        }
        recording.info = recording.read_camera_info()?;
        Ok(recording)
    }

    /// The camera's own description; none when no camera took part or the file does not say it any more.
    pub fn camera_info(&self) -> Option<&CameraInfo> {
        self.info.as_ref()
    }

    /// How it ended, once [`Iterator::next`] has given nothing.
    pub fn end(&self) -> End {
        self.end
    }

    /// What could not be read so far.
    pub fn unread(&self) -> &Unread {
        &self.unread
    }

    /// What is missing in a recording that was read to its end, as a sentence; `None` where it is whole. All verbs that read recordings use
    /// this text.
    pub fn shortfall(&self) -> Option<String> {
        let path = self.path.display();
        let Unread { places, bytes, why, .. } = &self.unread;
        let why = why.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
        let place = if *places == 1 { "1 place".into() } else { format!("{places} places") };
        let damaged =
            format!("{path}: {bytes} bytes in {place} cannot be read{why}; all that is whole is used");
        match (self.end, places) {
            (End::CutOff, 0 | 1) => Some(format!(
                "{path}: cut off, by a kill or a power cut; what was written before is whole and is used"
            )),
            (End::CutOff, _) => Some(format!("{damaged}, up to where it is cut off")),
            (_, 0) => None,
            _ => Some(damaged),
        }
    }

    /// Logs the shortfall as a warning, if there is one.
    pub fn warn_of_shortfall(&self) {
        if let Some(shortfall) = self.shortfall() {
            tracing::warn!("{shortfall}");
        }
    }

    fn read_camera_info(&self) -> Result<Option<CameraInfo>, RecordError> {
        let Some(channel) = self.channels.iter().find(|channel| channel.topic == CAMERA_TOPIC) else {
            return Ok(None);
        };
        let encoding = channel.message_encoding.as_str();
        if ![IMAGE_ENCODING, UNFILTERED_IMAGE_ENCODING].contains(&encoding) {
            let why = format!(
                "images are in `{encoding}`, this version reads `{UNFILTERED_IMAGE_ENCODING}` and `{IMAGE_ENCODING}`"
            );
            return Err(RecordError::damaged(&self.path, why));
        }
        let info = channel.metadata.get("info");
        info.map(|json| serde_json::from_str(json).map_err(|error| RecordError::damaged(&self.path, error)))
            .transpose()
    }

    /// Reads the next piece of the file; whether there was one.
    fn read_on(&mut self) -> Result<bool, RecordError> {
        let Some(piece) = self.pieces.next() else {
            if self.end == End::NotReached {
                self.end = End::CutOff;
            }
            return Ok(false);
        };
        let piece = piece.map_err(RecordError::io("reading", &self.path))?;
        match piece.content {
            Content::Records(records) => records.into_iter().for_each(|record| match record {
                Record::Channel(channel) if self.channels.iter().all(|known| known.id != channel.id) => {
                    self.channels.push(channel);
                }
                Record::Message { header, data } => self.ahead.push_back(Ahead::Message {
                    channel: header.channel_id,
                    at: MonotonicNs(header.log_time),
                    data: data.into_owned(),
                }),
                _ => {}
            }),
            Content::Unreadable | Content::SetAside => {
                self.ahead.push_back(Ahead::Gap { bytes: piece.bytes })
            }
            Content::End => self.end = End::Closed,
            Content::Header => {}
        }
        Ok(true)
    }

    /// The topic of a channel; where the chunk with the channels cannot be read, they are assumed to be those of every recording.
    fn topic(&self, id: u16) -> Option<&str> {
        match self.channels.is_empty() {
            true => CHANNELS.iter().find(|(known, _)| *known == id).map(|(_, topic)| *topic),
            false => {
                self.channels.iter().find(|channel| channel.id == id).map(|channel| channel.topic.as_str())
            }
        }
    }

    /// A message as an item; `None` on a topic that is not this program's.
    fn item(&self, channel: u16, data: &[u8]) -> Option<Result<Item, String>> {
        let topic = self.topic(channel)?;
        let item = match topic {
            CAMERA_TOPIC => filter::decode(data).map(Item::Image).map_err(|error| error.to_string()),
            SERVO_TOPIC => serde_json::from_slice(data).map(Item::Servo).map_err(|error| error.to_string()),
            COMMAND_TOPIC => {
                serde_json::from_slice(data).map(Item::Command).map_err(|error| error.to_string())
            }
            _ => return None,
        };
        Some(item.map_err(|error| format!("message on `{topic}`: {error}")))
    }

    /// Counts a part that cannot be read.
    fn gap(&mut self, bytes: u64, why: Option<String>) -> Item {
        self.unread.places += 1;
        self.unread.bytes += bytes;
        self.unread.why = self.unread.why.take().or(why);
        self.is_interrupted = true;
        Item::Gap
    }

    /// Notes an image, and counts the images missing before it where something could not be read.
    fn count(&mut self, image: &CameraImage) {
        let before = self.last.replace(image.sequence);
        if std::mem::take(&mut self.is_interrupted) {
            self.unread.images += u64::from(before.map_or(0, |before| images_lost(before, image.sequence)));
        }
    }
}

impl Iterator for Recording {
    type Item = Result<(MonotonicNs, Item), RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let item = match self.ahead.pop_front() {
                Some(Ahead::Gap { bytes }) => self.gap(bytes, None),
                Some(Ahead::Message { channel, at, data }) => {
                    self.at = at;
                    match self.item(channel, &data) {
                        Some(Ok(item)) => item,
                        Some(Err(why)) => self.gap(data.len() as u64, Some(why)),
                        None => continue,
                    }
                }
                None => match self.read_on() {
                    Ok(true) => continue,
                    Ok(false) => return None,
                    Err(error) => return Some(Err(error)),
                },
            };
            if let Item::Image(image) = &item {
                self.count(image);
            }
            return Some(Ok((self.at, item)));
        }
    }
}
