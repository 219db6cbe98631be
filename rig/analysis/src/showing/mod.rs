//! What a job shows of itself while it goes on: the camera's picture with what is found in it, traces of servo and keypoints, clocks and
//! losses, the fit as it converges. A daemon's page looks at it.
//!
//! The working threads handles over the newest image, or a small message, and never wait: what finds no room in the queue is dropped. A
//! thread of low priority makes [`Snapshot`]s of it, five a second and only while a client is connected to its Unix socket. Each
//! snapshot is complete, so a client that misses one needs only the next.
//!
//! - `state`: what is known of the job, and the snapshots made of it;
//! - `servo`: commanded and measured servo angles, and the board's clock;
//! - `traces`: the last seconds of angles and keypoints;
//! - `picture`, `outline`: a small picture, and what is drawn over it;
//! - `socket`: the thread, and its clients;
//! - [`lines`]: the receiving end of the socket.

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

/// Messages that may wait for the thread; it empties the queue every 200 ms. Chosen.
const MESSAGE_QUEUE_CAPACITY: usize = 4096;
/// The end of a job waits no longer than this for the thread to send the last snapshot. Chosen.
const FINAL_SNAPSHOT_TIMEOUT: Duration = Duration::from_secs(1);

/// Handle by which a job publishes its live view; an empty one publishes nothing.
#[derive(Debug, Clone, Default)]
pub struct Showing(Option<Arc<Handles>>);

#[derive(Debug)]
struct Handles {
    messages: SyncSender<Message>,
    slots: Arc<Slots>,
    thread: Thread,
}

/// Data of which only the newest item is shown.
#[derive(Debug, Default)]
struct Slots {
    filmed: Newest<Arc<CameraImage>>,
    found: Newest<Found>,
    counted: Newest<(ImageCount, Behind)>,
    /// Whether a client is connected.
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
    /// Replaces the item, unless it is just being taken.
    fn put(&self, newer: impl FnOnce() -> T) {
        if let Ok(mut slot) = self.0.try_lock() {
            *slot = Some(newer());
        }
    }

    fn is_empty(&self) -> bool {
        self.0.try_lock().is_ok_and(|slot| slot.is_none())
    }

