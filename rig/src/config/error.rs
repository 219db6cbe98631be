//! Why a config cannot be used.

use std::path::PathBuf;

use ident::strict::StrictError;

/// Why a config cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The text is at fault.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// Its tables contradict each other.
    #[error("{}: {why}", path.display())]
    Contradiction {
        /// The config.
        path: PathBuf,
        /// What, and what to do.
        why: String,
    },
}
