//! Why films cannot be written.

use std::path::PathBuf;

use record::RecordError;

/// Why a film cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file's ending is not that of a film.
    #[error("{} is no film's name: end it in .mp4, .webm or .mkv", path.display())]
    Ending {
        /// The name.
        path: PathBuf,
    },
    /// Films need ffmpeg.
    #[error("writing the film {} needs the program ffmpeg: install the package ffmpeg", path.display())]
    NoFfmpeg {
        /// The film.
        path: PathBuf,
    },
    /// The installed ffmpeg has no encoder for it.
    #[error("writing the film {}: the installed ffmpeg has neither {wanted}; choose another ending", path.display())]
    NoEncoder {
        /// The film.
        path: PathBuf,
        /// Encoders, one of which is needed.
        wanted: String,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
    /// ffmpeg failed.
    #[error("ffmpeg could not write {}: {message}", path.display())]
    Failed {
        /// The film.
        path: PathBuf,
        /// The end of its error output.
        message: String,
    },
}
