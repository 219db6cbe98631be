//! A run folder says by itself what an `[[run]]` would.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::{ExperimentError, Run, RunKind};
use crate::table::{ServoTable, read_base, read_servo, read_trajectory};
use ground::names;

/// What a fit needs of `start.json`; the rest of it is for others.
#[derive(Deserialize)]
struct Start {
    id: String,
    kind: RunKind,
    model: PathBuf,
    #[serde(default)]
    prescribed: bool,
    release_s: Option<f64>,
}

/// A run folder whose `start.json` has been read.
pub(super) struct Folder {
    path: PathBuf,
    start: Start,
}

impl Folder {
    pub(super) fn read(path: &Path) -> Result<Self, ExperimentError> {
        let file = path.join("start.json");
        let text = read_text("the start of run", &file)?;
        let start =
            serde_json::from_str(&text).map_err(|source| ExperimentError::Start { path: file, source })?;
        Ok(Self { path: path.into(), start })
    }

    /// The model the run was made with: its path and text.
    pub(super) fn model(&self) -> Result<(PathBuf, String), ExperimentError> {
        let path = self.path.join(&self.start.model);
        let text = read_text("model", &path)?;
        Ok((path, text))
    }

    /// The run, with its servo table as `held` makes of it.
    pub(super) fn run(self, held: impl Fn(ServoTable) -> ServoTable) -> Result<Run, ExperimentError> {
        let table = self.path.join("trajectory.csv");
        if !table.exists() {
            let reason = format!("{} is not there; extract it first with `rig replay`", table.display());
            return Err(ExperimentError::Data { run: self.start.id, reason });
        }
        let trajectory = read_trajectory(&table)?;
        let mut run = Run::new(self.start.id, self.start.kind, trajectory);
        let servo = self.path.join("servo.csv");
        if run.kind == RunKind::Driven || servo.exists() {
            run.take_servo(held(read_servo(&servo)?));
        }
        let base = self.path.join("base.csv");
        if base.exists() {
            run.base = Some(Arc::new(read_base(&base)?));
        }
        run.prescribed = self.start.prescribed;
        if run.kind == RunKind::Drop {
            run.release_s = self.start.release_s;
        }
        Ok(run)
    }
}

pub(super) fn read_text(what: &'static str, path: &Path) -> Result<String, ExperimentError> {
    names::read_text(path).map_err(|source| ExperimentError::Unreadable { what, path: path.into(), source })
}
