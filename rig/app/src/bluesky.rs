//! A recorded run as the documents of Bluesky's event model (start, descriptors, events, stop), a JSON array `[name, document]` a line:
//! what `databroker`'s catalog of JSON lines and pandas read.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use anyhow::Context as _;
use jiff::Timestamp;
use serde_json::{Map, Value, json};

use super::Failure;
use record::folder::{RunFolder, file};
use record::journal;
use record::outputs::OutputFile;

/// The streams that are tables of a run folder: name, file, what the numbers come from. The first is Bluesky's name for what was measured.
const TABLES: [(&str, &str, &str); 3] = [
    ("primary", file::TRAJECTORY, "keypoints in the pictures"),
    ("servo", file::SERVO, "servo"),
    ("images", file::FRAMES, "camera"),
];
/// The stream of what happened, see `journal.jsonl`.
const JOURNAL: &str = "journal";
/// Ends of column names that are units.
const UNITS: [&str; 5] = ["m", "rad", "s", "ns", "px"];

/// Writes `run` to `out`; what was left out comes back, a sentence each.
///
/// # Errors
/// [`Failure::Input`] where the run or `out` cannot be read or written.
pub fn export(run: &Path, out: &OutputFile) -> Result<Vec<String>, Failure> {
    let run = RunFolder::open(run).map_err(Failure::input)?;
    let began = run.start().clock.utc.parse::<Timestamp>();
    let began = began
        .with_context(|| format!("{}: clock.utc", run.file(file::START).display()))
        .map_err(Failure::Input)?;
    let part = out.begin().map_err(Failure::input)?;
    let mut documents = Documents {
        id: run.start().id.to_string(),
        began_s: began.as_nanosecond() as f64 * 1e-9,
        events: BTreeMap::new(),
        out: std::io::BufWriter::new(part),
    };
    let mut left_out = Vec::new();
    documents.start(&run)?;
    for (name, table, source) in TABLES {
        let path = run.file(table);
        if path.is_file() {
            documents.table(name, &path, source)?;
        } else {
            left_out.push(format!("no stream {name}: the run has no {table}"));
        }
    }
    let path = run.file(file::JOURNAL);
    if path.is_file() {
        documents.journal(&path)?;
    }
    match run.incomplete() {
        None => documents.stop(&run)?,
        Some(why) => left_out.push(format!("no stop document: {why}")),
    }
    let writing = || format!("writing {}", out.path().display());
    let part = documents.out.into_inner().map_err(|error| error.into_error());
    part.with_context(writing).map_err(Failure::Input)?.finish().map_err(Failure::input)?;
    Ok(left_out)
}

/// The documents of a run, as they are written.
struct Documents<W: Write> {
    /// The run's name, which the names of all documents begin with.
    id: String,
    /// Wall-clock time of the run's start \[s since 1970\].
    began_s: f64,
    /// Number of events of each stream.
    events: BTreeMap<String, u64>,
    out: W,
}

impl<W: Write> Documents<W> {
    fn write(&mut self, name: &str, document: Value) -> Result<(), Failure> {
        writeln!(self.out, "{}", json!([name, document])).map_err(Failure::input)
    }

    fn start(&mut self, run: &RunFolder) -> Result<(), Failure> {
        let start = run.start();
        let document = json!({
            "uid": self.id,
            "time": self.began_s,
            "scan_id": start.number,
            "plan_name": start.kind,
            "rig_version": start.version,
            "model": start.model,
            "config_toml": start.config,
            "camera": start.camera.as_ref().map(|camera| &camera.name),
            "board": start.board.as_ref().map(|board| &board.name),
            "hints": { "dimensions": [[["time_s"], "primary"]] },
        });
        self.write("start", document)
    }

    /// Writes a stream: its keys with what describes each, then its rows of time since the run's start \[s\] and values.
    fn stream(
        &mut self,
        name: &str,
        keys: Map<String, Value>,
        rows: impl Iterator<Item = Result<(f64, Map<String, Value>), Failure>>,
    ) -> Result<(), Failure> {
        let descriptor = format!("{}-{name}", self.id);
        let names: Vec<String> = keys.keys().cloned().collect();
        let document = json!({
            "uid": descriptor,
            "run_start": self.id,
            "time": self.began_s,
            "name": name,
            "data_keys": keys,
            "object_keys": { name: names },
            "hints": {},
            "configuration": {},
        });
        self.write("descriptor", document)?;
        let mut count = 0_u64;
        for row in rows {
            let (time_s, data) = row?;
            let time = self.began_s + time_s;
            count += 1;
            let timestamps: Map<String, Value> = data.keys().map(|key| (key.clone(), json!(time))).collect();
            let document = json!({
                "uid": format!("{descriptor}-{count}"),
                "descriptor": descriptor,
                "seq_num": count,
                "time": time,
                "data": data,
                "timestamps": timestamps,
                "filled": {},
            });
            self.write("event", document)?;
        }
        self.events.insert(name.into(), count);
        Ok(())
    }

