//! Why an experiment was refused.

use std::path::{Path, PathBuf};

use crate::own_cause::CauseError;
use crate::parameters::ParameterError;
use crate::table::TableError;
use crate::weights::WeightError;
use ground::strict::StrictError;

/// Why an experiment was refused.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// Something `experiment.toml` says, once it is compared with the files it names.
    #[error("{}{}", path.display(), place.as_ref().map(Place::to_string).unwrap_or_default())]
    At {
        /// `experiment.toml`.
        path: PathBuf,
        /// Where it speaks of it, if it does.
        place: Option<Place>,
        /// What is wrong.
        source: Box<ExperimentError>,
    },
    /// The `[fit]` table does not go with the model.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// The `[mechanism]` or `[water]` table.
    #[error(transparent)]
    Weights(#[from] WeightError),
    /// A `[[cause]]` table was refused.
    #[error(transparent)]
    Cause(#[from] CauseError),
    /// `experiment.toml` could not be read, or is no valid TOML of an experiment.
    #[error(transparent)]
    Config(#[from] StrictError),
    /// A trajectory or servo table.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A file could not be read.
    #[error("reading {what} {}", path.display())]
    Unreadable {
        /// What the file should be.
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The model text was refused.
    #[error("model {}", path.display())]
    Model {
        /// Path of the file.
        path: PathBuf,
        /// Line and reason.
        source: Box<sim::MjcfError>,
    },
    /// `start.json` of a run folder was refused.
    #[error("{}: not the start of a run", path.display())]
    Start {
        /// Path of the file.
        path: PathBuf,
        /// Line, column and reason.
        source: serde_json::Error,
    },
    /// No model is named, and no run folder brings one.
    #[error("{}: no `model` is named and no run folder brings one; add `model = \"<file>.xml\"`", path.display())]
    NoModel {
        /// `experiment.toml`.
        path: PathBuf,
    },
    /// Two run folders were made with different models.
    #[error("{} and {} differ; name the one to fit as `model`", first.display(), second.display())]
    Models {
        /// Path of one model.
        first: PathBuf,
        /// Path of the other model.
        second: PathBuf,
    },
    /// There is no run at all.
    #[error("the experiment has no runs; add a `[[run]]`")]
    NoRuns,
    /// `[diagnose]` names what is no cause.
    #[error("`{key}` under [diagnose] names `{name}`, which is no cause{hint}; docs/causes.md lists all")]
    NoCause {
        /// Key in `[diagnose]`.
        key: &'static str,
        /// The name that is not known.
        name: String,
        /// What may have been meant.
        hint: String,
    },
    /// `[diagnose] elements` names what is not there.
    #[error(
        "`elements` under [diagnose] names `{name}`, and the model has no body, joint, geom or keypoint of that name{hint}"
    )]
    NoElement {
        /// The name that is not known.
        name: String,
        /// What may have been meant.
        hint: String,
    },
    /// A run contradicts itself or the model, or says too little.
    #[error("run `{run}`: {reason}")]
    Run {
        /// Its id, or its place in the file.
        run: String,
        /// What is wrong, the limit, what to do.
        reason: String,
    },
    /// A run's images cannot answer anything.
    #[error("run `{run}`: {reason}")]
    Data {
        /// Its id.
        run: String,
        /// What is missing, and what to do.
        reason: String,
    },
}

impl ExperimentError {
    /// Whether the input is well formed, but holds no answer (as against wrong input).
    pub fn is_lack_of_data(&self) -> bool {
        match self {
            Self::At { source, .. } => source.is_lack_of_data(),
            Self::Data { .. } => true,
            _ => false,
        }
    }

    /// Puts the place in `text`, which is `path`, to an error that knows a name written there.
    pub(super) fn located(self, path: &Path, text: &str) -> Self {
        let name = match &self {
            Self::Cause(error) => {
                let place = meant(error, text);
                let error = CauseError { is_located: place.is_some(), ..error.clone() };
                return Self::At { path: path.into(), place, source: Box::new(Self::Cause(error)) };
            }
            Self::Run { run, .. } | Self::Data { run, .. } => run,
            Self::Parameters(error) => error.name(),
            Self::Weights(error) => error.name(),
            Self::NoCause { name, .. } | Self::NoElement { name, .. } => name,
            Self::NoRuns => "",
            _ => return self,
        };
        let place = text.lines().enumerate().find_map(|(index, line)| {
            let column = says(line, name)?;
            Some(Place { line: index + 1, text: line.to_owned(), column, width: name.chars().count() })
        });
        Self::At { path: path.into(), place, source: Box::new(self) }
    }
}

/// A place in a text, as it is shown to whoever wrote it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Counted from 1.
    pub line: usize,
    /// The whole line.
    pub text: String,
    /// Characters before what is meant.
    pub column: usize,
    /// Characters that are meant.
    pub width: usize,
}

impl std::fmt::Display for Place {
    /// `, line 5`, then the line with carets beneath what is meant.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = self.line.to_string();
        let margin = " ".repeat(number.len());
        writeln!(f, ", line {number}\n{margin} |\n{number} | {}", self.text)?;
        write!(f, "{margin} | {}{}", " ".repeat(self.column), "^".repeat(self.width))
    }
}

/// The place that `error` means in the `[[cause]]` of `text` that it is about; that cause's name where it means nothing on one line.
fn meant(error: &CauseError, text: &str) -> Option<Place> {
    let error = &error.error;
    let names = |line: &&str| says(line, &error.cause).is_some() && line.contains("name");
    let begin = text.lines().position(|line| names(&line))?;
    let (at, width) = error.meant;
    // the name may stand below what is meant, so the lines of the same table above it come last
    let table = text.lines().take(begin).enumerate();
    let head = table.filter(|(_, line)| line.trim_start().starts_with('[')).last().map_or(0, |(at, _)| at);
    let below = text.lines().enumerate().skip(begin);
    let lines = below.chain(text.lines().enumerate().take(begin).skip(head));
    let is_expression = !error.text.chars().all(|c| c.is_alphanumeric() || c == '_');
    // a parameter's name stands in expressions too: where it is a key, that is meant
    let is_key = |line: &str, column: usize| {
        let rest: String = line.chars().skip(column + width).collect();
        !is_expression && rest.trim_start().starts_with('=')
    };
    let all: Vec<(usize, &str)> = lines.collect();
    let key = all.iter().find(|(_, line)| says(line, &error.text).is_some_and(|column| is_key(line, column)));
    let found = key.into_iter().chain(&all).find_map(|&(index, line)| {
        let column = match is_expression {
            true => line.find(&error.text).map(|byte| line[..byte].chars().count()),
            false => says(line, &error.text),
        };
        Some((index, line, column? + at))
    });
    let (index, line, column) = found?;
    Some(Place { line: index + 1, text: line.to_owned(), column, width })
}

/// How many characters a line of TOML has before `name` as a whole key or string.
fn says(line: &str, name: &str) -> Option<usize> {
    let part = |c: char| c.is_alphanumeric() || "/_*?#-".contains(c);
    let whole = |at: usize| !line[..at].ends_with(part) && !line[at + name.len()..].starts_with(part);
    let mut places = line.match_indices(name).map(|(at, _)| at).filter(|_| !name.is_empty());
    places.find(|&at| whole(at)).map(|at| line[..at].chars().count())
}
