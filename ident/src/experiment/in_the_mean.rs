//! A command in steps, as the straight lines that fine steps are in the mean.
//!
//! A board that follows a profile puts out a whole number of microseconds and holds it for a millisecond; a bus servo is told another goal
//! two hundred times a second. No servo follows single ones of such steps: through one that is 20 ms late, 1.6 mrad each millisecond
//! leave a ripple below 0.1 mrad. What it does follow is their mean, which is late by half the time for which a step is held. A simulation
//! of the mean takes steps as long as that of the profile; one of the steps themselves ends its own at each of them, and is no more exact.
//!
//! Each step becomes a slope, even about its instant, so that the angle summed over time stays. Where steps are multiples of one, as of a
//! microsecond, what is left is rounding, and the lines are those of least squares, as long as the steps go: they meet where the profile turns.
//! Steps far apart, larger than those beside them, or to and from a drive that is off stay steps.

use sim::Command;

/// Steps that are held longer than this are what the servo does \[s\] (chosen): less than the 20 ms in which a hobby servo looks at its pulse once.
const HELD_MAX_S: f64 = 0.015;
/// A step larger than this many times those beside it is one that somebody wanted (chosen): those of a profile's corner differ by less.
const LEAP_RATIO_MIN: f64 = 4.0;
/// Steps are multiples of the smallest where each differs by no more than this share of itself from one (chosen): a calibration's table has parts
/// of unequal slope, and steps of a smooth motion differ by more.
const ROUNDING_SHARE_MAX: f64 = 0.12;
/// A line may pass the middle of a step at this many of the smallest step (chosen): rounding leaves half of one, and a fit needs some room.
const OFF_LINE_STEPS_MAX: f64 = 0.75;
/// How often corners are sought anew between lines fitted to either side (chosen): they are where they stay then.
const CORNER_ITERATIONS: usize = 3;
/// Two lines that meet further than this from the step between them \[s\] (chosen) are nearly one.
const CORNER_SHIFT_MAX_S: f64 = 0.01;

/// `command` with fine steps in the mean, where it consists of such; any other as it is.
pub(crate) fn in_the_mean(command: &Command) -> Command {
    let Some(steps) = command.steps() else { return command.clone() };
    let width = steps.actuators.len();
    let columns: Vec<Vec<Knot>> = (0..width)
        .map(|column| {
            let values: Vec<f64> = steps.angle_rad.iter().skip(column).step_by(width).copied().collect();
            path(&holds(&steps.time_s, &values))
        })
        .collect();
    let mut times: Vec<f64> = columns.iter().flatten().map(|knot| knot.time_s).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut mean = Command { actuators: steps.actuators, ..Command::default() };
    for time_s in times {
        let sides: Vec<[f64; 2]> = columns.iter().map(|column| about(column, time_s)).collect();
        let is_leap = sides.iter().any(|[before, after]| before.to_bits() != after.to_bits());
        for side in usize::from(!is_leap)..2 {
            mean.time_s.push(time_s);
            mean.angle_rad.extend(sides.iter().map(|sides| sides[side]));
        }
    }
    mean
}

/// A place that the path goes through, straight from the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Knot {
    time_s: f64,
    value: f64,
}

/// A value and how long it is held.
#[derive(Debug, Clone, Copy)]
struct Hold {
    from_s: f64,
    to_s: f64,
    value: f64,
}

impl Hold {
    fn lasts_s(&self) -> f64 {
        self.to_s - self.from_s
    }

    fn is_short(&self) -> bool {
        self.lasts_s() <= HELD_MAX_S
    }

    fn middle_s(&self) -> f64 {
        0.5 * (self.from_s + self.to_s)
    }
}

/// What is held and how long; the first value was always held, the last will be.
fn holds(time_s: &[f64], values: &[f64]) -> Vec<Hold> {
    let mut holds: Vec<Hold> = Vec::new();
    for (&from_s, &value) in time_s.iter().zip(values) {
        match holds.last_mut() {
            Some(last) if last.value.to_bits() == value.to_bits() => {}
            Some(last) => {
                last.to_s = from_s;
                holds.push(Hold { from_s, to_s: f64::INFINITY, value });
            }
            None => holds.push(Hold { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY, value }),
        }
    }
    holds
}

