//! Keypoints while the run is still filmed: a quiet thread takes the images as they come, so that little is left to do after
//! the last one. It gives what the recording would give, to the bit; and a first fit of what there is so far.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use ident::experiment::Method;

use super::early::EarlyFit;
use super::experiment::experiment;
use super::sampled::sampled;
use super::stored;
use super::timeline::{Chronicle, Rising};
use crate::calibration::Plane;
use crate::camera::CameraImage;
use crate::clock::MonotonicNs;
use crate::config::RigConfig;
use crate::images::TimedImage;
use crate::images::recording::timed;
use crate::record::folder::RunFolder;
use crate::vision::ImageRecord;
use crate::vision::extractor::Extractor;
use crate::vision::record::trajectory;

/// Bytes of images that may wait for their turn; with more, they are taken from the recording afterwards.
const MOST_WAITING: usize = 1 << 30;
/// Images between two looks at what has come.
const AT_ONCE: usize = 4;
/// How far behind the devices' threads the scheduler puts this one, as `nice` counts.
const QUIET: i32 = 10;

/// An extraction under way beside the filming.
#[derive(Debug)]
pub struct Live {
    /// None once more images waited than may.
    told: Option<Sender<Told>>,
    waiting: Arc<AtomicUsize>,
    thread: JoinHandle<Option<Begun>>,
}

/// As far as it got.
#[derive(Debug)]
pub struct Begun {
    /// Knows the empty tank.
    pub extractor: Extractor,
    /// One for each usable image that was looked at.
    pub records: Vec<ImageRecord>,
    /// Their lines in `extraction.jsonl`.
    pub lines: Vec<u8>,
    /// The usable images after them.
    pub left: Vec<TimedImage>,
    /// A fit of some of them.
    pub early: Option<EarlyFit>,
}

#[derive(Debug)]
enum Told {
    Image(Arc<CameraImage>),
    Learn(Range<u64>),
    Fit(Box<Chronicle>),
}

impl Live {
    /// Begins for `run`, which is filmed; none with a calibration that cannot be used, which the analysis will say.
    /// `paths_from`: the folder that paths in `config` start from.
    pub fn start(run: &RunFolder, config: &RigConfig, paths_from: &Path, threads: usize) -> Option<Self> {
        let (told, heard) = channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let mut follower = Follower {
            run: run.clone(),
            config: config.clone(),
            plane: config.calibration.plane(paths_from).ok()?,
            folder: paths_from.into(),
            origin: run.origin(),
            threads,
            waiting: Arc::clone(&waiting),
            rising: Rising::default(),
            received: 0,
            usable: VecDeque::new(),
            extractor: None,
            records: Vec::new(),
            lines: Vec::new(),
            fit: None,
            early: None,
        };
        let thread = std::thread::spawn(move || {
            // Without it the extraction is merely less polite.
            let _ = rustix::process::nice(QUIET);
            follower.follow(&heard)
        });
        Some(Self { told: Some(told), waiting, thread })
    }

    /// The next image received.
    pub fn image(&mut self, image: &Arc<CameraImage>) {
        if self.waiting.fetch_add(image.data.len(), Ordering::Relaxed) > MOST_WAITING {
            self.told = None;
        }
        self.tell(Told::Image(Arc::clone(image)));
    }

    /// The empty tank is to be learned from these of the images received.
    pub fn learn(&mut self, from: Range<u64>) {
        self.tell(Told::Learn(from));
    }

    /// Enough of the run has been seen for a first fit, with what the `chronicle` says of it so far.
    pub fn fit(&mut self, chronicle: Chronicle) {
        self.tell(Told::Fit(Box::new(chronicle)));
    }

    fn tell(&mut self, told: Told) {
        // A follower that has ended has nothing to give, which shows at the end.
        if let Some(sender) = &self.told {
            let _ = sender.send(told);
        }
    }

    /// What came of it, if it took in all of the usable images, whose times \[s\] are `times_s`.
    pub fn finish(self, times_s: &[f64]) -> Option<Begun> {
        drop(self.told?);
        let begun = self.thread.join().ok().flatten()?;
        let looked_at = begun.records.iter().map(|record| record.time_s);
        let all = looked_at.chain(begun.left.iter().map(|image| image.time_s));
        all.eq(times_s.iter().copied()).then_some(begun)
    }
}

