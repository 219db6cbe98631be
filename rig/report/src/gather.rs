//! Fills a report from a run folder, whatever files are there, and from a fit.

use std::path::Path;

use ident::fit::Fitted;
use ident::table::{self, TableError};
use sim::{Command, Model, State};

use super::data::{ImageQuality, ReportData, RunEnd, RunFigures, ServoTrace};
use super::format::counted;
use super::motion::Motion;
use ground::reasons::told_together;
use record::RecordError;
use record::folder::{RunFolder, file};
use record::frames::{self, FrameRow};
use record::losses::{Limits, Losses};
use record::start_stop::{RunKind, Start, Status, Stop};
use servo::StopOutcome;

/// Why a run folder's files could not be read for a report.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// A file of the recording.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A trajectory or servo table.
    #[error(transparent)]
    Table(#[from] TableError),
}

impl ReportData {
    /// What a run folder says by itself: how the run went, images, servo, measured keypoints, wall times, origin.
    /// The fit, the simulated motion, images and clocks come from whoever has them.
    ///
    /// # Errors
    /// [`GatherError`] when a file is there and cannot be read; a missing one is left out.
    pub fn of_run(folder: &RunFolder) -> Result<Self, GatherError> {
        let start = folder.start();
        let mut data = Self {
            id: start.id.to_string(),
            date: date(&start.clock.utc),
            description: description(start),
            end: folder.stop().map(end),
            provenance: provenance(start),
            config_toml: Some(start.config.clone()).filter(|text| !text.trim().is_empty()),
            ..Self::default()
        };
        data.warnings.extend(folder.incomplete().map(|why| format!("The run is incomplete: {why}.")));
        if folder.stop().is_some_and(|stop| stop.servo == StopOutcome::LeftToDeadMan) {
            data.warnings.push("The servo board did not answer the stop; its dead-man stopped it.".into());
        }
        if let Some(path) = present(folder, file::FRAMES) {
            let rows = frames::read(&path)?;
            let losses = Losses::by(folder, Some(&rows));
            let dropped = folder.stop().map_or(0, |stop| stop.messages_dropped);
            data.images = Some(images(&rows, &losses, dropped));
            let missing = losses.degraded(&Limits::of(folder));
            let missing = missing.or_else(|| losses.say().filter(|_| losses.unread > 0));
            data.warnings.extend(missing.map(|missing| format!("{missing}.")));
            data.warnings.extend(image_warnings(&rows));
        }
        if let Some(path) = present(folder, file::SERVO) {
            data.servo =
                Some(ServoTrace { commanded: table::read_command(&path)?, measured: measured(&path) });
        }
        if let Some(path) = present(folder, file::TRAJECTORY) {
            let started = data.servo.as_ref().and_then(|servo| servo.commanded.first_motion_s());
            data.runs = vec![RunFigures {
                id: data.id.clone(),
                measured: table::read_trajectory(&path)?,
                start_s: started.filter(|_| start.kind == RunKind::Driven),
                ..RunFigures::default()
            }];
        }
        if let Some(path) = present(folder, file::TIMING) {
            let bytes = std::fs::read(&path).map_err(RecordError::io("reading", &path))?;
            data.timing =
                serde_json::from_slice(&bytes).map_err(|error| RecordError::damaged(&path, error))?;
        }
        Ok(data)
    }
}

impl ReportData {
    /// Adds a fit: coefficients, errors, and each run measured and simulated. A run that is shown already keeps
    /// what else is known of it.
    pub fn add_fitted(&mut self, fitted: &Fitted) {
        self.fit = Some(fitted.fit.clone());
        self.timing.workers = fitted.timing.threads;
        self.motions = fitted.runs.iter().map(|run| Motion::of(&fitted.model, run)).collect();
        for run in &fitted.runs {
            let figures = match self.runs.iter().position(|shown| shown.id == run.id) {
                Some(place) => &mut self.runs[place],
                None => {
                    self.runs.push(RunFigures { id: run.id.clone(), ..RunFigures::default() });
                    let last = self.runs.len() - 1;
                    &mut self.runs[last]
                }
            };
            figures.usage = run.usage;
            figures.measured = run.measured.clone();
            figures.simulated = run.simulated.clone();
            figures.start_s = Some(run.start_s);
            figures.base_m = base(&fitted.model, &run.initial);
        }
    }
}

