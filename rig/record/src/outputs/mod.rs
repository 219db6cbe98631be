//! Where a command may write: never onto, into or around what it reads, and never into a recorded run.
//!
//! Before it does any work, a verb names to [`Outputs`] everything that it reads, and asks for everything that it will write. It gets handles,
//! an [`OutputFile`] or an [`OutputFolder`]. All functions that write results take such a handle and no path, so that no verb can forget to
//! ask; and a handle writes a file whole: under another name, forced to the disk, renamed.

mod error;
mod handle;
mod place;
#[cfg(test)]
mod tests;

pub use error::OutputError;
pub use handle::{OutputFile, OutputFolder};

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use wildmatch::WildMatch;

use crate::folder::file;
use crate::run_id::RunId;
use place::Place;

/// What one command reads, and what of its outputs it has asked for.
#[derive(Debug, Default)]
pub struct Outputs {
    inputs: Vec<Named>,
    files: Vec<Named>,
    folders: Vec<(Named, Vec<WildMatch>)>,
}

/// A path as it was given, and where it leads.
#[derive(Debug, Clone)]
struct Named {
    path: PathBuf,
    place: Place,
}

impl Named {
    fn new(path: &Path) -> Self {
        Self { path: path.into(), place: Place::of(path) }
    }
}

impl Outputs {
    /// Those of a command that reads the files `inputs`; of a folder it reads everything in it.
    pub fn reading(inputs: impl IntoIterator<Item = PathBuf>) -> Self {
        let mut outputs = Self::default();
        for input in inputs {
            // of a folder of pictures that lie elsewhere
            let elsewhere = std::fs::read_dir(&input).into_iter().flatten().flatten().filter(|entry| {
                entry
                    .metadata()
                    .is_ok_and(|there| there.is_symlink() || (there.is_file() && there.nlink() > 1))
            });
            outputs.inputs.extend(elsewhere.map(|entry| Named::new(&entry.path())));
            outputs.inputs.push(Named::new(&input));
        }
        outputs
    }

    /// The file `path`.
    ///
    /// # Errors
    /// [`OutputError`]: it is an input or lies in one, or in a run folder; another output is the same file; or something else is there.
    pub fn file(&mut self, path: &Path) -> Result<OutputFile, OutputError> {
        let out = Named::new(path);
        self.check_inputs(&out)?;
        outside_runs(&out, &out.place.path)?;
        no_folder(&out)?;
        let same = |other: &&Named| other.place.is(&out.place);
        let in_folder =
            |(folder, names): &&(Named, Vec<WildMatch>)| first_of(&out.place, &folder.place, names);
        let other =
            self.files.iter().find(same).or(self.folders.iter().find(in_folder).map(|(folder, _)| folder));
        if let Some(other) = other {
            return Err(OutputError::Twice { out: out.path, other: other.path.clone() });
        }
        self.files.push(out.clone());
        Ok(OutputFile::new(&out.path, out.place.path))
    }

    /// The folder `path`, in which files are written, or folders, whose names are among `names`: `*` stands for any letters.
    ///
    /// # Errors
    /// [`OutputError`]: it is an input or lies in one, or in a run folder; it holds a run that is an input, or an input of such a name;
    /// another output is one of its files; or something else is there.
    pub fn folder(&mut self, path: &Path, names: &[&str]) -> Result<OutputFolder, OutputError> {
        let out = Named::new(path);
        outside_runs(&out, &out.place.path)?;
        self.folder_of(out, names)
    }

    /// The folder `path` for what a replay makes of a run, as [`Self::folder`]; it may be there from an earlier replay, and have a run's name.
    ///
    /// # Errors
    /// [`OutputError`], also where a run was recorded in it.
    pub fn results(&mut self, path: &Path, names: &[&str]) -> Result<OutputFolder, OutputError> {
        let out = Named::new(path);
        let recorded = [file::JOURNAL, file::RECORDING, file::RETENTION];
        match recorded.iter().any(|name| out.place.path.join(name).exists()) {
            true => outside_runs(&out, &out.place.path)?,
            false => outside_runs(&out, out.place.path.parent().unwrap_or(&out.place.path))?,
        }
        self.folder_of(out, names)
    }

