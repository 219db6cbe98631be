//! Runs that nobody made, many of them: what a list and a trend are looked at with.

use std::io::Write as _;
use std::path::Path;

use ident::fit::{Fit, FittedParameter};
use serde_json::json;

/// The config that a run carries with it is most of what is read of it.
const CONFIG: &str = include_str!("../../configs/chain-driven-hanging.toml");

/// Writes the run with this number to the folder of runs `out`.
///
/// # Errors
/// What the system says.
pub fn make(out: &Path, number: usize) -> std::io::Result<()> {
    let at = second(number);
    let folder = out.join(format!("{at}-{:06}", number % 1_000_000));
    std::fs::create_dir_all(&folder)?;
    let id = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let clock = |ns: u64| json!({ "monotonic_ns": ns, "utc": "2026-11-20T10:15:03Z" });
    let start = json!({
        "id": id, "kind": "driven", "model": "model-start.xml", "prescribed": false, "version": "0.1.0", "clock": clock(0), "config": CONFIG,
    });
    let stop = json!({
        "status": "success", "clock": clock(9_000_000_000), "servo": "acknowledged", "images": 900, "images_lost": 0, "messages_dropped": 0,
    });
    // a slow drift, a scatter from run to run, and one run in seven that leaves it open
    let scatter = ((number as f64 * 12.9898).sin() * 43_758.545_3).fract();
    let parameters = (0..15).map(|k| FittedParameter {
        name: format!("g{}/p{}", k / 5, k % 5),
        unit: "1".into(),
        value: 0.5 + 1e-3 * k as f64 + 1e-5 * number as f64 + 0.01 * scatter,
        std: if number.is_multiple_of(7) { 2.0 } else { 0.01 },
        upper: 10.0,
        determined: !number.is_multiple_of(7),
        ..FittedParameter::default()
    });
    let fit = Fit { parameters: parameters.collect(), error_m: Some(1e-4), noise_m: 1e-4, ..Fit::default() };
    for (name, value) in [("start.json", start), ("stop.json", stop), ("fit.json", json!(fit))] {
        std::fs::File::create(folder.join(name))?.write_all(value.to_string().as_bytes())?;
    }
    Ok(())
}

/// A second of its own for each run, as a run's id begins.
fn second(number: usize) -> String {
    let (day, second) = (number / 86_400, number % 86_400);
    format!("202601{:02}T{:02}{:02}{:02}Z", day + 1, second / 3600, second / 60 % 60, second % 60)
}
