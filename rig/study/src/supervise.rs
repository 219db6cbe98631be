//! Tasks one after the other, or several at once, each in a process of its own: what one does to its process, it does to no other.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use app::Failure;
use ground::strict::duration;
use record::outputs::Outputs;

use crate::folder::{FILES, StudyFolder};
use crate::task::Task;
use crate::tries::Tries;

/// How often a task's process is looked at. Chosen: a hundredth of a task of a second.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Does the tasks in the files `tasks`, `workers` at once, each until it has a result or is set aside.
///
/// # Errors
/// [`Failure::Interrupted`] after a signal; else the first thing that could not be done, when all others are done.
pub fn supervise(tasks: &[PathBuf], workers: usize, interrupted: &AtomicBool) -> Result<(), Failure> {
    let program = std::env::current_exe().map_err(Failure::internal)?;
    let (next, trouble) = (AtomicUsize::new(0), Mutex::new(None));
    std::thread::scope(|scope| {
        for _ in 0..workers.min(tasks.len()) {
            scope.spawn(|| {
                while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if interrupted.load(Ordering::Relaxed) {
                        return;
                    }
                    if let Err(failure) = one(&program, task, interrupted) {
                        let mut trouble = trouble.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                        trouble.get_or_insert(failure);
                    }
                }
            });
        }
    });
    if interrupted.load(Ordering::Relaxed) {
        return Err(Failure::Interrupted(anyhow!(
            "interrupted; `rig study resume` goes on with the tasks that are left"
        )));
    }
    trouble.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).map_or(Ok(()), Err)
}

/// Does one task, again where its process dies, until it has a result or is set aside.
fn one(program: &Path, path: &Path, interrupted: &AtomicBool) -> Result<(), Failure> {
    let task = Task::read(path)?;
    let id = task.id()?;
    let folder = StudyFolder::open(&Outputs::default().folder(StudyFolder::of_task(path)?, &FILES)?);
    // one more than it may die: that one sets it aside
    for _ in 0..=task.tries {
        if folder.has_result(&id) || folder.set_aside(&id).is_some() {
            return Ok(());
        }
        let mut child = begin(program, path, &folder.log(&id))?;
        let deadline = Instant::now() + duration(task.limit_s);
        match wait(&mut child, deadline, interrupted).map_err(Failure::internal)? {
            Waited::Ended => {}
            Waited::Interrupted => {
                Tries::of(&folder, &id).take_back();
                return Ok(());
            }
            Waited::TooLong => {
                let why = format!("took longer than {} s, its limit under [task] limit_s", task.limit_s);
                folder.put_aside(&id, &why)?;
            }
        }
    }
    if folder.has_result(&id) || folder.set_aside(&id).is_some() {
        return Ok(());
    }
    Err(Failure::Input(anyhow!(
        "task {} could not be carried out here ({}); see {}",
        path.display(),
        task.words(),
        folder.log(&id).display()
    )))
}

#[expect(clippy::disallowed_methods, reason = "a log, put to its end, in a study's own folder")]
fn begin(program: &Path, task: &Path, log: &Path) -> Result<Child, Failure> {
    let opened = std::fs::OpenOptions::new().append(true).create(true).open(log);
    let log = opened.with_context(|| format!("writing {}", log.display())).map_err(Failure::Input)?;
    let twice = log.try_clone().map_err(Failure::internal)?;
    Command::new(program)
        .arg("task")
        .arg(task)
        .stdin(Stdio::null())
        .stdout(twice)
        .stderr(log)
        .spawn()
        .with_context(|| format!("starting {}", program.display()))
        .map_err(Failure::Internal)
}

enum Waited {
    Ended,
    TooLong,
    Interrupted,
}

fn wait(child: &mut Child, deadline: Instant, interrupted: &AtomicBool) -> std::io::Result<Waited> {
    loop {
        if child.try_wait()?.is_some() {
            return Ok(Waited::Ended);
        }
        let ended = match () {
            () if interrupted.load(Ordering::Relaxed) => Waited::Interrupted,
            () if Instant::now() >= deadline => Waited::TooLong,
            () => {
                std::thread::sleep(POLL_INTERVAL);
                continue;
            }
        };
        // it may have ended just now
        let _ = child.kill();
        child.wait()?;
        return Ok(ended);
    }
}
