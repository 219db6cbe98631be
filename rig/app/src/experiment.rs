//! One experiment from config to report, for `rig run` and `rig daemon`; the same analysis for a recorded run.

use std::path::Path;

use anyhow::anyhow;

use super::announce::count_down;
use super::{Failure, InRun, Interrupt, Watcher, on_threads, read_model, recover};
use crate::doctor::{self, Health};
use analysis::live::Live;
use analysis::{Analysis, AnalysisError, prepared};
use camera::CameraKind;
use config::RigConfig;
use ground::claim::Claim;
use record::folder::RunFolder;
use record::outputs::OutputFolder;
use record::stage::Stage;
use report::ReportData;
use run::listener::{Listener, Listeners, Notice};
use run::machine::Ending;
use run::{Conducted, Job, open};
use servo::PulseProfile;
use vision::{SequenceError, VisionError};

/// How far an experiment goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// Film only; extraction and fit are left to a replay.
    Film,
    /// Up to the keypoints.
    Keypoints,
    /// Up to the report.
    Report,
}

/// An experiment as its config describes it.
pub struct Experiment<'a> {
    /// The config.
    pub config: &'a RigConfig,
    /// The folder that relative paths in it start from.
    pub base: &'a Path,
    /// The folder of run folders.
    pub runs_dir: &'a Path,
    /// How far it goes.
    pub extent: Extent,
    /// What the servos play; none: the config's profile.
    pub motion: Option<PulseProfile>,
    /// Worker threads.
    pub threads: usize,
    /// Its motion is announced by a countdown: it is not begun by a person just now.
    pub announced: bool,
}

/// An experiment that was carried out.
pub struct Done {
    /// The run.
    pub conducted: Conducted,
    /// What its report shows, where it went as far as that.
    pub data: Option<ReportData>,
}

impl Experiment<'_> {
    /// Checks that the film can be extracted and fitted.
    ///
    /// # Errors
    /// [`Failure::Input`] where the config names what the model has not, or puts the mechanism outside of the picture; and for SAM 2, whose clicks are in a picture of a film.
    pub fn check(&self) -> Result<(), Failure> {
        if self.config.vision.sam2().is_some() && self.extent != Extent::Film {
            return Err(Failure::Input(anyhow!(
                "[vision] segmenter = \"sam2\" is for films that are recorded already: it is clicked in one of their images, and takes far \
                 longer than the filming; say \"classical\" here or `rig run --film-only`, then `rig replay RUN --config CONFIG --out DIR` \
                 with segmenter = \"sam2\" and the clicks in CONFIG"
            )));
        }
        let camera = &self.config.camera;
        // a recorded camera has the size that it was recorded with
        if self.extent != Extent::Film && camera.kind != CameraKind::Replay {
            let check =
                doctor::picture::calibration(self.config, self.base, [camera.width_px, camera.height_px]);
            if check.health == Health::Bad {
                return Err(Failure::Input(anyhow!("{}: {}", check.subject, check.finding)));
            }
        }
        if self.extent == Extent::Report {
            prepared(self.config, read_model(&self.base.join(&self.config.run.model))?)?;
        }
        Ok(())
    }

    /// Claims the folder of run folders, recovers what earlier runs left unfinished in it, and sees that there is room in it, and what
    /// [`Self::check`] sees.
    ///
    /// # Errors
    /// [`Failure::Input`] when another process has it, or it has no room.
    pub fn claim(&self) -> Result<Claim, Failure> {
        self.check()?;
        let claim = recover::claim(self.runs_dir)?;
        // room for a hold, while the disk has some
        open::latch(self.config, Some(self.runs_dir)).make_room().map_err(Failure::input)?;
        recover::all(self.runs_dir, &claim, |run, said| tracing::warn!("run {run} {said}"));
        for check in doctor::host::runs_folder(self.runs_dir, self.config.expected_bytes()) {
            if check.health == Health::Bad {
                return Err(Failure::Input(anyhow!("{}: {}", check.subject, check.finding)));
            }
        }
        Ok(claim)
    }

    /// Carries it out once.
    ///
    /// # Errors
    /// [`Failure`] by class; a run that has begun stays readable and is named by [`InRun`].
    pub async fn carry_out(&self, interrupt: &Interrupt, watcher: &mut dyn Watcher) -> Result<Done, Failure> {
        let job = Job {
            config: self.config,
            base: self.base,
            runs_dir: self.runs_dir,
            motion: self.motion.as_ref(),
        };
        if self.announced {
            count_down(self.config, self.runs_dir, interrupt, watcher).await?;
        }
        let mut showing = watcher.showing().of_run(self.config);
        let fits = self.extent == Extent::Report;
        let mut live = (self.extent != Extent::Film)
            .then(|| Live::new(self.config, self.base, self.threads, fits, watcher.showing()));
        let mut reporter = ProgressReporter { watcher, run: String::new(), phase: "" };
        let mut listeners = Listeners(vec![&mut reporter, &mut showing]);
        listeners.0.extend(live.as_mut().map(|live| live as &mut dyn Listener));
        let conducted = job.conduct(interrupt.raised(), &mut listeners).await.map_err(Failure::of_run)?;
        let folder = &conducted.folder;
        let in_run = InRun(folder.path().into());
        match &conducted.filmed.ending {
            Ending::Success => {}
            Ending::Abort(reason) => {
                return Err(Failure::Interrupted(anyhow!("aborted: {reason}").context(in_run)));
            }
            Ending::Fail(reason) => {
                return Err(Failure::Hardware(anyhow!("run incomplete: {reason}").context(in_run)));
            }
        }
        if self.extent == Extent::Film {
            return Ok(Done { conducted, data: None });
        }
        let results = OutputFolder::of_run(folder);
        let analysis = Analysis {
            run: folder,
            out: &results,
            config: self.config,
            paths_from: self.base,
            from: Stage::Frames,
            live,
        };
        if self.extent == Extent::Keypoints {
            let extract = || on_threads(self.threads, || Ok(analysis.keypoints(watcher)));
            let extracted = tokio::task::block_in_place(extract)?;
            watcher.clear();
            extracted.map_err(|error| analysis_failed(error, in_run))?;
            return Ok(Done { conducted, data: None });
        }
        let data = analysed(analysis, self.threads, interrupt, watcher)?;
        Ok(Done { conducted, data: Some(data) })
    }
}

