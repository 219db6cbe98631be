//! Receivers of a run's progress as it happens: its journal, the person at the tank, the page, the extraction alongside the filming.

use std::ops::Range;
use std::sync::Arc;

use super::film::ImageCount;
use camera::CameraImage;
use record::ServoCommand;
use record::folder::RunFolder;
use record::recording::Behind;
use servo::ServoEvent;

/// Something that happens in a run.
#[derive(Debug, Clone)]
pub enum Notice {
    /// An image came, and is recorded.
    Image(Arc<CameraImage>),
    /// An event of the board, which is recorded.
    Servo(ServoEvent),
    /// A command to the board, which is recorded.
    Command(ServoCommand),
    /// These of the images received show enough of the motion to learn the empty tank from.
    Learn(Range<u64>),
    /// Enough of the motion has been filmed for a first fit.
    Fit,
    /// The phase changed, or time passed in it: phase and images so far.
    Phase(&'static str, u64),
    /// Images received so far, and how far the disk is behind; sent as often as `Phase`.
    Counted(ImageCount, Behind),
    /// An entry for the journal.
    Journal(String),
    /// The disk does not keep up; images will be lost if this continues.
    FallsBehind(Behind),
    /// The person at the tank should let go now.
    LetGo,
}

/// Receives the notices of a run. It is called between two images: longer work belongs into a thread of its own.
pub trait Listener {
    /// The run's folder is there, and filming begins.
    fn begins(&mut self, _run: &RunFolder) {}

    /// The next notice.
    fn hear(&mut self, notice: &Notice);
}

impl<F: FnMut(&Notice)> Listener for F {
    fn hear(&mut self, notice: &Notice) {
        self(notice);
    }
}

/// Several listeners; each receives every notice, in this order.
pub struct Listeners<'a>(pub Vec<&'a mut dyn Listener>);

impl Listener for Listeners<'_> {
    fn begins(&mut self, run: &RunFolder) {
        self.0.iter_mut().for_each(|listener| listener.begins(run));
    }

    fn hear(&mut self, notice: &Notice) {
        self.0.iter_mut().for_each(|listener| listener.hear(notice));
    }
}
