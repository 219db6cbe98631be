//! The recorded images: through the extraction, and a few of them into the report.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use ident::fit::{Fitted, FittedRun};
use image::GrayImage;

use super::error::AnalysisError;
use super::live::Begun;
use super::sampled::sampled;
use super::timeline::{ImageTime, Timeline, USABLE};
use crate::calibration::Plane;
use crate::images::TimedImage;
use crate::images::recording::timed;
use crate::record::folder::{RunFolder, file};
use crate::record::reader::{Item, Recording};
use crate::report::{Overlay, ReportData};
use crate::tank::render::{Look, Renderer};
use crate::vision::extractor::Extractor;
use crate::vision::{Extraction, ImageRecord, Mask, Status, VisionConfig};

/// Images whose pictures are held in memory at once.
const AT_ONCE: usize = 64;
/// Images shown in a report with what was found in them.
const SHOWN: usize = 6;
/// Centrelines drawn for the superimposed motion.
const CENTRELINES: usize = 40;

/// The usable images of a recorded run.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// The run.
    pub run: &'a RunFolder,
    /// Its images' times.
    pub timeline: &'a Timeline,
}

/// How keypoints are extracted.
pub struct Task<'a> {
    /// The `[vision]` table.
    pub config: &'a VisionConfig,
    /// The folder that paths in it start from.
    pub folder: &'a Path,
    /// From pixels to metres.
    pub plane: Plane,
    /// The silhouettes of all usable images, where they are given and not looked for.
    pub masks: Option<Vec<Option<Mask>>>,
    /// Which of the images received the empty tank is learned from; all, where nobody says.
    pub learn_from: Option<Range<u64>>,
}

impl Task<'_> {
    /// Extracts the keypoints of all images of `source`, going on from what was `begun` while it was filmed; `progress` hears
    /// how many are done.
    ///
    /// # Errors
    /// [`AnalysisError`] when the recording cannot be read or its images cannot be told from their background.
    pub fn carry_out(
        self,
        source: Source<'_>,
        begun: Option<Begun>,
        threads: usize,
        mut progress: impl FnMut(usize),
    ) -> Result<Extraction, AnalysisError> {
        let usable = source.usable();
        let (mut extractor, mut records, left) = match begun {
            Some(Begun { extractor, records, left, .. }) => {
                (extractor.with_threads(threads), records, Some(left))
            }
            None => {
                let sample = sampled(&usable, |image| image.index as u64, self.learn_from.as_ref());
                let sample = source.load(sample.into_iter().copied())?;
                let sample: Vec<&TimedImage> = sample.iter().collect();
                let (config, plane) = (self.config, self.plane.clone());
                (Extractor::learn(&sample, config, plane, self.folder, threads)?, Vec::new(), None)
            }
        };
        let mut waiting: Vec<TimedImage> = Vec::with_capacity(AT_ONCE);
        let mut take_in = |waiting: &mut Vec<TimedImage>| {
            let mut found = match &self.masks {
                Some(masks) => extractor.push_with_masks(waiting, &masks[records.len()..]),
                None => extractor.push(waiting),
            };
            records.append(&mut found);
            waiting.clear();
            progress(records.len());
        };
        let take = |image| {
            waiting.push(image);
            if waiting.len() == AT_ONCE {
                take_in(&mut waiting);
            }
        };
        match left {
            Some(left) => left.into_iter().for_each(take),
            None => source.each(usable.iter().copied(), take)?,
        }
        take_in(&mut waiting);
        Ok(Extraction::of(records, self.config.links, self.plane))
    }
}

impl<'a> Source<'a> {
    /// How many usable images there are.
    pub fn count(self) -> usize {
        self.usable().len()
    }

    /// When each usable image was exposed \[s\].
    pub fn times_s(self) -> Vec<f64> {
        self.usable().iter().map(|image| image.row.time_s).collect()
    }

    /// Puts some images with what was found in them, the first pose, and centrelines into a report.
    ///
    /// # Errors
    /// [`AnalysisError`] when the recording cannot be read again.
    pub fn show(
        self,
        data: &mut ReportData,
        extraction: &Extraction,
        fitted: &Fitted,
    ) -> Result<(), AnalysisError> {
        let usable = self.usable();
        let shown = worth_showing(extraction);
        let images = self.load(shown.iter().map(|&index| usable[index]))?;
        data.overlays = shown
            .iter()
            .zip(&images)
            .filter_map(|(&index, image)| {
                Some(overlay(image.grey.as_ref().ok()?, &extraction.records[index]))
            })
            .collect();
        let Some(figures) = data.runs.first_mut() else { return Ok(()) };
        figures.measured_pose = data.overlays.first().cloned();
        figures.centrelines_m = extraction
            .records
            .iter()
            .step_by(extraction.records.len().div_ceil(CENTRELINES).max(1))
            .map(|record| record.centreline.iter().map(|&px| extraction.plane.metres(px)).collect())
            .collect();
        if let (Some(pose), Some(run)) = (&figures.measured_pose, fitted.runs.first()) {
            figures.simulated_pose = Some(drawn(fitted, run, &pose.image, &extraction.plane));
        }
        Ok(())
    }

    fn usable(self) -> Vec<&'a ImageTime> {
        self.timeline.images.iter().filter(|image| image.row.status == USABLE).collect()
    }

    fn load<'i>(self, wanted: impl Iterator<Item = &'i ImageTime>) -> Result<Vec<TimedImage>, AnalysisError> {
        let mut images = Vec::new();
        self.each(wanted, |image| images.push(image))?;
        Ok(images)
    }

    /// Decodes the `wanted` images, which rise in index, and hands them on.
    fn each<'i>(
        self,
        mut wanted: impl Iterator<Item = &'i ImageTime>,
        mut take: impl FnMut(TimedImage),
    ) -> Result<(), AnalysisError> {
        let Some(mut next) = wanted.next() else { return Ok(()) };
        let mut index = 0;
        for item in Recording::open(&self.run.file(file::RECORDING))? {
            let (_, Item::Image(image)) = item? else { continue };
            if index == next.index {
                take(timed(&image, self.run.origin()));
                match wanted.next() {
                    Some(image) => next = image,
                    None => break,
                }
            }
            index += 1;
        }
        Ok(())
    }
}

/// The fitted model in its initial pose, as the camera would see it.
fn drawn(fitted: &Fitted, run: &FittedRun, like: &GrayImage, plane: &Plane) -> GrayImage {
    let look = Look::plain(like.width(), like.height());
    Renderer::new(plane.clone(), look).draw(&fitted.model, &run.initial.qpos)
}

/// The first image, evenly spread ones, and the first rejected one: an index into the records each.
fn worth_showing(extraction: &Extraction) -> BTreeSet<usize> {
    let records = &extraction.records;
    let spread = (0..SHOWN - 1).map(|k| k * (records.len() - 1) / (SHOWN - 1).max(1));
    let rejected = records.iter().position(|record| record.status == Status::Rejected);
    spread.chain(rejected).collect()
}

fn overlay(image: &GrayImage, record: &ImageRecord) -> Overlay {
    Overlay {
        time_s: record.time_s,
        image: image.clone(),
        mask: record.mask.as_ref().map(|mask| mask.picture(image.width(), image.height())),
        centreline_px: record.centreline.clone(),
        keypoints_px: record.keypoints.iter().enumerate().map(|(i, k)| (format!("P{i}"), k.px)).collect(),
        status: if record.reason.is_empty() { "ok".into() } else { record.reason.clone() },
    }
}
