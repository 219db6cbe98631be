//! A few of the recorded images in the report.

use std::collections::{BTreeMap, BTreeSet};

use ident::fit::{Fitted, FittedRun};
use image::GrayImage;
use sim::Command;

use super::error::AnalysisError;
use super::strip;
use camera::calibration::Plane;
use images::TimedImage;
use images::recording::RecordedImages;
use report::{Overlay, RefusedImages, ReportData};
use tank::render::{Look, Renderer};
use vision::contact_sheet::MOST_SHOWN;
use vision::refused::refused;
use vision::{Extraction, ImageRecord, SequenceError, Status};

/// Images shown in a report with what was found in them.
const SHOWN_IMAGES: usize = 6;
/// Centrelines drawn for the superimposed motion.
const DRAWN_CENTRELINES: usize = 40;

/// Puts some images with what was found in them, refused ones by reason, the first pose, and centrelines into a report.
///
/// # Errors
/// [`AnalysisError`] when the recording cannot be read again.
pub(super) fn show(
    data: &mut ReportData,
    extraction: &Extraction,
    (fitted, command): (Option<&Fitted>, Option<&Command>),
    source: &RecordedImages,
) -> Result<(), AnalysisError> {
    let records = &extraction.records;
    let groups = refused(records, MOST_SHOWN);
    let spread = worth_showing(extraction);
    let run = fitted.and_then(|fitted| Some((fitted, fitted.runs.first()?)));
    let strip = run.map_or_else(Vec::new, |(_, run)| strip::chosen(extraction, run, command));
    let refused = groups.iter().flat_map(|group| &group.shown);
    let wanted: BTreeSet<usize> = spread.iter().chain(refused).chain(&strip).copied().collect();
    let images = source.numbered(&wanted).map_err(SequenceError::from)?;
    let images: BTreeMap<usize, TimedImage> = wanted.into_iter().zip(images).collect();
    let overlay = |index: &usize| {
        let grey = images.get(index)?.grey.as_ref().ok()?;
        Some(overlay(grey, &records[*index], &extraction.names))
    };
    data.overlays = spread.iter().filter_map(overlay).collect();
    data.refused = groups
        .into_iter()
        .map(|group| {
            let shown: Vec<Overlay> = group.shown.iter().filter_map(overlay).collect();
            RefusedImages {
                unreadable: group.shown.len() - shown.len(),
                reason: group.reason,
                doubtful: group.status == Status::Doubtful,
                count: group.count,
                shown,
            }
        })
        .collect();
    let Some(figures) = data.runs.first_mut() else { return Ok(()) };
    figures.measured_pose = data.overlays.first().cloned();
    figures.centrelines_m = records
        .iter()
        .step_by(records.len().div_ceil(DRAWN_CENTRELINES).max(1))
        .map(|record| record.centreline.iter().map(|&px| extraction.plane.metres(px)).collect())
        .collect();
    if let Some((fitted, run)) = run {
        figures.strip = strip::strip(&strip, &images, extraction, fitted, run);
    }
    if let (Some(pose), Some((fitted, run))) = (&figures.measured_pose, run) {
        figures.simulated_pose = Some(drawn(fitted, run, &pose.image, &extraction.plane));
    }
    Ok(())
}

/// The fitted model in its initial pose, as the camera would see it.
fn drawn(fitted: &Fitted, run: &FittedRun, like: &GrayImage, plane: &Plane) -> GrayImage {
    let look = Look::plain(like.width(), like.height());
    Renderer::new(plane.clone(), look).draw(&fitted.model, &run.initial.qpos)
}

/// The first image, and evenly spread ones: an index into the records each.
fn worth_showing(extraction: &Extraction) -> BTreeSet<usize> {
    let last = extraction.records.len().saturating_sub(1);
    let spread = (0..SHOWN_IMAGES).map(|k| k * last / (SHOWN_IMAGES - 1));
    spread.filter(|&index| index < extraction.records.len()).collect()
}

fn overlay(image: &GrayImage, record: &ImageRecord, names: &[String]) -> Overlay {
    Overlay {
        name: record.name.clone(),
        time_s: record.time_s,
        image: image.clone(),
        mask: record.mask.as_ref().map(|mask| mask.picture(image.width(), image.height())),
        centreline_px: record.centreline.clone(),
        keypoints_px: names.iter().cloned().zip(record.keypoints.iter().map(|k| k.px)).collect(),
        status: if record.reason.is_empty() { "ok".into() } else { record.reason.clone() },
    }
}
