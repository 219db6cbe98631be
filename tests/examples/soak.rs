//! A camera at full rate for minutes, recorded while a servo plays and a fit has the other core:
//! `cargo run --release -p system-tests --example soak -- [--size 1280x720] [--fps 120] [--yuyv] [--noise 3] [--minutes 10] [--in FOLDER]`
//!
//! Ends with a JSON line: images and bytes, what was lost and where, resident memory at the beginning, the end, and at most. The
//! recording is deleted.

#![expect(clippy::print_stdout, reason = "an example talks to its terminal")]

use std::path::PathBuf;

use camera::Encoding;
use system_tests::soak::Soak;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut soak = Soak {
        size_px: (1280, 720),
        fps: 120.0,
        encoding: Encoding::Grey,
        noise_grey: 3.0,
        profile_s: 600.0,
    };
    let mut folder = PathBuf::from(".");
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} wants a value"));
        match word.as_str() {
            "--size" => {
                let size = value()?;
                let (width, height) = size.split_once('x').ok_or("--size wants WIDTHxHEIGHT")?;
                soak.size_px = (width.parse()?, height.parse()?);
            }
            "--fps" => soak.fps = value()?.parse()?,
            "--yuyv" => soak.encoding = Encoding::Yuyv,
            "--noise" => soak.noise_grey = value()?.parse()?,
            "--minutes" => soak.profile_s = 60.0 * value()?.parse::<f64>()?,
            "--in" => folder = value()?.into(),
            _ => return Err(format!("unknown argument `{word}`").into()),
        }
    }
    let folder = tempfile::tempdir_in(folder)?;
    let endured = soak.endure(&folder.path().join("recording.mcap"));
    let resident = &endured.resident_bytes;
    let (after_10_s, last, most) = (resident.get(10), resident.last(), resident.iter().max());
    let mut line = serde_json::to_value(&endured)?;
    line["resident_bytes"] = serde_json::json!({ "after_10_s": after_10_s, "last": last, "most": most });
    line["ending"] = serde_json::json!(endured.filmed.ending);
    line["share"] = serde_json::json!(endured.recorded_bytes as f64 / endured.received_bytes as f64);
    println!("{line}");
    Ok(())
}
