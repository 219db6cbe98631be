//! What is deleted, and only where the rig's config says so: recordings of runs that are older than the newest ones.

use std::collections::HashSet;
use std::path::Path;

use super::Failure;
use super::last_good::LastGood;
use config::RetentionConfig;
use ground::error_chain::with_causes;
use record::folder::{RunFolder, file};
use record::order;
use record::retention::{Removed, remove_recording};
use record::run_id::RunId;
use store::Store;

/// Deletes what `config` says of the runs in `store`'s folder, and gives what that was. The newest are those that were made last, whatever the
/// clock said ([`order`]). A run that has not ended keeps its recording, and so does one that the last good fit was made from or that a job
/// which waits or runs is about, and the last that was made.
///
/// # Errors
/// [`Failure::Internal`] where the folder or the queue cannot be read. A recording that cannot be deleted stays.
pub fn retain(store: &Store, config: &RetentionConfig) -> Result<Vec<(RunId, Removed)>, Failure> {
    let runs_dir = store.runs_dir();
    let last = order::last(runs_dir);
    let with_recording = with_recording(runs_dir)?;
    let beyond = with_recording.len().saturating_sub(config.keep_recordings.get());
    if beyond == 0 {
        return Ok(Vec::new());
    }
    let mut kept: HashSet<String> = LastGood::among(runs_dir).runs()?.into_iter().collect();
    kept.extend(store.runs_wanted().map_err(Failure::internal)?.iter().map(RunId::to_string));
    let may_go = |run: &&RunFolder| {
        let start = run.start();
        run.stop().is_some() && !kept.contains(start.id.as_str()) && last != Some(start.number)
    };
    let mut removed = Vec::new();
    for run in with_recording[..beyond].iter().filter(may_go) {
        let id = &run.start().id;
        match remove_recording(run) {
            Ok(gone) => removed.push((id.clone(), gone)),
            Err(error) => tracing::warn!("run {id} keeps its recording: {}", with_causes(&error)),
        }
    }
    Ok(removed)
}

/// The runs that have their recordings, oldest first. Those that cannot be opened keep them.
fn with_recording(runs_dir: &Path) -> Result<Vec<RunFolder>, Failure> {
    let entries = std::fs::read_dir(runs_dir).map_err(Failure::internal)?;
    let paths = entries
        .flatten()
        .filter(|entry| RunId::try_from(entry.file_name().into_string().unwrap_or_default()).is_ok());
    let paths = paths.map(|entry| entry.path()).filter(|path| path.join(file::RECORDING).exists());
    let mut runs: Vec<RunFolder> = paths.filter_map(|path| RunFolder::open(&path).ok()).collect();
    runs.sort_by_cached_key(|run| (run.start().number, run.start().id.clone()));
    if let Some(last) = runs.last().map(|run| run.start().number)
        && order::last(runs_dir).is_some_and(|begun| begun < last)
    {
        // runs of another folder were put here: those that are made from now on come behind them
        order::raise(runs_dir, last).map_err(Failure::internal)?;
    }
    Ok(runs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::fixtures;
    use record::start_stop::Stop;
    use record::verify::{State, verify};
    use store::job::{NewJob, Work};

    fn id(day: usize) -> RunId {
        format!("202611{day:02}T101503Z-ab12cd").parse().unwrap()
    }

    fn run(runs_dir: &Path, day: usize, ended: bool) -> RunFolder {
        let start = fixtures::start(id(day).as_str());
        let mut run = RunFolder::create(runs_dir, start).unwrap();
        std::fs::write(run.file(file::RECORDING), "a film").unwrap();
        let stop = Stop { images: 1, ..fixtures::stop() };
        if ended {
            run.finish(stop, None).unwrap();
        }
        run
    }

    #[test]
    fn run_that_was_made_last_keeps_its_recording_wherever_the_clock_stood() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let config = RetentionConfig { keep_recordings: 2.try_into().unwrap() };
        let mut made = Vec::new();
        // the clock goes back with each run: by its id the newest is the oldest
        for day in (10..=16).rev() {
            made.push(run(folder.path(), day, true));
            let gone: Vec<RunId> = retain(&store, &config).unwrap().into_iter().map(|(id, _)| id).collect();
            let oldest = made.len().checked_sub(3).map(|place| made[place].start().id.clone());
            assert_eq!(gone, oldest.into_iter().collect::<Vec<_>>());
        }
        // runs of another folder, where more were made, are put here
        let other = tempfile::tempdir().unwrap();
        order::raise(other.path(), 500).unwrap();
        for day in [20, 21] {
            let run = run(other.path(), day, true);
            std::fs::rename(run.path(), folder.path().join(run.start().id.as_str())).unwrap();
        }
        let last = run(folder.path(), 9, true);
        retain(&store, &config).unwrap();
        assert!(last.file(file::RECORDING).exists());
        assert_eq!(run(folder.path(), 8, true).start().number, 503);
    }

    #[test]
    fn oldest_recordings_go_but_not_those_that_somebody_needs() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let runs: Vec<RunFolder> = (1..=7).map(|day| run(folder.path(), day, day != 3)).collect();
        store.add(&NewJob::new(Work::Recalibrate { run: id(1) })).unwrap();
        let good = LastGood::among(folder.path());
        std::fs::create_dir(good.folder()).unwrap();
        let fit = format!(r#"{{"runs":[{{"id":"{}","use":"fit","keypoints":[]}}]}}"#, id(4));
        std::fs::write(good.folder().join(file::FIT), fit).unwrap();
        let config = RetentionConfig { keep_recordings: 2.try_into().unwrap() };

        let gone: Vec<RunId> = retain(&store, &config).unwrap().into_iter().map(|(id, _)| id).collect();
        // 1 has a job that waits, 3 has not ended, 4 is the last good fit's, 6 and 7 are the newest
        assert_eq!(gone, [id(2), id(5)]);
        let has = |day: usize| runs[day - 1].file(file::RECORDING).exists();
        assert_eq!((1..=7).filter(|&day| has(day)).collect::<Vec<_>>(), [1, 3, 4, 6, 7]);
        for run in [&runs[1], &runs[4], &runs[6]] {
            let found = verify(run.path());
            assert_eq!(found.state, State::Sound, "{found:?}");
        }
        assert_eq!(retain(&store, &config).unwrap(), []);

        // killed before the file was gone: done again, and what was said stays
        std::fs::write(runs[1].file(file::RECORDING), "a film").unwrap();
        let said = std::fs::read(runs[1].file(file::RETENTION)).unwrap();
        assert_eq!(retain(&store, &config).unwrap().len(), 1);
        assert_eq!(std::fs::read(runs[1].file(file::RETENTION)).unwrap(), said);
    }
}
