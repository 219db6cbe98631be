//! HyperQueue: an array of as many tasks as the study has, by `hq submit --each-line`. Its server and workers are the user's, also inside Slurm or
//! PBS; needs the study's folder, and this program under its path, on all of them.

use std::process::Command;

use anyhow::{Context as _, anyhow};
use app::Failure;
use serde::Deserialize;

use super::{AtWork, Batch, Engine, told};
use crate::folder::StudyFolder;

/// See [module](self).
#[derive(Debug)]
pub(super) struct HyperQueue;

const INSTALL: &str = "get it from https://github.com/It4innovations/hyperqueue, one file and no root; `--on local` needs nothing";

#[derive(Deserialize)]
struct Submitted {
    id: u64,
}

#[derive(Deserialize)]
struct Listed {
    id: u64,
    task_stats: Counts,
}

#[derive(Deserialize)]
struct Counts {
    running: usize,
    waiting: usize,
}

impl Engine for HyperQueue {
    fn name(&self) -> &'static str {
        "hyperqueue"
    }

    fn submit(&self, batch: &Batch<'_>) -> Result<String, Failure> {
        let study = batch.study;
        let seconds = (batch.limit_s() * study.tries as f64).ceil() as u64 + 60;
        let said = told(
            Command::new("hq")
                .args(["--output-mode", "json", "submit", "--stdout", "none", "--stderr", "none"])
                .args(["--name", &batch.title(), "--cpus", &study.threads.to_string()])
                .args(["--crash-limit", &study.tries.to_string(), "--time-limit", &format!("{seconds}s")])
                .args(&study.hyperqueue)
                .arg("--each-line")
                .arg(batch.list)
                .args(["--", "sh", "-c", "exec \"$0\" task --supervise \"$HQ_ENTRY\""])
                .arg(&batch.program),
            INSTALL,
        )?;
        let submitted: Submitted = read(&said)?;
        Ok(submitted.id.to_string())
    }

    fn look(&self, _: &StudyFolder, id: &str) -> Result<AtWork, Failure> {
        let said = told(Command::new("hq").args(["--output-mode", "json", "job", "list", "--all"]), INSTALL)?;
        let jobs: Vec<Listed> = read(&said)?;
        let job = jobs.into_iter().find(|job| job.id.to_string() == id);
        // a server that was started anew without its journal knows of none: then it has nothing of it either
        Ok(job.map_or(AtWork::default(), |job| AtWork {
            waiting: job.task_stats.waiting,
            running: job.task_stats.running,
        }))
    }

    fn cancel(&self, _: &StudyFolder, id: &str) -> Result<(), Failure> {
        told(Command::new("hq").args(["job", "cancel", id]), INSTALL).map(drop)
    }
}

fn read<T: serde::de::DeserializeOwned>(said: &str) -> Result<T, Failure> {
    serde_json::from_str(said)
        .with_context(|| format!("hq says `{said}`"))
        .map_err(|error| Failure::Internal(anyhow!(error)))
}
