//! What is deleted, and only where the rig's config says so: recordings of runs that are older than the newest ones.

use std::collections::HashSet;
use std::path::Path;

use super::Failure;
use super::last_good::LastGood;
use crate::config::RetentionConfig;
use crate::error_chain::with_causes;
use crate::record::folder::{RunFolder, file};
use crate::record::retention::{Removed, remove_recording};
use crate::record::run_id::RunId;
use crate::store::Store;

/// Deletes what `config` says of the runs in `store`'s folder, and gives what that was. A run that has not ended keeps its recording,
/// and so does one that the last good fit was made from or that a job which waits or runs is about.
///
/// # Errors
/// [`Failure::Internal`] where the folder or the queue cannot be read. A recording that cannot be deleted stays.
pub fn retain(store: &Store, config: &RetentionConfig) -> Result<Vec<(RunId, Removed)>, Failure> {
    let runs_dir = store.runs_dir();
    let mut with_recording = with_recording(runs_dir)?;
    with_recording.sort_unstable();
    let beyond = with_recording.len().saturating_sub(config.keep_recordings.get());
    if beyond == 0 {
        return Ok(Vec::new());
    }
    let mut kept: HashSet<String> = LastGood::among(runs_dir).runs()?.into_iter().collect();
    kept.extend(store.runs_wanted().map_err(Failure::internal)?.iter().map(RunId::to_string));
    let mut removed = Vec::new();
    for id in with_recording.into_iter().take(beyond).filter(|id| !kept.contains(id.as_str())) {
        let run = RunFolder::open(&runs_dir.join(id.as_str()));
        match run
            .and_then(|run| if run.stop().is_some() { remove_recording(&run).map(Some) } else { Ok(None) })
        {
            Ok(gone) => removed.extend(gone.map(|gone| (id, gone))),
            Err(error) => tracing::warn!("run {id} keeps its recording: {}", with_causes(&error)),
        }
    }
    Ok(removed)
}

fn with_recording(runs_dir: &Path) -> Result<Vec<RunId>, Failure> {
    let entries = std::fs::read_dir(runs_dir).map_err(Failure::internal)?;
    let ids =
        entries.flatten().filter_map(|entry| RunId::try_from(entry.file_name().into_string().ok()?).ok());
    Ok(ids.filter(|id| runs_dir.join(id.as_str()).join(file::RECORDING).exists()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::fixtures;
    use crate::record::start_stop::Stop;
    use crate::record::verify::{State, verify};
    use crate::store::job::{NewJob, Work};

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
