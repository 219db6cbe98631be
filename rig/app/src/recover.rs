//! Recovery of runs that a kill or a power cut has ended: the recording is closed properly, the tables are made from it, and
//! `stop.json` is written.

use std::path::{Path, PathBuf};

use ident::table::{read_servo, servo_text};

use super::Failure;
use analysis::AnalysisError;
use analysis::timeline::{Timeline, TimelineBuilder, USABLE};
use config::RigConfig;
use ground::claim::Claim;
use ground::clock::MonotonicNs;
use ground::error_chain::with_causes;
use record::files::{create_folder, read_json};
use record::folder::{self, RunFolder, file};
use record::frames::FrameRow;
use record::outputs::OutputFolder;
use record::reader::{Item, Recording};
use record::repair::{Repaired, repair};
use record::run_id::RunId;
use record::start_stop::{ClockPair, Recovered, Start, Status, Stop};
use record::sums::{Sum, Sums};
use record::{RecordError, ServoCommand, frames, journal};
use run::machine::Ending;
use servo::StopOutcome;

/// The lock of whoever films into the runs folder `runs_dir`.
pub fn lock(runs_dir: &Path) -> PathBuf {
    runs_dir.join(".lock")
}

/// Takes that lock.
///
/// # Errors
/// [`Failure::Input`] when another process has it, or it cannot be written.
pub fn claim(runs_dir: &Path) -> Result<Claim, Failure> {
    create_folder(runs_dir).map_err(Failure::input)?;
    Claim::take("the runs folder", &lock(runs_dir)).map_err(Failure::input)
}

/// Recovers all runs in `runs_dir` that have no `stop.json` that can be read, while nobody films into it: says so of each. One that cannot be recovered
/// stays as it is, and keeps nobody from the next run.
pub fn all(runs_dir: &Path, claim: &Claim, mut say: impl FnMut(&RunId, &str)) {
    if let Err(error) = folder::remove_unmade(runs_dir) {
        tracing::warn!("{}", with_causes(&error));
        return;
    }
    for id in unfinished(runs_dir) {
        match recover(&runs_dir.join(id.as_str()), claim) {
            Ok(Some(said)) => say(&id, &said),
            Ok(None) => {}
            Err(failure) => {
                say(&id, &format!("ended without a word, and cannot be recovered: {:#}", failure.error()))
            }
        }
    }
}

/// Recovers all runs in `runs_dir`, and returns what became of each; none while somebody films into it.
pub fn unfinished_in(runs_dir: &Path) -> Vec<(RunId, String)> {
    let mut said = Vec::new();
    if let Ok(claim) = claim(runs_dir) {
        all(runs_dir, &claim, |run, text| said.push((run.clone(), text.to_owned())));
    }
    said
}

/// The runs without a `stop.json` that can be read, by their ids.
fn unfinished(runs_dir: &Path) -> Vec<RunId> {
    // an unreadable folder is reported by the code that writes to it
    let entries = std::fs::read_dir(runs_dir).into_iter().flatten().flatten();
    let ids = entries.filter_map(|entry| RunId::try_from(entry.file_name().into_string().ok()?).ok());
    let is_unfinished = |id: &RunId| read_json::<Stop>(&runs_dir.join(id.as_str()).join(file::STOP)).is_err();
    let mut ids: Vec<_> = ids.filter(is_unfinished).collect();
    ids.sort();
    ids
}

/// Recovers the run in the folder `path`, while nobody films into the folder that it is in; says what became of it. None where it has
/// its `stop.json`, and its recording is what was written.
///
/// # Errors
/// [`Failure::Input`] for a folder that is no run, [`Failure::Data`] where the disk refuses. What was recorded stays as it was, and
/// nothing is lost by trying again.
pub fn recover(path: &Path, _claim: &Claim) -> Result<Option<String>, Failure> {
    let mut run = RunFolder::open(path).map_err(Failure::input)?;
    match run.stop().cloned() {
        Some(stop) => damaged(&mut run, stop).map_err(Failure::data),
        None => unended(&mut run).map(Some).map_err(Failure::data),
    }
}

