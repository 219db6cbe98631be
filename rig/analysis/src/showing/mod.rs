//! What a job shows of itself while it goes on: the camera's picture with what is found in it, traces of servo and keypoints, clocks and
//! losses, the fit as it converges. A daemon's page looks at it.
//!
//! Whoever works hands over the newest image, or a small record, and never waits: what finds no room is dropped, and looks the poorer
//! for it. A quiet thread makes [`Snapshot`]s of it, five a second and only while somebody is connected to its Unix socket; each is
//! whole, so that who misses one has missed nothing but time.
//!
//! - `state`: what is known, and how it is told;
//! - `servo`: what it was told, what it does, and its board's clock;
//! - `traces`: the last seconds of angles and keypoints;
//! - `picture`, `outline`: a small picture, and what lies over it;
//! - `socket`: the thread, and who listens to it;
//! - [`lines`]: the other end of the socket.

pub mod lines;
mod outline;
mod picture;
mod servo;
mod socket;
mod state;
mod traces;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::Thread;
use std::time::Duration;

use ident::fit::Progress;

use ::servo::profile::ProfileConfig;
use ::servo::{ServoConfig, ServoEvent};
use camera::CameraImage;
use camera::calibration::View;
use config::RigConfig;
use ground::clock::MonotonicNs;
use images::TimedImage;
pub use picture::{Overlay, Picture, Spot};
use record::ServoCommand;
use record::folder::RunFolder;
use record::recording::Behind;
use record::run_id::RunId;
use run::film::ImageCount;
use run::listener::{Listener, Notice};
pub use servo::Clock;
pub use state::{Figures, FitCurve, Snapshot, Value};
pub use traces::{Line, Traces};
use vision::ImageRecord;

/// Small records that may wait for the thread: of a fifth of a second.
const MOST_TOLD: usize = 4096;
/// The last words of a job wait no longer for the thread and for who listens.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Where a job hands over what is to be seen of it; nobody's, where it is none.
#[derive(Debug, Clone, Default)]
pub struct Showing(Option<Arc<Hand>>);

#[derive(Debug)]
struct Hand {
    told: SyncSender<Told>,
    slots: Arc<Slots>,
    thread: Thread,
}

/// What of several only the newest is looked at.
#[derive(Debug, Default)]
struct Slots {
    filmed: Newest<Arc<CameraImage>>,
    found: Newest<Found>,
    counted: Newest<(ImageCount, Behind)>,
    /// Somebody is connected.
    watched: AtomicBool,
}

#[derive(Debug)]
struct Newest<T>(Mutex<Option<T>>);

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> Newest<T> {
    /// In place of what was there, unless that is just being taken.
    fn put(&self, newer: impl FnOnce() -> T) {
        if let Ok(mut slot) = self.0.try_lock() {
            *slot = Some(newer());
        }
    }

    fn is_empty(&self) -> bool {
        self.0.try_lock().is_ok_and(|slot| slot.is_none())
    }

    fn take(&self) -> Option<T> {
        // one that is being filled is there at the next look
        self.0.try_lock().ok()?.take()
    }
}

/// Shows a run while it is filmed.
#[derive(Debug)]
pub struct ShowingRun<'a> {
    showing: Showing,
    config: &'a RigConfig,
    phase: &'static str,
}

impl Listener for ShowingRun<'_> {
    fn begins(&mut self, run: &RunFolder) {
        let fps = run.start().camera.as_ref().map_or(0.0, |camera| camera.fps);
        self.showing.film(&run.start().id, self.config, run.origin(), fps);
    }

    fn hear(&mut self, notice: &Notice) {
        match notice {
            Notice::Image(image) => self.showing.image(image),
            Notice::Servo(event) => self.showing.servo(event),
            Notice::Command(command) => self.showing.command(command),
            Notice::Counted(images, behind) => self.showing.counted(images, *behind),
            Notice::Phase(phase, _) if *phase != self.phase => {
                self.showing.stage(phase, None);
                self.phase = phase;
            }
            _ => {}
        }
    }
}

/// An image that was looked at, and what was found in it.
#[derive(Debug)]
struct Found {
    image: TimedImage,
    record: ImageRecord,
}

/// What is filmed, and with what.
#[derive(Debug, Clone)]
struct Filming {
    run: String,
    origin: MonotonicNs,
    fps: f64,
    servo: Option<ServoConfig>,
    mirrored: bool,
}

