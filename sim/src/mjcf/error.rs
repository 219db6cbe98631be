//! Why MJCF was refused: everything that is wrong with it, each with its place.

use std::cell::RefCell;
use std::fmt;
use std::sync::Arc;

/// Why MJCF was refused.
#[derive(Debug, thiserror::Error)]
pub enum MjcfError {
    /// The model's own file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] std::io::Error),
    /// Everything that was refused, in the order in which it was found.
    #[error("{}", listed(.0))]
    Refused(Vec<Refusal>),
}

/// One thing that was refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Where it stands.
    pub place: Place,
    /// What was read, what is wrong with it, and what to do.
    pub problem: String,
}

/// A line of a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The included file, as seen from the model's folder; none for the model itself.
    pub file: Option<Arc<str>>,
    /// The line, from 1 on.
    pub line: u32,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.file {
            Some(file) => write!(f, "{file}, line {}", self.line),
            None => write!(f, "line {}", self.line),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.problem)
    }
}

/// Lines of a refusal at most (chosen): whoever has more to change has begun by then.
const LISTED_MAX: usize = 50;

fn listed(refusals: &[Refusal]) -> String {
    if let [only] = refusals {
        return only.to_string();
    }
    let mut text = format!("{} things are refused:", refusals.len());
    let mut told = Vec::new();
    for refusal in refusals.iter().take(LISTED_MAX) {
        // what to do is told once
        let (what, way) = refusal.problem.split_once("; ").unwrap_or((&refusal.problem, ""));
        text += &format!("\n  {}: {what}", refusal.place);
        if !way.is_empty() && !told.contains(&way) {
            text += &format!("; {way}");
            told.push(way);
        }
    }
    if refusals.len() > LISTED_MAX {
        text += &format!("\n  and {} more", refusals.len() - LISTED_MAX);
    }
    text
}

/// What has been refused so far. Reading goes on after a refusal, with a stand-in, so that all are found at once.
#[derive(Debug, Default)]
pub(super) struct Refusals(RefCell<Vec<Refusal>>);

impl Refusals {
    /// Refuses what stands at `place`. What several elements inherit from one default class is told once.
    pub(super) fn add(&self, place: &Place, problem: impl Into<String>) {
        let refusal = Refusal { place: place.clone(), problem: problem.into() };
        let mut list = self.0.borrow_mut();
        if !list.contains(&refusal) {
            list.push(refusal);
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.borrow().is_empty()
    }

    /// `value`, unless something was refused.
    pub(super) fn unless_refused<T>(self, value: Option<T>) -> Result<T, MjcfError> {
        let refusals = self.0.into_inner();
        value.filter(|_| refusals.is_empty()).ok_or(MjcfError::Refused(refusals))
    }
}
