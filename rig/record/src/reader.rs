//! Reads `recording.mcap` by its message stream: neither summary nor footer is needed, and what cannot be read is passed over and
//! counted.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use mcap::records::{Channel, Record};

use super::pieces::{Pieces, What};
use super::recording::{
    CAMERA_TOPIC, CHANNELS, COMMAND_TOPIC, IMAGE_ENCODING, SERVO_TOPIC, UNFILTERED_IMAGE_ENCODING,
};
use super::{RecordError, ServoCommand, filter};
use camera::{CameraImage, CameraInfo, images_lost};
use ground::clock::MonotonicNs;
use servo::ServoEvent;

/// One recorded thing.
#[derive(Debug, Clone)]
pub enum Item {
    /// An image as received.
    Image(CameraImage),
    /// An event of the board.
    Servo(ServoEvent),
    /// What the board was told.
    Command(ServoCommand),
    /// Something was here that cannot be read: [`Recording::unread`].
    Gap,
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

/// What of a recording could not be read so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Unread {
    /// In so many places.
    pub places: u64,
    /// Their length \[bytes\].
    pub bytes: u64,
    /// Images that the camera counted there; after the last image and before the first it counted nothing that is known.
    pub images: u64,
    /// Why a message in a chunk that is whole cannot be read, of the first one.
    why: Option<String>,
}

/// The messages of a recording in the order they were handed over: the item, and when that was.
pub struct Recording {
    path: PathBuf,
    pieces: Pieces,
    /// What was read and not given yet.
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
        recording.info = recording.camera_info_told()?;
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

    /// Says, once it was read to its end, what it does not give any more; nothing where it is whole. The verbs that read one all say
    /// it alike.
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

    /// Says so to who looks on.
    pub fn warn_of_shortfall(&self) {
        if let Some(said) = self.shortfall() {
            tracing::warn!("{said}");
        }
    }

    fn camera_info_told(&self) -> Result<Option<CameraInfo>, RecordError> {
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
        match piece.what {
            What::Records(records) => records.into_iter().for_each(|record| match record {
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
            What::Unreadable | What::Aside => self.ahead.push_back(Ahead::Gap { bytes: piece.bytes }),
            What::End => self.end = End::Closed,
            What::Header => {}
        }
        Ok(true)
    }

    /// The topic of a channel; where the chunk that tells the channels cannot be read, they are those of every recording.
    fn topic(&self, id: u16) -> Option<&str> {
        match self.channels.is_empty() {
            true => CHANNELS.iter().find(|(known, _)| *known == id).map(|(_, topic)| *topic),
            false => {
                self.channels.iter().find(|channel| channel.id == id).map(|channel| channel.topic.as_str())
            }
        }
    }

    /// What a message says; none on a topic that is not this program's.
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

    /// Counts what cannot be read.
    fn gap(&mut self, bytes: u64, why: Option<String>) -> Item {
        self.unread.places += 1;
        self.unread.bytes += bytes;
        self.unread.why = self.unread.why.take().or(why);
        self.is_interrupted = true;
        Item::Gap
    }

    /// Counts an image in, and with it those that the camera counted where something could not be read.
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
