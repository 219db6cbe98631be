//! Keypoints from other programs' files into trajectories, and trajectories into files for them.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ground::spreadsheet;
use ground::strict::{Positive, Share};
use sim::Trajectory;

use super::Failure;
use camera::calibration::{Plane, View};
use config::ExtractionConfig;
use images::folder;
use interchange::wcon::{self, Document, Line, Written};
use interchange::{Format, Imported, Marks, Times, dlc, marks, sleap};
use record::folder::{RunFolder, file};
use record::outputs::{OutputError, OutputFile, Outputs};
use vision::outline::Outline;
use vision::{Mode, Status, VisionConfig, output};

/// A larger file is not read as a table of keypoints \[bytes\]. Chosen.
const TABLE_FILE_LIMIT_BYTES: u64 = 1 << 30;

/// What to read, and how.
#[derive(Debug)]
pub struct Import<'a> {
    /// The other program's file.
    pub file: &'a Path,
    /// Its format; left out: told by how it begins.
    pub format: Option<Format>,
    /// Any rig config: its calibration, rate and shares.
    pub config: &'a Path,
    /// The mechanism's model; left out: the config's.
    pub model: Option<&'a Path>,
    /// The trajectory to write, and each image's status.
    pub out: &'a TableOfImages,
    /// Which body parts are keypoints, see [`marks::chosen`].
    pub keypoints: Option<&'a str>,
    /// Which animal, track or id.
    pub individual: Option<&'a str>,
    /// Images per second; wins over the config's.
    pub fps: Option<f64>,
    /// A table `file,time_s` of when images were taken.
    pub times: Option<&'a Path>,
    /// What is less likely counts as not seen.
    pub least_likelihood: f64,
    /// Sigma of a mark per axis \[px\].
    pub std_px: Option<f64>,
    /// WCON's y grows downward.
    pub y_down: bool,
}

/// What came of an import.
#[derive(Debug)]
pub struct ImportOutcome {
    /// What was read.
    pub imported: Imported,
    /// Which format it was.
    pub format: Format,
    /// What was taken for granted, a sentence each.
    pub notes: Vec<String>,
}

