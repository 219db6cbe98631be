//! Camera and servo board on threads of their own. Images reach the coordinator through a bounded queue; events of the board and all
//! faults come through an unbounded one, so that nothing on the way to the safe stop ever waits for room.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::sync::mpsc::error::TrySendError::{Closed, Full};
use tokio::sync::mpsc::{Sender, UnboundedSender};

use super::stillness::changed_share;
use camera::{Camera, CameraError, CameraImage, decode};
use ground::clock::MonotonicNs;
use ground::urgency::Urgency;
use servo::{PulseProfile, PulseTrack};
use servo::{ServoBoard, ServoError, ServoEvent, StopOutcome};

/// What the camera's threads send to the coordinator.
#[derive(Debug)]
pub enum CameraUpdate {
    /// An image, in order of exposure.
    Image(Arc<CameraImage>),
    /// Share of the picture that changed within [`STILLNESS_SPAN_S`].
    Changed(f64),
}

/// Faults and events of the board, which must not wait for room: few and small, even from a board that reports a hundred pulses a second.
#[derive(Debug)]
pub enum Signal {
    /// The camera failed; nothing more comes from it.
    CameraFailed(CameraError),
    /// An event of the board.
    Servo(ServoEvent),
    /// The board failed.
    ServoFailed(ServoError),
    /// A device thread panicked.
    Panicked(&'static str),
}

/// Time between two images that are compared for stillness \[s\], chosen.
pub const STILLNESS_SPAN_S: f64 = 0.1;
/// Time between two tries to send into a full queue, chosen.
const QUEUE_RETRY_PERIOD: Duration = Duration::from_millis(1);
/// Time between two polls of the board, chosen.
const SERVO_POLL_PERIOD: Duration = Duration::from_millis(5);

/// Sends [`Signal::Panicked`] when its thread unwinds.
struct PanicReport(&'static str, UnboundedSender<Signal>);

impl Drop for PanicReport {
    fn drop(&mut self) {
        if std::thread::panicking() {
            // Fails only when the coordinator has ended: then nobody needs it.
            let _ = self.1.send(Signal::Panicked(self.0));
        }
    }
}

/// Starts the thread `name`. Every thread of a device starts here, so that no panic goes unreported.
fn start_thread(
    name: &'static str,
    urgency: Urgency,
    signals: UnboundedSender<Signal>,
    work: impl FnOnce() + Send + 'static,
) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let _report = PanicReport(name, signals);
        urgency.take();
        work();
    })
}

/// The camera's thread. Dropping it stops the camera.
#[derive(Debug)]
pub struct CameraThread {
    quit: SyncSender<()>,
    thread: Option<JoinHandle<()>>,
}

impl CameraThread {
    /// Starts `camera` and passes its images on; silence for `stall` is a fault. While the queue is full the camera waits, and
    /// counts what it loses.
    ///
    /// # Errors
    /// [`CameraError`] when the camera does not start.
    pub fn start(
        mut camera: Box<dyn Camera>,
        stall: Duration,
        updates: Sender<CameraUpdate>,
        signals: UnboundedSender<Signal>,
    ) -> Result<Self, CameraError> {
        camera.start()?;
        let (quit, quitting) = sync_channel::<()>(1);
        let (look_at, watched) = sync_channel(1);
        let changes = updates.clone();
        let watcher = start_thread("stillness", Urgency::Pictures, signals.clone(), move || {
            watch_stillness(&watched, &changes);
        });
        let thread = start_thread("camera", Urgency::Pictures, signals.clone(), move || {
            let quits = || !matches!(quitting.try_recv(), Err(TryRecvError::Empty));
            'film: while !quits() {
                let image = match camera.next_image(stall) {
                    Ok(image) => Arc::new(image),
                    Err(error) => {
                        let _ = signals.send(Signal::CameraFailed(error));
                        break;
                    }
                };
                // The stillness thread skips images that it has no time for.
                if let Err(TrySendError::Disconnected(_)) = look_at.try_send(Arc::clone(&image)) {
                    break;
                }
                let mut waiting = Some(CameraUpdate::Image(image));
                while let Some(image) = waiting.take() {
                    match updates.try_send(image) {
                        Ok(()) => {}
                        Err(Full(image)) if !quits() => {
                            waiting = Some(image);
                            std::thread::sleep(QUEUE_RETRY_PERIOD);
                        }
                        // Nobody wants it any more.
                        Err(Full(_) | Closed(_)) => break 'film,
                    }
                }
            }
            camera.stop();
            drop(look_at);
            let _ = watcher.join();
        });
        Ok(Self { quit, thread: Some(thread) })
    }
}

