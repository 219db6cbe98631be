//! Films one experiment: passes the devices' events to the state machine, and carries out its actions.

use std::future::Future;
use std::ops::Range;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use super::devices::{CameraThread, CameraUpdate, ServoThread, Signal};
use super::listener::{Listener, Notice};
use super::machine::{Action, Ending, Event, Machine, Plan};
use camera::{Camera, CameraError, CameraImage, Rising, images_lost};
use ground::clock::MonotonicNs;
use ground::error_chain::with_causes;
use record::recording::{Recorded, Recorder};
use record::{RecordError, ServoCommand};
use servo::PulseProfile;
use servo::{ServoBoard, ServoError, ServoEvent, StopOutcome};

/// Images and measures of their stillness that may wait for the coordinator, chosen: several seconds of them.
const QUEUE_IMAGES: usize = 1024;
/// Longest time between two events to the state machine, chosen.
const TICK_PERIOD: Duration = Duration::from_millis(10);

/// What a run is filmed with.
pub struct Setup {
    /// What to wait for and how long.
    pub plan: Plan,
    /// The camera, not started yet.
    pub camera: Box<dyn Camera>,
    /// Longest time without an image before it is a fault.
    pub stall: Duration,
    /// The board and what it is to play; a drop has none.
    pub drive: Option<(Box<dyn ServoBoard>, PulseProfile)>,
    /// The recording that everything goes into.
    pub recorder: Recorder,
}

/// The empty tank is learned from the first part of the motion, chosen: by then the water on both sides of the mechanism was visible,
/// and the rest of the motion is time to analyse the images.
const LEARN_MOTION_SHARE: f64 = 1.0 / 3.0;
/// The shortest such part \[s\], chosen.
const MIN_LEARN_MOTION_S: f64 = 2.0;
/// Share of the motion after which a first fit begins, chosen: the rest of the motion is time for it.
const FIRST_FIT_MOTION_SHARE: f64 = 0.75;

/// The result of filming.
#[derive(Debug, Clone, PartialEq)]
pub struct Filmed {
    /// How it ended.
    pub ending: Ending,
    /// How the safe stop went.
    pub servo: StopOutcome,
    /// Time from the decision to stop to the board's answer \[s\].
    pub stop_s: f64,
    /// What went into the recording.
    pub recorded: Recorded,
    /// What was wrong with its images.
    pub images: ImageCount,
    /// Which of the images received the empty tank was learned from, once enough motion was seen.
    pub learn_from: Option<Range<u64>>,
}

