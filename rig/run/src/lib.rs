//! One experiment from still water to a recorded run: the state machine, the device threads it talks to, and the
//! one safe stop that every way out passes.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod devices;
mod error;
pub mod film;
pub mod listener;
pub mod machine;
pub mod open;
mod recorded;
pub mod stillness;

use std::collections::BTreeMap;
use std::future::Future;
use std::path::Path;

use ident::experiment::RunKind;
use serde_json::json;

use config::MotionKind;
use config::RigConfig;
pub use error::RunError;
use film::{Filmed, Setup, film};
use ground::error_chain::with_causes;
use listener::{Listener, Listeners, Notice};
use machine::{Ending, Plan};
use record::RecordError;
use record::folder::{RunFolder, file};
use record::journal::Journal;
use record::recording::{Behind, Recorder, RecorderOptions};
use record::run_id::RunId;
use record::start_stop::{ClockPair, Start, Status, Stop};
use servo::profile::{Profile, ProfileError};
use servo::{PulseProfile, PulseTrack};

/// How far ahead of a profile's start the board is armed \[s\], chosen: a few round trips and repetitions.
const ARMING_LEAD_S: f64 = 0.4;
/// How long the servo takes to its start pulse before a run \[s\], chosen: slow, since its position before is not known.
const SERVO_APPROACH_S: f64 = 1.5;

/// An experiment to run, and where its run folder goes.
pub struct Job<'a> {
    /// The config.
    pub config: &'a RigConfig,
    /// The folder in which the config lies: relative paths in it start there.
    pub base: &'a Path,
    /// The folder of run folders.
    pub runs_dir: &'a Path,
    /// The motion that the servos play; `None`: the config's profile.
    pub motion: Option<&'a PulseProfile>,
}

/// A finished run: its folder and its result.
pub struct Conducted {
    /// Its folder.
    pub folder: RunFolder,
    /// The result of filming.
    pub filmed: Filmed,
}

impl Job<'_> {
    /// Films the experiment into a new run folder; `listener` is notified of its progress. Once the folder is there, faults end up in
    /// its `stop.json` and not in the error.
    ///
    /// # Errors
    /// [`RunError`] when it could not even begin.
    pub async fn conduct(
        &self,
        interrupt: impl Future<Output = ()>,
        listener: &mut dyn Listener,
    ) -> Result<Conducted, RunError> {
        let pulses = self.pulses()?;
        let plane = self.config.calibration.plane(self.base)?;
        let mut opened = open::open(self.config, self.base, Some(self.runs_dir))?;
        let filmed = opened.camera.info();
        plane.fits([filmed.width_px, filmed.height_px])?;
        let origin = ClockPair::now();
        opened.begin(origin.monotonic_ns);
        let mut folder = self.create(&opened, origin)?;
        let journal = folder.journal()?;
        let recorder = Recorder::create(
            &folder.file(file::RECORDING),
            Some(opened.camera.info()),
            RecorderOptions::of(opened.camera.info()),
        )?;

        // Held until the servo has stopped: `rig estop` finds this process through it.
        let _port = opened.claim.take();
        let mut hand = opened.hand.take();
        let drive = opened.board.take().zip(pulses);
        let setup = Setup {
            plan: self.plan(drive.as_ref().map(|(_, pulses)| pulses)),
            camera: opened.camera,
            stall: self.config.camera.stall(),
            drive,
            recorder,
        };
        listener.begins(&folder);
        let mut journal = JournalListener { journal, error: None };
        let mut listeners = Listeners(vec![&mut journal]);
        listeners.0.extend(hand.as_mut().map(|hand| hand as &mut dyn Listener));
        listeners.0.push(listener);
        let filmed = film(setup, interrupt, &mut listeners).await;
        let JournalListener { journal, error: journal_error } = journal;
        let stopped = journal.write(
            "stopped",
            json!({
                "servo": filmed.servo,
                "stop_s": filmed.stop_s,
                "ending": filmed.ending,
                "recorded_bytes": filmed.recorded.bytes,
                "most_waiting_bytes": filmed.recorded.most_waiting_bytes,
            }),
        );
        // a journal that cannot be written does not prevent the run's stop.json
        if let Some(error) = stopped.and_then(|()| journal.sync()).err().or(journal_error) {
            tracing::warn!("{}", with_causes(&error));
        }
        folder.finish(stop(&filmed), filmed.recorded.sum)?;
        Ok(Conducted { folder, filmed })
    }

    /// The pulses of the whole motion, with a small slow one in front where a servo is not calibrated.
    fn pulses(&self) -> Result<Option<PulseProfile>, ProfileError> {
        if let Some(motion) = self.motion {
            return Ok(Some(motion.clone()));
        }
        let (Some(profile), Some(servo)) = (&self.config.profile, &self.config.servo) else {
            return Ok(None);
        };
        let pulses = Profile::new(profile)?.pulses(servo)?;
        let driven = |track: &PulseTrack| servo.channel(track.channel);
        if pulses.tracks.iter().filter_map(driven).all(|channel| channel.calibrated) {
            return Ok(Some(pulses));
        }
        Ok(Some(Profile::new(&profile.cautious())?.pulses(servo)?.then(&pulses)))
    }

    fn plan(&self, pulses: Option<&PulseProfile>) -> Plan {
        let run = &self.config.run;
        Plan {
            kind: run.kind,
            approach_s: pulses.map_or(0.0, |_| SERVO_APPROACH_S),
            settle_s: run.settle_s.get(),
            film_s: run.film_s.get(),
            profile_s: pulses.map_or(0.0, |pulses| pulses.duration_us() as f64 * 1e-6),
            lead_s: ARMING_LEAD_S,
            release_timeout_s: run.release_timeout_s.get(),
            still_share: run.still_share.get(),
        }
    }

    /// Makes the run folder with all that an analysis needs later.
    fn create(&self, opened: &open::Opened, clock: ClockPair) -> Result<RunFolder, RunError> {
        let (mut config, files) = self.config.gathered();
        if let Some(sam2) = &mut config.vision.sam2 {
            sam2.start_from(self.base);
        }
        let read = |path: &Path| {
            let path = self.base.join(path);
            std::fs::read(&path).map_err(|source| RunError::File { path, source })
        };
        let path = self.base.join(&self.config.run.model);
        let model = sim::mjcf::alone(&path).map_err(|source| RunError::Model { path, source })?;
        let kind = match self.config.run.kind {
            MotionKind::Driven => RunKind::Driven,
            MotionKind::Drop => RunKind::Drop,
        };
        let mut details = BTreeMap::from([
            ("mechanism".to_owned(), json!(self.config.mechanism)),
            ("water".to_owned(), json!(self.config.water)),
            ("calibration".to_owned(), json!(self.config.calibration)),
        ]);
        details.extend(
            self.config
                .path
                .as_ref()
                .map(|path| (Start::CONFIG_PATH.to_owned(), json!(path.to_string_lossy()))),
        );
        let start = Start {
            id: RunId::now(),
            number: 0,
            kind,
            model: file::MODEL_START.into(),
            prescribed: self.config.run.prescribed,
            clock,
            version: env!("CARGO_PKG_VERSION").into(),
            board: opened.board.as_ref().map(|board| board.info().clone()),
            camera: Some(opened.camera.info().clone()),
            config: toml::to_string(&config).map_err(|error| RecordError::damaged(self.base, error))?,
            details,
        };
        let contents =
            files.iter().map(|path| Ok((path, read(path)?))).collect::<Result<Vec<_>, RunError>>()?;
        let folder = RunFolder::create(self.runs_dir, start)?;
        folder.write(file::MODEL_START, model.as_bytes())?;
        for (path, bytes) in contents {
            if let Some(name) = path.file_name() {
                folder.write(&name.to_string_lossy(), &bytes)?;
            }
        }
        Ok(folder)
    }
}

