//! The order of runs: that in which their folders were made, by a number in `start.json`.
//!
//! Run ids and file times contain the wall clock and do not serve for this: a clock that is set back would make a run that has just ended the
//! oldest, and retention would delete it. No clock of the machine goes on over its restarts; so each run is counted.
//! Runs from before 2026-11-27 have no number, come before all others, and are ordered by their ids.

use std::path::Path;

use super::RecordError;
use super::files::write_whole;
use super::folder;

/// Name of the file in a runs folder with the number of runs that were begun in it.
const RUN_COUNT_FILE: &str = ".runs-begun";

/// How many runs were begun in the folder `runs_dir`, where that is known: the number of the last.
pub fn last(runs_dir: &Path) -> Option<u64> {
    std::fs::read_to_string(runs_dir.join(RUN_COUNT_FILE)).ok()?.trim().parse().ok()
}

/// Counts a run that is about to begin; returns its number. Where the count is missing or unreadable, the numbers of all runs are read.
///
/// # Errors
/// [`RecordError`] where the folder cannot be read or written.
pub(super) fn next(runs_dir: &Path) -> Result<u64, RecordError> {
    let last = match last(runs_dir) {
        Some(last) => last,
        None => {
            let runs = folder::list(runs_dir)?;
            runs.iter().filter_map(|run| Some(run.folder.as_ref().ok()?.start().number)).max().unwrap_or(0)
        }
    };
    raise(runs_dir, last.saturating_add(1))
}

/// Stores that `number` runs were begun: later runs get greater numbers.
///
/// # Errors
/// [`RecordError`] where it cannot be written.
pub fn raise(runs_dir: &Path, number: u64) -> Result<u64, RecordError> {
    write_whole(&runs_dir.join(RUN_COUNT_FILE), format!("{number}\n").as_bytes())?;
    Ok(number)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::super::folder::RunFolder;
    use super::*;

    #[test]
    fn runs_are_in_the_order_in_which_they_were_made_whatever_the_clock_said() {
        let dir = tempfile::tempdir().unwrap();
        let made = ["20261120T101503Z-ab12cd", "19700101T000003Z-ab12cd", "20271120T101503Z-ab12cd"];
        for (place, id) in made.into_iter().enumerate() {
            RunFolder::create(dir.path(), fixtures::start(id)).unwrap();
            // without its file the count goes on all the same, and so it does with one that is garbled
            match place {
                0 => std::fs::remove_file(dir.path().join(RUN_COUNT_FILE)).unwrap(),
                _ => std::fs::write(dir.path().join(RUN_COUNT_FILE), "garbage").unwrap(),
            }
        }
        let listed: Vec<_> =
            folder::list(dir.path()).unwrap().into_iter().map(|run| run.id.to_string()).collect();
        assert_eq!(listed, made);
    }
}