/// Reports the progress of the filming.
struct ProgressReporter<'a> {
    watcher: &'a mut dyn Watcher,
    run: String,
    phase: &'static str,
}

impl Listener for ProgressReporter<'_> {
    fn begins(&mut self, run: &RunFolder) {
        self.run = run.start().id.to_string();
    }

    fn hear(&mut self, notice: &Notice) {
        match notice {
            Notice::Phase(phase, images) => {
                if *phase != self.phase {
                    self.watcher.event(&format!("{}  {phase}", self.run));
                    self.phase = phase;
                }
                self.watcher.status(format!("{phase}: {images} images"));
            }
            Notice::LetGo => self.watcher.alert("The water is still: let go of the mechanism now."),
            Notice::FallsBehind(behind) => tracing::warn!("{behind}"),
            Notice::Journal(text) => tracing::info!("{text}"),
            _ => {}
        }
    }
}

/// Carries out `analysis` on so many threads.
///
/// # Errors
/// [`Failure`] by class, [`Failure::Interrupted`] too when a signal has made the fit end with its best so far: what was asked for
/// is not there, though all files are.
pub fn analysed(
    analysis: Analysis<'_>,
    threads: usize,
    interrupt: &Interrupt,
    watcher: &mut dyn Watcher,
) -> Result<ReportData, Failure> {
    let (run, out) = (InRun(analysis.run.path().into()), analysis.out.path().to_owned());
    let analysed = tokio::task::block_in_place(|| on_threads(threads, || Ok(analysis.carry_out(watcher))));
    watcher.clear();
    let data = match analysed? {
        Ok(data) => data,
        Err(error) => return Err(analysis_failed(error, run)),
    };
    if interrupt.is_raised() {
        let text = report::written(&data, &out);
        return Err(Failure::Interrupted(
            anyhow!("interrupted; the best so far is written\n{text}").context(run),
        ));
    }
    Ok(data)
}

fn analysis_failed(error: AnalysisError, run: InRun) -> Failure {
    let lacking = match &error {
        AnalysisError::Images(SequenceError::Vision(VisionError::Sam2(_))) => false,
        AnalysisError::Images(SequenceError::Vision(_)) => true,
        AnalysisError::Fit(error) => error.is_lack_of_data(),
        AnalysisError::NothingMoved => true,
        _ => false,
    };
    Failure::data_if(lacking, anyhow::Error::new(error).context(run))
}
