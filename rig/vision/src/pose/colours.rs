//! Colours beside the outline: the tank's as it is now, and the mechanism's.

use super::lines::{Reading, SAMPLES_PER_LINE, outward};
use super::mechanism::Run;
use super::tank::{PLANES, State, median};

/// A colour, or none where nothing tells.
pub(super) type Colour = Option<[f32; PLANES]>;

/// Samples so far outside tell the tank as it is now \[px\], chosen.
const OUTSIDE_PX: [f64; 2] = [3.0, 12.0];
/// Samples so far inside tell the mechanism's colour \[px\], chosen.
const INSIDE_PX: [f64; 2] = [2.0, 6.5];
/// The tank by the outline departs from what was learned by no more, by plane; chosen.
const MOST_OFFSET: [f32; PLANES] = [40.0, 8.0, 8.0];
/// Neighbours on either side over which offsets and colours are smoothed, chosen.
const OFFSET_NEIGHBOURS: usize = 4;
const OUTER_NEIGHBOURS: usize = 2;

/// Brings the tank of `reading` to what is seen just outside the outline: shadows, caustics, mist; what is unknown becomes that.
pub(super) fn adapt_tank(reading: &mut Reading, runs: &[Run]) {
    let is_outside = |k: usize| {
        let d = outward(k) * reading.step_px;
        d > OUTSIDE_PX[0] && d < OUTSIDE_PX[1]
    };
    let outside: Vec<usize> = (0..SAMPLES_PER_LINE).filter(|&k| is_outside(k)).collect();
    let at = |line: usize| outside.iter().map(move |k| line * SAMPLES_PER_LINE + k);
    let lines = reading.lines();
    let offsets: Vec<Colour> = (0..lines)
        .map(|line| {
            let known = at(line).filter(|&at| reading.state[at] == Some(State::Known));
            medians(known.map(|at| difference(reading.picture[at], reading.tank[at])))
        })
        .collect();
    let outer: Vec<Colour> = (0..lines)
        .map(|line| medians(at(line).filter(|&at| reading.is_open(at)).map(|at| reading.picture[at])))
        .collect();
    let offsets = smoothed(&offsets, runs, OFFSET_NEIGHBOURS);
    let outer = smoothed(&outer, runs, OUTER_NEIGHBOURS);
    for line in 0..lines {
        let offset = offsets[line].unwrap_or_default();
        for at in line * SAMPLES_PER_LINE..(line + 1) * SAMPLES_PER_LINE {
            if reading.state[at] == Some(State::Unknown) {
                reading.tank[at] = outer[line].unwrap_or_default();
                continue;
            }
            for plane in 0..PLANES {
                reading.tank[at][plane] += offset[plane].clamp(-MOST_OFFSET[plane], MOST_OFFSET[plane]);
            }
        }
    }
}

/// What is seen just inside the outline, by line, where `counts` lets a line count.
pub(super) fn inside(reading: &Reading, counts: impl Fn(usize) -> bool) -> Vec<Colour> {
    let is_inside = |k: usize| {
        let d = -outward(k) * reading.step_px;
        d > INSIDE_PX[0] && d < INSIDE_PX[1]
    };
    let within: Vec<usize> = (0..SAMPLES_PER_LINE).filter(|&k| is_inside(k)).collect();
    (0..reading.lines())
        .map(|line| {
            let samples =
                within.iter().map(|k| line * SAMPLES_PER_LINE + k).filter(|&at| reading.is_open(at));
            if counts(line) { medians(samples.map(|at| reading.picture[at])) } else { None }
        })
        .collect()
}

/// Each colour the median of its neighbours in its run.
pub(super) fn smoothed(colours: &[Colour], runs: &[Run], neighbours: usize) -> Vec<Colour> {
    let mut out = vec![None; colours.len()];
    for run in runs {
        for i in run.clone() {
            let near = i.saturating_sub(neighbours).max(run.start)..(i + neighbours + 1).min(run.end);
            out[i] = medians(near.filter_map(|i| colours[i]));
        }
    }
    out
}

/// The median of each plane; none of nothing.
pub(super) fn medians(colours: impl Iterator<Item = [f32; PLANES]>) -> Colour {
    let mut planes: [Vec<f32>; PLANES] = Default::default();
    for colour in colours {
        for (plane, value) in planes.iter_mut().zip(colour) {
            plane.push(value);
        }
    }
    let [a, b, c] = planes.map(|mut values| median(&mut values));
    Some([a?, b?, c?])
}

pub(super) fn difference(a: [f32; PLANES], b: [f32; PLANES]) -> [f32; PLANES] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