/// The values of a path at `time_s`, come to and gone from.
fn about(path: &[Knot], time_s: f64) -> [f64; 2] {
    let first = path.partition_point(|knot| knot.time_s < time_s);
    let next = path.partition_point(|knot| knot.time_s <= time_s);
    if first < next {
        return [path[first].value, path[next - 1].value];
    }
    let value = match (first.checked_sub(1).map(|before| path[before]), path.get(first)) {
        (Some(a), Some(b)) if !b.value.is_nan() && !a.value.is_nan() => {
            a.value + (time_s - a.time_s) / (b.time_s - a.time_s) * (b.value - a.value)
        }
        (Some(a), _) => a.value,
        (None, Some(b)) => b.value,
        (None, None) => 0.0,
    };
    [value; 2]
}

/// The path that `holds` are in the mean.
fn path(holds: &[Hold]) -> Vec<Knot> {
    let mut knots: Vec<Knot> = Vec::new();
    let mut first = 0;
    for last in 0..holds.len() {
        if last + 1 < holds.len() && is_fine(holds, last) {
            continue;
        }
        slopes(&holds[first..=last], &mut knots);
        first = last + 1;
    }
    if knots.is_empty() {
        // nothing ever moves
        knots.extend(holds.first().map(|hold| Knot { time_s: 0.0, value: hold.value }));
    }
    knots
}

/// Whether the step after hold `before` is one of many alike.
fn is_fine(holds: &[Hold], before: usize) -> bool {
    let size = |step: usize| (holds[step + 1].value - holds[step].value).abs();
    let (here, next) = (&holds[before], &holds[before + 1]);
    let beside_before = (before > 0 && here.is_short()).then(|| size(before - 1));
    let beside_after = (before + 2 < holds.len() && next.is_short()).then(|| size(before + 1));
    // a drive that is off has no number, and no step to or from it is fine
    let beside = beside_before.into_iter().chain(beside_after).filter(|size| size.is_finite());
    beside.reduce(f64::max).is_some_and(|largest| size(before) <= LEAP_RATIO_MIN * largest)
}

/// Appends the way through `holds`, all steps between which are fine.
fn slopes(holds: &[Hold], knots: &mut Vec<Knot>) {
    let mut push = |time_s: f64, value: f64, is_leap: bool| {
        let is_new = knots.last().is_none_or(|last| last.time_s < time_s || is_leap && last.time_s == time_s);
        if time_s.is_finite() && is_new {
            knots.push(Knot { time_s, value });
        }
    };
    let [Some(first), Some(last)] = [holds.first(), holds.last()] else { return };
    match rounded_to(holds) {
        Some(step) => {
            let lines = lines(holds, OFF_LINE_STEPS_MAX * step);
            push(first.from_s, lines[0].at(first.from_s), true);
            for pair in lines.windows(2) {
                let (time_s, value) = pair[0].corner(&pair[1], holds[pair[1].first].from_s);
                push(time_s, value, false);
            }
            push(last.to_s, lines[lines.len() - 1].at(last.to_s), false);
        }
        None => {
            push(first.from_s, first.value, true);
            for pair in holds.windows(2) {
                let half_s = 0.5 * pair[0].lasts_s().min(pair[1].lasts_s());
                push(pair[0].to_s - half_s, pair[0].value, false);
                push(pair[1].from_s + half_s, pair[1].value, false);
            }
            push(last.to_s, last.value, false);
        }
    }
}

/// The step of which all between `holds` are multiples, if there is one.
fn rounded_to(holds: &[Hold]) -> Option<f64> {
    let sizes = || holds.windows(2).map(|pair| (pair[1].value - pair[0].value).abs());
    let step = sizes().reduce(f64::min)?;
    let is_multiple = |size: f64| {
        let times = size / step;
        (times - times.round()).abs() <= ROUNDING_SHARE_MAX * times.round()
    };
    sizes().all(is_multiple).then_some(step)
}

