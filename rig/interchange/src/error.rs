//! Why another program's file cannot be read, or one for it not be written.

/// Why another program's file cannot be read, or one for it not be written. The file's name is its reader's to say.
#[derive(Debug, thiserror::Error)]
pub enum InterchangeError {
    /// The file is of another form.
    #[error("the file is {what}")]
    Unknown {
        /// Of which, and what to do.
        what: String,
    },
    /// A line does not hold what it should.
    #[error("line {line}: {what}")]
    Line {
        /// Counted from 1.
        line: u64,
        /// What is wrong, and what is wanted.
        what: String,
    },
    /// A place in a JSON document does not hold what it should.
    #[error("{place}: {what}")]
    Place {
        /// As in `data[3].x[7]`.
        place: String,
        /// What is wrong, and what is wanted.
        what: String,
    },
    /// The text is no JSON.
    #[error("not a JSON document")]
    Json(#[from] serde_json::Error),
    /// The text is no CSV.
    #[error("not a table of comma separated values")]
    Csv(#[from] csv::Error),
    /// The file holds several of what only one is wanted of, or lacks what was asked for.
    #[error("{what}")]
    Choice {
        /// What there is, and how to say which is meant.
        what: String,
    },
    /// Nothing says when images were taken.
    #[error("{what}")]
    Times {
        /// What is missing or wrong, and what to do.
        what: String,
    },
}

impl InterchangeError {
    pub(super) fn line(line: u64, what: impl Into<String>) -> Self {
        Self::Line { line, what: what.into() }
    }

    pub(super) fn place(place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Place { place: place.into(), what: what.into() }
    }

    pub(super) fn choice(what: impl Into<String>) -> Self {
        Self::Choice { what: what.into() }
    }
}

/// Names in a sentence, the first of many.
pub(super) fn listed<T: std::fmt::Display>(names: &[T]) -> String {
    const MOST: usize = 30;
    let mut text: Vec<String> = names.iter().take(MOST).map(|name| format!("`{name}`")).collect();
    if names.len() > MOST {
        text.push(format!("and {} more", names.len() - MOST));
    }
    if text.is_empty() { "none".into() } else { text.join(", ") }
}