/// Makes the recording of a run whole that has ended, where it is not what was written.
fn damaged(run: &mut RunFolder, stop: Stop) -> Result<Option<String>, RecordError> {
    let recording = run.file(file::RECORDING);
    if !recording.exists() {
        return Ok(None);
    }
    let written = Sums::read(run.path()).ok().flatten().and_then(|sums| sums.0.get(file::RECORDING).copied());
    if written.is_some_and(|sum| Sum::of_file(&recording).is_ok_and(|found| found == sum)) {
        return Ok(None);
    }
    let repaired = repair(&recording, run.start().camera.as_ref())?;
    if repaired.was_whole && written.is_none() {
        return Ok(None);
    }
    let images = RecordedRun::of(run).rows.len() as u64;
    let said = format!(
        "had a damaged recording; {images} of its {} images can be read{}",
        stop.images,
        unreadable(repaired)
    );
    run.finish_again(Stop { recovered: Some(recovered(repaired)), ..stop }, &[file::RECORDING])?;
    Ok(Some(said))
}

/// Ends a run that has not ended itself, or whose end cannot be read.
fn unended(run: &mut RunFolder) -> Result<String, RecordError> {
    let recording = run.file(file::RECORDING);
    let repaired = match recording.exists() {
        true => repair(&recording, run.start().camera.as_ref())?,
        false => Repaired::default(),
    };
    let recorded = RecordedRun::of(run);
    let mut made = recorded.write_tables(run)?;
    if !repaired.was_whole {
        made.push(file::RECORDING);
    }
    let stop = recorded.stop(run, repaired);
    let mut said = match run.unreadable_stop() {
        Some(_) => format!("had a {} that cannot be read", file::STOP),
        None => "ended without a word".into(),
    };
    said += &format!(
        "; its {} images, {:.1} s, are kept as `{}`{}",
        stop.images,
        stop.clock.monotonic_ns.seconds_since(run.origin()),
        store::runs::word(stop.status),
        unreadable(repaired)
    );
    if run.unreadable_stop().is_some() {
        said += &format!(", the damaged file as {}", put_aside(run)?);
    }
    run.finish_again(stop, &made)?;
    Ok(said)
}

/// Renames a `stop.json` that cannot be read, and returns the new name.
fn put_aside(run: &RunFolder) -> Result<String, RecordError> {
    let stamp = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%S%6fZ");
    let (path, name) = (run.file(file::STOP), format!("{}-damaged-{stamp}", file::STOP));
    std::fs::rename(&path, run.file(&name)).map_err(RecordError::io("putting aside", &path))?;
    Ok(name)
}

fn unreadable(repaired: Repaired) -> String {
    match repaired.unreadable_bytes {
        0 => String::new(),
        bytes => format!(", {bytes} bytes of the recording cannot be read"),
    }
}

fn recovered(repaired: Repaired) -> Recovered {
    Recovered { at_utc: jiff::Timestamp::now().to_string(), unreadable_bytes: repaired.unreadable_bytes }
}

/// All that is readable of a run's recording and journal.
struct RecordedRun {
    rows: Vec<FrameRow>,
    /// Images that the camera counted where the recording cannot be read.
    images_unread: u64,
    images_repeated: u64,
    timeline: Result<Timeline, String>,
    servo: Option<StopOutcome>,
    /// Time of the last item of recording and journal.
    last: MonotonicNs,
    /// How the run ended, as the journal says, where that was written.
    ended: Option<Ending>,
}

