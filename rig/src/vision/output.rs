//! What `rig extract` writes beside the trajectory: each image's status, and whole centrelines.

use std::io::Write;

use serde_json::{Value, json};

use super::record::{Extraction, ImageRecord};
use super::spline::{arc_lengths, point_at};

/// Points of a written centreline, evenly spaced from base to tip.
pub const CENTRELINE_POINTS: usize = 101;

/// Writes `file,time_s,status,reason`, one row an image.
///
/// # Errors
/// What the writer says.
pub fn write_frames(extraction: &Extraction, out: impl Write) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["file", "time_s", "status", "reason"])?;
    for record in &extraction.records {
        csv.serialize((&record.name, record.time_s, record.status, &record.reason))?;
    }
    csv.flush()?;
    Ok(())
}

/// Writes `time_s,c0_x_m,c0_z_m,...`, one row an image, empty cells where it was rejected.
///
/// # Errors
/// What the writer says.
pub fn write_centreline_csv(extraction: &Extraction, out: impl Write) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(out);
    let names = (0..CENTRELINE_POINTS).flat_map(|i| [format!("c{i}_x_m"), format!("c{i}_z_m")]);
    csv.write_record(std::iter::once("time_s".to_owned()).chain(names))?;
    for record in &extraction.records {
        let cells: Vec<String> = match metres(extraction, record) {
            Some(line) => line.iter().flatten().map(f64::to_string).collect(),
            None => vec![String::new(); 2 * CENTRELINE_POINTS],
        };
        csv.write_record(std::iter::once(record.time_s.to_string()).chain(cells))?;
    }
    csv.flush()?;
    Ok(())
}

/// The centrelines as a WCON document: x to the right and y up in the picture, in millimetres; `null` where an
/// image was rejected, whose reason stands in the custom block.
///
/// # Source
/// Worm tracker Commons Object Notation, openworm/tracker-commons.
pub fn wcon(extraction: &Extraction, id: &str) -> Value {
    const MM: f64 = 1e3;
    let axis = |axis: usize| -> Vec<Value> {
        let row = |record: &ImageRecord| match metres(extraction, record) {
            Some(line) => json!(line.iter().map(|p| p[axis] * MM).collect::<Vec<f64>>()),
            None => json!(vec![Value::Null; CENTRELINE_POINTS]),
        };
        extraction.records.iter().map(row).collect()
    };
    let times: Vec<f64> = extraction.records.iter().map(|record| record.time_s).collect();
    let quality: Vec<Value> = extraction
        .records
        .iter()
        .map(|record| json!({ "file": record.name, "status": record.status, "reason": record.reason }))
        .collect();
    json!({
        "units": { "t": "s", "x": "mm", "y": "mm" },
        "data": [{ "id": id, "t": times, "x": axis(0), "y": axis(1) }],
        "metadata": { "software": { "name": "rig", "version": env!("CARGO_PKG_VERSION") } },
        "@rig": { "images": quality },
    })
}

/// An image's centreline in the plane of motion, [`CENTRELINE_POINTS`] points `[x, z]` \[m\].
fn metres(extraction: &Extraction, record: &ImageRecord) -> Option<Vec<[f64; 2]>> {
    let lengths = arc_lengths(&record.centreline);
    let total = *lengths.last()?;
    let step = total / (CENTRELINE_POINTS - 1) as f64;
    let point = |i: usize| extraction.plane.metres(point_at(&record.centreline, &lengths, step * i as f64));
    Some((0..CENTRELINE_POINTS).map(point).collect())
}