#[derive(Debug)]
enum Told {
    Film(Box<Filming>),
    /// What goes on, and how many steps it has where that is known.
    Stage(String, Option<u64>),
    Step(u64),
    Servo(ServoEvent),
    Command(ServoCommand),
    /// How keypoints and the axes of their plane are called.
    Keypoints(Vec<String>, View),
    /// Where they were at this time \[s\], in that plane \[m\].
    Placed(f64, Vec<[f64; 2]>),
    /// Where a fit stands, and which one it is.
    Fit(&'static str, Box<Standing>),
    /// Nothing follows; an answer is waited for.
    End(SyncSender<()>),
}

/// Where a fit stands.
#[derive(Debug, Clone)]
struct Standing {
    phase: &'static str,
    evaluations: u64,
    max_evaluations: u64,
    /// Root mean square of the keypoints' errors \[m\]; of a part of the images where `is_rough`.
    rms_m: f64,
    is_rough: bool,
    values: Vec<Value>,
}

impl Showing {
    /// On a socket at `path`, as job `job`. Where that cannot be, the log says why, and nothing is shown.
    pub fn open(path: &Path, job: i64) -> Self {
        let (told, heard) = sync_channel(MOST_TOLD);
        let slots = Arc::new(Slots::default());
        match socket::start(path, job, heard, Arc::clone(&slots)) {
            Ok(thread) => Self(Some(Arc::new(Hand { told, slots, thread }))),
            Err(error) => {
                tracing::warn!("nothing of this job is shown while it goes on: {}: {error}", path.display());
                Self::default()
            }
        }
    }

    /// What shows a run of `config` while it is filmed.
    pub fn of_run(self, config: &RigConfig) -> ShowingRun<'_> {
        ShowingRun { showing: self, config, phase: "" }
    }

    fn tell(&self, told: impl FnOnce() -> Told) {
        if let Some(hand) = &self.0 {
            let _ = hand.told.try_send(told());
        }
    }

    /// `run`, of `config`, begins to be filmed; its times count from `origin`, and the camera promises `fps` images a second. What was
    /// known of a run before it is forgotten.
    fn film(&self, run: &RunId, config: &RigConfig, origin: MonotonicNs, fps: f64) {
        if let Some(hand) = &self.0 {
            // what nobody has looked at
            drop((hand.slots.filmed.take(), hand.slots.found.take(), hand.slots.counted.take()));
        }
        self.tell(|| {
            Told::Film(Box::new(Filming {
                run: run.to_string(),
                origin,
                fps,
                servo: config.servo.clone(),
                mirrored: config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored),
            }))
        });
    }

    /// What goes on now, and how many steps it has where that is known.
    pub fn stage(&self, name: &str, steps: Option<u64>) {
        self.tell(|| Told::Stage(name.into(), steps));
    }

    /// So many steps are done.
    pub fn step(&self, done: u64) {
        self.tell(|| Told::Step(done));
    }

    /// The next image received.
    fn image(&self, image: &Arc<CameraImage>) {
        if let Some(hand) = &self.0 {
            hand.slots.filmed.put(|| Arc::clone(image));
        }
    }

    /// What was received so far, and what of it waits for the disk.
    fn counted(&self, images: &ImageCount, behind: Behind) {
        if let Some(hand) = &self.0 {
            hand.slots.counted.put(|| (images.clone(), behind));
        }
    }

    /// The next event of the board.
    fn servo(&self, event: &ServoEvent) {
        self.tell(|| Told::Servo(event.clone()));
    }

    /// What the board was told next.
    fn command(&self, command: &ServoCommand) {
        self.tell(|| Told::Command(command.clone()));
    }

    /// Keypoints are looked for: what they are called, and in which plane they are.
    pub fn keypoints(&self, names: &[String], view: View) {
        self.tell(|| Told::Keypoints(names.to_vec(), view));
    }

    /// What was found in the next images, one record for each.
    pub fn found(&self, images: &[TimedImage], records: &[ImageRecord]) {
        let Some(hand) = &self.0 else { return };
        for record in records {
            let metres = || record.keypoints.iter().map(|keypoint| keypoint.metres).collect();
            self.tell(|| Told::Placed(record.time_s, metres()));
        }
        // a copy of a picture costs something: only where somebody looks, and has taken the last one
        let wanted = hand.slots.watched.load(Ordering::Relaxed) && hand.slots.found.is_empty();
        if let (true, Some((image, record))) = (wanted, images.iter().zip(records).next_back()) {
            hand.slots.found.put(|| Found { image: image.clone(), record: record.clone() });
        }
    }

    /// Where the fit called `which` stands.
    pub fn fit(&self, which: &'static str, progress: &Progress<'_>) {
        let named = |(parameter, &value): (&ident::parameters::FreeParameter, &f64)| Value {
            name: parameter.name().into(),
            value,
        };
        let standing = || Standing {
            phase: progress.phase,
            evaluations: progress.evaluations,
            max_evaluations: progress.max_evaluations,
            rms_m: progress.loss_m2.sqrt(),
            is_rough: progress.is_rough,
            values: progress.parameters.free.iter().zip(progress.values).map(named).collect(),
        };
        self.tell(|| Told::Fit(which, Box::new(standing())));
    }

    /// Nothing follows. Whoever looks gets the last of it, if that takes no time worth speaking of.
    pub fn end(&self) {
        let Some(hand) = self.0.as_ref().filter(|hand| hand.slots.watched.load(Ordering::Relaxed)) else {
            return;
        };
        let (answer, answered): (_, Receiver<()>) = sync_channel(1);
        if hand.told.try_send(Told::End(answer)).is_ok() {
            hand.thread.unpark();
            let _ = answered.recv_timeout(LAST_WORDS);
        }
    }
}

#[cfg(test)]
mod tests;
