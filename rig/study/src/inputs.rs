//! What a task reads: a digest of all of it, and what is known of how it was recorded.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use app::Failure;
use ident::experiment::Experiment;
use record::folder::{RunFolder, file};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// Files of a run folder that are results, and nothing that a fit reads.
const RESULTS: [&str; 1] = [file::MODEL];
/// Tables of a run folder that a fit reads.
const TABLES: [&str; 4] = [file::START, file::TRAJECTORY, file::SERVO, "base.csv"];

/// What is known of how an experiment was recorded, for trends.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Conditions {
    /// When its first run began, RFC 3339.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub began_utc: Option<String>,
    /// Of the water, \[°C\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Which tank it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tank: Option<String>,
    /// Which specimen it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mechanism: Option<String>,
}

/// SHA-256 over the names and bytes of all that a fit of the experiment at `path` reads: a run folder's tables and models, or an experiment's
/// file with everything it names.
///
/// # Errors
/// [`Failure::Input`] where something cannot be read.
pub(crate) fn digest(path: &Path) -> Result<String, Failure> {
    let mut hash = Sha256::new();
    add(path, &mut hash)?;
    if path.is_file() {
        for source in Experiment::sources(path).into_iter().skip(1) {
            add(&source, &mut hash)?;
        }
    }
    Ok(text(hash))
}

/// SHA-256 of `bytes`, in hexadecimal digits.
pub(crate) fn digest_of(bytes: &[u8]) -> String {
    let mut hash = Sha256::new();
    hash.update(bytes);
    text(hash)
}

fn text(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn add(path: &Path, hash: &mut Sha256) -> Result<(), Failure> {
    let reading = |path: &Path| format!("reading {}", path.display());
    let mut one = |path: &Path| -> Result<(), Failure> {
        let bytes = std::fs::read(path).with_context(|| reading(path)).map_err(Failure::Input)?;
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        for part in [name, &bytes] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        Ok(())
    };
    if !path.is_dir() {
        return one(path);
    }
    let entries = std::fs::read_dir(path).with_context(|| reading(path)).map_err(Failure::Input)?;
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let is_read = |name: &str| {
        let ending = Path::new(name).extension().unwrap_or_default();
        let is_model = (ending == "xml" || ending == "toml") && !RESULTS.contains(&name);
        TABLES.contains(&name) || (is_model && !name.starts_with('.'))
    };
    names.iter().filter(|name| is_read(name)).try_for_each(|name| one(&path.join(name)))
}

/// What the files of the experiment at `path` say of how it was recorded: of its first run folder, and of its own `[water]`.
pub(crate) fn conditions(path: &Path) -> Conditions {
    let mut found = Conditions::default();
    let table = std::fs::read_to_string(path).ok().and_then(|text| text.parse::<toml::Table>().ok());
    let folder: Option<PathBuf> = match &table {
        None => Some(path.into()),
        Some(table) => table
            .get("run")
            .and_then(|runs| runs.as_array()?.first()?.get("folder")?.as_str())
            .map(|folder| app::base(path).join(folder)),
    };
    let temperature_c = |table: &toml::Table| number(table.get("water")?.get("temperature_c")?);
    // a folder that cannot be opened is reported by the task that reads it
    if let Some(run) = folder.and_then(|folder| RunFolder::open(&folder).ok()) {
        let start = run.start();
        found.began_utc = Some(start.clock.utc.clone());
        found.temperature_c =
            start.config.parse::<toml::Table>().ok().and_then(|table| temperature_c(&table));
    }
    found.temperature_c = table.as_ref().and_then(temperature_c).or(found.temperature_c);
    found
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|integer| integer as f64))
}