impl Drop for CameraThread {
    fn drop(&mut self) {
        let _ = self.quit.try_send(());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn watch_stillness(images: &Receiver<Arc<CameraImage>>, updates: &Sender<CameraUpdate>) {
    let mut before: Option<(MonotonicNs, image::GrayImage)> = None;
    for image in images {
        if before.as_ref().is_some_and(|(then, _)| image.mid_exposure.seconds_since(*then) < STILLNESS_SPAN_S)
        {
            continue;
        }
        // A damaged image says nothing about the water; extraction reports it later.
        let Ok(picture) = decode::grey(&image) else { continue };
        if let Some((_, before)) = &before
            // One that finds no room is dropped: the next follows soon.
            && let Err(Closed(_)) = updates.try_send(CameraUpdate::Changed(changed_share(before, &picture)))
        {
            return;
        }
        before = Some((image.mid_exposure, picture));
    }
}

enum Order {
    Approach(PulseProfile, f64),
    Arm(PulseProfile, MonotonicNs),
    /// Where the outcome goes, and the way in which the board is stopped.
    Stop(SyncSender<StopOutcome>, fn(&mut dyn ServoBoard) -> StopOutcome),
}

/// The servo board's thread, and the one safe stop: it is passed on every way out, at the latest when this is
/// dropped, be it by an error, by a panic or by the end.
#[derive(Debug)]
pub struct ServoThread {
    orders: SyncSender<Order>,
    thread: Option<JoinHandle<()>>,
    outcome: Option<StopOutcome>,
}

impl ServoThread {
    /// Takes the board over.
    pub fn start(mut board: Box<dyn ServoBoard>, signals: UnboundedSender<Signal>) -> Self {
        let (orders, inbox) = sync_channel(4);
        let thread = start_thread("servo", Urgency::Servo, signals.clone(), move || {
            serve(board.as_mut(), &inbox, &signals);
        });
        Self { orders, thread: Some(thread), outcome: None }
    }

    /// Moves every channel of `profile` to where its track starts, within `duration_s`; a refusal comes back as
    /// [`Signal::ServoFailed`].
    pub fn approach(&self, profile: &PulseProfile, duration_s: f64) {
        let _ = self.orders.try_send(Order::Approach(profile.clone(), duration_s));
    }

    /// Uploads and arms; a refusal comes back as [`Signal::ServoFailed`].
    pub fn arm(&self, profile: PulseProfile, start: MonotonicNs) {
        // A full or closed inbox means the thread has ended, which it reports itself.
        let _ = self.orders.try_send(Order::Arm(profile, start));
    }

    /// The safe stop. Returns the board's outcome; calling it again changes nothing.
    pub fn stop(&mut self) -> StopOutcome {
        self.end(|board| board.stop())
    }

    /// The ordinary end, after which the board is free for whoever comes next. As [`stop`](Self::stop) otherwise.
    pub fn leave(&mut self) -> StopOutcome {
        self.end(|board| board.leave())
    }

    fn end(&mut self, how: fn(&mut dyn ServoBoard) -> StopOutcome) -> StopOutcome {
        if let Some(outcome) = self.outcome {
            return outcome;
        }
        let (answer, answered) = sync_channel(1);
        let sent = self.orders.send(Order::Stop(answer, how)).is_ok();
        let outcome = if sent {
            answered.recv().unwrap_or(StopOutcome::LeftToDeadMan)
        } else {
            StopOutcome::LeftToDeadMan
        };
        self.outcome = Some(outcome);
        outcome
    }
}

impl Drop for ServoThread {
    fn drop(&mut self) {
        self.stop();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve(board: &mut dyn ServoBoard, orders: &Receiver<Order>, signals: &UnboundedSender<Signal>) {
    loop {
        match orders.recv_timeout(SERVO_POLL_PERIOD) {
            Ok(Order::Approach(profile, duration_s)) => {
                let jog = |track: &PulseTrack| board.jog(track.channel, track.start_pulse, duration_s);
                if let Err(error) = profile.tracks.iter().try_for_each(jog) {
                    let _ = signals.send(Signal::ServoFailed(error));
                }
            }
            Ok(Order::Arm(profile, start)) => {
                if let Err(error) = board.arm(&profile, start) {
                    let _ = signals.send(Signal::ServoFailed(error));
                }
            }
            Ok(Order::Stop(answer, how)) => {
                let outcome = how(board);
                // Events up to the stop still belong into the recording.
                forward(board, signals);
                let _ = answer.send(outcome);
                return;
            }
            Err(RecvTimeoutError::Timeout) => forward(board, signals),
            Err(RecvTimeoutError::Disconnected) => {
                board.stop();
                return;
            }
        }
    }
}

fn forward(board: &mut dyn ServoBoard, signals: &UnboundedSender<Signal>) {
    match board.poll() {
        Ok(events) => {
            for event in events {
                let _ = signals.send(Signal::Servo(event));
            }
        }
        Err(error) => {
            let _ = signals.send(Signal::ServoFailed(error));
        }
    }
}

#[cfg(test)]
mod tests;
