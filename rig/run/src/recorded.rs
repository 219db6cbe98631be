//! The camera and the board of a recorded run, read from its recording for a replay.

use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

use camera::replay::Film;
use ground::clock::{MonotonicNs, ReplayClock};
use ground::error_chain::with_causes;
use record::folder::{RunFolder, file};
use record::reader::{Item, Recording};
use record::{RecordError, ServoCommand};
use servo::replay::ReplayBoard;

/// The images of the camera of `run`, timed for a run that begins at `start`; `None` where it had no camera.
pub(super) fn film(run: &RunFolder, start: &Arc<OnceLock<MonotonicNs>>) -> Result<Option<Film>, RecordError> {
    let recording = Recording::open(&run.file(file::RECORDING))?;
    let Some(info) = recording.camera_info().or(run.start().camera.as_ref()).cloned() else {
        return Ok(None);
    };
    let image = |item| match item {
        Ok((at, Item::Image(image))) => Some(Ok((at, image))),
        Ok(_) => None,
        Err(error) => Some(Err(with_causes(&error))),
    };
    let received = Box::new(recording.filter_map(image));
    Ok(Some(Film { info, received, clock: ReplayClock::new(run.origin(), Arc::clone(start)) }))
}

/// The board of `run`, timed for a run that begins at `start`; `None` where it had no board.
pub(super) fn board(
    run: &RunFolder,
    start: &Arc<OnceLock<MonotonicNs>>,
) -> Result<Option<ReplayBoard>, RecordError> {
    let Some(info) = run.start().board.clone() else { return Ok(None) };
    let (mut events, mut profile) = (VecDeque::new(), None);
    for item in Recording::open(&run.file(file::RECORDING))? {
        match item? {
            (at, Item::Servo(event)) => events.push_back((at, event)),
            (_, Item::Command(ServoCommand::Arm { profile: played, .. })) => profile = Some(played),
            _ => {}
        }
    }
    Ok(Some(ReplayBoard { info, events, profile, clock: ReplayClock::new(run.origin(), Arc::clone(start)) }))
}