/// Films until the machine stops, `interrupt` resolves, or a device fails. Whatever happens, the servo is stopped
/// before anything else is closed.
pub async fn film(setup: Setup, interrupt: impl Future<Output = ()>, listener: &mut impl Listener) -> Filmed {
    let (signals, mut signal_receiver) = mpsc::unbounded_channel();
    let (updates, mut update_receiver) = mpsc::channel(QUEUE_IMAGES);
    let profile = setup.drive.as_ref().map(|(_, profile)| profile.clone());
    let mut servo = setup.drive.map(|(board, _)| ServoThread::start(board, signals.clone()));
    if let (Some(servo), Some(profile)) = (&servo, &profile) {
        servo.approach(profile, setup.plan.approach_s);
    }
    let camera = CameraThread::start(setup.camera, setup.stall, updates, signals);
    let mut intake = Intake { recorder: setup.recorder, images: Images::default(), listener };

    let mut milestones = Milestones::new(setup.plan.motion_s());
    let mut machine = Machine::new(setup.plan, MonotonicNs::now());
    let mut interrupt = pin!(interrupt);
    let mut ticks = tokio::time::interval(TICK_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut next = camera.as_ref().err().map(|error| Event::Fault(error.to_string()));

    let ending = loop {
        let event = match next.take() {
            Some(event) => event,
            None => tokio::select! {
                biased;
                () = &mut interrupt => Event::Interrupted("interrupted".into()),
                Some(signal) = signal_receiver.recv() => match intake.take_signal(signal) {
                    Ok(Some(event)) => event,
                    Ok(None) => continue,
                    Err(error) => Event::Fault(with_causes(&error)),
                },
                Some(update) = update_receiver.recv() => {
                    intake.take_update(update).unwrap_or_else(|error| Event::Fault(with_causes(&error)))
                }
                _ = ticks.tick() => Event::Tick,
            },
        };
        let now = MonotonicNs::now();
        if event == Event::Tick {
            intake.listener.hear(&Notice::Phase(machine.phase(), intake.images.count.received));
            intake.listener.hear(&Notice::Counted(intake.images.count.clone(), intake.recorder.behind()));
            if let Some(behind) = intake.recorder.falls_behind() {
                intake.listener.hear(&Notice::FallsBehind(behind));
            }
            if let Some(moves_s) = machine.moves_for_s(now) {
                milestones.pass(moves_s, intake.images.count.received, intake.listener);
            }
        }
        match machine.on(event, now) {
            None => {}
            Some(Action::Arm(start)) => {
                if let (Some(servo), Some(profile)) = (&servo, &profile) {
                    intake.listener.hear(&Notice::Journal("arming".into()));
                    servo.arm(profile.clone(), start);
                    let sent = intake.command(ServoCommand::Arm { start, profile: profile.clone() });
                    next = sent.err().map(|error| Event::Fault(with_causes(&error)));
                }
            }
            Some(Action::AskForRelease) => intake.listener.hear(&Notice::LetGo),
            Some(Action::Journal(text)) => intake.listener.hear(&Notice::Journal(text.into())),
            Some(Action::Stop(ending)) => break ending,
        }
    };

    let decided = MonotonicNs::now();
    let outcome = tokio::task::block_in_place(|| match (&mut servo, &ending) {
        (None, _) => StopOutcome::NotNeeded,
        (Some(servo), Ending::Success) => servo.leave(),
        (Some(servo), Ending::Abort(_) | Ending::Fail(_)) => servo.stop(),
    });
    let stop_s = MonotonicNs::now().seconds_since(decided);
    intake.listener.hear(&Notice::Journal("servo-stopped".into()));
    tokio::task::block_in_place(|| drop(camera));
    // Events and images from before the stop still belong into the recording; faults after it change nothing.
    while let Ok(signal) = signal_receiver.try_recv() {
        let _ = intake.take_signal(signal);
    }
    while let Ok(update) = update_receiver.try_recv() {
        let _ = intake.take_update(update);
    }
    let _ = intake.command(ServoCommand::Stop { outcome });
    intake.listener.hear(&Notice::Counted(intake.images.count.clone(), intake.recorder.behind()));
    let images = intake.images.count.clone();
    let (ending, recorded) = intake.finish(ending);
    Filmed { ending, servo: outcome, stop_s, recorded, images, learn_from: milestones.learn_from }
}

/// When enough of the motion has been filmed for the analysis that runs alongside.
struct Milestones {
    learn_s: f64,
    fit_s: f64,
    /// Images received before the motion began.
    first_moving: Option<u64>,
    learn_from: Option<Range<u64>>,
    fits: bool,
}

impl Milestones {
    /// Of a motion that takes `motion_s` \[s\].
    fn new(motion_s: f64) -> Self {
        Self {
            learn_s: (LEARN_MOTION_SHARE * motion_s).max(MIN_LEARN_MOTION_S),
            fit_s: FIRST_FIT_MOTION_SHARE * motion_s,
            first_moving: None,
            learn_from: None,
            fits: false,
        }
    }

    /// The mechanism has moved for `moves_s` \[s\], and so many images are `received`.
    fn pass(&mut self, moves_s: f64, received: u64, listener: &mut impl Listener) {
        let from = *self.first_moving.get_or_insert(received)..received;
        if self.learn_from.is_none() && moves_s >= self.learn_s && !from.is_empty() {
            listener.hear(&Notice::Learn(from.clone()));
            self.learn_from = Some(from);
        }
        if !self.fits && moves_s >= self.fit_s {
            listener.hear(&Notice::Fit);
            self.fits = true;
        }
    }
}

/// Takes in images and events: records them and passes them on to the listener.
struct Intake<'a, L> {
    recorder: Recorder,
    images: Images,
    listener: &'a mut L,
}

