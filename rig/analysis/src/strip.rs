//! The same instants filmed and simulated, side by side: what the paper's Figs. 9 and 12 show.

use std::collections::BTreeMap;

use ident::fit::{Fitted, FittedRun};
use image::GrayImage;
use image::imageops::{self, FilterType};
use sim::{Command, Model};

use camera::calibration::Plane;
use images::TimedImage;
use report::StripImage;
use tank::render::{Look, Renderer, outlines};
use vision::{Extraction, ImageRecord, Status};

/// Number of instants shown. Chosen.
const STRIP_INSTANTS: usize = 8;
/// Longer side of a picture on the page at most \[px\]. Chosen.
const PICTURE_MAX_SIDE_PX: u32 = 280;
/// Margin around the mechanism, as a share of its extent. Chosen.
const MARGIN_SHARE: f64 = 0.06;

/// The images worth showing: evenly over one cycle of the servo's strokes, else over what there is to see of the motion.
pub(super) fn chosen(extraction: &Extraction, run: &FittedRun, command: Option<&Command>) -> Vec<usize> {
    let records = &extraction.records;
    let Some((from_s, to_s)) = span(run, command) else { return Vec::new() };
    let step_s = (to_s - from_s) / (STRIP_INSTANTS - 1) as f64;
    let nearest = |wanted_s: f64| {
        let usable = records.iter().enumerate().filter(|(_, record)| record.status == Status::Ok);
        let off = |record: &ImageRecord| (record.time_s - wanted_s).abs();
        let best = usable.min_by(|(_, a), (_, b)| off(a).total_cmp(&off(b)))?;
        (off(best.1) <= step_s / 2.0).then_some(best.0)
    };
    let mut chosen: Vec<usize> =
        (0..STRIP_INSTANTS).filter_map(|k| nearest(from_s + k as f64 * step_s)).collect();
    chosen.dedup();
    chosen
}

/// From when to when \[s\].
fn span(run: &FittedRun, command: Option<&Command>) -> Option<(f64, f64)> {
    let last_s = *run.simulated.time_s.last()?;
    let cycle = command.and_then(|command| cycle(command, last_s));
    let (from_s, to_s) = cycle.unwrap_or_else(|| (run.start_s, motion_end_s(run).unwrap_or(last_s)));
    (from_s < to_s).then_some((from_s, to_s))
}

/// One pair of strokes in the middle of those that end by `last_s`: from one reversal of the first servo to the next but one.
fn cycle(command: &Command, last_s: f64) -> Option<(f64, f64)> {
    let rows: Vec<(f64, f64)> =
        command.time_s.iter().map(|&time_s| (time_s, command.at(0, time_s))).collect();
    let mut reversals = Vec::new();
    let mut direction = 0.0;
    for pair in rows.windows(2) {
        let moved = pair[1].1 - pair[0].1;
        if moved != 0.0 {
            if moved * direction < 0.0 && pair[0].0 <= last_s {
                reversals.push(pair[0].0);
            }
            direction = moved;
        }
    }
    let cycles = reversals.len().checked_sub(2)?;
    let from = cycles / 2;
    Some((reversals[from], *reversals.get(from + 2)?))
}

/// When the simulated motion has decayed to a tenth of its greatest amplitude \[s\].
fn motion_end_s(run: &FittedRun) -> Option<f64> {
    const REMAINING_MOTION_SHARE: f64 = 0.1;
    let width = run.simulated.keypoints.len();
    let end = run.simulated.position_m.chunks_exact(width.max(1)).last()?;
    let off = |row: &[[f64; 3]]| {
        let far =
            row.iter().zip(end).map(|(a, b)| (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>());
        far.filter(|square| square.is_finite()).fold(0.0, f64::max).sqrt()
    };
    let far: Vec<f64> = run.simulated.position_m.chunks_exact(width.max(1)).map(off).collect();
    let most = far.iter().copied().fold(0.0, f64::max);
    let last = far.iter().rposition(|&far| far > REMAINING_MOTION_SHARE * most)?;
    run.simulated.time_s.get(last + 1).copied()
}

/// The images number `chosen` and renderings of the model at the same instants, all cropped alike to the mechanism.
pub(super) fn strip(
    chosen: &[usize],
    images: &BTreeMap<usize, TimedImage>,
    extraction: &Extraction,
    fitted: &Fitted,
    run: &FittedRun,
) -> Vec<StripImage> {
    let altered = fitted.model.altered();
    let model = altered.as_ref().unwrap_or(&fitted.model);
    let shown: Vec<Shown<'_>> = chosen
        .iter()
        .filter_map(|&index| {
            let filmed = images.get(&index)?.grey.as_ref().ok()?;
            let record = extraction.records.get(index)?;
            let row = record::simulated::row_at(&run.simulated.time_s, record.time_s)?;
            let qpos = run.qpos.get(row * model.nq()..(row + 1) * model.nq())?;
            Some(Shown { filmed, record, row, qpos })
        })
        .collect();
    let Some(cut) = Cut::around(&shown, model, &extraction.plane) else { return Vec::new() };
    let Some(first) = shown.first() else { return Vec::new() };
    let renderer = Renderer::new(extraction.plane.clone(), look(first));
    let one = |shown: &Shown<'_>| StripImage {
        time_s: shown.record.time_s,
        filmed: cut.of(shown.filmed),
        simulated: cut.of(&renderer.draw(model, shown.qpos)),
        errors_m: errors_m(run, shown.row),
    };
    shown.iter().map(one).collect()
}

