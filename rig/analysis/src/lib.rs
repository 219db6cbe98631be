//! From a recording to a report. A run is analysed by the same code that replays it, so both give the same bytes.
//!
//! ```text
//! recording.mcap -> frames.csv, servo.csv, extraction.jsonl -> trajectory.csv -> warm-start.json, fit.json, model.xml
//!                -> diagnosis.json -> report.html
//! ```

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

mod early;
mod error;
mod experiment;
pub mod live;
mod pictures;
pub mod showing;
pub mod stored;
mod strip;
pub mod timeline;

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;

use ident::diagnose::{self, DiagnoseError, Diagnosed, NextExperiment, diagnose};
use ident::fit::{Fitted, Observer, WarmStart};
use ident::table;

use crate::showing::Showing;
use config::RigConfig;
use early::EarlyFit;
pub use error::AnalysisError;
use experiment::experiment;
pub use experiment::prepared;
use ground::error_chain::with_causes;
use ground::shell;
use images::TimedImage;
use images::recording::RecordedImages;
use live::Live;
use record::RecordError;
use record::files::read_json;
use record::folder::{RunFolder, file};
use record::frames::{self, FrameRow};
use record::outputs::OutputFolder;
use record::simulated::Simulated;
use record::stage::Stage;
use record::sums::Sums;
use record::timing::{self, Timing};
use report::{DiagnosisFigures, ReportData};
use timeline::{Timeline, late_s};
use vision::{Extraction, ImageRecord, SequenceError, Status, Task};

/// Receives the progress of an analysis.
pub trait Progress: Observer + diagnose::Observer {
    /// A stage begins: its name, and how many steps it has where that is known.
    fn begin(&mut self, name: &str, steps: Option<u64>);
    /// `done` steps of the stage are done.
    fn step(&mut self, done: u64);
    /// Where the live view is published; by default nowhere.
    fn showing(&self) -> Showing {
        Showing::default()
    }
}

/// What to analyse, and where the results go.
pub struct Analysis<'a> {
    /// The recorded run.
    pub run: &'a RunFolder,
    /// The folder for results, the run's own or another.
    pub out: &'a OutputFolder,
    /// The config to analyse with.
    pub config: &'a RigConfig,
    /// The folder that paths in the config start from.
    pub paths_from: &'a Path,
    /// Where to begin.
    pub from: Stage,
    /// The extraction made during the filming; none for a run that is replayed from its recording.
    pub live: Option<Live>,
}

/// Fit and diagnosis of the keypoints.
struct FitAndDiagnosis {
    fitted: Fitted,
    /// The diagnosis, where the config asks for one.
    diagnosed: Option<Result<Diagnosed, DiagnoseError>>,
}

