//! Keypoints from and to other programs: a file a format, each a pure function between text and what it says.
//!
//! [`dlc`] and [`sleap`] hold what trackers saw in the picture: [`Marks`], which [`marks`] puts into the plane of motion. [`wcon`] holds
//! lines that lie in it already. Either way an [`Imported`] comes out: a trajectory, and for each image why something in it is
//! missing. Nothing that the file lacks is made up.
//!
//! [`foxglove`] is one way only: messages of a run to be looked at.
//!
//! A file of pixels has the centre of the top left pixel at (0, 0), as everything here has.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod dlc;
mod error;
pub mod foxglove;
mod lines;
pub mod marks;
mod sheet;
pub mod sleap;
mod units;
pub mod wcon;

pub use error::InterchangeError;
pub use marks::{Mark, MarkedImage, Marks, Times};

use ground::choice::Choice;
use sim::Trajectory;

use vision::Status;

/// What became of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageStatus {
    /// What its file calls it.
    pub name: String,
    /// Its time \[s\].
    pub time_s: f64,
    /// `Ok` with all its keypoints, `Doubtful` with some, `Rejected` with none.
    pub status: Status,
    /// Why not all of them; empty when `Ok`.
    pub reason: String,
}

/// What was read from another program's file.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The keypoints over time, one row an image; NaN where one is missing. z is up in the picture, y is never observed.
    pub trajectory: Trajectory,
    /// What became of each image.
    pub images: Vec<ImageStatus>,
}

impl Imported {
    fn of(keypoints: Vec<String>) -> Self {
        Self { trajectory: Trajectory { keypoints, ..Trajectory::default() }, images: Vec::new() }
    }

    /// Adds an image: each keypoint's `[x, z]` \[m\], or why it is not there.
    fn push(&mut self, name: String, time_s: f64, points: Vec<Result<[f64; 2], String>>) {
        let whys: Vec<&String> = points.iter().filter_map(|point| point.as_ref().err()).collect();
        let (missing, alike) = (whys.len(), whys.windows(2).all(|pair| pair[0] == pair[1]));
        let reason = match whys.first() {
            // A line as a whole is at fault.
            Some(why) if alike && missing == points.len() => (*why).clone(),
            _ => {
                let named = points.iter().zip(&self.trajectory.keypoints);
                let missing = named
                    .filter_map(|(point, name)| point.as_ref().err().map(|why| format!("{name}: {why}")));
                missing.collect::<Vec<_>>().join("; ")
            }
        };
        let status = match missing {
            0 => Status::Ok,
            some if some < points.len() => Status::Doubtful,
            _ => Status::Rejected,
        };
        self.trajectory.time_s.push(time_s);
        let place = |point: Result<[f64; 2], String>| point.map_or([f64::NAN; 3], |[x, z]| [x, f64::NAN, z]);
        self.trajectory.position_m.extend(points.into_iter().map(place));
        self.images.push(ImageStatus { name, time_s, status, reason });
    }

    /// How many images have the given status.
    pub fn count(&self, status: Status) -> usize {
        self.images.iter().filter(|image| image.status == status).count()
    }
}

/// Whose file it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// DeepLabCut's CSV, of an analysed video or of labels
    Dlc,
    /// SLEAP's analysis CSV
    Sleap,
    /// Worm tracker Commons Object Notation
    Wcon,
}

impl Choice for Format {
    const ALL: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Dlc, "dlc", "DeepLabCut's CSV, of an analysed video or of labels"),
        (Self::Sleap, "sleap", "SLEAP's analysis CSV"),
        (Self::Wcon, "wcon", "Worm tracker Commons Object Notation"),
    ];
}

impl Format {
    /// The format's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dlc => "DeepLabCut CSV",
            Self::Sleap => "SLEAP analysis CSV",
            Self::Wcon => "WCON",
        }
    }

    /// The format of a file that begins with `bytes`.
    ///
    /// # Errors
    /// [`InterchangeError::Unknown`], with what to do where it is a format that has another form.
    pub fn of(bytes: &[u8]) -> Result<Self, InterchangeError> {
        let unknown = |what: &str| Err(InterchangeError::Unknown { what: what.into() });
        if bytes.starts_with(b"\x89HDF") {
            return unknown(
                "an HDF5 file; have DeepLabCut save a CSV (save_as_csv=True), or SLEAP export an analysis CSV",
            );
        }
        if bytes.starts_with(b"PK") {
            return unknown("a zip archive; unpack it first");
        }
        let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
        let head = head.trim_start_matches('\u{feff}').trim_start();
        let titles = head.lines().find(|line| !line.starts_with('#')).unwrap_or_default();
        // a column of row numbers, as pandas writes it, has no title
        let mut cells = titles
            .trim_start_matches([',', ';', '\t'])
            .split([',', ';', '\t'])
            .map(|cell| cell.trim_matches(['"', ' ']));
        if head.starts_with(['{', '[']) {
            json(bytes).map_or(Ok(Self::Wcon), unknown)
        } else if cells.clone().next() == Some("scorer") {
            Ok(Self::Dlc)
        } else if cells.any(|cell| cell == "frame_idx") {
            Ok(Self::Sleap)
        } else if head.is_empty() {
            unknown("empty")
        } else {
            unknown(
                "of no known form: a DeepLabCut CSV begins with `scorer`, a SLEAP analysis CSV has a column `frame_idx`, \
                 WCON begins with `{`",
            )
        }
    }
}