impl<L: Listener> Intake<'_, L> {
    /// Records an update of the camera; returns its event for the state machine.
    fn take_update(&mut self, update: CameraUpdate) -> Result<Event, RecordError> {
        Ok(match update {
            CameraUpdate::Image(image) => {
                self.recorder.image(Arc::clone(&image))?;
                self.listener.hear(&Notice::Image(Arc::clone(&image)));
                Event::Image { identical: self.images.take(image) }
            }
            CameraUpdate::Changed(share) => Event::Changed(share),
        })
    }

    /// Records a signal of a device; returns its event for the state machine, if it has one.
    fn take_signal(&mut self, signal: Signal) -> Result<Option<Event>, RecordError> {
        Ok(Some(match signal {
            Signal::CameraFailed(CameraError::End) => Event::Fault("camera: no more images".into()),
            Signal::CameraFailed(error) => Event::Fault(with_causes(&error)),
            Signal::ServoFailed(ServoError::Held(hold)) => Event::Interrupted(hold.to_string()),
            Signal::ServoFailed(error) => Event::Fault(with_causes(&error)),
            Signal::Panicked(thread) => Event::Fault(format!("our fault: the {thread} thread panicked")),
            Signal::Servo(event) => {
                self.recorder.servo(&event)?;
                self.listener.hear(&Notice::Servo(event.clone()));
                match event {
                    ServoEvent::Started { .. } => Event::Started,
                    ServoEvent::Finished { .. } => Event::Finished,
                    ServoEvent::Note { text } => {
                        self.listener.hear(&Notice::Journal(format!("servo: {text}")));
                        return Ok(None);
                    }
                    ServoEvent::Ping { .. } | ServoEvent::Pulse { .. } | ServoEvent::Position { .. } => {
                        return Ok(None);
                    }
                }
            }
        }))
    }

    /// Records a command to the board.
    fn command(&mut self, command: ServoCommand) -> Result<(), RecordError> {
        self.recorder.command(&command)?;
        self.listener.hear(&Notice::Command(command));
        Ok(())
    }

    /// Closes the recording. A success becomes a failure where the recording could not be finished.
    fn finish(self, ending: Ending) -> (Ending, Recorded) {
        match tokio::task::block_in_place(|| self.recorder.finish()) {
            Ok(recorded) => (ending, recorded),
            Err(error) if ending == Ending::Success => {
                (Ending::Fail(with_causes(&error)), Recorded::default())
            }
            Err(_) => (ending, Recorded::default()),
        }
    }
}

/// Images received, and what was wrong with them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImageCount {
    /// All that were received.
    pub received: u64,
    /// Lost on the way, as the camera's own count says.
    pub lost: u64,
    /// Marked as damaged, or not whole.
    pub damaged: u64,
    /// Same bytes as the image before.
    pub repeated: u64,
    /// Stamp not later than that of every image before.
    pub stale: u64,
}

#[derive(Default)]
struct Images {
    count: ImageCount,
    last: Option<Arc<CameraImage>>,
    rising: Rising,
}

impl Images {
    /// Counts an image in; true when its bytes are those of the one before.
    fn take(&mut self, image: Arc<CameraImage>) -> bool {
        let identical = self.last.as_ref().is_some_and(|last| last.data == image.data);
        let lost = self.last.as_ref().map_or(0, |last| images_lost(last.sequence, image.sequence));
        let count = &mut self.count;
        count.received += 1;
        count.lost += u64::from(lost);
        count.damaged += u64::from(image.damaged);
        count.repeated += u64::from(identical);
        count.stale += u64::from(!self.rising.takes(image.mid_exposure));
        self.last = Some(image);
        identical
    }
}

#[cfg(test)]
mod panics;
#[cfg(test)]
mod tests {
    use super::*;
    use camera::fixtures;

    #[test]
    fn what_is_wrong_with_images_is_counted() {
        let mut images = Images::default();
        let mut take = |sequence, at_ns, byte, damaged| {
            let image = fixtures::image(sequence, MonotonicNs(at_ns), (2, 1));
            images.take(Arc::new(CameraImage { data: vec![byte; 2], damaged, ..image }))
        };
        assert!(!take(0, 10, 1, false));
        assert!(!take(3, 20, 2, true), "two lost, one damaged");
        assert!(take(4, 30, 2, false), "repeated");
        assert!(!take(5, 30, 3, false), "stamped as the one before");
        assert!(!take(6, 25, 4, false), "stamped earlier");
        assert!(!take(7, 40, 5, false));
        let counted = ImageCount { received: 6, lost: 2, damaged: 1, repeated: 1, stale: 2 };
        assert_eq!(images.count, counted);
    }
}