/// Where the site P0 is at the start of a run.
fn base(model: &Model, initial: &State) -> Option<[f64; 3]> {
    let site = model.sites.iter().position(|site| site.name == "P0")?;
    Some(model.poses(&initial.qpos).site_pos[site].0)
}

fn present(folder: &RunFolder, name: &str) -> Option<std::path::PathBuf> {
    Some(folder.file(name)).filter(|path| path.is_file())
}

/// RFC 3339 to the second, as people write it; the text itself when it is no date.
fn date(utc: &str) -> String {
    utc.parse::<jiff::Timestamp>()
        .map_or_else(|_| utc.to_owned(), |t| t.strftime("%Y-%m-%d %H:%M:%S UTC").to_string())
}

fn description(start: &Start) -> String {
    let kind = match start.kind {
        RunKind::Drop => "Drop: at rest, then let go",
        RunKind::Driven if start.prescribed => "Driven: the driven joint follows the command exactly",
        RunKind::Driven => "Driven by its servo",
        RunKind::Free => "Free: already moving in the first image",
    };
    let config: Option<toml::Table> = start.config.parse().ok();
    let name = config.as_ref().and_then(|table| table.get("run")?.get("name")?.as_str());
    match name {
        Some(name) => format!("{name}. {kind}."),
        None => format!("{kind}."),
    }
}

fn end(stop: &Stop) -> RunEnd {
    let reason = stop.reason.clone().unwrap_or_else(|| "no reason was written".into());
    match stop.status {
        Status::Success => RunEnd::Success,
        Status::Abort => RunEnd::Abort(reason),
        Status::Fail => RunEnd::Fail(reason),
    }
}

fn provenance(start: &Start) -> Vec<(String, String)> {
    let mut rows = vec![("rig".to_owned(), start.version.clone()), ("model".to_owned(), start.model.clone())];
    if let Some(camera) = &start.camera {
        rows.push((
            "camera".into(),
            format!(
                "{}, {}×{} at {} images/s, {:+.1} ms to mid-exposure",
                camera.name,
                camera.width_px,
                camera.height_px,
                camera.fps,
                camera.mid_exposure_offset_s * 1e3
            ),
        ));
    }
    if let Some(board) = &start.board {
        rows.push((
            "servo board".into(),
            format!("{}, protocol {}, boot {:08x}", board.name, board.protocol_version, board.boot_id),
        ));
    }
    for (name, value) in &start.details {
        if let Some(text) = value.as_str() {
            rows.push((name.clone(), text.to_owned()));
        } else if value.is_number() {
            rows.push((name.clone(), value.to_string()));
        }
    }
    rows
}

fn images(rows: &[FrameRow], losses: &Losses, dropped: u64) -> ImageQuality {
    let reasons = rows.iter().filter(|row| row.status != "ok");
    let reasons = reasons.map(|row| if row.reason.is_empty() { &row.status } else { &row.reason });
    let rejected = told_together(reasons.map(String::as_str));
    let rejected = rejected.into_iter().map(|told| (told.text, told.members.len())).collect();
    let gaps = rows.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
    let span = rows.last().zip(rows.first()).map_or(0.0, |(last, first)| last.time_s - first.time_s);
    ImageQuality {
        received: losses.received as usize,
        used: rows.iter().filter(|row| row.status == "ok").count(),
        rejected,
        lost: losses.lost.saturating_sub(dropped) as usize,
        dropped: dropped as usize,
        unread: losses.unread as usize,
        fps: (span > 0.0).then(|| (rows.len() - 1) as f64 / span),
        longest_gap_s: gaps.reduce(f64::max),
        losses: *losses,
    }
}

fn image_warnings(rows: &[FrameRow]) -> Vec<String> {
    let mut warnings = Vec::new();
    let damaged = rows.iter().filter(|row| row.damaged).count();
    if damaged > 0 {
        warnings.push(format!("{} marked as damaged by the camera's driver.", counted(damaged, "image")));
    }
    let backward = rows.windows(2).filter(|pair| pair[1].time_s <= pair[0].time_s).count();
    if backward > 0 {
        warnings.push(format!("{} with a stamp not later than the one before.", counted(backward, "image")));
    }
    warnings
}