    /// The file `path`, of which only a part is changed, by somebody's wish: it may be an input.
    ///
    /// # Errors
    /// [`OutputError`]: it lies in a run folder, or is no file.
    pub fn edited(path: &Path) -> Result<OutputFile, OutputError> {
        let out = Named::new(path);
        outside_runs(&out, &out.place.path)?;
        no_folder(&out)?;
        Ok(OutputFile::new(&out.path, out.place.path))
    }

    fn folder_of(&mut self, out: Named, names: &[&str]) -> Result<OutputFolder, OutputError> {
        self.check_inputs(&out)?;
        if out.place.path.exists() && !out.place.path.is_dir() {
            return Err(OutputError::Kind { out: out.path, found: "a file", wanted: "a folder" });
        }
        let names: Vec<WildMatch> = names.iter().map(|name| WildMatch::new(name)).collect();
        let held = |input: &&Named| {
            let holds_run = is_run(&input.place.path) && input.place.within(&out.place).is_some();
            holds_run || first_of(&input.place, &out.place, &names)
        };
        if let Some(input) = self.inputs.iter().find(held) {
            return Err(OutputError::HoldsInput { out: out.path, input: input.path.clone() });
        }
        if let Some(other) = self.files.iter().find(|other| first_of(&other.place, &out.place, &names)) {
            return Err(OutputError::Twice { out: out.path, other: other.path.clone() });
        }
        self.folders.push((out.clone(), names.clone()));
        Ok(OutputFolder::new(&out.path, out.place.path, names))
    }

    /// Sees that `out` is no input and lies in none.
    fn check_inputs(&self, out: &Named) -> Result<(), OutputError> {
        for input in &self.inputs {
            let Some(way) = out.place.within(&input.place) else { continue };
            let (out, input) = (out.path.clone(), input.path.clone());
            return Err(match way.as_os_str().is_empty() {
                true => OutputError::Input { out, input },
                false => OutputError::InInput { out, input },
            });
        }
        Ok(())
    }
}

/// Whether `place` lies in the folder `folder`, in that file or folder of it or is it, which one of `names` is for.
fn first_of(place: &Place, folder: &Place, names: &[WildMatch]) -> bool {
    let way = place.within(folder);
    let first = way.as_deref().and_then(|way| way.iter().next());
    first.is_some_and(|first| names.iter().any(|name| name.matches(&first.to_string_lossy())))
}

/// Whether a run was recorded there, is being recorded, or is shown there by a replay.
fn is_run(folder: &Path) -> bool {
    let name = folder.file_name().and_then(|name| name.to_str());
    folder.join(file::START).is_file() || name.is_some_and(|name| name.parse::<RunId>().is_ok())
}

/// Sees that `folder`, in which `out` is to be, is no run folder and lies in none.
fn outside_runs(out: &Named, folder: &Path) -> Result<(), OutputError> {
    match folder.ancestors().find(|above| is_run(above)) {
        Some(run) => Err(OutputError::InRun { out: out.path.clone(), run: run.into() }),
        None => Ok(()),
    }
}

/// Sees that nothing but a file, if anything, is where the file `out` is to be.
fn no_folder(out: &Named) -> Result<(), OutputError> {
    let below = out.place.path.ancestors().skip(1).find(|above| above.exists());
    let found = match out.path.metadata().ok() {
        Some(there) if there.is_dir() => "a folder",
        Some(there) if !there.is_file() => "a device or a pipe",
        None if out.path.file_name().is_none() => "no name",
        None if below.is_some_and(|below| !below.is_dir()) => "below a file",
        _ => return Ok(()),
    };
    Err(OutputError::Kind { out: out.path.clone(), found, wanted: "a file" })
}