    /// A table with `time_s`, a row an event. A cell without a number in a column of numbers is null, which arrays have as NaN.
    fn table(&mut self, name: &str, path: &Path, source: &str) -> Result<(), Failure> {
        let reading = || format!("reading {}", path.display());
        let wrong = |error: csv::Error| Failure::Input(anyhow::Error::new(error).context(reading()));
        let mut reader = csv::Reader::from_path(path).map_err(wrong)?;
        let header: Vec<String> = reader.headers().map_err(wrong)?.iter().map(str::to_owned).collect();
        let rows: Vec<csv::StringRecord> = reader.records().collect::<Result<_, _>>().map_err(wrong)?;
        let Some(time) = header.iter().position(|column| column == "time_s") else {
            return Err(Failure::Input(anyhow::anyhow!("{}: it has no column time_s", reading())));
        };
        let units = header.iter().map(|column| column.rsplit_once('_').map(|(_, end)| end));
        let units: Vec<Option<&str>> = units.map(|end| end.filter(|end| UNITS.contains(end))).collect();
        let cells = |column| rows.iter().filter_map(move |row| row.get(column));
        let kinds = units.iter().enumerate().map(|(column, unit)| Kind::of(cells(column), *unit));
        let kinds: Vec<Kind> = kinds.collect();
        let keys = header.iter().zip(&kinds).zip(&units);
        let keys = keys.map(|((column, kind), unit)| (column.clone(), data_key(kind.name(), source, *unit)));
        let keys: Map<String, Value> = keys.collect();
        let events = rows.iter().enumerate().map(|(index, row)| {
            let time_s: f64 = row.get(time).unwrap_or_default().parse().map_err(|error| {
                Failure::Input(anyhow::anyhow!("{}: row {}: time_s: {error}", reading(), index + 1))
            })?;
            let cells = header.iter().zip(row).zip(&kinds);
            let cells = cells.map(|((column, cell), kind)| (column.clone(), kind.value(cell)));
            Ok((time_s, cells.collect()))
        });
        self.stream(name, keys, events)
    }

    fn journal(&mut self, path: &Path) -> Result<(), Failure> {
        let entries = journal::read(path).map_err(Failure::input)?;
        let key = |dtype, unit| data_key(dtype, file::JOURNAL, unit);
        let keys = [
            ("time_s".to_owned(), key("number", Some("s"))),
            ("event".into(), key("string", None)),
            ("details".into(), key("string", None)),
        ];
        let events = entries.into_iter().map(|entry| {
            let details = Value::Object(entry.details).to_string();
            let data = json!({ "time_s": entry.at_s, "event": entry.event, "details": details });
            Ok((entry.at_s, data.as_object().cloned().unwrap_or_default()))
        });
        self.stream(JOURNAL, Map::from_iter(keys), events)
    }

    fn stop(&mut self, run: &RunFolder) -> Result<(), Failure> {
        let Some(stop) = run.stop() else { return Ok(()) };
        let document = json!({
            "uid": format!("{}-stop", self.id),
            "run_start": self.id,
            "time": self.began_s + stop.clock.monotonic_ns.seconds_since(run.origin()),
            "exit_status": stop.status,
            "reason": stop.reason.as_deref().unwrap_or_default(),
            "num_events": self.events,
        });
        self.write("stop", document)
    }
}

/// What the cells of a column are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Boolean,
    Integer,
    Number,
    Text,
}

impl Kind {
    /// What all of a column's `cells` are. Only a column of numbers may have empty ones.
    fn of<'a>(cells: impl Iterator<Item = &'a str> + Clone, unit: Option<&str>) -> Self {
        let all = |holds: fn(&str) -> bool| cells.clone().all(holds);
        if all(str::is_empty) {
            // no row, or a gap in each
            if unit.is_some() { Self::Number } else { Self::Text }
        } else if all(|cell| cell.parse::<bool>().is_ok()) {
            Self::Boolean
        } else if unit.is_none_or(|unit| unit == "ns") && all(|cell| cell.parse::<i64>().is_ok()) {
            Self::Integer
        } else if all(|cell| cell.is_empty() || cell.parse::<f64>().is_ok()) {
            Self::Number
        } else {
            Self::Text
        }
    }

    /// As the event model calls it.
    fn name(self) -> &'static str {
        match self {
            Self::Boolean => "boolean",
            Self::Integer => "integer",
            Self::Number => "number",
            Self::Text => "string",
        }
    }

    fn value(self, cell: &str) -> Value {
        match self {
            Self::Boolean => json!(cell.parse::<bool>().ok()),
            Self::Integer => json!(cell.parse::<i64>().ok()),
            Self::Number => json!(cell.parse::<f64>().ok()),
            Self::Text => json!(cell),
        }
    }
}

/// What describes a column.
fn data_key(dtype: &str, source: &str, unit: Option<&str>) -> Value {
    let mut key = json!({ "dtype": dtype, "shape": [], "source": source });
    if let Some(unit) = unit {
        key["units"] = json!(unit);
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_is_what_all_its_cells_are() {
        for (cells, unit, kind) in [
            (&["true", "false"][..], None, Kind::Boolean),
            (&["0", "1"], None, Kind::Integer),
            (&["25508844981204", "9007199254740993"], Some("ns"), Kind::Integer),
            (&["0", "1"], Some("s"), Kind::Number),
            (&["0", ""], None, Kind::Number),
            (&["", ""], Some("m"), Kind::Number),
            (&["", ""], None, Kind::Text),
            (&["", "no keypoint"], None, Kind::Text),
        ] {
            assert_eq!(Kind::of(cells.iter().copied(), unit).name(), kind.name(), "{cells:?}");
        }
        assert_eq!(Kind::Integer.value("9007199254740993").to_string(), "9007199254740993");
        assert_eq!(Kind::Number.value(""), Value::Null);
    }
}
