//! The data of a run folder besides the recording.

use std::path::Path;

use anyhow::Context as _;
use ident::table;
use jiff::Timestamp;
use serde_json::{Map, Value, json};
use sim::{Command, Model, Trajectory};

use super::bag::{JOURNAL, SERVO};
use crate::{Failure, read_model};
use analysis::stored;
use camera::calibration::{Plane, View};
use config::ExtractionConfig;
use ground::clock::MonotonicNs;
use interchange::foxglove::{self, Level};
use record::folder::{RunFolder, file};
use record::journal;
use record::simulated::Simulated;
use record::start_stop::Status;
use vision::outline::Outline;
use vision::record::StoredRecord;

/// The data of a run folder besides the recording.
pub(super) struct RunData {
    /// Wall-clock time of the run's start \[ns since 1970\].
    pub(super) origin_ns: u64,
    pub(super) origin: MonotonicNs,
    pub(super) plane: Option<Plane>,
    pub(super) view: View,
    pub(super) records: Vec<StoredRecord>,
    /// Names of the records' keypoints.
    pub(super) names: Vec<String>,
    pub(super) measured: Option<Trajectory>,
    pub(super) simulation: Option<Simulation>,
    pub(super) command: Option<Command>,
    /// Messages that are not in the recording: time, topic, text.
    pub(super) messages: Vec<(u64, &'static str, Value)>,
    pub(super) has_recording: bool,
}

/// The calibrated model and how it moves.
pub(super) struct Simulation {
    pub(super) model: Model,
    pub(super) motion: Simulated,
}

impl RunData {
    pub(super) fn read(run: &RunFolder) -> Result<(Self, Vec<String>), Failure> {
        let start = run.start();
        let utc: Timestamp = start
            .clock
            .utc
            .parse()
            .with_context(|| format!("{}: clock.utc", run.file(file::START).display()))
            .map_err(Failure::Input)?;
        let origin_ns = u64::try_from(utc.as_nanosecond())
            .with_context(|| format!("{}: clock.utc is before 1970", run.file(file::START).display()))
            .map_err(Failure::Input)?;
        let mut left_out = Vec::new();
        let config =
            ExtractionConfig::parse(&start.config, &run.file(file::START)).map_err(Failure::input)?;
        let plane = config.plane().map_err(|error| left_out.push(format!("no calibration: {error}"))).ok();
        let there = |name: &str| Some(run.file(name)).filter(|path| path.is_file());
        let mut needed = |name: &str, what: &str| {
            let path = there(name);
            if path.is_none() {
                left_out.push(format!("no {what}: the run has no {name}"));
            }
            path
        };
        let has_recording = needed(file::RECORDING, "pictures").is_some();
        let records = needed(file::EXTRACTION, "silhouettes' middle lines");
        let records =
            records.map_or(Ok(Vec::new()), |path| stored::read_all(&path)).map_err(Failure::input)?;
        let measured = needed(file::TRAJECTORY, "measured keypoints")
            .map(|path| table::read_trajectory(&path).map_err(Failure::input))
            .transpose()?;
        let simulation = match needed(file::SIMULATED, "simulated motion") {
            Some(path) => {
                let model = read_model(&run.file(file::MODEL))?;
                let model = model.altered().unwrap_or(model);
                let motion = Simulated::read(&path, model.nq()).map_err(Failure::input)?;
                Some(Simulation { model, motion })
            }
            None => None,
        };
        let known = read_model(&run.file(&start.model)).ok();
        let outline = Outline::new(&config.vision, known.as_ref()).ok();
        let mut run_data = Self {
            origin_ns,
            origin: run.origin(),
            view: plane.as_ref().map_or_else(View::default, Plane::view),
            plane,
            records,
            names: outline.map_or_else(Vec::new, |outline| outline.keypoints()),
            measured,
            simulation,
            command: there(file::SERVO)
                .map(|path| table::read_command(&path).map_err(Failure::input))
                .transpose()?,
            messages: Vec::new(),
            has_recording,
        };
        if let Some(path) = there(file::JOURNAL) {
            run_data.add_journal(run, &path)?;
        }
        if let Some(path) = there(file::SERVO) {
            run_data.add_servo(&path)?;
        }
        run_data.messages.sort_by_key(|(at_ns, ..)| *at_ns);
        Ok((run_data, left_out))
    }

    /// Wall-clock time of an instant of the run.
    pub(super) fn at_ns(&self, time_s: f64) -> u64 {
        self.origin_ns.saturating_add_signed((time_s * 1e9).round() as i64)
    }

    fn add_journal(&mut self, run: &RunFolder, path: &Path) -> Result<(), Failure> {
        for entry in journal::read(path).map_err(Failure::input)? {
            let at_ns = self.at_ns(entry.at_s);
            let level = if entry.event == "recording-falls-behind" { Level::Warning } else { Level::Info };
            let message = match entry.details.is_empty() {
                true => entry.event.clone(),
                false => format!("{} {}", entry.event, Value::Object(entry.details)),
            };
            self.messages.push((at_ns, JOURNAL, foxglove::log(at_ns, level, "journal", &message)));
        }
        if let Some(stop) = run.stop() {
            let at_ns = self.at_ns(stop.clock.monotonic_ns.seconds_since(self.origin));
            let (level, word) = match stop.status {
                Status::Success => (Level::Info, "success"),
                Status::Abort => (Level::Warning, "abort"),
                Status::Fail => (Level::Error, "fail"),
            };
            let message =
                stop.reason.as_ref().map_or_else(|| word.into(), |reason| format!("{word}: {reason}"));
            self.messages.push((at_ns, JOURNAL, foxglove::log(at_ns, level, "stop", &message)));
        }
        Ok(())
    }

    /// Each row of `servo.csv`.
    fn add_servo(&mut self, path: &Path) -> Result<(), Failure> {
        let mut reader = csv::Reader::from_path(path).map_err(Failure::input)?;
        let header = reader.headers().map_err(Failure::input)?.clone();
        for record in reader.records() {
            let record = record.map_err(Failure::input)?;
            let row: Map<String, Value> = header
                .iter()
                .zip(&record)
                .filter_map(|(name, cell)| Some((name.to_owned(), json!(cell.parse::<f64>().ok()?))))
                .collect();
            if let Some(time_s) = row.get("time_s").and_then(Value::as_f64) {
                self.messages.push((self.at_ns(time_s), SERVO, Value::Object(row)));
            }
        }
        Ok(())
    }
}