/// A straight line through some of the holds.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Index of the first hold.
    first: usize,
    about_s: f64,
    value: f64,
    slope: f64,
}

impl Line {
    fn at(&self, time_s: f64) -> f64 {
        // a hold without an end is level
        if self.slope == 0.0 { self.value } else { self.value + self.slope * (time_s - self.about_s) }
    }

    /// Through `holds`, of which the first has the index `first`: what leaves the least square, over time.
    fn through(holds: &[Hold], first: usize) -> Self {
        let level = |value| Self { first, about_s: 0.0, value, slope: 0.0 };
        if let [only] = holds {
            return level(only.value);
        }
        let lasts_s: f64 = holds.iter().map(Hold::lasts_s).sum();
        let (from_s, to_s) = (holds[0].from_s, holds[holds.len() - 1].to_s);
        let about_s = 0.5 * (from_s + to_s);
        let value = holds.iter().map(|hold| hold.lasts_s() * hold.value).sum::<f64>() / lasts_s;
        let moment: f64 = holds
            .iter()
            .map(|hold| hold.lasts_s() * (hold.middle_s() - about_s) * (hold.value - value))
            .sum();
        Self { first, about_s, value, slope: 12.0 * moment / lasts_s.powi(3) }
    }

    /// Where this line goes over into the `next`, about `step_s`, and the value there.
    fn corner(&self, next: &Self, step_s: f64) -> (f64, f64) {
        let ahead = next.at(step_s) - self.at(step_s);
        let after_s = ahead / (self.slope - next.slope);
        if after_s.abs() <= CORNER_SHIFT_MAX_S {
            let time_s = step_s + after_s;
            return (time_s, self.at(time_s));
        }
        (step_s, 0.5 * (self.at(step_s) + next.at(step_s)))
    }
}

