//! Every number of a config may be anything: it is used, or refused by its key, and nothing panics on it.

use crate::measured;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use toml::{Table, Value};

use super::RigConfig;
use servo::profile::Profile;

/// A key of a config: its tables and its name, and a value of its.
type Key = (Vec<String>, Value);

/// The config that explains every key, and all that hold numbers: those left at their defaults stand in comments.
fn reference() -> (PathBuf, Table, Vec<Key>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-hanging.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let (mut table, mut keys) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let line = line.strip_prefix("# ").unwrap_or(line);
        let is_header = line.starts_with('[');
        let name = line.trim_start_matches('[').split(']').next().unwrap_or_default();
        if is_header {
            table = name.split('.').map(str::to_owned).collect();
        } else if let Ok(one) = line.parse::<Table>()
            && let Some((key, value)) = one.into_iter().next()
            && numbers(&value)
        {
            keys.push(([table.clone(), vec![key]].concat(), value));
        }
    }
    let mut config = text.parse().unwrap();
    // what these tables do not go without
    for (table, key, value) in [("schedule", "cron", "0 3 * * *"), ("vision.sam2", "weights", "sam2")] {
        let place: Vec<String> = table.split('.').chain([key]).map(str::to_owned).collect();
        put(&mut config, &place, &value.into());
    }
    let click =
        Table::from_iter([("x_px", 320.0), ("y_px", 200.0)].map(|(key, px)| (key.to_owned(), px.into())));
    let place = ["vision", "sam2", "clicks"].map(str::to_owned);
    put(&mut config, &place, &Value::Array(vec![click.into()]));
    RigConfig::parse(&toml::to_string(&config).unwrap(), &path).unwrap_or_else(|error| panic!("{error}"));
    (path, config, keys)
}

/// Whether a number stands in it.
fn numbers(value: &Value) -> bool {
    match value {
        Value::Integer(_) | Value::Float(_) => true,
        Value::Array(each) => each.iter().any(numbers),
        Value::Table(table) => table.values().any(numbers),
        _ => false,
    }
}

/// `value` with `number` in the place of each of its own.
fn with(value: &Value, number: &Value) -> Value {
    match value {
        Value::Integer(_) | Value::Float(_) => number.clone(),
        Value::Array(each) => each.iter().map(|one| with(one, number)).collect::<Vec<_>>().into(),
        Value::Table(table) => {
            let each = table.iter().map(|(key, one)| (key.clone(), with(one, number)));
            Value::Table(each.collect())
        }
        other => other.clone(),
    }
}

/// Puts `value` at `path`.
fn put(table: &mut Table, path: &[String], value: &Value) {
    let (key, rest) = path.split_first().unwrap();
    if rest.is_empty() {
        table.insert(key.clone(), value.clone());
        return;
    }
    match table.entry(key.clone()).or_insert_with(|| Value::Table(Table::new())) {
        Value::Table(inner) => put(inner, rest, value),
        Value::Array(each) => {
            each.iter_mut().filter_map(Value::as_table_mut).for_each(|one| put(one, rest, value))
        }
        other => panic!("{key} is {other}"),
    }
}

/// Reads the config with `value` at `path`, and asks it all that is computed from its numbers alone; what is refused is refused by its key.
fn read(at: &Path, table: &Table, (path, example): &Key, number: &Value) {
    let mut changed = table.clone();
    let value = with(example, number);
    put(&mut changed, path, &value);
    let key = path.last().unwrap();
    match RigConfig::parse(&toml::to_string(&changed).unwrap(), at) {
        Ok(config) => {
            let _ = (config.camera.stall(), config.expected_bytes(), config.gathered());
            let schedule = config.schedule.as_ref();
            let _ = schedule
                .map(|schedule| [schedule.rest_s, schedule.catch_up_s].map(|s| s.map(|s| s.duration())));
            let profile = config.profile.as_ref().map(Profile::new);
            if let (Some(Ok(profile)), Some(servo)) = (profile, &config.servo) {
                let _ = (profile.pulses(servo), servo.wire(), servo.stream_period_s());
            }
            let (mut fit, mut diagnose) = (config.fit.clone(), config.diagnose.clone());
            measured::put_into(&config.camera, config.servo.as_ref(), &mut fit, &mut diagnose);
        }
        Err(error) => {
            let said = error.to_string();
            let names = [key, &path[0]].into_iter().chain(keys_in(example));
            assert!(names.into_iter().any(|name| said.contains(name.as_str())), "{key} = {value}: {said}");
        }
    }
}

/// The keys of the tables in it.
fn keys_in(value: &Value) -> Vec<&String> {
    match value {
        Value::Array(each) => each.iter().flat_map(keys_in).collect(),
        Value::Table(table) => {
            table.iter().flat_map(|(key, one)| [vec![key], keys_in(one)].concat()).collect()
        }
        _ => Vec::new(),
    }
}

/// Numbers at which code ends that thought of no such one.
fn hard() -> Vec<Value> {
    let floats =
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 1e300, -1e300, 1e19, 1.8e19, 1e10];
    let small = [f64::MIN_POSITIVE, 5e-324, 1e-300, 1e-10, 0.0, -0.0, -1.0];
    let integers = [i64::MIN, -1, 0, 1, 2, i64::from(u32::MAX), i64::from(u32::MAX) + 1, i64::MAX];
    floats.into_iter().chain(small).map(Value::Float).chain(integers.map(Value::Integer)).collect()
}

#[test]
fn hard_numbers_at_every_key_are_used_or_refused_by_name_and_nothing_panics() {
    let (at, table, keys) = reference();
    assert!(keys.len() > 60, "{} keys: {keys:?}", keys.len());
    for key in &keys {
        hard().iter().for_each(|number| read(&at, &table, key, number));
    }
}

#[test]
fn times_that_something_waits_are_at_most_a_year_and_that_is_said() {
    let (at, table, _) = reference();
    for (in_table, key) in [
        ("run", "settle_s"),
        ("run", "film_s"),
        ("run", "release_timeout_s"),
        ("camera", "stall_s"),
        ("schedule", "rest_s"),
        ("schedule", "catch_up_s"),
    ] {
        let mut changed = table.clone();
        put(&mut changed, &[in_table.to_owned(), key.to_owned()], &Value::Float(1e300));
        let said = RigConfig::parse(&toml::to_string(&changed).unwrap(), &at).unwrap_err().to_string();
        assert!(
            said.contains(key) && said.contains("1e300") && said.contains("31622400 s, a year"),
            "{said}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]
    #[test]
    fn no_number_at_any_key_makes_a_config_panic(
        key in any::<prop::sample::Index>(),
        float in any::<f64>(),
        integer in any::<Option<i64>>(),
    ) {
        thread_local! { static REFERENCE: (PathBuf, Table, Vec<Key>) = reference(); }
        REFERENCE.with(|(at, table, keys)| {
            read(at, table, key.get(keys), &integer.map_or(Value::Float(float), Value::Integer));
        });
    }
}