/// Writes a run's journal.
struct JournalListener {
    journal: Journal,
    /// The last entry's that could not be written.
    error: Option<RecordError>,
}

impl Listener for JournalListener {
    fn hear(&mut self, notice: &Notice) {
        let written = match notice {
            Notice::Journal(text) => self.journal.write(text, json!({})),
            Notice::FallsBehind(Behind { waiting_mib, queue_mib }) => self.journal.write(
                "recording-falls-behind",
                json!({ "waiting_mib": waiting_mib, "queue_mib": queue_mib }),
            ),
            _ => return,
        };
        self.error = written.err().or(self.error.take());
    }
}

fn stop(filmed: &Filmed) -> Stop {
    let (status, reason) = match &filmed.ending {
        Ending::Success => (Status::Success, None),
        Ending::Abort(reason) => (Status::Abort, Some(reason.clone())),
        Ending::Fail(reason) => (Status::Fail, Some(reason.clone())),
    };
    Stop {
        status,
        reason,
        clock: ClockPair::now(),
        servo: filmed.servo,
        images: filmed.recorded.images,
        images_lost: filmed.images.lost,
        images_damaged: filmed.images.damaged,
        images_repeated: filmed.images.repeated,
        images_stale: filmed.images.stale,
        messages_dropped: filmed.recorded.dropped,
        learn_from: filmed.learn_from.clone(),
        recovered: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pulses(calibrated: bool) -> PulseProfile {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let mut config = RigConfig::read(&configs.join("chain-driven-pose-1.toml")).unwrap();
        config.servo.as_mut().unwrap().channels[0].calibrated = calibrated;
        let job = Job { config: &config, base: &configs, runs_dir: Path::new("unused"), motion: None };
        job.pulses().unwrap().unwrap()
    }

    #[test]
    fn servo_that_is_not_calibrated_first_moves_little_and_slowly() {
        let (careful, plain) = (pulses(false), pulses(true));
        let reach = |track: &PulseTrack| -> u16 {
            let first = &track.segments[..3];
            first.iter().map(|&(_, pulse)| pulse.abs_diff(track.start_pulse)).max().unwrap()
        };
        let (first, full) = (
            reach(&careful.tracks[0]),
            plain.tracks[0].segments.iter().map(|s| s.1.abs_diff(plain.tracks[0].start_pulse)).max().unwrap(),
        );
        assert!(first > 0 && first * 8 < full, "{first} µs of {full} µs");
        assert_eq!(careful.tracks[0].segments[3..], plain.tracks[0].segments);
    }
}
