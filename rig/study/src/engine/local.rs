//! This machine: `rig task --supervise` in a session of its own, a process for each task.

use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};

use anyhow::Context as _;
use app::Failure;
use ground::claim::Claim;
use rustix::process::{Pid, Signal, kill_process};

use super::{AtWork, Batch, Engine};
use crate::folder::{LOCK, StudyFolder};

/// See [module](self).
#[derive(Debug)]
pub(super) struct Local;

impl Engine for Local {
    fn name(&self) -> &'static str {
        "local"
    }

    #[expect(clippy::disallowed_methods, reason = "a log, in a study's own folder")]
    fn submit(&self, batch: &Batch<'_>) -> Result<String, Failure> {
        let path = batch.folder.logs().join(format!("local-{}.txt", batch.number));
        let log = std::fs::File::create(&path)
            .with_context(|| format!("writing {}", path.display()))
            .map_err(Failure::Input)?;
        let twice = log.try_clone().map_err(Failure::internal)?;
        let mut command = Command::new(&batch.program);
        command.args(["task", "--supervise", "--workers"]).arg(batch.workers.to_string());
        command.arg("--lock").arg(batch.folder.path().join(LOCK)).arg("--list").arg(batch.list);
        // a Ctrl-C at the terminal is for whoever watches, who passes it on
        command.stdin(Stdio::null()).stdout(twice).stderr(log).process_group(0);
        let child = command.spawn().context("starting the tasks").map_err(Failure::Internal)?;
        let id = child.id();
        // nobody else collects its end while this process lives
        std::thread::spawn(move || {
            let mut child = child;
            child.wait()
        });
        Ok(id.to_string())
    }

    fn look(&self, folder: &StudyFolder, id: &str) -> Result<AtWork, Failure> {
        let is_held = Claim::holder(&folder.path().join(LOCK)).is_some_and(|pid| pid.to_string() == id);
        // it takes the lock first thing, but not before it has begun
        Ok(AtWork { waiting: 0, running: usize::from(is_held || is_beginning(id)) })
    }

    fn cancel(&self, folder: &StudyFolder, id: &str) -> Result<(), Failure> {
        if self.look(folder, id)?.is_over() {
            return Ok(());
        }
        let pid = id.parse().ok().and_then(Pid::from_raw);
        pid.map_or(Ok(()), |pid| kill_process(pid, Signal::TERM)).map_err(Failure::input)
    }
}

/// Whether the process is there, and this program's.
fn is_beginning(id: &str) -> bool {
    let arguments = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
    arguments.split(|&byte| byte == 0).any(|argument| argument == b"--supervise")
}
