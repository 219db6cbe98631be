//! Centrelines of a real worm against those of an independent tracker.
//!
//! 200 grey crops of one worm, whose background is never seen without it, with the other tracker's midlines
//! (52 points) for those images in which it found one. Read from the folder that `RIG_SHARED` names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use camera::calibration::Calibration;
use images::{self, TimedImage};
use serde::Deserialize;
use vision::{Extraction, ImageRecord, SequenceError, Status, Task, VisionConfig, spline};

/// A rejected image among those with a midline counts as this \[px\].
const REJECTED_PX: f64 = 5.0;
/// The median over those images must not exceed this \[px\].
const MEDIAN_LIMIT_PX: f64 = 0.8;
/// Share of them that must be answered.
const ANSWERED: f64 = 0.98;

/// Share of the images without a midline that must be rejected. In most of them another object is at the border, in
/// others the worm touches itself; before one of them the tracker gave up for a reason that it does not show.
const REJECTED: f64 = 0.95;
/// The first image of the later half. The limits of the gates were chosen so that they would be the same from either
/// half: both are printed.
const LATER: &str = "00240.png";

#[derive(Deserialize)]
struct Config {
    calibration: Calibration,
    vision: VisionConfig,
}

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("RIG_SHARED").map(|root| PathBuf::from(root).join("data/worm-midlines"));
    if folder.is_none() {
        println!("skipped: RIG_SHARED does not name the folder of shared data");
    }
    folder
}

fn midlines(folder: &Path) -> BTreeMap<String, Vec<[f64; 2]>> {
    let mut lines: BTreeMap<String, Vec<[f64; 2]>> = BTreeMap::new();
    for row in csv::Reader::from_path(folder.join("midlines.csv")).unwrap().deserialize() {
        let (file, _, x, y, _): (String, usize, f64, f64, f64) = row.unwrap();
        lines.entry(file).or_default().push([x, y]);
    }
    lines
}

fn extraction(folder: &Path) -> Extraction {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/worm.toml");
    let config: Config = ground::strict::read(&config).unwrap();
    let plane = config.calibration.plane(Path::new("")).unwrap();
    let source = images::open(&folder.join("frames"), Some(30.0)).unwrap();
    let heard = |_: &[TimedImage], _: &[ImageRecord]| Ok::<(), SequenceError>(());
    Task::new(&config.vision, None, plane, Path::new("")).unwrap().extract(source.as_ref(), heard).unwrap()
}

/// Rms distance of the tracker's points from our line, wherever along it \[px\]: blind to where each line ends.
fn rms_across(record: &ImageRecord, truth: &[[f64; 2]]) -> f64 {
    let nearest = |p: &[f64; 2]| {
        record.centreline.iter().map(|q| spline::distance(*p, *q)).fold(f64::INFINITY, f64::min)
    };
    (truth.iter().map(|p| nearest(p).powi(2)).sum::<f64>() / truth.len() as f64).sqrt()
}

/// Rms distance of points at equal shares of both lines' lengths \[px\]; head and tail in the better order.
fn rms(record: &ImageRecord, truth: &[[f64; 2]]) -> f64 {
    let lengths = spline::arc_lengths(&record.centreline);
    let total = lengths[lengths.len() - 1];
    let truth_lengths = spline::arc_lengths(truth);
    let truth_total = truth_lengths[truth_lengths.len() - 1];
    let n = truth.len();
    let off = |backwards: bool| {
        let squared = (0..n).map(|i| {
            let share = i as f64 / (n - 1) as f64;
            let here = spline::point_at(&record.centreline, &lengths, share * total);
            let there = if backwards { 1.0 - share } else { share };
            spline::distance(here, spline::point_at(truth, &truth_lengths, there * truth_total)).powi(2)
        });
        (squared.sum::<f64>() / n as f64).sqrt()
    };
    off(false).min(off(true))
}

#[test]
fn centrelines_agree_with_an_independent_tracker() {
    let Some(folder) = data() else { return };
    let truth = midlines(&folder);
    let extraction = extraction(&folder);
    let (mut scores, mut across) = (Vec::new(), Vec::new());
    for record in &extraction.records {
        let score = match truth.get(&record.name) {
            Some(line) if record.status != Status::Rejected => rms(record, line),
            Some(_) => REJECTED_PX,
            None => continue,
        };
        if record.status != Status::Rejected {
            across.push(rms_across(record, &truth[&record.name]));
        }
        scores.push(score);
    }
    let without: Vec<_> = extraction.records.iter().filter(|r| !truth.contains_key(&r.name)).collect();
    let rejected = without.iter().filter(|r| r.status == Status::Rejected).count();
    for later in [false, true] {
        let half = |record: &&ImageRecord| (record.name.as_str() >= LATER) == later;
        let answered = |record: &&ImageRecord| record.status != Status::Rejected;
        let (with, none): (Vec<_>, Vec<_>) =
            extraction.records.iter().filter(half).partition(|record| truth.contains_key(&record.name));
        println!(
            "{} half: {} of {} images with a midline answered, {} of {} without",
            if later { "later" } else { "earlier" },
            with.iter().copied().filter(answered).count(),
            with.len(),
            none.iter().copied().filter(answered).count(),
            none.len()
        );
    }
    let answered = scores.iter().filter(|&&s| s < REJECTED_PX).count();
    scores.sort_by(f64::total_cmp);
    let median = scores[scores.len() / 2];
    println!(
        "{} images with a midline: {answered} answered, rms median {median:.3} px, 90 % {:.3} px, worst {:.3} px",
        scores.len(),
        scores[scores.len() * 9 / 10],
        scores[scores.len() - 1]
    );
    across.sort_by(f64::total_cmp);
    println!("across the line alone: rms median {:.3} px", across[across.len() / 2]);
    println!("{} images without: {rejected} rejected", without.len());
    assert!(median <= MEDIAN_LIMIT_PX, "{median}");
    for record in without.iter().filter(|r| r.status == Status::Rejected) {
        assert!(record.keypoints.is_empty() && record.centreline.is_empty());
    }
    assert!(rejected as f64 >= REJECTED * without.len() as f64, "{rejected}");
    assert!(answered as f64 >= ANSWERED * scores.len() as f64, "{answered}");
}
