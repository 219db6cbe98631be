//! Keypoints while the run is still filmed: a low-priority thread processes the images as they arrive, so that little is left to do after
//! the last one. It gives what the recording would give, to the bit; and a first fit of what there is so far.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use ident::experiment::Method;
use sim::Trajectory;

use super::early::EarlyFit;
use super::experiment::{experiment, model};
use super::timeline::TimelineBuilder;
use crate::showing::Showing;
use camera::calibration::Plane;
use config::RigConfig;
use ground::urgency::Urgency;
use images::live::{Feed, LeftImages, LiveImages, live};
use record::folder::RunFolder;
use run::listener::{Listener, Notice};
use vision::Task;
use vision::extractor::LEARN_FROM;
use vision::record::trajectory;
use vision::sequence::Begun;

/// Images looked at together.
const IMAGES_AT_ONCE: usize = 4;

/// Extraction and first fit during the filming of a run.
#[derive(Debug)]
pub struct Live {
    config: RigConfig,
    paths_from: PathBuf,
    threads: usize,
    fits: bool,
    showing: Showing,
    /// Images, events and commands since the run began.
    pub(super) builder: Option<TimelineBuilder>,
    /// The extraction; none with a calibration that cannot be used, which the analysis will say.
    extraction: Option<LiveExtraction>,
}

/// An extraction under way in a thread of its own.
#[derive(Debug)]
struct LiveExtraction {
    images: Feed,
    fit: Sender<TimelineBuilder>,
    thread: JoinHandle<Option<Head>>,
}

/// The part of the extraction done during the filming.
#[derive(Debug)]
pub(super) struct Head {
    /// The extraction of the usable images that were looked at.
    pub(super) begun: Begun,
    /// The usable images after them, not processed yet.
    pub(super) left: LeftImages,
    /// A fit of some of them.
    pub(super) early: Option<EarlyFit>,
}

impl Live {
    /// Beside a run of `config`, whose relative paths start at `paths_from`. Of so many `threads` one is left to servo, camera and the
    /// kernel that carries their bytes: images that are late are looked at by all of them afterwards. `fits`: a first fit is wanted too.
    /// What is found is shown by `showing`.
    pub fn new(config: &RigConfig, paths_from: &Path, threads: usize, fits: bool, showing: Showing) -> Self {
        let (config, paths_from) = (config.clone(), paths_from.into());
        Self { config, paths_from, threads, fits, showing, builder: None, extraction: None }
    }

    fn start(&self, run: &RunFolder) -> Option<LiveExtraction> {
        let (images, filmed) = live(run.origin());
        let (fit, fits) = channel();
        let follower = Follower {
            run: run.clone(),
            config: self.config.clone(),
            plane: self.config.calibration.plane(&self.paths_from).ok()?,
            folder: self.paths_from.clone(),
            fits,
            showing: self.showing.clone(),
        };
        let threads = self.threads.saturating_sub(1).max(1);
        let thread = std::thread::spawn(move || {
            // the pool's threads inherit it
            Urgency::Computing.take();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
            pool.install(|| follower.follow(filmed))
        });
        Some(LiveExtraction { images, fit, thread })
    }

    /// What came of the extraction, if it took in all of the usable images, whose times \[s\] are `times_s`.
    pub(super) fn finish(self, times_s: &[f64]) -> Option<Head> {
        let LiveExtraction { images, thread, .. } = self.extraction?;
        let whole = images.is_whole();
        drop(images);
        let head = thread.join().ok().flatten().filter(|_| whole)?;
        let looked_at = head.begun.records().iter().map(|record| record.time_s);
        looked_at.chain(head.left.times_s()).eq(times_s.iter().copied()).then_some(head)
    }
}

impl Listener for Live {
    fn begins(&mut self, run: &RunFolder) {
        self.builder = Some(TimelineBuilder::new(run.origin()));
        self.extraction = self.start(run);
    }

    fn hear(&mut self, notice: &Notice) {
        let Some(builder) = &mut self.builder else { return };
        match notice {
            Notice::Image(image) => builder.image(image),
            Notice::Servo(event) => builder.servo(event),
            Notice::Command(command) => builder.command(command),
            _ => {}
        }
        let Some(extraction) = &mut self.extraction else { return };
        match notice {
            Notice::Image(image) => extraction.images.image(image),
            Notice::Learn(from) => extraction.images.learn(from.clone()),
            // a thread that has ended has nothing to give, which shows at the end
            Notice::Fit if self.fits => drop(extraction.fit.send(builder.clone())),
            _ => {}
        }
    }
}

struct Follower {
    run: RunFolder,
    config: RigConfig,
    plane: Plane,
    folder: PathBuf,
    /// Fits to begin once the images have been caught up with.
    fits: Receiver<TimelineBuilder>,
    showing: Showing,
}

impl Follower {
    /// None where the empty tank was not learned: the analysis will try again and say why.
    fn follow(self, mut images: LiveImages) -> Option<Head> {
        let sample = images.sample(LEARN_FROM)?;
        let model = model(&self.run).ok()?;
        let mut task = Task::new(&self.config.vision, Some(&model), self.plane.clone(), &self.folder).ok()?;
        let names = task.outline.keypoints();
        let mut begun = task.learn(&sample).ok()?;
        drop(sample);
        let mut early = None;
        let waiting = images.waiting();
        self.showing.keypoints(&names, self.plane.view());
        loop {
            let mut timed = images.by_ref().map(Ok::<_, Infallible>);
            let Ok(Some((looked_at, found))) = begun.take(&mut timed, IMAGES_AT_ONCE) else { break };
            self.showing.found(&looked_at, found);
            if waiting.count() < IMAGES_AT_ONCE
                && let Ok(builder) = self.fits.try_recv()
            {
                early = self.begin_fit(trajectory(begun.records(), &names, self.plane.view()), builder);
            }
        }
        Some(Head { begun, left: images.left(), early })
    }

    /// Fits what has been observed so far; none where that cannot be done, or where the fit of the whole begins elsewhere.
    fn begin_fit(&self, observed: Trajectory, builder: TimelineBuilder) -> Option<EarlyFit> {
        if self.config.fit.method != Method::Hybrid {
            return None;
        }
        let timeline = builder.timeline(&self.config).ok()?;
        let experiment = experiment(&self.run, &self.config, &timeline, observed).ok()?;
        Some(EarlyFit::begin(experiment, self.showing.clone()))
    }
}

#[cfg(test)]
mod tests;
