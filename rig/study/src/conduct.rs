//! What `rig study` does: plans, hands tasks to an engine, looks, cancels.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;
use app::{Failure, Watcher};
use ground::statistics::median;
use record::outputs::{OutputFolder, Outputs};

use crate::engine::{AtWork, Batch, Engine, of_job};
use crate::folder::{FILES, Job, Standing, Study, StudyFolder};
use crate::plan::StudyFile;
use crate::tries::Tries;

/// How often results are counted while somebody watches, chosen.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);
/// How often the engine itself is asked, in looks: asking one costs its server something.
const LOOKS_PER_QUESTION: u32 = 15;
/// Tasks whose times are looked at to learn how long one takes, at most.
const MOST_MEASURED: usize = 200;

/// Plans the study of the file at `path` into the folder `out`, where it may have been begun; its experiments are read, and never written.
///
/// # Errors
/// As [`StudyFile::plan`].
pub fn plan(path: &Path, out: &Path) -> Result<(StudyFolder, Study), Failure> {
    // refused before anything is read that takes long
    Outputs::reading([path.to_owned()]).folder(&absolute(out)?, &FILES)?;
    let file = StudyFile::read(path)?;
    let plan = file.plan(path)?;
    let read = plan.subjects.iter().map(|subject| subject.path.clone());
    let models = plan.tasks.iter().filter_map(|(_, task)| task.model.clone());
    let models: std::collections::BTreeSet<PathBuf> = models.collect();
    let mut outputs = Outputs::reading(read.chain(models).chain([path.to_owned()]));
    let folder = StudyFolder::open(&outputs.folder(&absolute(out)?, &FILES)?);
    let study = folder.write_plan(&file, path, &plan)?;
    Ok((folder, study))
}

/// The study in the folder `path`.
///
/// # Errors
/// [`Failure::Input`] where there is none.
pub fn open(path: &Path) -> Result<(StudyFolder, Study), Failure> {
    let out: OutputFolder = Outputs::default().folder(&absolute(path)?, &FILES)?;
    let folder = StudyFolder::open(&out);
    let study = folder.study()?;
    Ok((folder, study))
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(Failure::input)
}

/// Hands what is left of `study` to `engine`; gives how many tasks that was.
///
/// # Errors
/// [`Failure::Input`] where the engine is not there, or still has tasks of this study.
pub fn submit(
    folder: &StudyFolder,
    study: &mut Study,
    engine: &dyn Engine,
    workers: NonZeroUsize,
) -> Result<usize, Failure> {
    for job in &study.jobs {
        let at_work = of_job(job)?.look(folder, &job.id);
        // one that does not answer any more has nothing that a task done twice would harm
        if at_work.is_ok_and(|at_work| !at_work.is_over()) {
            return Err(Failure::Input(anyhow!(
                "{} is still under way, as job {} of {}: `rig study status` says how far it is, `rig study cancel` ends it",
                folder.path().display(),
                job.id,
                job.engine
            )));
        }
    }
    let left = folder.left(study);
    if left.is_empty() {
        return Ok(0);
    }
    let number = study.jobs.len() + 1;
    let list: String = left.iter().map(|id| format!("{}\n", folder.task(id).display())).collect();
    let list = folder.write_submitted(&format!("{number}.txt"), &list)?;
    let count = left.len();
    let batch = Batch {
        folder,
        study,
        list: &list,
        count,
        number,
        measured_s: measured_s(folder, study),
        workers,
        program: std::env::current_exe().map_err(Failure::internal)?,
    };
    let id = engine.submit(&batch)?;
    study.jobs.push(Job { engine: engine.name().into(), id, tasks: count });
    folder.write_study(study)?;
    Ok(count)
}

/// How long tasks of `study` took, of those that are done: in the middle, and the longest \[s\].
fn measured_s(folder: &StudyFolder, study: &Study) -> Option<[f64; 2]> {
    let took = study.tasks.iter().filter_map(|id| Some(Tries::of(folder, id).took()?.wall_s));
    let mut wall_s: Vec<f64> = took.take(MOST_MEASURED).collect();
    let longest_s = wall_s.iter().copied().fold(0.0, f64::max);
    median(&mut wall_s, f64::total_cmp).map(|middle_s| [middle_s, longest_s])
}

/// What tasks of `study` took, of those that are done: seconds, processor seconds, the most memory of one \[MiB\].
pub fn took(folder: &StudyFolder, study: &Study) -> (f64, f64, f64) {
    let all = study.tasks.iter().filter_map(|id| Tries::of(folder, id).took());
    all.fold((0.0, 0.0, 0.0), |(wall_s, cpu_s, peak_mib), took| {
        (wall_s + took.wall_s, cpu_s + took.cpu_s, f64::max(peak_mib, took.peak_mib))
    })
}

/// What engines still have of `study`; of one that does not answer, what it says.
pub fn look(folder: &StudyFolder, study: &Study) -> (AtWork, Vec<String>) {
    let (mut all, mut trouble) = (AtWork::default(), Vec::new());
    for job in &study.jobs {
        match of_job(job).and_then(|engine| engine.look(folder, &job.id)) {
            Ok(at_work) => {
                all.waiting += at_work.waiting;
                all.running += at_work.running;
            }
            Err(failure) => trouble.push(format!("job {} of {}: {:#}", job.id, job.engine, failure.error())),
        }
    }
    (all, trouble)
}

/// Cancels what engines still have of `study`.
///
/// # Errors
/// As the engine says; the others are cancelled all the same.
pub fn cancel(folder: &StudyFolder, study: &Study) -> Result<usize, Failure> {
    let (mut cancelled, mut trouble) = (0, None);
    for job in &study.jobs {
        let engine = of_job(job)?;
        match engine.look(folder, &job.id) {
            Ok(at_work) if at_work.is_over() => {}
            Ok(_) => match engine.cancel(folder, &job.id) {
                Ok(()) => cancelled += 1,
                Err(failure) => trouble = Some(failure),
            },
            Err(failure) => trouble = Some(failure),
        }
    }
    trouble.map_or(Ok(cancelled), Err)
}

/// Watches `study` until nothing of it is left, or no engine has anything of it; `is_interrupted` ends the watching, and nothing else.
pub fn watch(
    folder: &StudyFolder,
    study: &Study,
    watcher: &mut dyn Watcher,
    is_interrupted: &dyn Fn() -> bool,
) -> Standing {
    watcher.begin("tasks", Some(study.tasks.len() as u64));
    let mut looks = 0_u32;
    let mut is_over = false;
    loop {
        let standing = folder.standing(study);
        watcher.step((standing.done + standing.set_aside) as u64);
        if standing.left() == 0 || is_over || is_interrupted() {
            watcher.clear();
            return standing;
        }
        std::thread::sleep(LOOK_INTERVAL);
        looks += 1;
        if looks.is_multiple_of(LOOKS_PER_QUESTION) {
            let (at_work, trouble) = look(folder, study);
            // then once more: its last results may have come since they were counted
            is_over = at_work.is_over() && trouble.is_empty();
        }
    }
}

/// Lets tasks that died under a signal or a cancelled job begin from none again.
pub fn forget_tries(folder: &StudyFolder, study: &Study) {
    folder.left(study).iter().for_each(|id| Tries::of(folder, id).take_back());
}
