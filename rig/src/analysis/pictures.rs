//! A few of the recorded images in the report.

use std::collections::BTreeSet;

use ident::fit::{Fitted, FittedRun};
use image::GrayImage;

use super::error::AnalysisError;
use crate::calibration::Plane;
use crate::images::recording::RecordedImages;
use crate::report::{Overlay, ReportData};
use crate::tank::render::{Look, Renderer};
use crate::vision::{Extraction, ImageRecord, SequenceError, Status};

/// Images shown in a report with what was found in them.
const SHOWN_IMAGES: usize = 6;
/// Centrelines drawn for the superimposed motion.
const DRAWN_CENTRELINES: usize = 40;

/// Puts some images with what was found in them, the first pose, and centrelines into a report.
///
/// # Errors
/// [`AnalysisError`] when the recording cannot be read again.
pub(super) fn show(
    data: &mut ReportData,
    extraction: &Extraction,
    fitted: &Fitted,
    source: &RecordedImages,
) -> Result<(), AnalysisError> {
    let shown = worth_showing(extraction);
    let images = source.numbered(&shown).map_err(SequenceError::from)?;
    data.overlays = shown
        .iter()
        .zip(&images)
        .filter_map(|(&index, image)| {
            Some(overlay(image.grey.as_ref().ok()?, &extraction.records[index], &extraction.names))
        })
        .collect();
    let Some(figures) = data.runs.first_mut() else { return Ok(()) };
    figures.measured_pose = data.overlays.first().cloned();
    figures.centrelines_m = extraction
        .records
        .iter()
        .step_by(extraction.records.len().div_ceil(DRAWN_CENTRELINES).max(1))
        .map(|record| record.centreline.iter().map(|&px| extraction.plane.metres(px)).collect())
        .collect();
    if let (Some(pose), Some(run)) = (&figures.measured_pose, fitted.runs.first()) {
        figures.simulated_pose = Some(drawn(fitted, run, &pose.image, &extraction.plane));
    }
    Ok(())
}

/// The fitted model in its initial pose, as the camera would see it.
fn drawn(fitted: &Fitted, run: &FittedRun, like: &GrayImage, plane: &Plane) -> GrayImage {
    let look = Look::plain(like.width(), like.height());
    Renderer::new(plane.clone(), look).draw(&fitted.model, &run.initial.qpos)
}

/// The first image, evenly spread ones, and the first rejected one: an index into the records each.
fn worth_showing(extraction: &Extraction) -> BTreeSet<usize> {
    let records = &extraction.records;
    let spread = (0..SHOWN_IMAGES - 1).map(|k| k * (records.len() - 1) / (SHOWN_IMAGES - 1).max(1));
    let rejected = records.iter().position(|record| record.status == Status::Rejected);
    spread.chain(rejected).collect()
}

fn overlay(image: &GrayImage, record: &ImageRecord, names: &[String]) -> Overlay {
    Overlay {
        time_s: record.time_s,
        image: image.clone(),
        mask: record.mask.as_ref().map(|mask| mask.picture(image.width(), image.height())),
        centreline_px: record.centreline.clone(),
        keypoints_px: names.iter().cloned().zip(record.keypoints.iter().map(|k| k.px)).collect(),
        status: if record.reason.is_empty() { "ok".into() } else { record.reason.clone() },
    }
}
