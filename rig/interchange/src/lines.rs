//! Lines of a WCON document: how an entry holds them, and keypoints on them.

use serde_json::Value;

use super::wcon::Line;
use super::{Imported, InterchangeError};
use vision::spline::{arc_lengths, point_at};

/// A place farther off than this is in no tank \[m\].
const COORDINATE_LIMIT_M: f64 = 1e4;

/// The keys of the origin that an entry's points count from, if it has one: its own, or the centroid.
pub(super) fn offset_keys(entry: &Value) -> Option<[&'static str; 2]> {
    let has = |keys: [&'static str; 2]| keys.iter().any(|key| !entry[*key].is_null()).then_some(keys);
    has(["ox", "oy"]).or_else(|| has(["cx", "cy"]))
}

/// The lines of one entry at `place` in the document. `t`, `scales` and those of `offsets`: seconds and metres in one of the file's units.
pub(super) fn of_entry(
    entry: &Value,
    place: &str,
    t: f64,
    scales: [f64; 2],
    offsets: Option<([&'static str; 2], [f64; 2])>,
) -> Result<Vec<Line>, InterchangeError> {
    let refused = |key: &str, what: String| InterchangeError::place(format!("{place}.{key}"), what);
    let times = match &entry["t"] {
        Value::Null => return Err(refused("t", "is missing".into())),
        Value::Array(times) => times.iter().collect(),
        time => vec![time],
    };
    let many = entry["t"].is_array();
    // `value` of `key` at instant `i`: one for each instant, or one for all.
    let at = |key: &'static str, i: usize| match &entry[key] {
        Value::Array(list) if many => list.get(i).unwrap_or(&Value::Null),
        value => value,
    };
    for key in ["x", "y"] {
        match &entry[key] {
            Value::Null if entry.get(key).is_none() => return Err(refused(key, "is missing".into())),
            Value::Array(list) if many && list.len() != times.len() => {
                return Err(refused(key, format!("has {} rows for {} times", list.len(), times.len())));
            }
            Value::Array(_) => {}
            _ if many && times.len() > 1 => {
                return Err(refused(key, format!("is one number for {} times", times.len())));
            }
            _ => {}
        }
    }
    let line = |(i, time): (usize, &Value)| {
        let Some(time_s) = time.as_f64().map(|time| time * t).filter(|time_s| time_s.is_finite()) else {
            return Err(refused(&format!("t[{i}]"), format!("{time} is not a number")));
        };
        let mut origin = [0.0; 2];
        if let Some((keys, sizes)) = offsets {
            for axis in 0..2 {
                let Some(offset) = at(keys[axis], i).as_f64() else {
                    return Err(refused(&format!("{}[{i}]", keys[axis]), "is missing or no number".into()));
                };
                origin[axis] = offset * sizes[axis];
            }
        }
        let coordinates = |key: &'static str, axis: usize| -> Result<Vec<Option<f64>>, InterchangeError> {
            let one = |value: &Value| match value {
                Value::Null => Ok(None),
                value => match value.as_f64().map(|value| value * scales[axis] + origin[axis]) {
                    Some(metres) if metres.abs() <= COORDINATE_LIMIT_M => Ok(Some(metres)),
                    Some(metres) => {
                        let what = format!(
                            "{value} is {metres:e} m, in no tank (limit {COORDINATE_LIMIT_M} m); check the units"
                        );
                        Err(refused(&format!("{key}[{i}]"), what))
                    }
                    None => Err(refused(&format!("{key}[{i}]"), format!("{value} is not a number"))),
                },
            };
            match at(key, i) {
                Value::Array(list) => list.iter().map(one).collect(),
                value => one(value).map(|one| vec![one]),
            }
        };
        let (x, y) = (coordinates("x", 0)?, coordinates("y", 1)?);
        if x.len() != y.len() {
            return Err(refused(&format!("x[{i}]"), format!("has {} points, y has {}", x.len(), y.len())));
        }
        let mut points: Vec<Option<[f64; 2]>> =
            x.into_iter().zip(y).map(|(x, y)| x.zip(y).map(|(x, y)| [x, y])).collect();
        // The head is our base.
        if at("head", i).as_str() == Some("R") {
            points.reverse();
        }
        Ok(Line { time_s, points })
    };
    times.into_iter().enumerate().map(line).collect()
}

/// P0..Pn at `shares` of each line's length.
pub(super) fn at_shares(lines: &[Line], shares: &[f64]) -> Imported {
    let mut imported = Imported::of((0..shares.len()).map(|i| format!("P{i}")).collect());
    for (i, line) in lines.iter().enumerate() {
        let points = match whole(line) {
            Ok(points) => {
                let lengths = arc_lengths(&points);
                let total = lengths.last().copied().unwrap_or(0.0);
                shares.iter().map(|share| Ok(point_at(&points, &lengths, share * total))).collect()
            }
            Err(why) => vec![Err(why); shares.len()],
        };
        imported.push(i.to_string(), line.time_s, points);
    }
    imported
}

/// A line of which no point is missing: a length past a gap would be a guess.
fn whole(line: &Line) -> Result<Vec<[f64; 2]>, String> {
    let points: Vec<[f64; 2]> = line.points.iter().flatten().copied().collect();
    match (points.len(), line.points.len()) {
        (found, of) if found < of => Err(format!("{} of the line's {of} points are missing", of - found)),
        (found, _) if found < 2 => Err(format!("a line has two points or more, this one {found}")),
        _ if points.iter().all(|point| *point == points[0]) => Err("the line has no length".into()),
        _ => Ok(points),
    }
}

/// Lines whose points are the keypoints `names`.
pub(super) fn as_they_are(lines: &[Line], names: &[String]) -> Imported {
    let mut imported = Imported::of(names.to_vec());
    for (i, line) in lines.iter().enumerate() {
        let points = match line.points.len() == names.len() {
            true => line.points.iter().map(|point| point.ok_or_else(|| "not seen".to_owned())).collect(),
            false => {
                let why = format!("the line has {} points for {} keypoints", line.points.len(), names.len());
                vec![Err(why); names.len()]
            }
        };
        imported.push(i.to_string(), line.time_s, points);
    }
    imported
}

/// Keypoints that are tracks of one point, at the times of all of them.
pub(super) fn one_each(tracks: Vec<(String, &[Line])>) -> Imported {
    let mut times_s: Vec<f64> =
        tracks.iter().flat_map(|(_, lines)| lines.iter().map(|line| line.time_s)).collect();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup();
    let (names, tracks): (Vec<String>, Vec<&[Line]>) = tracks.into_iter().unzip();
    let mut imported = Imported::of(names);
    for (i, time_s) in times_s.into_iter().enumerate() {
        let point = |lines: &&[Line]| {
            let line = lines.binary_search_by(|line| line.time_s.total_cmp(&time_s));
            let line = line.map(|at| &lines[at]).map_err(|_| "not in the file at this time".to_owned())?;
            match line.points[..] {
                [point] => point.ok_or_else(|| "not seen".to_owned()),
                _ => Err(format!("the track has {} points, a keypoint has one", line.points.len())),
            }
        };
        imported.push(i.to_string(), time_s, tracks.iter().map(point).collect());
    }
    imported
}
