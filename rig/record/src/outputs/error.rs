//! Why a command may not write to the place that was given.

use std::path::PathBuf;

/// Why a command may not write to the place that was given. Nothing was done yet.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The output would replace an input.
    #[error(
        "output {} is the input {}, which would be lost: write to another place",
        out.display(), input.display()
    )]
    Input {
        /// The output, as it was given.
        out: PathBuf,
        /// The input, as it was given.
        input: PathBuf,
    },
    /// The output would lie in an input folder.
    #[error(
        "output {} lies in the input {}, which stays as it is: write to a place outside of it",
        out.display(), input.display()
    )]
    InInput {
        /// The output.
        out: PathBuf,
        /// The input, a folder.
        input: PathBuf,
    },
    /// What is written into the folder could take the place of what is read, or be taken for a part of it.
    #[error(
        "output {} is a folder that holds the input {}: write to a folder of its own",
        out.display(), input.display()
    )]
    HoldsInput {
        /// The output, a folder.
        out: PathBuf,
        /// The input.
        input: PathBuf,
    },
    /// A recorded run stays as it was recorded.
    #[error(
        "output {} lies in the run folder {}, which stays as it was recorded: write to a place outside of it",
        out.display(), run.display()
    )]
    InRun {
        /// The output.
        out: PathBuf,
        /// The run folder.
        run: PathBuf,
    },
    /// Two outputs are the same file.
    #[error(
        "outputs {} and {} would take each other's place: give each a place of its own",
        out.display(), other.display()
    )]
    Twice {
        /// The output.
        out: PathBuf,
        /// Another one of the same command.
        other: PathBuf,
    },
    /// Something of another kind is at that place.
    #[error("output {} is {found}: give the name of {wanted}", out.display())]
    Kind {
        /// The output.
        out: PathBuf,
        /// What is there.
        found: &'static str,
        /// What was to be written.
        wanted: &'static str,
    },
}
