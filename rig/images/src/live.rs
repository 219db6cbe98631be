//! Images as a camera gives them, for whoever looks at them while it films.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use super::recording::{RecordedImages, even};
use camera::source::{ImageSource, Images, SourceError, TimedImage};
use camera::{CameraImage, Rising};
use ground::clock::MonotonicNs;

/// Bytes of images that may wait for their turn; with more nothing further is taken, and the recording has them all.
const MOST_WAITING: usize = 1 << 30;

#[derive(Debug)]
enum Message {
    Image(Arc<CameraImage>),
    Learn(Range<u64>),
}

/// Where the images go in. Dropping it ends the sequence.
#[derive(Debug)]
pub struct Feed {
    /// None once more images waited than may.
    sender: Option<Sender<Message>>,
    waiting: Waiting,
}

/// How many images wait.
#[derive(Debug, Clone, Default)]
pub struct Waiting(Arc<AtomicUsize>);

impl Waiting {
    /// So many.
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

impl Feed {
    /// The next image received.
    pub fn image(&mut self, image: &Arc<CameraImage>) {
        if self.waiting.0.fetch_add(1, Ordering::Relaxed).saturating_mul(image.data.len()) > MOST_WAITING {
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
        // Whoever does not listen any more has nothing to give, which shows at the end.
        if let Some(sender) = &self.sender {
            let _ = sender.send(message);
        }
    }
}

/// Where the usable images come out, each later than all before, decoded when it is their turn. The sequence ends as the feed
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
    held: VecDeque<(u64, Arc<CameraImage>)>,
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
        held: VecDeque::new(),
        learn_from: None,
    };
    (Feed { sender: Some(sender), waiting }, images)
}

impl LiveImages {
    /// How many images wait.
    pub fn waiting(&self) -> Waiting {
        self.waiting.clone()
    }

    /// Waits until it is told what the empty tank is to be learned from, and gives an even sample of at most `most` of that, as
    /// the recording will; none where the sequence ends before. All images are still to come.
    pub fn sample(&mut self, most: usize) -> Option<Vec<TimedImage>> {
        while self.learn_from.is_none() {
            let message = self.receiver.recv().ok()?;
            self.take(message);
        }
        let places: Vec<u64> = self.held.iter().map(|(place, _)| *place).collect();
        let numbers = even(&places, most, self.learn_from.as_ref());
        Some(numbers.map(|number| TimedImage::of(&self.held[number].1, self.origin)).collect())
    }

    /// What still waits, once the sequence has ended.
    pub fn left(self) -> LeftImages {
        LeftImages { images: self.held.into_iter().map(|(_, image)| image).collect(), origin: self.origin }
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Image(image) => {
                if self.rising.takes(image.mid_exposure) {
                    self.held.push_back((self.received, image));
                } else {
                    self.waiting.0.fetch_sub(1, Ordering::Relaxed);
                }
                self.received += 1;
            }
            Message::Learn(from) => self.learn_from = Some(from),
        }
    }
}

/// Usable images that nobody had looked at when the filming ended.
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

    /// They as the rest of the film that `recorded` holds whole.
    pub fn of<'a>(&'a self, recorded: &'a RecordedImages) -> RestOfFilm<'a> {
        RestOfFilm { left: self, recorded }
    }
}

/// A film whose first images have been looked at: the others, and a sample of all.
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
            let message = match self.held.is_empty() {
                true => self.receiver.recv().map_err(TryRecvError::from),
                false => self.receiver.try_recv(),
            };
            match message {
                Ok(message) => self.take(message),
                Err(TryRecvError::Empty) => {
                    let (_, image) = self.held.pop_front()?;
                    self.waiting.0.fetch_sub(1, Ordering::Relaxed);
                    return Some(TimedImage::of(&image, self.origin));
                }
                Err(TryRecvError::Disconnected) => return None,
            }
        }
    }
}