/// What the JSON document `bytes` is where it is no WCON, which has units, by the words that others' forms have.
fn json(bytes: &[u8]) -> Option<&'static str> {
    const POINTS_OF_YOUR_OWN: &str = "OpenPose's JSON of one picture, without names of parts or times; read them with Python and give them to \
         `tankrig.Keypoints(names, position_px, confidence, image).to_trajectory(config, out)`";
    const COCO: &str = "COCO's JSON of annotated pictures; `tankrig.from_coco(file).to_trajectory(config, out)` in Python reads it";
    let text = String::from_utf8_lossy(bytes);
    let has = |word: &str| text.contains(&format!("\"{word}\""));
    if has("units") {
        None
    } else if has("people") || has("pose_keypoints_2d") {
        Some(POINTS_OF_YOUR_OWN)
    } else if has("annotations") || has("categories") || (has("keypoints") && has("image_id")) {
        Some(COCO)
    } else if text.trim_start().starts_with('[') {
        Some("a JSON array; WCON is an object, `{\"units\": ...}`")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn format_is_told_by_how_a_file_begins() {
        for (text, wanted) in [
            ("scorer,rig,rig\n", Format::Dlc),
            ("\u{feff}scorer,rig\n", Format::Dlc),
            ("scorer;rig\n", Format::Dlc),
            (",scorer,rig\n", Format::Dlc),
            ("track,frame_idx,instance.score,a.x\n", Format::Sleap),
            (" \n{\"units\":{}}", Format::Wcon),
        ] {
            assert_eq!(Format::of(text.as_bytes()).unwrap(), wanted, "{text}");
        }
        for (bytes, wanted) in [
            (&b""[..], "empty"),
            (b"time_s,P1_x_m\n", "of no known form"),
            (b"\x89HDF\r\n", "save_as_csv=True"),
            (b"PK\x03\x04", "unpack"),
            (br#"{"version":1.3,"people":[{"pose_keypoints_2d":[1,2,0.9]}]}"#, "OpenPose's JSON"),
            (br#"{"info":{},"images":[],"annotations":[],"categories":[]}"#, "tankrig.from_coco"),
            (br#"[{"image_id":1,"category_id":1,"keypoints":[1,2,2]}]"#, "COCO's JSON"),
            (b"[1, 2]", "a JSON array"),
        ] {
            let error = Format::of(bytes).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }

    const FILES: [&str; 3] = [
        "scorer,,,a,a,a,a\nindividuals,,,i,i,j,j\nbodyparts,,,P0,P0,P0,P0\ncoords,,,x,y,x,y\nl,f,i1.png,1,2,3,4\nl,f,i2.png,1,2,,\n",
        "track,frame_idx,instance.score,P0.x,P0.y,P0.score\nt,0,0.9,1,2,0.5\nt,3,,1.5,2e1,nan\n",
        r#"{"units":{"t":"0.1*s","x":"mm","y":"mm"},"data":[{"id":1,"t":[0,1],"x":[[1,null],[2,3]],"y":[[1,2],[3,4]],"head":"R"}]}"#,
    ];

    proptest::proptest! {
        /// Whatever becomes of a file on its way, its reader ends with an answer or an error.
        #[test]
        fn damaged_files_are_read_or_refused(
            cut in 0_usize..400,
            changes in proptest::collection::vec((0_usize..400, proptest::char::range('\t', '~')), 0..8),
        ) {
            let plane = camera::calibration::Plane::square(0.001, [0.0, 0.0]);
            for file in FILES {
                let mut letters: Vec<char> = file.chars().collect();
                for (at, letter) in &changes {
                    let count = letters.len();
                    letters[at % count] = *letter;
                }
                letters.truncate(if cut < 200 { letters.len() } else { cut - 200 });
                let text: String = letters.into_iter().collect();
                for marks in [dlc::read(&text, None), dlc::read(&text, Some("i")), sleap::read(&text, None)].into_iter().flatten() {
                    let (choices, times) = (marks::chosen(&marks.parts, None), marks.times_s(&Times::Rate(10.0)));
                    if let (Ok(choices), Ok(times_s)) = (choices, times) {
                        let imported = marks.imported(&choices, &times_s, &plane, 0.6, Some(1.0));
                        proptest::prop_assert_eq!(imported.trajectory.position_m.len(), choices.len() * times_s.len());
                    }
                }
                if let Ok(Ok(imported)) = wcon::read(&text).map(|document| document.imported(None, &[0.0, 0.5, 1.0])) {
                    proptest::prop_assert_eq!(imported.trajectory.position_m.len(), 3 * imported.images.len());
                }
            }
        }
    }
}