/// The `<actuator>_measured_rad` columns of a servo table; `None` where it has none.
fn measured(path: &Path) -> Option<Command> {
    const MEASURED_ENDING: &str = "_measured_rad";
    let mut reader = csv::Reader::from_path(path).ok()?;
    let header = reader.headers().ok()?.clone();
    let columns: Vec<_> = header
        .iter()
        .enumerate()
        .filter_map(|(i, name)| Some((i, name.strip_suffix(MEASURED_ENDING)?.to_owned())))
        .collect();
    if columns.is_empty() {
        return None;
    }
    let mut command =
        Command { actuators: columns.iter().map(|(_, name)| name.clone()).collect(), ..Command::default() };
    for record in reader.records() {
        let record = record.ok()?;
        command.time_s.push(record.get(0)?.parse().ok()?);
        // an empty cell is an instant without a measurement of this servo
        let angle =
            |&(i, _): &(usize, String)| record.get(i).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN);
        command.angle_rad.extend(columns.iter().map(angle));
    }
    Some(command)
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::fixtures;

    fn folder(runs: &Path) -> RunFolder {
        let start = Start {
            prescribed: true,
            config: "[run]\nname = \"pose I\"\n".into(),
            ..fixtures::start("20261120T101503Z-ab12cd")
        };
        RunFolder::create(runs, start).unwrap()
    }

    fn row(time_s: f64, status: &str, reason: &str) -> FrameRow {
        FrameRow {
            sequence: 0,
            time_s,
            stamp_ns: 0,
            damaged: false,
            lost_before: u32::from(time_s > 0.25),
            status: status.into(),
            reason: reason.into(),
        }
    }

    #[test]
    fn incomplete_run_is_reported_with_what_it_has() {
        let runs = tempfile::tempdir().unwrap();
        let folder = folder(runs.path());
        let data = ReportData::of_run(&folder).unwrap();
        assert_eq!(data.date, "2026-11-20 10:15:03 UTC");
        assert!(data.description.starts_with("pose I. Driven"), "{}", data.description);
        assert!(data.end.is_none() && data.warnings[0].contains("cut short"), "{:?}", data.warnings);
    }

    #[test]
    fn files_of_a_run_become_counts_servo_and_keypoints() {
        let runs = tempfile::tempdir().unwrap();
        let mut folder = folder(runs.path());
        let rows =
            [row(0.0, "ok", ""), row(0.1, "ok", ""), row(0.2, "rejected", "too dark"), row(0.3, "ok", "")];
        frames::write(&folder.file(file::FRAMES), &rows).unwrap();
        let servo = "time_s,servo_rad,servo_measured_rad\n0,0,0\n0.1,0,\n0.2,0.5,0.4\n";
        std::fs::write(folder.file(file::SERVO), servo).unwrap();
        std::fs::write(folder.file(file::TRAJECTORY), "time_s,P1_x_m,P1_z_m\n0,0.1,0\n0.1,,\n").unwrap();
        let stop = Stop {
            status: Status::Fail,
            reason: Some("camera gone".into()),
            images: 4,
            images_lost: 1,
            messages_dropped: 2,
            servo: StopOutcome::LeftToDeadMan,
            ..fixtures::stop()
        };
        folder.finish(stop, None).unwrap();

        let data = ReportData::of_run(&folder).unwrap();
        let images = data.images.unwrap();
        assert_eq!((images.received, images.used, images.lost, images.dropped), (4, 3, 1, 2));
        assert_eq!(images.rejected, [("too dark".to_owned(), 1)]);
        assert!((images.fps.unwrap() - 10.0).abs() < 1e-9);
        assert_eq!(data.end, Some(RunEnd::Fail("camera gone".into())));
        let measured = data.servo.unwrap().measured.unwrap();
        assert_eq!((measured.actuators[0].as_str(), measured.angle_rad[2]), ("servo", 0.4));
        assert!(measured.angle_rad[1].is_nan());
        assert_eq!(data.runs[0].start_s, Some(0.1));
        assert_eq!(data.warnings.len(), 2, "{:?}", data.warnings);
    }
}
