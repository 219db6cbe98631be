//! Why a sequence of images cannot be read.

use std::path::PathBuf;

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
    /// `frames.csv` is malformed.
    #[error("{} line {line}: {what}", path.display())]
    Frames {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// What is wrong.
        what: String,
    },
    /// The numbers in the files' names do not say which image each is.
    #[error("the numbers in the names of the pictures in {} do not say which image each is: {what}; write a frames.csv (file,time_s) beside them", path.display())]
    Numbers {
        /// The folder.
        path: PathBuf,
        /// What is wrong with them.
        what: String,
    },
    /// No pictures.
    #[error("{} holds no .png, .jpg or .jpeg files", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// The times of the pictures are not known.
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
    Recording(Box<dyn std::error::Error + Send + Sync>),
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
    #[error("{program} could not read {}: {message}", path.display())]
    Video {
        /// Which program.
        program: &'static str,
        /// The video.
        path: PathBuf,
        /// The end of its error output.
        message: String,
    },
    /// The film's pixels are not square.
    #[error("the film {0} has pixels of {ratio} (width to height), and a calibration is for square ones: make them square with ffmpeg -i {0} -vf scale=iw*sar:ih,setsar=1 OUT", path.display())]
    Pixels {
        /// The film.
        path: PathBuf,
        /// A pixel's width to its height.
        ratio: String,
    },
    /// No image lies in the part that was asked for.
    #[error("no image lies between {from} and {to} of the source's own time: change --from-s or --to-s")]
    Window {
        /// Its beginning.
        from: String,
        /// Its end.
        to: String,
    },
    /// The factor of slow motion is not a positive number.
    #[error("slow motion {factor} is not a positive number: 240 images/s played at 30 is 8")]
    SlowMotion {
        /// What was given.
        factor: f64,
    },
}
