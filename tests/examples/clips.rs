//! Films that the mock camera did not draw, read as `rig extract` reads them:
//! `cargo run --release -p system-tests --example clips -- [--level clean|usual|hard|broken] [--count N] [--first SEED] [--seconds S]
//! [--bodies] [--octopus] [--large] [--self-check] [--write FOLDER [--every N]] [--json FILE] [--errors FILE.csv]`
//!
//! A line a film, and for each level the worst and what counts over all its films. Without `--level` all four. `--bodies`, `--octopus`:
//! what nothing holds. `--write` leaves every tenth picture of each film to look at, or each so many-th by `--every`, and where its keypoints
//! truly are (truth.csv; `scripts/paper-recipe` reads that). `--errors` each keypoint of each answered image
//! beside the truth. One thread.
#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::PathBuf;

use system_tests::clips::clip::{Clip, Level, body_clip, clip, octopus_clip};
use system_tests::clips::score::{Score, read};
use vision::{Extraction, Status};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value =
        |name: &str| arguments.iter().position(|one| one == name).and_then(|at| arguments.get(at + 1));
    let number = |name: &str, otherwise: f64| value(name).map_or(Ok(otherwise), |text| text.parse());
    let (count, first) = (number("--count", 10.0)? as u64, number("--first", 0.0)? as u64);
    let seconds = number("--seconds", 2.0)?;
    let large = arguments.iter().any(|one| one == "--large");
    let drawn =
        match (arguments.iter().any(|one| one == "--bodies"), arguments.iter().any(|one| one == "--octopus"))
        {
            (true, _) => body_clip,
            (_, true) => octopus_clip,
            _ => clip,
        };
    let self_check = arguments.iter().any(|one| one == "--self-check");
    let folder = value("--write").map(PathBuf::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut errors = value("--errors").map(csv::Writer::from_path).transpose()?;
    if let Some(errors) = &mut errors {
        errors.write_record(ERROR_COLUMNS)?;
    }
    let mut all = Vec::new();
    for (name, level) in
        Level::ALL.into_iter().filter(|(name, _)| value("--level").is_none_or(|one| one == name))
    {
        let mut scores = Vec::new();
        for seed in first..first + count {
            let clip = drawn(level, seed, seconds, large);
            if let Some(folder) = &folder {
                write(&clip, folder, number("--every", 10.0)? as usize)?;
            }
            let (score, extraction) = pool.install(|| read(&clip, self_check));
            println!("{}", line(&score));
            match extraction.as_ref().and_then(|extraction| extraction.checked.as_ref()) {
                Some(Ok(check)) => print!("{check}"),
                Some(Err(why)) => println!("the film {why}"),
                None => {}
            }
            if let (Some(errors), Some(extraction)) = (&mut errors, extraction) {
                compare(&clip, &extraction, errors)?;
            }
            scores.push(score);
        }
        println!("{}\n", summary(name, &scores));
        all.extend(scores);
    }
    if let Some(path) = value("--json") {
        std::fs::write(path, serde_json::to_vec_pretty(&all)?)?;
    }
    Ok(())
}

/// Columns of `--errors`.
const ERROR_COLUMNS: [&str; 8] =
    ["film", "time_s", "keypoint", "true_x_px", "true_y_px", "error_x_px", "error_y_px", "std_px"];

/// Writes a row for each keypoint that was answered.
fn compare(
    clip: &Clip,
    extraction: &Extraction,
    out: &mut csv::Writer<std::fs::File>,
) -> Result<(), csv::Error> {
    for (record, truth) in extraction.records.iter().zip(&clip.truth) {
        if record.status != Status::Ok {
            continue;
        }
        for (place, (keypoint, point)) in record.keypoints.iter().zip(&truth.points).enumerate() {
            let error = [0, 1].map(|axis| keypoint.px[axis] - point[axis]);
            let numbers = (point[0], point[1], error[0], error[1], keypoint.std_px);
            out.serialize((&clip.name, record.time_s, format!("P{place}"), numbers))?;
        }
    }
    Ok(())
}

fn line(score: &Score) -> String {
    if let Some(why) = &score.refused {
        return format!("{:32} refused: {why}", score.name);
    }
    let rms: Vec<String> = score.rms_px.iter().map(|rms| format!("{rms:6.2}")).collect();
    format!(
        "{:32} rms [px] {:28} answered {:5.1} %  wrong {:3} of {:3}  error/sigma {:6.2}  {:4.0} images/s",
        score.name,
        rms.join(" "),
        100.0 * score.answered,
        score.wrong_unflagged,
        score.images,
        score.normalised,
        score.images_per_s
    )
}

fn summary(level: &str, scores: &[Score]) -> String {
    let refused = scores.iter().filter(|score| score.refused.is_some()).count();
    let wrong: usize = scores.iter().map(|score| score.wrong_unflagged).sum();
    let images: usize = scores.iter().map(|score| score.images).sum();
    let answered = scores.iter().map(|score| score.answered).sum::<f64>() / scores.len().max(1) as f64;
    let worst = scores.iter().flat_map(|score| &score.rms_px).copied().fold(0.0, f64::max);
    format!(
        "{level}: {} films, {refused} refused, worst rms {worst:.2} px, {:.1} % answered, {wrong} of {images} images wrong and unflagged",
        scores.len(),
        100.0 * answered
    )
}

fn write(clip: &Clip, folder: &std::path::Path, every: usize) -> Result<(), Box<dyn std::error::Error>> {
    let folder = folder.join(clip.name.replace([' ', '(', ')'], "-"));
    std::fs::create_dir_all(&folder)?;
    let mut truth = csv::Writer::from_path(folder.join("truth.csv"))?;
    let points = clip.truth.first().map_or(0, |truth| truth.points.len());
    let columns = (0..points).flat_map(|i| ["x", "y"].map(|axis| format!("P{i}_{axis}_px")));
    truth.write_record(std::iter::once("image".to_owned()).chain(columns))?;
    for (image, shown) in clip.images.iter().zip(&clip.truth).step_by(every.max(1)) {
        if let Ok(grey) = &image.grey {
            grey.save(folder.join(format!("{}.png", image.name)))?;
            let cells = shown.points.iter().flatten().map(f64::to_string);
            truth.write_record(std::iter::once(image.name.clone()).chain(cells))?;
        }
    }
    truth.flush()?;
    Ok(())
}