impl Analysis<'_> {
    /// Carries out all stages from [`Analysis::from`] on and writes their files; what the report shows comes back. The threads of
    /// the caller's pool work on it; the results do not depend on how many those are.
    ///
    /// # Errors
    /// [`AnalysisError`]; the files of the stages before it are there, and a report of what the images gave.
    pub fn carry_out(mut self, progress: &mut dyn Progress) -> Result<ReportData, AnalysisError> {
        let mut timing = Timing { workers: rayon::current_num_threads(), ..Timing::default() };
        let (timeline, extraction, early) = self.observed(&mut timing, progress)?;
        let outcome = self.fit_and_diagnose(&timeline, early, &mut timing, progress);
        progress.begin("report", None);
        let data = self.report(&timeline, extraction.as_ref(), outcome.as_ref());
        self.add_sums()?;
        // the fit's error is more useful than the report's
        outcome.and(data)
    }

    /// Carries out all stages up to the keypoints, and writes their files: `servo.csv`, `frames.csv`, `trajectory.csv`. The threads of
    /// the caller's pool work on it.
    ///
    /// # Errors
    /// [`AnalysisError`].
    pub fn keypoints(mut self, progress: &mut dyn Progress) -> Result<(), AnalysisError> {
        let mut timing = Timing { workers: rayon::current_num_threads(), ..Timing::default() };
        self.observed(&mut timing, progress)?;
        self.out.write_json(file::TIMING, &timing)?;
        Ok(self.add_sums()?)
    }

    /// Adds the results' checksums where they are in the run's own folder.
    fn add_sums(&self) -> Result<(), RecordError> {
        if self.out.path() == self.run.path() { Sums::add_results(self.run.path()) } else { Ok(()) }
    }

    /// Timeline, extraction and early fit; no extraction where the trajectory is taken over as it is.
    fn observed(
        &mut self,
        timing: &mut Timing,
        progress: &mut dyn Progress,
    ) -> Result<(Timeline, Option<Extraction>, Option<EarlyFit>), AnalysisError> {
        let mut live = self.live.take();
        let builder = live.as_mut().and_then(|live| live.builder.take());
        let timeline = timing.measure("recording", || match builder {
            Some(builder) => builder.timeline(self.config),
            None => Timeline::read(self.run, self.config),
        })?;
        if let Some(command) = &timeline.command {
            self.out.write(file::SERVO, table::servo_text(command, &timeline.measured).as_bytes())?;
        }
        if self.from == Stage::Trajectory {
            self.take_over(&[file::FRAMES, file::EXTRACTION, file::TRAJECTORY])?;
            return Ok((timeline, None, None));
        }
        let (extraction, early) = timing.measure("images", || self.extract(&timeline, live, progress))?;
        Ok((timeline, Some(extraction), early))
    }

    /// Fit and diagnosis of the keypoints.
    fn fit_and_diagnose(
        &self,
        timeline: &Timeline,
        early: Option<EarlyFit>,
        timing: &mut Timing,
        progress: &mut dyn Progress,
    ) -> Result<FitAndDiagnosis, AnalysisError> {
        let trajectory = table::read_trajectory(&self.out.path().join(file::TRAJECTORY))?;
        let experiment = experiment(self.run, self.config, timeline, trajectory)?;
        let warm = self.warm_start(early, timing)?;
        progress.begin("fit", Some(experiment.fit.max_evaluations));
        let (mut fitted, left) =
            timing.measure("fit", || ident::fit::first_answer(&experiment, warm.as_ref(), progress))?;
        if let Some(warm) = &warm {
            self.out.write_json(file::WARM_START, warm)?;
        }
        self.write_fit(&fitted, timing)?;
        if let Some(left) = left {
            // the first coefficients are written; now other starts are tried
            fitted = timing.measure("other starts", || ident::fit::resume(&experiment, left, progress))?;
            self.write_fit(&fitted, timing)?;
        }
        let wanted = self.config.run.diagnose;
        let mut diagnosed =
            // from the model itself, not from the fit's result: the diagnosis searches from both
            wanted.then(|| timing.measure("diagnosis", || diagnose(&experiment, progress)));
        if let Some(Ok(diagnosed)) = &mut diagnosed {
            let design = |_: &str| Some(shell::design(self.run.path(), self.run.start().config_path()?));
            NextExperiment::to_type(&mut diagnosed.diagnosis.next_experiments, design);
            self.out.write_json(file::DIAGNOSIS, &diagnosed.diagnosis)?;
        }
        self.out.write_json(file::TIMING, timing)?;
        Ok(FitAndDiagnosis { fitted, diagnosed })
    }

    /// Writes the report; without a fit it shows the results of the images, and why there is no fit.
    fn report(
        &self,
        timeline: &Timeline,
        extraction: Option<&Extraction>,
        outcome: Result<&FitAndDiagnosis, &AnalysisError>,
    ) -> Result<ReportData, AnalysisError> {
        let mut data = ReportData::of_run(&RunFolder::open(self.out.path())?)?;
        data.warnings.extend(timeline.shortfall.iter().map(|shortfall| format!("{shortfall}.")));
        match outcome {
            Ok(FitAndDiagnosis { fitted, diagnosed }) => {
                data.add_fitted(fitted);
                match diagnosed {
                    Some(Ok(diagnosed)) => data.diagnosis = Some(DiagnosisFigures::new(diagnosed)),
                    // the coefficients are useful without a diagnosis
                    Some(Err(error)) => data.warnings.push(format!("No diagnosis: {error}.")),
                    None => {}
                }
            }
            Err(error) => data.warnings.push(format!("No fit: {}.", with_causes(error))),
        }
        data.clocks.extend(timeline.clock_quality());
        if let Some(extraction) = extraction {
            let images = self.images(timeline);
            let command = timeline.command.as_ref();
            let fitted = outcome.ok().map(|outcome| &outcome.fitted);
            pictures::show(&mut data, extraction, (fitted, command), &images)?;
        }
        self.out.write(file::REPORT, report::render(&data).as_bytes())?;
        Ok(data)
    }

    /// Where the fit begins: at the result of an `early` fit, or where it began when the run was recorded.
    fn warm_start(
        &self,
        early: Option<EarlyFit>,
        timing: &mut Timing,
    ) -> Result<Option<WarmStart>, RecordError> {
        if let Some((warm, wall)) = early.and_then(EarlyFit::result) {
            timing
                .stages
                .push(timing::Stage { name: "early fit, while filming".into(), wall_s: wall.as_secs_f64() });
            return Ok(Some(warm));
        }
        let path = self.run.file(file::WARM_START);
        if path.exists() { read_json(&path).map(Some) } else { Ok(None) }
    }

    fn write_fit(&self, fitted: &Fitted, timing: &Timing) -> Result<(), AnalysisError> {
        self.out.write_json(file::FIT, &fitted.fit)?;
        let comment =
            format!("Calibrated by rig {} on run {}.", env!("CARGO_PKG_VERSION"), self.run.start().id);
        self.out.write(file::MODEL, fitted.to_mjcf(&comment).as_bytes())?;
        if let Some(run) = fitted.runs.first() {
            let simulated = Simulated { time_s: run.simulated.time_s.clone(), qpos: run.qpos.clone() };
            self.out.write(file::SIMULATED, simulated.text().as_bytes())?;
        }
        Ok(self.out.write_json(file::TIMING, timing)?)
    }

    fn extract(
        &self,
        timeline: &Timeline,
        live: Option<Live>,
        progress: &mut dyn Progress,
    ) -> Result<(Extraction, Option<EarlyFit>), AnalysisError> {
        progress.begin("images", Some(timeline.images.len() as u64));
        let (config, folder) = (&self.config.vision, self.paths_from);
        let plane = self.config.calibration.plane(folder)?;
        let stored = match self.from {
            Stage::Mask | Stage::Keypoints => Some(stored::read(self.run, timeline.usable().count())?),
            _ => None,
        };
        let done = Cell::new(0);
        let showing = progress.showing();
        let found = |images: &[TimedImage], records: &[ImageRecord]| {
            done.set(done.get() + images.len() as u64);
            progress.step(done.get());
            showing.found(images, records);
            Ok::<(), AnalysisError>(())
        };
        let model = experiment::model(self.run)?;
        let mut task = Task::new(config, Some(&model), plane, folder).map_err(SequenceError::from)?;
        let names = task.outline.keypoints();
        showing.keypoints(&names, task.plane.view());
        let mut early = None;
        let extraction = if let (Stage::Keypoints, Some(stored)) = (self.from, &stored) {
            let records = stored.iter().map(|record| record.record(&task.plane)).collect();
            Extraction::named(records, names, task.plane.clone())
        } else {
            match stored {
                // the usual shape is learned from the stored silhouettes too
                Some(stored) if config.sam2().is_some() => {
                    let found = stored.into_iter().filter_map(|record| Some((record.time_s, record.mask?)));
                    task.silhouettes = Some(Arc::new(found.collect()));
                }
                stored => {
                    task.masks = stored.map(|stored| stored.into_iter().map(|record| record.mask).collect());
                }
            }
            let recorded = self.images(timeline);
            let times_s: Vec<f64> = timeline.usable().map(|image| image.row.time_s).collect();
            match live.and_then(|live| live.finish(&times_s)) {
                Some(head) => {
                    done.set(head.begun.records().len() as u64);
                    let extraction = task.finish(head.begun, &head.left.of(&recorded), found)?;
                    early = head.early.filter(|_| !extraction.is_revised);
                    extraction
                }
                None => task.extract(&recorded, found)?,
            }
        };
        if let Some(Err(why)) = &extraction.checked {
            tracing::warn!(
                "[vision] self_check: the film {why}; keypoints keep the sigmas that they have without it"
            );
        }
        stored::write(self.out, &extraction.records)?;
        let mut rows: Vec<FrameRow> = timeline.images.iter().map(|image| image.row.clone()).collect();
        let used = rows.iter_mut().filter(|row| row.status == timeline::USABLE);
        for (row, record) in used.zip(&extraction.records) {
            row.status = match record.status {
                Status::Ok => "ok",
                Status::Doubtful => "doubtful",
                Status::Rejected => "rejected",
            }
            .into();
            row.reason.clone_from(&record.reason);
        }
        let path = self.out.path().join(file::FRAMES);
        let rows = frames::table(&rows).map_err(|error| RecordError::damaged(&path, error))?;
        self.out.write(file::FRAMES, &rows)?;
        self.out.write(file::TRAJECTORY, table::trajectory_text(&extraction.trajectory).as_bytes())?;
        Ok((extraction, early))
    }

    /// The run's images that get a row in the trajectory.
    fn images(&self, timeline: &Timeline) -> RecordedImages {
        RecordedImages::of_run(self.run)
            .later_by(late_s(self.run, self.config))
            .usable_at(timeline.usable().map(|image| image.index).collect())
    }

    /// Copies files of the run that are taken as they are into another folder for results.
    fn take_over(&self, names: &[&str]) -> Result<(), AnalysisError> {
        for name in names {
            let (from, to) = (self.run.file(name), self.out.file(name));
            if from != to.path() {
                let bytes = std::fs::read(&from).map_err(RecordError::io("reading", &from))?;
                to.write(&bytes)?;
            }
        }
        Ok(())
    }
}
