//! Why images cannot be read.

use std::path::PathBuf;

use record::RecordError;

/// Why a folder's pictures cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder or a file in it could not be read.
    #[error("reading {}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// `frames.csv` is not one.
    #[error("{} line {line}: {what}", path.display())]
    Frames {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// What is wrong.
        what: String,
    },
    /// No pictures.
    #[error("{} holds no .png, .jpg or .jpeg files", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// Nothing says when the pictures were taken.
    #[error("{} has no frames.csv: set [camera] fps", path.display())]
    NoTimes {
        /// The folder.
        path: PathBuf,
    },
}

/// Why a sequence cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The folder's pictures cannot be listed.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// Neither a folder nor a file.
    #[error("{} is neither a run, a folder of pictures, a picture nor a video file", path.display())]
    Nothing {
        /// What was given.
        path: PathBuf,
    },
    /// Video files need ffmpeg.
    #[error("reading the video {} needs the programs ffmpeg and ffprobe: install the package ffmpeg", path.display())]
    NoFfmpeg {
        /// The video.
        path: PathBuf,
    },
    /// ffmpeg or ffprobe did not understand the file.
    #[error("{program} could not read {}: {said}", path.display())]
    Video {
        /// Which program.
        program: &'static str,
        /// The video.
        path: PathBuf,
        /// Its last words.
        said: String,
    },
    /// No image lies in the part that was asked for.
    #[error("no image lies between {from} and {to} of the source's own time: change --from-s or --to-s")]
    Window {
        /// Its beginning.
        from: String,
        /// Its end.
        to: String,
    },
    /// Times cannot be divided by this.
    #[error("slow motion {factor} is not a positive number: 240 images/s played at 30 is 8")]
    SlowMotion {
        /// What was given.
        factor: f64,
    },
}

/// Why a film cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file's name says nothing of a film.
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
    /// This ffmpeg was built without.
    #[error("writing the film {}: the installed ffmpeg has neither {wanted}; choose another ending", path.display())]
    NoEncoder {
        /// The film.
        path: PathBuf,
        /// Encoders, one of which is needed.
        wanted: String,
    },
    /// The file cannot be there.
    #[error(transparent)]
    Write(#[from] RecordError),
    /// ffmpeg gave up.
    #[error("ffmpeg could not write {}: {said}", path.display())]
    Failed {
        /// The film.
        path: PathBuf,
        /// Its last words.
        said: String,
    },
}
