//! What `rig extract` writes beside the trajectory: each image's status, and whole centrelines.

use std::io::Write;

use super::record::{Extraction, ImageRecord, Status};
use super::spline::{arc_lengths, point_at};

/// Points of a written centreline, evenly spaced from base to tip.
pub const CENTRELINE_POINTS: usize = 101;

/// Writes `file,time_s,status,reason`, one row an image.
///
/// # Errors
/// What the writer says.
pub fn write_frames<'a>(
    images: impl IntoIterator<Item = (&'a str, f64, Status, &'a str)>,
    out: impl Write,
) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["file", "time_s", "status", "reason"])?;
    for image in images {
        csv.serialize(image)?;
    }
    csv.flush()?;
    Ok(())
}

/// Writes `time_s,c0_x_m,c0_z_m,...` (from above y for z), one row an image, empty cells where it was rejected.
///
/// # Errors
/// What the writer says.
pub fn write_centreline_csv(extraction: &Extraction, out: impl Write) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(out);
    let axes = extraction.plane.view().seen_axes();
    let names = (0..CENTRELINE_POINTS).flat_map(|i| axes.map(|(_, axis)| format!("c{i}_{axis}_m")));
    csv.write_record(std::iter::once("time_s".to_owned()).chain(names))?;
    for record in &extraction.records {
        let cells: Vec<String> = match centreline(extraction, record) {
            Some(line) => line.iter().flatten().map(f64::to_string).collect(),
            None => vec![String::new(); 2 * CENTRELINE_POINTS],
        };
        csv.write_record(std::iter::once(record.time_s.to_string()).chain(cells))?;
    }
    csv.flush()?;
    Ok(())
}

/// An image's centreline in the plane of motion, [`CENTRELINE_POINTS`] points \[m\] to the right and up; none where it was rejected.
pub fn centreline(extraction: &Extraction, record: &ImageRecord) -> Option<Vec<[f64; 2]>> {
    let lengths = arc_lengths(&record.centreline);
    let total = *lengths.last()?;
    let step = total / (CENTRELINE_POINTS - 1) as f64;
    let point = |i: usize| extraction.plane.metres(point_at(&record.centreline, &lengths, step * i as f64));
    Some((0..CENTRELINE_POINTS).map(point).collect())
}
