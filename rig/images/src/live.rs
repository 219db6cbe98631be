//! Images as a camera gives them, for whoever looks at them while it films.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use super::recording::even;
use camera::source::TimedImage;
use camera::{CameraImage, Rising};
use ground::clock::MonotonicNs;

/// Bytes of images that may wait for their turn; with more nothing further is taken, and the recording has them all.
const MOST_WAITING: usize = 1 << 30;

#[derive(Debug)]
enum Told {
    Image(Arc<CameraImage>),
    Learn(Range<u64>),
}

/// Where the images go in. Dropping it ends the sequence.
#[derive(Debug)]
pub struct Feed {
    /// None once more images waited than may.
    told: Option<Sender<Told>>,
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
            self.told = None;
        }
        self.tell(Told::Image(Arc::clone(image)));
    }

    /// The empty tank is to be learned from these of the images received.
    pub fn learn(&mut self, from: Range<u64>) {
        self.tell(Told::Learn(from));
    }

    /// How many images wait.
    pub fn waiting(&self) -> usize {
        self.waiting.count()
    }

    /// Whether all images found room.
    pub fn is_whole(&self) -> bool {
        self.told.is_some()
    }

    fn tell(&mut self, told: Told) {
        // Whoever does not listen any more has nothing to give, which shows at the end.
        if let Some(sender) = &self.told {
            let _ = sender.send(told);
        }
    }
}

/// Where the usable images come out, each later than all before, decoded when it is their turn. The sequence ends as the feed
/// does, be there images that still wait.
#[derive(Debug)]
pub struct LiveImages {
    heard: Receiver<Told>,
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
    let (told, heard) = channel();
    let waiting = Waiting::default();
    let images = LiveImages {
        heard,
        waiting: waiting.clone(),
        origin,
        rising: Rising::default(),
        received: 0,
        held: VecDeque::new(),
        learn_from: None,
    };
    (Feed { told: Some(told), waiting }, images)
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
            let told = self.heard.recv().ok()?;
            self.take(told);
        }
        let places: Vec<u64> = self.held.iter().map(|(place, _)| *place).collect();
        let numbers = even(&places, most, self.learn_from.as_ref());
        Some(numbers.map(|number| TimedImage::of(&self.held[number].1, self.origin)).collect())
    }

    /// What still waits.
    pub fn left(self) -> Vec<Arc<CameraImage>> {
        self.held.into_iter().map(|(_, image)| image).collect()
    }

    fn take(&mut self, told: Told) {
        match told {
            Told::Image(image) => {
                if self.rising.takes(image.mid_exposure) {
                    self.held.push_back((self.received, image));
                } else {
                    self.waiting.0.fetch_sub(1, Ordering::Relaxed);
                }
                self.received += 1;
            }
            Told::Learn(from) => self.learn_from = Some(from),
        }
    }
}

impl Iterator for LiveImages {
    type Item = TimedImage;

    fn next(&mut self) -> Option<TimedImage> {
        loop {
            let told = match self.held.is_empty() {
                true => self.heard.recv().map_err(TryRecvError::from),
                false => self.heard.try_recv(),
            };
            match told {
                Ok(told) => self.take(told),
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
