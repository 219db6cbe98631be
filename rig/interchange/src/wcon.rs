//! Worm tracker Commons Object Notation: lines over time, in units of the file's own, as a JSON document.
//!
//! Its `x` and `y` are ours to the right and upward. A gap is `null`. Lines that are keypoints themselves have their names in the block
//! `@rig` that we write; other programs pass over it.

use serde_json::{Map, Value, json};

use super::error::listed;
use super::units::{Kind, factor};
use super::{Imported, InterchangeError, lines};

/// What moves, at one instant: its points from one end to the other, `[x, z]` \[m\], none where one is missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// When \[s\].
    pub time_s: f64,
    /// Where; as many as the file says.
    pub points: Vec<Option<[f64; 2]>>,
}

/// All lines of one that moves, in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Animal {
    /// Its name in the file.
    pub id: String,
    /// Its lines.
    pub lines: Vec<Line>,
}

/// A document.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// What moves.
    pub animals: Vec<Animal>,
    /// The points' names, where the points are keypoints.
    pub keypoints: Option<Vec<String>>,
    /// The files before and after this one, where it is one of a series.
    pub series: Vec<String>,
}

/// What a document is that is no WCON.
fn other_json(root: &Value) -> InterchangeError {
    let has =
        |key: &str| root.get(key).is_some() || root.get(0).is_some_and(|first| first.get(key).is_some());
    let known = [("annotations", "COCO keypoints"), ("people", "OpenPose"), ("keypoints", "COCO results")];
    let form = known
        .iter()
        .find(|(key, _)| has(key))
        .map_or(String::new(), |(_, form)| format!(" (it looks like {form})"));
    InterchangeError::Unknown {
        what: format!(
            "JSON, but no WCON, which has `units` and `data`{form}; convert it to a table of `time_s,P0_x_m,P0_z_m,...` or to DeepLabCut's CSV"
        ),
    }
}

/// Reads `text`.
///
/// # Errors
/// [`InterchangeError`] with the place in the document.
pub fn read(text: &str) -> Result<Document, InterchangeError> {
    let root: Value = serde_json::from_str(text.strip_prefix('\u{feff}').unwrap_or(text))?;
    if root.get("units").is_none() && root.get("data").is_none() {
        return Err(other_json(&root));
    }
    let units = |key: &str| root["units"][key].as_str();
    let scale = |key: &str, kind: Kind| {
        let Some(unit) = units(key) else {
            return Err(InterchangeError::place("units", format!("says no unit of {key}")));
        };
        let wanted = if kind == Kind::Time { "time, such as s" } else { "length, such as mm" };
        factor(unit, kind).ok_or_else(|| {
            InterchangeError::place(format!("units.{key}"), format!("`{unit}` is no unit of {wanted}"))
        })
    };
    let t = scale("t", Kind::Time)?;
    let scales = [scale("x", Kind::Length)?, scale("y", Kind::Length)?];
    let entries = match &root["data"] {
        Value::Array(entries) => entries.iter().collect(),
        entry @ Value::Object(_) => vec![entry],
        _ => return Err(InterchangeError::place("data", "is no list of what moves")),
    };
    let mut animals: Vec<Animal> = Vec::new();
    for (i, entry) in entries.into_iter().enumerate() {
        let place = format!("data[{i}]");
        let id = match &entry["id"] {
            Value::String(id) => id.clone(),
            Value::Number(id) => id.to_string(),
            _ => return Err(InterchangeError::place(place, "has no id, a text or a number")),
        };
        let offsets = lines::offset_keys(entry)
            .map(|keys| -> Result<_, InterchangeError> {
                Ok((keys, [scale(keys[0], Kind::Length)?, scale(keys[1], Kind::Length)?]))
            })
            .transpose()?;
        let found = lines::of_entry(entry, &place, t, scales, offsets)?;
        match animals.iter_mut().find(|animal| animal.id == id) {
            Some(animal) => animal.lines.extend(found),
            None => animals.push(Animal { id, lines: found }),
        }
    }
    for animal in &mut animals {
        animal.lines.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // Files that were put together say some things twice.
        animal.lines.dedup();
        if let Some(pair) = animal.lines.windows(2).find(|pair| pair[0].time_s == pair[1].time_s) {
            let what = format!("two lines at {} s", pair[0].time_s);
            return Err(InterchangeError::place(format!("id {}", animal.id), what));
        }
    }
    let strings = |value: &Value| -> Vec<String> {
        let list = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
        list.iter().filter_map(|name| name.as_str().map(str::to_owned)).collect()
    };
    let keypoints = Some(strings(&root["@rig"]["keypoints"])).filter(|names| !names.is_empty());
    let series = [&root["files"]["prev"], &root["files"]["next"]].into_iter().flat_map(strings).collect();
    Ok(Document { animals, keypoints, series })
}

