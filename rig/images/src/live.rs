//! Images of a camera that is filming, for an analysis that runs alongside.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use super::recording::{RecordedImages, even};
use camera::source::{ImageSource, Images, SourceError, TimedImage};
use camera::{CameraImage, Rising};
use ground::clock::MonotonicNs;

/// Bytes of images that may wait for the analysis, chosen; beyond that no more are queued, and the recording has them all.
const MAX_WAITING_BYTES: usize = 1 << 30;

#[derive(Debug)]
enum Message {
    Image(Arc<CameraImage>),
    Learn(Range<u64>),
}

/// The sending end of the queue of images. Dropping it ends the sequence.
#[derive(Debug)]
pub struct Feed {
    /// `None` once more images waited than allowed.
    sender: Option<Sender<Message>>,
    waiting: Waiting,
}

/// How many images wait.
#[derive(Debug, Clone, Default)]
pub struct Waiting(Arc<AtomicUsize>);

impl Waiting {
    /// The number of images that wait.
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

impl Feed {
    /// Queues the next image received.
    pub fn image(&mut self, image: &Arc<CameraImage>) {
        if self.waiting.0.fetch_add(1, Ordering::Relaxed).saturating_mul(image.data.len()) > MAX_WAITING_BYTES
        {
            self.sender = None;
        }
        self.send(Message::Image(Arc::clone(image)));
    }

    /// The empty tank is to be learned from these of the images received.
    pub fn learn(&mut self, from: Range<u64>) {
        self.send(Message::Learn(from));
    }

    /// How many images wait.
    pub fn waiting(&self) -> usize {
        self.waiting.count()
    }

    /// Whether all images found room.
    pub fn is_whole(&self) -> bool {
        self.sender.is_some()
    }

    fn send(&mut self, message: Message) {
        // A receiver that has ended has no result, which shows at the end.
        if let Some(sender) = &self.sender {
            let _ = sender.send(message);
        }
    }
}

/// The receiving end: gives the usable images, each later than all before, and decodes each when it is its turn. The sequence ends as the feed
/// does, be there images that still wait.
#[derive(Debug)]
pub struct LiveImages {
    receiver: Receiver<Message>,
    waiting: Waiting,
    origin: MonotonicNs,
    rising: Rising,
    /// Images received.
    received: u64,
    /// Usable images that wait, with their places among all received.
    queued: VecDeque<(u64, Arc<CameraImage>)>,
    learn_from: Option<Range<u64>>,
}

/// A queue of images whose times count from `origin`.
pub fn live(origin: MonotonicNs) -> (Feed, LiveImages) {
    let (sender, receiver) = channel();
    let waiting = Waiting::default();
    let images = LiveImages {
        receiver,
        waiting: waiting.clone(),
        origin,
        rising: Rising::default(),
        received: 0,
        queued: VecDeque::new(),
        learn_from: None,
    };
    (Feed { sender: Some(sender), waiting }, images)
}

impl LiveImages {
    /// How many images wait.
    pub fn waiting(&self) -> Waiting {
        self.waiting.clone()
    }

    /// Waits until it is known which images the empty tank is to be learned from, and gives an even sample of at most `most` of these, as
    /// the recording will; `None` where the sequence ends before. All images are still to come.
    pub fn sample(&mut self, most: usize) -> Option<Vec<TimedImage>> {
        while self.learn_from.is_none() {
            let message = self.receiver.recv().ok()?;
            self.take(message);
        }
        let places: Vec<u64> = self.queued.iter().map(|(place, _)| *place).collect();
        let numbers = even(&places, most, self.learn_from.as_ref());
        Some(numbers.map(|number| TimedImage::of(&self.queued[number].1, self.origin)).collect())
    }

    /// The images that still wait, once the sequence has ended.
    pub fn left(self) -> LeftImages {
        LeftImages { images: self.queued.into_iter().map(|(_, image)| image).collect(), origin: self.origin }
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Image(image) => {
                if self.rising.takes(image.mid_exposure) {
                    self.queued.push_back((self.received, image));
                } else {
                    self.waiting.0.fetch_sub(1, Ordering::Relaxed);
                }
                self.received += 1;
            }
            Message::Learn(from) => self.learn_from = Some(from),
        }
    }
}

/// Usable images that were not analysed yet when the filming ended.
#[derive(Debug)]
pub struct LeftImages {
    images: Vec<Arc<CameraImage>>,
    origin: MonotonicNs,
}

impl LeftImages {
    /// When they were exposed \[s\].
    pub fn times_s(&self) -> impl Iterator<Item = f64> {
        self.images.iter().map(|image| image.mid_exposure.seconds_since(self.origin))
    }

    /// These images as the rest of the film that `recorded` holds in full.
    pub fn of<'a>(&'a self, recorded: &'a RecordedImages) -> RestOfFilm<'a> {
        RestOfFilm { left: self, recorded }
    }
}

/// A film whose first images have been analysed: gives the other images, and a sample of all.
#[derive(Debug)]
pub struct RestOfFilm<'a> {
    left: &'a LeftImages,
    recorded: &'a RecordedImages,
}

impl ImageSource for RestOfFilm<'_> {
    fn images(&self) -> Result<Images<'_>, SourceError> {
        Ok(Box::new(self.left.images.iter().map(|image| Ok(TimedImage::of(image, self.left.origin)))))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.left.images.len())
    }

    fn sample(&self, most: usize) -> Result<Vec<TimedImage>, SourceError> {
        self.recorded.sample(most)
    }
}

impl Iterator for LiveImages {
    type Item = TimedImage;

    fn next(&mut self) -> Option<TimedImage> {
        loop {
            let message = match self.queued.is_empty() {
                true => self.receiver.recv().map_err(TryRecvError::from),
                false => self.receiver.try_recv(),
            };
            match message {
                Ok(message) => self.take(message),
                Err(TryRecvError::Empty) => {
                    let (_, image) = self.queued.pop_front()?;
                    self.waiting.0.fetch_sub(1, Ordering::Relaxed);
                    return Some(TimedImage::of(&image, self.origin));
                }
                Err(TryRecvError::Disconnected) => return None,
            }
        }
    }
}
