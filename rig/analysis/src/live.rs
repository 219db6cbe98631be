//! Keypoints while the run is still filmed: a quiet thread takes the images as they come, so that little is left to do after
//! the last one. It gives what the recording would give, to the bit; and a first fit of what there is so far.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use ident::experiment::Method;
use sim::Trajectory;

use super::early::EarlyFit;
use super::experiment::{experiment, model};
use super::stored;
use super::timeline::Chronicle;
use crate::showing::Showing;
use camera::CameraImage;
use camera::calibration::Plane;
use config::RigConfig;
use ground::clock::MonotonicNs;
use ground::urgency::Urgency;
use images::live::{Feed, LiveImages, live};
use record::folder::RunFolder;
use vision::extractor::{Extractor, LEARN_FROM};
use vision::record::trajectory;
use vision::sequence::drive;
use vision::{ImageRecord, Task};

/// Images looked at together.
const IMAGES_AT_ONCE: usize = 4;

/// An extraction under way beside the filming.
#[derive(Debug)]
pub struct Live {
    images: Feed,
    fit: Sender<Chronicle>,
    thread: JoinHandle<Option<Begun>>,
}

/// As far as it got.
#[derive(Debug)]
pub(super) struct Begun {
    /// Knows the empty tank.
    pub(super) extractor: Extractor,
    /// One for each usable image that was looked at.
    pub(super) records: Vec<ImageRecord>,
    /// Their lines in `extraction.jsonl`.
    pub(super) lines: Vec<u8>,
    /// The usable images after them.
    pub(super) left: Vec<Arc<CameraImage>>,
    /// A fit of some of them.
    pub(super) early: Option<EarlyFit>,
}

impl Live {
    /// Begins for `run`, which is filmed; none with a calibration that cannot be used, which the analysis will say. Of so many `threads`
    /// one is left to servo, camera and the kernel that carries their bytes: images that are late are looked at by all of them afterwards.
    /// `paths_from`: the folder that paths in `config` start from; what is found is shown by `showing`.
    pub fn start(
        run: &RunFolder,
        config: &RigConfig,
        paths_from: &Path,
        threads: usize,
        showing: Showing,
    ) -> Option<Self> {
        let (feed, images) = live(run.origin());
        let (fit, fits) = channel();
        let follower = Follower {
            run: run.clone(),
            config: config.clone(),
            plane: config.calibration.plane(paths_from).ok()?,
            folder: paths_from.into(),
            fits,
            showing,
        };
        let thread = std::thread::spawn(move || {
            // the pool's threads inherit it
            Urgency::Computing.take();
            let threads = threads.saturating_sub(1).max(1);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
            pool.install(|| follower.follow(images))
        });
        Some(Self { images: feed, fit, thread })
    }

    /// The next image received.
    pub fn image(&mut self, image: &Arc<CameraImage>) {
        self.images.image(image);
    }

    /// The empty tank is to be learned from these of the images received.
    pub fn learn(&mut self, from: Range<u64>) {
        self.images.learn(from);
    }

    /// Enough of the run has been seen for a first fit, with what the `chronicle` says of it so far.
    pub fn fit(&mut self, chronicle: Chronicle) {
        // A follower that has ended has nothing to give, which shows at the end.
        let _ = self.fit.send(chronicle);
    }

    /// What came of it, if it took in all of the usable images, whose times \[s\] are `times_s`; `origin` is the run's.
    pub(super) fn finish(self, times_s: &[f64], origin: MonotonicNs) -> Option<Begun> {
        let whole = self.images.is_whole();
        drop(self.images);
        let begun = self.thread.join().ok().flatten().filter(|_| whole)?;
        let looked_at = begun.records.iter().map(|record| record.time_s);
        let left = begun.left.iter().map(|image| image.mid_exposure.seconds_since(origin));
        looked_at.chain(left).eq(times_s.iter().copied()).then_some(begun)
    }
}

struct Follower {
    run: RunFolder,
    config: RigConfig,
    plane: Plane,
    folder: PathBuf,
    /// Fits to begin once the images have been caught up with.
    fits: Receiver<Chronicle>,
    showing: Showing,
}

impl Follower {
    /// None where the empty tank was not learned or a record cannot be kept: the analysis will try again and say why.
    fn follow(self, mut images: LiveImages) -> Option<Begun> {
        let sample = images.sample(LEARN_FROM)?;
        let model = model(&self.run).ok()?;
        let mut task = Task::new(&self.config.vision, Some(&model), self.plane.clone(), &self.folder).ok()?;
        let names = task.outline.keypoints();
        let mut extractor = task.learn(&sample).ok()?;
        drop(sample);
        let (mut records, mut lines, mut early) = (Vec::new(), Vec::new(), None);
        let waiting = images.waiting();
        self.showing.keypoints(&names, self.plane.view());
        drive(&mut extractor, images.by_ref().map(Ok), IMAGES_AT_ONCE, |images, mut found| {
            self.showing.found(images, &found);
            lines.append(&mut stored::lines(&found)?);
            records.append(&mut found);
            if waiting.count() < IMAGES_AT_ONCE
                && let Ok(chronicle) = self.fits.try_recv()
            {
                early = self.begin_fit(trajectory(&records, &names, self.plane.view()), chronicle);
            }
            Ok::<(), serde_json::Error>(())
        })
        .ok()?;
        Some(Begun { extractor, records, lines, left: images.left(), early })
    }

    /// Fits what has been seen so far; none where that cannot be done, or where the fit of the whole begins elsewhere.
    fn begin_fit(&self, seen: Trajectory, chronicle: Chronicle) -> Option<EarlyFit> {
        if self.config.fit.method != Method::Hybrid {
            return None;
        }
        let timeline = chronicle.timeline(&self.config).ok()?;
        let experiment = experiment(&self.run, &self.config, &timeline, seen).ok()?;
        Some(EarlyFit::begin(experiment, self.showing.clone()))
    }
}

#[cfg(test)]
mod tests;