impl Document {
    /// The one that moves, or of several the one that is called `id`.
    ///
    /// # Errors
    /// [`InterchangeError::Choice`] with those that there are.
    pub fn animal(&self, id: Option<&str>) -> Result<&Animal, InterchangeError> {
        let names: Vec<&str> = self.animals.iter().map(|animal| animal.id.as_str()).collect();
        match (id, &self.animals[..]) {
            (_, []) => Err(InterchangeError::place("data", "is empty")),
            (None, [only]) => Ok(only),
            (None, _) => {
                let what = format!(
                    "several ids: say with --id which line is meant, or with --keypoints which of them are keypoints; the file has {}",
                    listed(&names)
                );
                Err(InterchangeError::choice(what))
            }
            (Some(id), animals) => animals.iter().find(|animal| animal.id == id).ok_or_else(|| {
                InterchangeError::choice(format!("there is no id `{id}`; the file has {}", listed(&names)))
            }),
        }
    }

    /// The keypoints of [`Document::animal`]: its points where they are keypoints, else places on its line at `shares` of its length.
    ///
    /// # Errors
    /// As [`Document::animal`].
    pub fn imported(&self, id: Option<&str>, shares: &[f64]) -> Result<Imported, InterchangeError> {
        let animal = self.animal(id)?;
        Ok(match &self.keypoints {
            Some(names) => lines::as_they_are(&animal.lines, names),
            None => lines::at_shares(&animal.lines, shares),
        })
    }

    /// Keypoints that are a track each, as in `asked` (see [`super::marks::chosen`]), at the times of all of them.
    ///
    /// # Errors
    /// [`InterchangeError::Choice`] where there is no such track.
    pub fn one_each(&self, asked: &str) -> Result<Imported, InterchangeError> {
        let ids: Vec<String> = self.animals.iter().map(|animal| animal.id.clone()).collect();
        let choices = super::marks::chosen(&ids, Some(asked))?;
        let tracks =
            choices.into_iter().map(|(name, at)| (name, self.animals[at].lines.as_slice())).collect();
        Ok(lines::one_each(tracks))
    }
}

/// A document to write.
#[derive(Debug, Clone)]
pub struct Written<'a> {
    /// What moves.
    pub id: &'a str,
    /// Its lines.
    pub lines: Vec<Line>,
    /// The points' names, where the points are keypoints.
    pub keypoints: Option<&'a [String]>,
    /// What became of each image, as `file`, `status` and `reason`.
    pub images: Option<Value>,
}

/// The document as JSON, in seconds and millimetres; x is to the right and y up in the picture.
///
/// # Source
/// Worm tracker Commons Object Notation, openworm/tracker-commons.
pub fn document(written: &Written<'_>) -> Value {
    const MM: f64 = 1e3;
    let axis = |axis: usize| -> Vec<Vec<Option<f64>>> {
        let coordinate =
            |point: &Option<[f64; 2]>| point.map(|point| point[axis] * MM).filter(|mm| mm.is_finite());
        written.lines.iter().map(|line| line.points.iter().map(coordinate).collect()).collect()
    };
    let times: Vec<f64> = written.lines.iter().map(|line| line.time_s).collect();
    let mut own = Map::new();
    own.extend(written.keypoints.map(|names| ("keypoints".to_owned(), json!(names))));
    own.extend(written.images.clone().map(|images| ("images".to_owned(), images)));
    json!({
        "units": { "t": "s", "x": "mm", "y": "mm" },
        "data": [{ "id": written.id, "t": times, "x": axis(0), "y": axis(1) }],
        "metadata": { "software": { "name": "rig", "version": env!("CARGO_PKG_VERSION") } },
        "comments": ["y is upward"],
        "@rig": own,
    })
}

#[cfg(test)]
mod tests;