impl Import<'_> {
    /// Reads the file and writes the trajectory, and each image's status beside it.
    ///
    /// # Errors
    /// [`Failure::Input`] where file, config or options are wrong, [`Failure::Data`] where not one keypoint can be used.
    pub fn carry_out(&self) -> Result<ImportOutcome, Failure> {
        let text = self.text()?;
        let format = match self.format {
            Some(format) => format,
            None => {
                Format::of(text.as_bytes()).with_context(|| self.reading(None)).map_err(Failure::Input)?
            }
        };
        let config = ExtractionConfig::read(self.config).map_err(Failure::input)?;
        let in_file = |error| Failure::Input(anyhow::Error::new(error).context(self.reading(Some(format))));
        let mut notes = Vec::new();
        let mut imported = match format {
            Format::Dlc => {
                self.import_marks(dlc::read(&text, self.individual).map_err(in_file)?, &config, &mut notes)?
            }
            Format::Sleap => {
                self.import_marks(sleap::read(&text, self.individual).map_err(in_file)?, &config, &mut notes)?
            }
            Format::Wcon => {
                let mut imported = self.lines(&wcon::read(&text).map_err(in_file)?, &config, &mut notes)?;
                if self.y_down {
                    imported.trajectory.position_m.iter_mut().for_each(|point| point[2] = -point[2]);
                }
                imported
            }
        };
        // What lines and marks have as z is up in the picture.
        let view = config.view().map_err(Failure::input)?;
        for point in &mut imported.trajectory.position_m {
            *point = view.world(View::Xz.seen(*point));
        }
        if imported.images.len() == imported.count(Status::Rejected) {
            let first =
                imported.images.first().map_or("the file has no images", |image| image.reason.as_str());
            let what = format!(
                "{}: no keypoint in any of {} images: {first}",
                self.file.display(),
                imported.images.len()
            );
            return Err(Failure::Data(anyhow!(what)));
        }
        let rows = imported.images.iter().map(|i| (i.name.as_str(), i.time_s, i.status, i.reason.as_str()));
        self.out.write(ident::table::trajectory_text(&imported.trajectory).as_bytes(), rows)?;
        Ok(ImportOutcome { imported, format, notes })
    }

    fn reading(&self, format: Option<Format>) -> String {
        let form = format.map_or(String::new(), |format| format!(" as {}", format.name()));
        format!("reading {}{form}", self.file.display())
    }

    fn text(&self) -> Result<String, Failure> {
        let size = std::fs::metadata(self.file).map(|data| data.len());
        if size.as_ref().is_ok_and(|size| *size > TABLE_FILE_LIMIT_BYTES) {
            let what = format!(
                "{}: larger than {TABLE_FILE_LIMIT_BYTES} bytes; cut it into parts",
                self.reading(None)
            );
            return Err(Failure::Input(anyhow!(what)));
        }
        let bytes = std::fs::read(self.file).with_context(|| self.reading(None)).map_err(Failure::Input)?;
        // The bytes tell a format that is none of text.
        let form = Format::of(&bytes).err();
        spreadsheet::decoded(bytes).map_err(|what| {
            let error = form.map_or_else(|| anyhow!("the file is {what}"), Into::into);
            Failure::Input(error.context(self.reading(None)))
        })
    }

    /// The keypoints in metres from a tracker's marks in the picture.
    fn import_marks(
        &self,
        marks: Marks,
        config: &ExtractionConfig,
        notes: &mut Vec<String>,
    ) -> Result<Imported, Failure> {
        let in_file =
            |error| Failure::Input(anyhow::Error::new(error).context(self.file.display().to_string()));
        if self.y_down {
            return Err(Failure::Input(anyhow!(
                "--y-down is for WCON: that a picture's rows grow downward is known"
            )));
        }
        let least_likelihood = Share::new(self.least_likelihood).map(Share::get).ok_or_else(|| {
            Failure::Input(anyhow!("--least-likelihood {} must be between 0 and 1", self.least_likelihood))
        })?;
        let std_px = positive("--std-px", self.std_px)?;
        let plane =
            config.plane().with_context(|| self.config.display().to_string()).map_err(Failure::Input)?;
        let keypoints = marks::chosen(&marks.parts, self.keypoints).map_err(in_file)?;
        let times_s = marks.times_s(&self.times(config, notes)?).map_err(in_file)?;
        match std_px {
            Some(std_px) => notes.push(format!("std: {std_px} px, as --std-px says")),
            None => notes.push(
                "std: none written, trackers give none; `rig fit` takes the noise from the keypoints".into(),
            ),
        }
        Ok(marks.imported(&keypoints, &times_s, &plane, least_likelihood, std_px))
    }

    /// What says when images were taken: `--times`, `--fps`, a table that `rig export dlc` left beside the file, the config.
    fn times(&self, config: &ExtractionConfig, notes: &mut Vec<String>) -> Result<Times, Failure> {
        let beside = frames_file(self.file);
        let table = match (self.times, self.fps) {
            (Some(table), _) => Some(table),
            (None, None) if beside.is_file() => Some(beside.as_path()),
            _ => None,
        };
        if let Some(table) = table {
            notes.push(format!("times: from {}", table.display()));
            return folder::table(table).map(Times::Table).map_err(Failure::input);
        }
        let (fps, whose) = match (positive("--fps", self.fps)?, config.fps()) {
            (Some(fps), _) => (fps, "--fps"),
            (None, Some(fps)) => (fps, "[camera] fps"),
            (None, None) => {
                let what = format!(
                    "{} does not say when its images were taken: give --fps, a table --times (file,time_s), or [camera] fps in {}",
                    self.file.display(),
                    self.config.display()
                );
                return Err(Failure::Input(anyhow!(what)));
            }
        };
        notes.push(format!("times: image number / {fps} s, by {whose}"));
        Ok(Times::Rate(fps))
    }

    /// Keypoints of lines that lie in the plane of motion already.
    fn lines(
        &self,
        document: &Document,
        config: &ExtractionConfig,
        notes: &mut Vec<String>,
    ) -> Result<Imported, Failure> {
        for (option, given) in [
            ("--std-px", self.std_px.is_some()),
            ("--fps", self.fps.is_some()),
            ("--times", self.times.is_some()),
        ] {
            if given {
                return Err(Failure::Input(anyhow!(
                    "{option} is of no use: WCON has metres and seconds of its own"
                )));
            }
        }
        let in_file =
            |error| Failure::Input(anyhow::Error::new(error).context(self.file.display().to_string()));
        notes.push(format!("y of the file is taken as {}", if self.y_down { "downward" } else { "upward" }));
        if !document.series.is_empty() {
            notes.push(format!("the file is one of a series: {} are not read", document.series.join(", ")));
        }
        if let Some(asked) = self.keypoints {
            return document.one_each(asked).map_err(in_file);
        }
        if let (Some(names), Ok(_)) = (&document.keypoints, document.animal(self.individual)) {
            notes.push(format!("its points are the keypoints {}", names.join(", ")));
            return document.imported(self.individual, &[]).map_err(in_file);
        }
        let shares = shares(config, self.model)?;
        notes.push(format!("P0..P{} at shares {shares:.4?} of the line", shares.len() - 1));
        document.imported(self.individual, &shares).map_err(in_file)
    }
}