/// Lines through `holds` in turn, each off the middle of none of its holds by more than `most`; a long hold is a line of its own.
fn lines(holds: &[Hold], most: f64) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    let mut first = 0;
    while first < holds.len() {
        let mut line = Line::through(&holds[first..=first], first);
        let mut next = first + 1;
        while holds[first].is_short() && next < holds.len() && holds[next].is_short() {
            let longer = Line::through(&holds[first..=next], first);
            let off = |hold: &Hold| (longer.at(hold.middle_s()) - hold.value).abs();
            if holds[first..=next].iter().any(|hold| off(hold) > most) {
                break;
            }
            line = longer;
            next += 1;
        }
        lines.push(line);
        first = next;
    }
    for _ in 0..CORNER_ITERATIONS {
        for place in 1..lines.len() {
            let end = lines.get(place + 1).map_or(holds.len(), |line| line.first);
            let (begin, first) = (lines[place - 1].first, lines[place].first);
            if !(holds[first - 1].is_short() && holds[first].is_short()) {
                continue;
            }
            let (corner_s, _) = lines[place - 1].corner(&lines[place], holds[first].from_s);
            let first = begin + holds[begin..end].partition_point(|hold| hold.middle_s() < corner_s);
            let first = first.clamp(begin + 1, end - 1);
            lines[place - 1] = Line::through(&holds[begin..first], begin);
            lines[place] = Line::through(&holds[first..end], first);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A microsecond of pulse.
    const STEP_RAD: f64 = 1.57e-3;

    /// What a board puts out for the straight lines between `corners`: each millisecond the nearest whole step.
    fn put_out(corners: &[(f64, f64)]) -> Command {
        let line = |t: f64| {
            let next = corners.partition_point(|&(at, _)| at <= t).clamp(1, corners.len() - 1);
            let ((t0, a0), (t1, a1)) = (corners[next - 1], corners[next]);
            a0 + (a1 - a0) * ((t - t0) / (t1 - t0)).clamp(0.0, 1.0)
        };
        let (from_s, to_s) = (corners[0].0, corners[corners.len() - 1].0);
        let mut sent = Command { actuators: vec!["servo".into()], ..Command::default() };
        for k in 0..=((to_s - from_s) / 1e-3).round() as usize {
            let time_s = from_s + k as f64 * 1e-3;
            let angle = (line(time_s) / STEP_RAD).round() * STEP_RAD;
            if sent.angle_rad.last() != Some(&angle) {
                sent.time_s.push(time_s);
                sent.angle_rad.push(angle);
            }
        }
        sent.held()
    }

    #[test]
    fn a_board_s_pulses_are_its_profile_half_a_millisecond_late() {
        let at = |steps: i32| f64::from(steps) * STEP_RAD;
        let corners =
            [(0.3, at(0)), (0.55, at(300)), (1.05, at(-300)), (2.05, at(300)), (2.3, at(0)), (2.8, at(0))];
        let mean = in_the_mean(&put_out(&corners));
        assert!(mean.time_s.len() < 12, "{:?}", mean.time_s);
        let late = |t: f64| {
            let next = corners.partition_point(|&(at, _)| at <= t - 5e-4).clamp(1, corners.len() - 1);
            let ((t0, a0), (t1, a1)) = (corners[next - 1], corners[next]);
            a0 + (a1 - a0) * ((t - 5e-4 - t0) / (t1 - t0)).clamp(0.0, 1.0)
        };
        for k in 0..2800 {
            let t = 1e-3 * f64::from(k);
            assert!((mean.at(0, t) - late(t)).abs() < 0.15 * STEP_RAD, "{t}: {} {}", mean.at(0, t), late(t));
        }
        let motion_s = mean.first_motion_s().unwrap();
        assert!((motion_s - 0.3005).abs() < 2e-4, "{motion_s}");
    }

    #[test]
    fn goals_of_a_smooth_motion_are_straight_between_and_jumps_stay() {
        let path = |t: f64| if t < 1.0 { (3.0 * t).sin() } else { 2.0 };
        let time_s: Vec<f64> = (0..400).map(|k| f64::from(k) / 185.0).collect();
        let angle_rad: Vec<f64> = time_s.iter().map(|&t| path(t)).collect();
        let sent = Command { actuators: vec!["servo".into()], time_s, angle_rad }.held();
        let mean = in_the_mean(&sent);
        for k in 20..360 {
            let t = 0.0061 * f64::from(k);
            let half_s = 0.5 / 185.0;
            let expected = if t < 0.98 { path(t - half_s) } else { sent.at(0, t) };
            let limit = if !(0.98..=1.01).contains(&t) { 1e-4 } else { 0.05 };
            assert!((mean.at(0, t) - expected).abs() < limit, "{t}: {} {expected}", mean.at(0, t));
        }
        let leaps = mean.time_s.windows(2).filter(|pair| pair[0] == pair[1]).count();
        assert_eq!(leaps, 1);
    }

    #[test]
    fn steps_far_apart_drives_that_are_off_and_straight_rows_stay() {
        let rows = |values: Vec<f64>, apart_s: f64| Command {
            actuators: vec!["a".into()],
            time_s: (0..values.len()).map(|k| k as f64 * apart_s).collect(),
            angle_rad: values,
        };
        let same = |a: &Command, b: &Command| {
            (0..400).map(|k| 1e-3 * f64::from(k) + 1e-4).all(|t| a.at(0, t).to_bits() == b.at(0, t).to_bits())
        };
        let far = rows(vec![0.0, 0.1, 0.2, 0.3], 0.05).held();
        assert!(same(&in_the_mean(&far), &far));
        let off = rows(vec![0.0, f64::NAN, 0.5, 0.5], 0.05).held();
        assert!(same(&in_the_mean(&off), &off));
        let straight = rows(vec![0.0, 0.1, 0.2, 0.3], 0.001);
        assert_eq!(in_the_mean(&straight), straight);
    }
}
