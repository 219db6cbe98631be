//! Single options written into a config: its comments, and all else in it, stay as they are.

use toml_edit::{DocumentMut, Item, Table, Value};

use super::{ConfigError, RigConfig};
use record::RecordError;
use record::outputs::OutputFile;

/// Why a config cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// The table is something else.
    #[error("[{table}] of the config is no table: write {key} into it by hand")]
    NoTable {
        /// The table.
        table: &'static str,
        /// The key.
        key: &'static str,
    },
    /// The channel is not there, or not as a table of its own.
    #[error(
        "the config has no [[servo.channel]] named `{channel}`: write calibration = {file:?} into it by hand"
    )]
    NoChannel {
        /// The channel.
        channel: String,
        /// What belongs there.
        file: String,
    },
    /// The config cannot be read.
    #[error("reading {path}")]
    Unreadable {
        /// The config.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The config is no TOML any more.
    #[error("reading the config")]
    Syntax(#[from] toml_edit::TomlError),
    /// The config would not be valid, before or after.
    #[error(transparent)]
    Invalid(#[from] ConfigError),
    /// It cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
}

/// Lets `edit` change the text of the config `file`, as it stands there now, and writes it back if it is still a config.
///
/// # Errors
/// What `edit` says, and [`EditError`]; the config is as it was then.
pub fn rewrite<E: From<EditError>>(
    file: &OutputFile,
    edit: impl FnOnce(&str) -> Result<String, E>,
) -> Result<(), E> {
    let path = file.path();
    let unreadable = |source| EditError::Unreadable { path: path.display().to_string(), source };
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let edited = edit(&text)?;
    RigConfig::parse(&edited, path).map_err(EditError::from)?;
    Ok(file.write(edited.as_bytes()).map_err(EditError::from)?)
}

/// Whether `text` has `[table] key`.
///
/// # Errors
/// [`EditError::Syntax`].
pub fn has(text: &str, table: &str, key: &str) -> Result<bool, EditError> {
    let document: DocumentMut = text.parse()?;
    Ok(document.get(table).and_then(Item::as_table_like).is_some_and(|table| table.contains_key(key)))
}

/// `text` with `[table] key` set to `value`.
///
/// # Errors
/// [`EditError::NoTable`], [`EditError::Syntax`].
pub fn set(
    text: &str,
    table: &'static str,
    key: &'static str,
    mut value: Value,
) -> Result<String, EditError> {
    let mut document: DocumentMut = text.parse()?;
    let entry = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    let Some(entries) = entry.as_table_like_mut() else {
        return Err(EditError::NoTable { table, key });
    };
    if let Some(before) = entries.get(key).and_then(Item::as_value) {
        // What stands around a value, a comment behind it, belongs to it.
        *value.decor_mut() = before.decor().clone();
    }
    entries.insert(key, Item::Value(value));
    if let Some(inline) = entry.as_inline_table_mut() {
        inline.fmt();
    }
    Ok(document.to_string())
}

/// `text` with the calibration of the servo channel called `channel` set to `file`; zero, gain and sign that stood there are gone, being the
/// file's now.
///
/// # Errors
/// [`EditError::NoChannel`], [`EditError::Syntax`].
pub fn set_servo_calibration(text: &str, channel: &str, file: &str) -> Result<String, EditError> {
    let mut document: DocumentMut = text.parse()?;
    let channels = document
        .get_mut("servo")
        .and_then(|servo| servo.get_mut("channel"))
        .and_then(Item::as_array_of_tables_mut);
    let named = |table: &&mut Table| table.get("name").and_then(Item::as_str) == Some(channel);
    let Some(table) = channels.and_then(|channels| channels.iter_mut().find(named)) else {
        return Err(EditError::NoChannel { channel: channel.into(), file: file.into() });
    };
    for key in ["zero_pulse_us", "us_per_rad"] {
        table.remove(key);
    }
    table.insert("calibration", Item::Value(file.into()));
    if let Some(profile) = document.get_mut("profile").and_then(Item::as_table_like_mut) {
        profile.remove("mirrored");
    }
    Ok(document.to_string())
}