/// Where P0..Pn lie on the line, as shares of its length: what `[vision]` says, or the model.
fn shares(config: &ExtractionConfig, model: Option<&Path>) -> Result<Vec<f64>, Failure> {
    let path = model.map(Path::to_owned).or(config.model());
    let model = path.as_deref().map(super::read_model).transpose()?;
    // On a line nothing depends on how it was found.
    let mode = config.vision.mode.or(model.is_none().then_some(Mode::Arc));
    let vision = VisionConfig { mode, ..config.vision.clone() };
    let outline = Outline::new(&vision, model.as_ref()).map_err(Failure::input)?;
    if outline.mode.is_free() {
        return Err(Failure::Input(anyhow!(
            "a line has no keypoints of a free body; state [vision] `mode` = \"arc\" and `links`"
        )));
    }
    match outline.lengths_m {
        // A line that others drew ends at P0 and Pn; how far links reach past them is not in it.
        Some(lengths_m) if config.vision.shares.is_none() => {
            let total: f64 = lengths_m.iter().sum();
            let mut at = 0.0;
            let next = lengths_m.iter().map(|length| {
                at += length;
                at / total
            });
            Ok(std::iter::once(0.0).chain(next).collect())
        }
        _ => Ok(outline.shares),
    }
}

fn positive(option: &str, value: Option<f64>) -> Result<Option<f64>, Failure> {
    match value.map(|value| (value, Positive::new(value))) {
        Some((value, None)) => Err(Failure::Input(anyhow!("{option} {value} must be finite and above 0"))),
        value => Ok(value.and_then(|(_, value)| value).map(Positive::get)),
    }
}

/// The table of images beside a file of keypoints.
pub fn frames_file(of: &Path) -> PathBuf {
    let mut path = of.as_os_str().to_owned();
    path.push(".frames.csv");
    path.into()
}

/// A table with a row for each image, and beside it what became of each.
#[derive(Debug)]
pub struct TableOfImages {
    table: OutputFile,
    images: OutputFile,
}

impl TableOfImages {
    /// One at `path`, which is asked for of `outputs`, and `<path>.frames.csv`.
    ///
    /// # Errors
    /// [`OutputError`] where it may not be there.
    pub fn at(path: &Path, outputs: &mut Outputs) -> Result<Self, OutputError> {
        Ok(Self { table: outputs.file(path)?, images: outputs.file(&frames_file(path))? })
    }

    /// Writes both.
    ///
    /// # Errors
    /// [`Failure::Input`] where one cannot be written.
    pub fn write<'a>(
        &self,
        table: &[u8],
        images: impl IntoIterator<Item = (&'a str, f64, Status, &'a str)>,
    ) -> Result<(), Failure> {
        self.table.write(table).map_err(Failure::input)?;
        let mut bytes = Vec::new();
        output::write_frames(images, &mut bytes).map_err(Failure::internal)?;
        self.images.write(&bytes).map_err(Failure::input)
    }
}