struct Follower {
    run: RunFolder,
    config: RigConfig,
    plane: Plane,
    folder: PathBuf,
    origin: MonotonicNs,
    threads: usize,
    /// Bytes that wait here and on the way here.
    waiting: Arc<AtomicUsize>,
    rising: Rising,
    received: u64,
    /// Usable images with their places among all received.
    usable: VecDeque<(u64, Arc<CameraImage>)>,
    extractor: Option<Extractor>,
    records: Vec<ImageRecord>,
    lines: Vec<u8>,
    /// For a fit to begin once the images have been caught up with.
    fit: Option<Box<Chronicle>>,
    early: Option<EarlyFit>,
}

impl Follower {
    /// None where the empty tank was not learned or a record cannot be kept.
    fn follow(&mut self, heard: &Receiver<Told>) -> Option<Begun> {
        loop {
            let ready = self.extractor.is_some() && self.usable.len() >= AT_ONCE;
            if self.extractor.is_some()
                && !ready
                && let Some(chronicle) = self.fit.take()
            {
                self.early = self.begin_fit(*chronicle);
            }
            let told = if ready { heard.try_recv() } else { heard.recv().map_err(TryRecvError::from) };
            match told {
                Ok(Told::Image(image)) => {
                    if self.rising.takes(image.mid_exposure) {
                        self.usable.push_back((self.received, image));
                    } else {
                        self.waiting.fetch_sub(image.data.len(), Ordering::Relaxed);
                    }
                    self.received += 1;
                }
                Ok(Told::Learn(from)) => self.learn(&from)?,
                Ok(Told::Fit(chronicle)) => self.fit = Some(chronicle),
                Err(TryRecvError::Empty) => self.look()?,
                Err(TryRecvError::Disconnected) => {
                    let left = self.next(self.usable.len());
                    let (records, lines) =
                        (std::mem::take(&mut self.records), std::mem::take(&mut self.lines));
                    let (extractor, early) = (self.extractor.take()?, self.early.take());
                    return Some(Begun { extractor, records, lines, left, early });
                }
            }
        }
    }

    /// None where that fails: the analysis will try again and say why.
    fn learn(&mut self, from: &Range<u64>) -> Option<()> {
        let sample = sampled(self.usable.make_contiguous(), |(index, _)| *index, Some(from));
        let sample: Vec<TimedImage> =
            sample.into_iter().map(|(_, image)| timed(image, self.origin)).collect();
        let sample: Vec<&TimedImage> = sample.iter().collect();
        let (config, plane) = (&self.config.vision, self.plane.clone());
        self.extractor = Some(Extractor::learn(&sample, config, plane, &self.folder, self.threads).ok()?);
        Some(())
    }

    /// Looks at the next images.
    fn look(&mut self) -> Option<()> {
        let images = self.next(AT_ONCE);
        if let Some(extractor) = &mut self.extractor {
            let mut records = extractor.push(&images);
            self.lines.append(&mut stored::lines(&records).ok()?);
            self.records.append(&mut records);
        }
        Some(())
    }

    /// Fits what has been seen so far; none where that cannot be done, or where the fit of the whole begins elsewhere.
    fn begin_fit(&self, chronicle: Chronicle) -> Option<EarlyFit> {
        if self.config.fit.method != Method::Hybrid {
            return None;
        }
        let timeline = chronicle.timeline(&self.config).ok()?;
        let seen = trajectory(&self.records, self.config.vision.links);
        Some(EarlyFit::begin(experiment(&self.run, &self.config, &timeline, seen).ok()?, self.threads))
    }

    fn next(&mut self, count: usize) -> Vec<TimedImage> {
        let (waiting, origin) = (&self.waiting, self.origin);
        let images = self.usable.drain(..count).map(|(_, image)| {
            waiting.fetch_sub(image.data.len(), Ordering::Relaxed);
            timed(&image, origin)
        });
        images.collect()
    }
}

#[cfg(test)]
mod tests;