impl RecordedRun {
    fn of(run: &RunFolder) -> Self {
        let mut builder = TimelineBuilder::new(run.origin());
        let (mut servo, mut last, mut before, mut images_repeated) = (None, run.origin(), None, 0);
        let path = run.file(file::RECORDING);
        let mut images_unread = 0;
        // a recording without a readable beginning has no items
        if let Ok(mut recording) = Recording::open(&path) {
            for (at, item) in recording.by_ref().map_while(Result::ok) {
                last = last.max(at);
                match item {
                    Item::Image(image) => {
                        builder.image(&image);
                        images_repeated += u64::from(before.as_ref() == Some(&image.data));
                        before = Some(image.data);
                    }
                    Item::Servo(event) => builder.servo(&event),
                    Item::Command(command) => {
                        if let ServoCommand::Stop { outcome } = &command {
                            servo = Some(*outcome);
                        }
                        builder.command(&command);
                    }
                    Item::Gap => builder.gap(),
                }
            }
            images_unread = recording.unread().images;
        }
        // a journal that was cut short is read as far as it goes, a damaged one not at all
        let journal = journal::read(&run.file(file::JOURNAL)).unwrap_or_default();
        if let Some(entry) = journal.last() {
            last = last.max(run.origin().plus_seconds(entry.at_s));
        }
        let ended = journal.iter().rev().find(|entry| entry.event == "stopped");
        let ended = ended.and_then(|entry| serde_json::from_value(entry.details.get("ending")?.clone()).ok());
        let rows = builder.rows();
        let config = RigConfig::parse(&run.start().config, &run.file(file::START));
        let timeline = config
            .map_err(|error| with_causes(&error))
            .and_then(|config| builder.timeline(&config).map_err(|error: AnalysisError| with_causes(&error)));
        Self { rows, images_unread, images_repeated, timeline, servo, last, ended }
    }

    /// Writes `frames.csv` and `servo.csv` where they are not there or cannot be read: which.
    fn write_tables(&self, run: &RunFolder) -> Result<Vec<&'static str>, RecordError> {
        let mut made = Vec::new();
        let [frames, servo] = [file::FRAMES, file::SERVO].map(|name| run.file(name));
        if frames::read(&frames).is_err() {
            frames::write(&frames, &self.rows)?;
            made.push(file::FRAMES);
        }
        match &self.timeline {
            Ok(Timeline { command: Some(command), measured, .. }) if read_servo(&servo).is_err() => {
                OutputFolder::of_run(run).write(file::SERVO, servo_text(command, measured).as_bytes())?;
                made.push(file::SERVO);
            }
            Ok(_) => {}
            Err(error) => tracing::warn!("run {}: no {}: {error}", run.start().id, file::SERVO),
        }
        Ok(made)
    }

    fn stop(&self, run: &RunFolder, repaired: Repaired) -> Stop {
        let start = run.start();
        let count = |of: &dyn Fn(&FrameRow) -> u64| self.rows.iter().map(of).sum();
        let (status, reason) = match &self.ended {
            // its recording was closed before the journal said so
            Some(Ending::Success) if repaired.was_whole && repaired.unreadable_bytes == 0 => {
                (Status::Success, None)
            }
            Some(Ending::Abort(reason)) => (Status::Abort, Some(reason.clone())),
            Some(Ending::Fail(reason)) => (Status::Fail, Some(reason.clone())),
            _ => (Status::Fail, Some("ended without a word: killed, or the power was cut".to_owned())),
        };
        // `frames.csv` may have been written before the recording was damaged, and have more rows
        let table_rows = frames::read(&run.file(file::FRAMES)).map_or(0, |rows| rows.len() as u64);
        let left = if start.board.is_some() { StopOutcome::LeftToDeadMan } else { StopOutcome::NotNeeded };
        Stop {
            status,
            reason,
            clock: ClockPair { monotonic_ns: self.last, utc: later(start, self.last) },
            servo: self.servo.unwrap_or(left),
            images: (self.rows.len() as u64 + self.images_unread).max(table_rows),
            images_lost: count(&|row| row.lost_before.into()),
            images_damaged: count(&|row| row.damaged.into()),
            images_repeated: self.images_repeated,
            images_stale: count(&|row| (row.status != USABLE).into()),
            messages_dropped: 0,
            learn_from: None,
            recovered: Some(recovered(repaired)),
        }
    }
}

/// The wall time of `at`, as the clocks stood when the run began.
fn later(start: &Start, at: MonotonicNs) -> String {
    let passed = jiff::SignedDuration::from_secs_f64(at.seconds_since(start.clock.monotonic_ns));
    let began: Option<jiff::Timestamp> = start.clock.utc.parse().ok();
    began
        .and_then(|began| began.checked_add(passed).ok())
        .map_or_else(|| start.clock.utc.clone(), |at| at.to_string())
}