struct Shown<'a> {
    filmed: &'a GrayImage,
    record: &'a ImageRecord,
    row: usize,
    qpos: &'a [f64],
}

/// Grey levels as in the image: the medians of the mechanism and of the water.
fn look(shown: &Shown<'_>) -> Look {
    let (width, height) = shown.filmed.dimensions();
    let plain = Look::plain(width, height);
    let Some(mask) = &shown.record.mask else { return plain };
    let mask = mask.picture(width, height);
    let mut greys: [Vec<u8>; 2] = [Vec::new(), Vec::new()];
    for (grey, inside) in shown.filmed.iter().zip(mask.iter()) {
        greys[usize::from(*inside > 0)].push(*grey);
    }
    let [Some(water), Some(mechanism)] = greys.map(|mut greys| {
        greys.sort_unstable();
        greys.get(greys.len() / 2).map(|&grey| f64::from(grey))
    }) else {
        return plain;
    };
    Look { water, mechanism, ..plain }
}

/// Distance of each measured keypoint from the simulated one at instant `row`, where it was observed.
fn errors_m(run: &FittedRun, row: usize) -> Vec<(String, f64)> {
    let named = run.measured.keypoints.iter().enumerate();
    let error = |k: usize| {
        let (measured, simulated) = (run.measured.at(row, k), run.simulated.at(row, k));
        let observed = (0..3).filter(|&axis| measured[axis].is_finite());
        observed.map(|axis| measured[axis] - simulated[axis]).reduce(f64::hypot).map(f64::abs)
    };
    named.filter_map(|(k, name)| Some((name.clone(), error(k)?))).collect()
}

/// The part of the picture in which the mechanism is.
struct Cut {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
}

impl Cut {
    fn around(shown: &[Shown<'_>], model: &Model, plane: &Plane) -> Option<Self> {
        let (width, height) = shown.first()?.filmed.dimensions();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut take_in = |px: [f64; 2]| {
            for axis in 0..2 {
                low[axis] = low[axis].min(px[axis]);
                high[axis] = high[axis].max(px[axis]);
            }
        };
        for one in shown {
            outlines(model, one.qpos, plane).into_iter().flatten().for_each(&mut take_in);
            let mask = one.record.mask.iter().flat_map(|mask| mask.pixels());
            mask.for_each(|(column, row)| take_in([column as f64, row as f64]));
        }
        let margin = MARGIN_SHARE * (high[0] - low[0]).max(high[1] - low[1]);
        let sides = [width, height];
        let from: [u32; 2] =
            std::array::from_fn(|i| (low[i] - margin).clamp(0.0, f64::from(sides[i])) as u32);
        let to: [u32; 2] =
            std::array::from_fn(|i| (high[i] + margin).ceil().clamp(0.0, f64::from(sides[i])) as u32);
        let [width, height] = [0, 1].map(|i| to[i].saturating_sub(from[i]));
        (width > 0 && height > 0).then_some(Self { left: from[0], top: from[1], width, height })
    }

    fn of(&self, image: &GrayImage) -> GrayImage {
        let cut = imageops::crop_imm(image, self.left, self.top, self.width, self.height).to_image();
        let longest = self.width.max(self.height);
        if longest <= PICTURE_MAX_SIDE_PX {
            return cut;
        }
        let smaller = |side: u32| (side * PICTURE_MAX_SIDE_PX / longest).max(1);
        imageops::resize(&cut, smaller(self.width), smaller(self.height), FilterType::Triangle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(angles: &[(f64, f64)]) -> Command {
        let (time_s, angle_rad) = angles.iter().copied().unzip();
        Command { actuators: vec!["servo".into()], time_s, angle_rad }
    }

    #[test]
    fn cycle_is_a_whole_pair_of_strokes_in_the_middle_of_the_run() {
        let strokes = command(&[
            (0.0, 0.0),
            (0.5, 0.0),
            (1.0, 0.5),
            (1.5, -0.5),
            (2.5, 0.5),
            (3.0, -0.5),
            (4.0, 0.5),
            (4.5, -0.5),
            (5.0, 0.0),
            (6.0, 0.0),
        ]);
        // reversals at 1, 1.5, 2.5, 3, 4, 4.5
        assert_eq!(cycle(&strokes, 10.0), Some((2.5, 4.0)));
        assert_eq!(cycle(&strokes, 2.6), Some((1.0, 2.5)));
        let one = command(&[(0.0, 0.0), (1.0, 0.5), (2.0, -0.5), (3.0, 0.0)]);
        assert_eq!(cycle(&one, 10.0), None, "a single cycle is shown from its start to its end");
    }
}
