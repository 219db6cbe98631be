//! Slurm: job arrays by `sbatch`. Each element does every so-manieth task of the list, as many as make its start worth while; a job after them
//! collects. Needs the study's folder, and this program under its path, on all nodes.

use std::process::Command;

use anyhow::anyhow;
use app::Failure;

use super::{AtWork, Batch, Engine, told};
use crate::folder::StudyFolder;

/// See [module](self).
#[derive(Debug)]
pub(super) struct Slurm;

const INSTALL: &str = "it comes with Slurm, on a cluster's login node; `--on local` needs nothing";
/// What an element of an array should take at least \[s\]. Chosen: starting one costs Slurm about a second.
const ELEMENT_S: f64 = 60.0;
/// Most elements, where `scontrol` does not say: Slurm's own default for MaxArraySize, less one.
const DEFAULT_MOST_ELEMENTS: usize = 1000;
/// Joins the numbers of the array and of the job that collects.
const AND: char = '+';

impl Engine for Slurm {
    fn name(&self) -> &'static str {
        "slurm"
    }

    fn submit(&self, batch: &Batch<'_>) -> Result<String, Failure> {
        let per_element =
            batch.usual_s().map_or(1.0, |usual_s| (ELEMENT_S / usual_s.max(1e-3)).ceil().max(1.0));
        let elements = ((batch.count as f64 / per_element).ceil() as usize).clamp(1, most_elements());
        let each = batch.count.div_ceil(elements);
        let words = [batch.program.display().to_string(), batch.list.display().to_string()];
        let [program, list] = words.map(|word| quoted(&word));
        let script = format!(
            "#!/bin/sh\nexec {program} task --supervise --list {list} --part \"$SLURM_ARRAY_TASK_ID\" --parts {elements}\n"
        );
        let script = batch.folder.write_submitted(&format!("{}.sh", batch.number), &script)?;
        let study = batch.study;
        let minutes = (batch.limit_s() * each as f64 / 60.0).ceil() as u64 + 1;
        let output = batch.folder.logs().join(format!("slurm-{}-%a.txt", batch.number));
        let id = told(
            Command::new("sbatch")
                .args(["--parsable", "--requeue", "--open-mode=append", "--export=ALL", "--ntasks=1"])
                .arg(format!("--job-name={}", batch.title()))
                .arg(format!("--array=0-{}", elements - 1))
                .arg(format!("--cpus-per-task={}", study.threads))
                .arg(format!("--mem={}M", study.memory_mib))
                .arg(format!("--time={minutes}"))
                .arg(format!("--output={}", output.display()))
                .args(&study.slurm)
                .arg(&script),
            INSTALL,
        )?;
        // `--parsable` puts a cluster's name behind a semicolon
        let id = id.split(';').next().unwrap_or(&id).to_owned();
        let collect =
            format!("{program} study collect {}", quoted(&batch.folder.path().display().to_string()));
        let output = batch.folder.logs().join("slurm-collect.txt");
        let after = told(
            Command::new("sbatch")
                .args(["--parsable", "--requeue", "--ntasks=1"])
                .arg(format!("--job-name={}-collect", batch.title()))
                .arg(format!("--dependency=afterany:{id}"))
                .arg(format!("--output={}", output.display()))
                .args(&study.slurm)
                .arg(format!("--wrap={collect}")),
            INSTALL,
        )?;
        let after = after.split(';').next().unwrap_or(&after).to_owned();
        Ok(format!("{id}{AND}{after}"))
    }

    fn look(&self, _: &StudyFolder, id: &str) -> Result<AtWork, Failure> {
        let (array, _) = id.split_once(AND).unwrap_or((id, ""));
        // `--me` and no job number: one that is long over would be an error
        let all = told(
            Command::new("squeue").args(["--noheader", "--array", "--me", "--format=%A %F %t"]),
            INSTALL,
        )?;
        let mut at_work = AtWork::default();
        for line in all.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [_, of_array, state] = words[..] else {
                return Err(Failure::Internal(anyhow!("squeue says `{line}`, which is no job's line")));
            };
            if of_array == array {
                match state {
                    "R" | "CG" | "CF" | "S" => at_work.running += 1,
                    _ => at_work.waiting += 1,
                }
            }
        }
        Ok(at_work)
    }

    fn cancel(&self, _: &StudyFolder, id: &str) -> Result<(), Failure> {
        told(Command::new("scancel").args(id.split(AND)), INSTALL).map(drop)
    }
}

/// The most elements that an array may have here.
fn most_elements() -> usize {
    let config = told(Command::new("scontrol").args(["show", "config"]), INSTALL).unwrap_or_default();
    let size = config.lines().find_map(|line| line.strip_prefix("MaxArraySize")?.split('=').nth(1));
    size.and_then(|size| size.trim().parse::<usize>().ok())
        .map_or(DEFAULT_MOST_ELEMENTS, |size| size.max(2) - 1)
}

/// `word` as one word of a shell.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}