/// A trajectory to hand over: that of a run folder, or a file.
#[derive(Debug)]
pub struct Export<'a> {
    /// The run folder, the folder of a replay, or the trajectory itself.
    pub from: &'a Path,
    /// Any rig config with the calibration; left out: the run's own.
    pub config: Option<&'a Path>,
}

impl Export<'_> {
    /// Where the trajectory is.
    ///
    /// # Errors
    /// [`Failure::Data`] where a folder holds none.
    pub fn path(&self) -> Result<PathBuf, Failure> {
        if !self.from.is_dir() {
            return Ok(self.from.into());
        }
        let path = self.from.join(file::TRAJECTORY);
        if path.is_file() {
            return Ok(path);
        }
        let what = format!(
            "{} holds no {}; extract it first with `rig replay`",
            self.from.display(),
            file::TRAJECTORY
        );
        Err(Failure::Data(anyhow!(what)))
    }

    fn trajectory(&self) -> Result<Trajectory, Failure> {
        ident::table::read_trajectory(&self.path()?).map_err(Failure::input)
    }

    fn run(&self) -> Option<RunFolder> {
        RunFolder::open(self.from).ok()
    }

    fn plane(&self) -> Result<Plane, Failure> {
        let config = match (self.config, self.run()) {
            (Some(config), _) => ExtractionConfig::read(config),
            (None, Some(run)) => ExtractionConfig::parse(&run.start().config, &run.file(file::START)),
            (None, None) => {
                let what = format!(
                    "{} is no run folder: say with --config which calibration it was filmed with",
                    self.from.display()
                );
                return Err(Failure::Input(anyhow!(what)));
            }
        };
        let config = config.map_err(Failure::input)?;
        config.plane().context("putting keypoints back into the picture").map_err(Failure::Input)
    }

    /// Writes DeepLabCut's CSV, and the images' times beside it, which it has no place for.
    ///
    /// # Errors
    /// [`Failure`] where there is no trajectory or no calibration.
    pub fn dlc(&self, out: &TableOfImages) -> Result<(), Failure> {
        let (trajectory, plane) = (self.trajectory()?, self.plane()?);
        let text = dlc::text(&trajectory, &plane).map_err(Failure::input)?;
        let names: Vec<String> = (0..trajectory.time_s.len()).map(|image| image.to_string()).collect();
        let rows = names.iter().enumerate().map(|(image, name)| {
            let row = image * trajectory.keypoints.len()..(image + 1) * trajectory.keypoints.len();
            let is_gap = |place: &&[f64; 3]| plane.view().seen(**place).iter().any(|metres| metres.is_nan());
            let gaps = trajectory.position_m[row.clone()].iter().filter(is_gap).count();
            let status = match gaps {
                0 => Status::Ok,
                gaps if gaps < row.len() => Status::Doubtful,
                _ => Status::Rejected,
            };
            (
                name.as_str(),
                trajectory.time_s[image],
                status,
                if gaps > 0 { "gap in the trajectory" } else { "" },
            )
        });
        out.write(text.as_bytes(), rows)
    }

    /// WCON, the keypoints as the points of a line.
    ///
    /// # Errors
    /// [`Failure`] where there is no trajectory.
    pub fn wcon(&self) -> Result<Vec<u8>, Failure> {
        let trajectory = self.trajectory()?;
        let id = self.run().map_or_else(|| "rig".to_owned(), |run| run.start().id.to_string());
        let view = View::of(&trajectory);
        let line = |(time_s, row): (&f64, &[[f64; 3]])| {
            let point = |place: &[f64; 3]| {
                Some(view.seen(*place)).filter(|seen| seen.iter().all(|metres| metres.is_finite()))
            };
            Line { time_s: *time_s, points: row.iter().map(point).collect() }
        };
        let rows = trajectory.position_m.chunks(trajectory.keypoints.len().max(1));
        let lines = trajectory.time_s.iter().zip(rows).map(line).collect();
        let written = Written { id: &id, lines, keypoints: Some(&trajectory.keypoints), images: None };
        serde_json::to_vec(&wcon::document(&written)).map_err(Failure::internal)
    }
}