    fn take(&self) -> Option<T> {
        // an item that is just being written is taken next time
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

/// An image, and what was extracted from it.
#[derive(Debug)]
struct Found {
    image: TimedImage,
    record: ImageRecord,
}

/// The run that is filmed, its camera's rate and its servo.
#[derive(Debug, Clone)]
struct Filming {
    run: String,
    origin: MonotonicNs,
    fps: f64,
    servo: Option<ServoConfig>,
    mirrored: bool,
}

/// A message to the thread that makes snapshots.
#[derive(Debug)]
enum Message {
    Film(Box<Filming>),
    /// What goes on, and how many steps it has where that is known.
    Stage(String, Option<u64>),
    Step(u64),
    Servo(ServoEvent),
    Command(ServoCommand),
    /// Names of the keypoints, and the axes of their plane.
    Keypoints(Vec<String>, View),
    /// Time \[s\] and positions of the keypoints in that plane \[m\].
    KeypointPositions(f64, Vec<[f64; 2]>),
    /// Name and progress of a fit.
    Fit(&'static str, Box<FitProgress>),
    /// The last message; the sender waits for an answer.
    End(SyncSender<()>),
}

/// Progress of a fit.
#[derive(Debug, Clone)]
struct FitProgress {
    phase: &'static str,
    evaluations: u64,
    max_evaluations: u64,
    /// Root mean square of the keypoints' errors \[m\]; of a part of the images where `is_rough`.
    rms_m: f64,
    is_rough: bool,
    values: Vec<Value>,
}

impl Showing {
    /// Publishes on a socket at `path`, as job `job`. If the socket cannot be opened, the log says why, and nothing is published.
    pub fn open(path: &Path, job: i64) -> Self {
        let (messages, receiver) = sync_channel(MESSAGE_QUEUE_CAPACITY);
        let slots = Arc::new(Slots::default());
        match socket::start(path, job, receiver, Arc::clone(&slots)) {
            Ok(thread) => Self(Some(Arc::new(Handles { messages, slots, thread }))),
            Err(error) => {
                tracing::warn!("the live view of this job is not available: {}: {error}", path.display());
                Self::default()
            }
        }
    }

    /// What shows a run of `config` while it is filmed.
    pub fn of_run(self, config: &RigConfig) -> ShowingRun<'_> {
        ShowingRun { showing: self, config, phase: "" }
    }

    fn send(&self, message: impl FnOnce() -> Message) {
        if let Some(handles) = &self.0 {
            let _ = handles.messages.try_send(message());
        }
    }

    /// The filming of `run`, of `config`, begins; its times count from `origin`, and the camera promises `fps` images a second. The
    /// data of an earlier run are dropped.
    fn film(&self, run: &RunId, config: &RigConfig, origin: MonotonicNs, fps: f64) {
        if let Some(handles) = &self.0 {
            // nobody has taken these
            drop((handles.slots.filmed.take(), handles.slots.found.take(), handles.slots.counted.take()));
        }
        self.send(|| {
            Message::Film(Box::new(Filming {
                run: run.to_string(),
                origin,
                fps,
                servo: config.servo.clone(),
                mirrored: config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored),
            }))
        });
    }

    /// Begins a stage called `name`; `steps` is how many steps it has, where that is known.
    pub fn stage(&self, name: &str, steps: Option<u64>) {
        self.send(|| Message::Stage(name.into(), steps));
    }

    /// `done` steps of the stage are done.
    pub fn step(&self, done: u64) {
        self.send(|| Message::Step(done));
    }

    /// The next image received.
    fn image(&self, image: &Arc<CameraImage>) {
        if let Some(handles) = &self.0 {
            handles.slots.filmed.put(|| Arc::clone(image));
        }
    }

    /// Images received so far, and how much data waits for the disk.
    fn counted(&self, images: &ImageCount, behind: Behind) {
        if let Some(handles) = &self.0 {
            handles.slots.counted.put(|| (images.clone(), behind));
        }
    }

    /// The next event of the board.
    fn servo(&self, event: &ServoEvent) {
        self.send(|| Message::Servo(event.clone()));
    }

    /// The next command to the board.
    fn command(&self, command: &ServoCommand) {
        self.send(|| Message::Command(command.clone()));
    }

    /// Names of the keypoints that are extracted, and the plane they are in.
    pub fn keypoints(&self, names: &[String], view: View) {
        self.send(|| Message::Keypoints(names.to_vec(), view));
    }

    /// What was extracted from the next images, one record for each.
    pub fn found(&self, images: &[TimedImage], records: &[ImageRecord]) {
        let Some(handles) = &self.0 else { return };
        for record in records {
            let metres = || record.keypoints.iter().map(|keypoint| keypoint.metres).collect();
            self.send(|| Message::KeypointPositions(record.time_s, metres()));
        }
        // copying a picture takes time: only for a connected client, and after the last one was taken
        let wanted = handles.slots.watched.load(Ordering::Relaxed) && handles.slots.found.is_empty();
        if let (true, Some((image, record))) = (wanted, images.iter().zip(records).next_back()) {
            handles.slots.found.put(|| Found { image: image.clone(), record: record.clone() });
        }
    }

    /// Progress of the fit called `which`.
    pub fn fit(&self, which: &'static str, progress: &Progress<'_>) {
        let named = |(parameter, &value): (&ident::parameters::FreeParameter, &f64)| Value {
            name: parameter.name().into(),
            value,
        };
        let fit_progress = || FitProgress {
            phase: progress.phase,
            evaluations: progress.evaluations,
            max_evaluations: progress.max_evaluations,
            rms_m: progress.loss_m2.sqrt(),
            is_rough: progress.is_rough,
            values: progress.parameters.free.iter().zip(progress.values).map(named).collect(),
        };
        self.send(|| Message::Fit(which, Box::new(fit_progress())));
    }

    /// Ends the live view. Connected clients get the last snapshot, for which it waits a second at most.
    pub fn end(&self) {
        let Some(handles) = self.0.as_ref().filter(|handles| handles.slots.watched.load(Ordering::Relaxed))
        else {
            return;
        };
        let (answer, answered): (_, Receiver<()>) = sync_channel(1);
        if handles.messages.try_send(Message::End(answer)).is_ok() {
            handles.thread.unpark();
            let _ = answered.recv_timeout(FINAL_SNAPSHOT_TIMEOUT);
        }
    }
}

#[cfg(test)]
mod tests;
