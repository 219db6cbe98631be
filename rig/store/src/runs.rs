//! The index of a runs folder: a line for each run, and its coefficients. The folders are the truth; the index knows from a
//! folder's time of change whether its line still holds.

use std::collections::HashMap;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ident::diagnose::Verdict;
use ident::fit::{Fit, FittedParameter};
use rusqlite::{Connection, params};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::models::MadeWith;
use super::{Store, StoreError};
use ground::error_chain::with_causes;
use record::folder::{RunFolder, file};
use record::losses::{Limits, Losses};
use record::run_id::RunId;
use record::start_stop::Status;
use record::{RecordError, below, journal};
use report::{Findings, Headline, is_determined_alone};

/// The status of a run whose folder says nothing.
const UNREADABLE: &str = "unreadable";
/// A folder modified less than this before it was read may change again without a new modification time. Chosen.
const MODIFICATION_TIME_MARGIN: Duration = Duration::from_secs(2);

/// One run as the list of runs shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Summary {
    /// Its name.
    pub id: String,
    /// `success`, `abort`, `fail`, `incomplete`, or `unreadable`.
    pub status: String,
    /// Why it did not end well, or cannot be read.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub reason: Option<String>,
    /// When it began, UTC.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub began: Option<String>,
    /// `drop` or `driven`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kind: Option<String>,
    /// To its stop; to its last journal entry where there was no stop \[s\].
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub duration_s: Option<f64>,
    /// Images received.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub images: Option<u64>,
    /// Its place among the runs of its folder, in the order in which they were made: 0 for those from before 2026-11-27, which come first.
    #[serde(default)]
    pub number: u64,
    /// Its lost images.
    #[serde(default)]
    pub losses: Option<Losses>,
    /// Why nothing is promoted that was made from it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub degraded: Option<String>,
    /// Error of its fitted simulation: root mean square along one axis, over all keypoints but P0 \[m\].
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub fit_error_m: Option<f64>,
    /// Ratio of that error to the keypoints' noise.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub error_over_noise: Option<f64>,
    /// How many of its coefficients the run determines, and how many were fitted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub determined: Option<[usize; 2]>,
    /// The report's headline and its colour.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub headline: Option<Headline>,
    /// The diagnosis's verdict.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub verdict: Option<String>,
    /// Whether it has a report.
    #[serde(default)]
    pub report: bool,
    /// The model that it was made with.
    #[serde(default)]
    pub model: Option<MadeWith>,
}

/// A coefficient as one run's fit found it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Coefficient {
    /// The run.
    pub run: String,
    /// Its name, for example `g3/blunt`.
    pub name: String,
    /// The unit of value, deviation and bounds, `1` for none; empty where its fit did not say.
    pub unit: String,
    /// Its value.
    pub value: f64,
    /// One standard deviation of it.
    pub std: Option<f64>,
    /// Whether the data determine it by itself.
    pub determined: bool,
    /// Lower bound of the fit.
    pub lower: f64,
    /// Upper bound of the fit.
    pub upper: f64,
}

/// The changes to the index.
struct Update {
    /// Coefficients and line of each run that is new or has changed, and when its folder had changed when it was read.
    lines: Vec<(Vec<Coefficient>, Summary, i64)>,
    /// Runs whose folders are gone.
    gone: Vec<String>,
}

/// Copies the index into memory; queries then find these tables first.
const COPY_TABLES: &str = "
    CREATE TEMP TABLE runs AS SELECT * FROM main.runs;
    CREATE UNIQUE INDEX temp.run_ids ON runs (id);
    CREATE TEMP TABLE coefficients AS SELECT * FROM main.coefficients;
    CREATE INDEX temp.run_coefficients ON coefficients (run);
";

impl Update {
    fn apply(&self, db: &Connection) -> rusqlite::Result<()> {
        let mut forget = db.prepare("DELETE FROM coefficients WHERE run = ?1")?;
        let mut remove = db.prepare("DELETE FROM runs WHERE id = ?1")?;
        for id in self.gone.iter().chain(self.lines.iter().map(|(_, summary, _)| &summary.id)) {
            forget.execute([id])?;
            remove.execute([id])?;
        }
        let mut line = db.prepare("INSERT INTO runs (id, modified_ns, summary) VALUES (?1, ?2, ?3)")?;
        let mut coefficient = db.prepare(
            "INSERT INTO coefficients (run, name, unit, value, std, determined, lower, upper)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
        )?;
        for (found, summary, modified_ns) in &self.lines {
            let text = serde_json::to_string(summary)
                .map_err(|error| rusqlite::Error::ToSqlConversionFailure(error.into()))?;
            line.execute(params![summary.id, modified_ns, text])?;
            for Coefficient { run, name, unit, value, std, determined, lower, upper } in found {
                coefficient.execute(params![run, name, unit, value, std, determined, lower, upper])?;
            }
        }
        Ok(())
    }
}

/// Counts of a refresh of the index.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refreshed {
    /// Runs there are.
    pub runs: usize,
    /// Of these, read again or for the first time.
    pub read: usize,
    /// Lines whose folders are gone.
    pub gone: usize,
}

impl Summary {
    /// Of the run `id` in the folder of run folders `runs_dir`. A link there is not followed: whoever asks over HTTP may not see
    /// where it leads.
    pub fn within(runs_dir: &Path, id: &RunId) -> Self {
        let path = runs_dir.join(id.as_str());
        if path.is_symlink() {
            let reason =
                format!("{} is a link, which is not followed; put the folder itself there", path.display());
            return Self { reason: Some(reason), ..Self::unread(id) };
        }
        Self::of(id, &path)
    }

    /// Of the run in the folder `path`, which is called `id`.
    pub fn of(id: &RunId, path: &Path) -> Self {
        let mut summary = Self::unread(id);
        match RunFolder::open(path) {
            Ok(run) => summary.fill(&run),
            Err(error) => summary.reason = Some(with_causes(&error)),
        }
        summary
    }

    fn unread(id: &RunId) -> Self {
        Self {
            id: id.to_string(),
            status: UNREADABLE.into(),
            reason: None,
            began: None,
            kind: None,
            duration_s: None,
            images: None,
            number: 0,
            losses: None,
            degraded: None,
            fit_error_m: None,
            error_over_noise: None,
            determined: None,
            headline: None,
            verdict: None,
            report: false,
            model: None,
        }
    }

    /// The remark in a list of runs: why the run is degraded, or is not fully readable.
    pub fn note(&self) -> Option<String> {
        let unreadable = || self.reason.clone().filter(|_| self.status == "incomplete");
        self.degraded.as_ref().map(|why| format!("degraded: {why}")).or_else(unreadable)
    }

    fn fill(&mut self, run: &RunFolder) {
        self.status = status(run).into();
        self.report = below::at(&run.file(file::REPORT)).is_ok();
        self.reason = match run.stop() {
            Some(stop) => stop.reason.clone(),
            None => run.unreadable_stop().and_then(|_| run.incomplete()),
        };
        self.number = run.start().number;
        self.began = Some(run.start().clock.utc.clone());
        self.kind = Some(format!("{:?}", run.start().kind).to_lowercase());
        self.duration_s = match run.stop() {
            Some(stop) => Some(stop.clock.monotonic_ns.seconds_since(run.origin())),
            None => {
                journal::read(&run.file(file::JOURNAL)).ok().and_then(|entries| Some(entries.last()?.at_s))
            }
        };
        if run.stop().is_some() || run.file(file::FRAMES).exists() {
            let losses = Losses::of(run);
            self.images = Some(losses.received);
            self.degraded = losses.degraded(&Limits::of(run));
            self.losses = Some(losses);
        }
        self.model = MadeWith::of(run);
        let diagnosis: Option<Said> = results(&run.file(file::DIAGNOSIS));
        self.verdict = diagnosis.as_ref().map(|said| said.verdict.name().to_owned());
        // an older fit has no such error
        let fit = results(&run.file(file::FIT)).filter(|fit: &Fit| fit.error_m.is_some());
        let Some(mut findings) = fit.as_ref().map(Findings::of) else { return };
        if let Some(said) = diagnosis {
            findings = findings.diagnosed(said.verdict, said.noise_m.hypot(said.noise.pose_std_m));
        }
        if let Some(losses) = self.losses {
            findings = findings.filmed(losses);
        }
        self.fit_error_m = findings.error_m;
        self.error_over_noise = findings.over_noise();
        self.determined = Some([findings.determined, findings.coefficients]);
        self.headline = Some(findings.headline());
    }

    fn is_readable(&self) -> bool {
        self.status != UNREADABLE
    }

    /// It may still be going on: its folder's time does not tell whether its line holds.
    fn is_open(&self) -> bool {
        self.status == "incomplete"
    }
}

/// How a run ended, in a word.
pub fn status(run: &RunFolder) -> &'static str {
    run.stop().map_or("incomplete", |stop| word(stop.status))
}

/// The same, of a run that has ended.
pub fn word(status: Status) -> &'static str {
    match status {
        Status::Success => "success",
        Status::Abort => "abort",
        Status::Fail => "fail",
    }
}

/// What a list says of a diagnosis.
#[derive(Debug, Deserialize)]
struct Said {
    verdict: Verdict,
    noise_m: f64,
    noise: SaidNoise,
}

#[derive(Debug, Deserialize)]
struct SaidNoise {
    #[serde(default)]
    pose_std_m: f64,
}

fn results<T: DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&below::read_at(path).ok()?).ok()
}

fn coefficients(run: &RunId, path: &Path) -> Vec<Coefficient> {
    let Some(fit) = results::<Fit>(&path.join(file::FIT)) else { return Vec::new() };
    let one = |parameter: &FittedParameter| Coefficient {
        run: run.to_string(),
        name: parameter.name.clone(),
        unit: parameter.unit.clone(),
        value: parameter.value,
        std: Some(parameter.std),
        determined: is_determined_alone(&fit, parameter),
        lower: parameter.lower,
        upper: parameter.upper,
    };
    fit.parameters.iter().map(one).collect()
}

/// When a folder last changed \[ns since 1970\].
fn modified_ns(path: &Path) -> std::io::Result<i64> {
    let since = path.metadata()?.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
    Ok(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

impl Store {
    /// Brings the index up to date with the folders; with `reread_all` all of them are read again.
    ///
    /// # Errors
    /// [`StoreError::Runs`] where the runs folder cannot be read, or as the database says.
    pub fn refresh(&mut self, reread_all: bool) -> Result<Refreshed, StoreError> {
        let runs_dir = self.runs_dir.clone();
        let io = || RecordError::io("reading runs folder", &runs_dir);
        self.drop_memory_copy()?;
        let mut known = self.known()?;
        let recent = SystemTime::now() - MODIFICATION_TIME_MARGIN;
        let recent_ns = recent.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64);
        let mut refreshed = Refreshed::default();
        let mut stale = Vec::new();
        for entry in std::fs::read_dir(&runs_dir).map_err(io())? {
            let entry = entry.map_err(io())?;
            let Ok(id) = RunId::try_from(entry.file_name().into_string().unwrap_or_default()) else {
                continue;
            };
            refreshed.runs += 1;
            let modified = modified_ns(&entry.path()).unwrap_or(0);
            if known.remove(id.as_str()) != Some(modified) || reread_all {
                // a folder that may still change without a new time counts as never read
                let read_at_ns = if modified < recent_ns { modified } else { 0 };
                stale.push((id, entry.path(), read_at_ns));
            }
        }
        (refreshed.read, refreshed.gone) = (stale.len(), known.len());
        if stale.is_empty() && known.is_empty() {
            return Ok(refreshed);
        }
        let lines: Vec<_> = stale
            .into_iter()
            .map(|(id, path, read_at_ns)| {
                let summary = Summary::within(&runs_dir, &id);
                let read_at_ns = if summary.is_open() { 0 } else { read_at_ns };
                let found = if summary.is_readable() { coefficients(&id, &path) } else { Vec::new() };
                (found, summary, read_at_ns)
            })
            .collect();
        let update = Update { lines, gone: known.into_keys().collect() };
        match self.change_without_waiting("bringing the index up to date in", |db| update.apply(db)) {
            Err(error) if error.is_temporary() => self.use_memory_copy(&update, &error)?,
            other => other?,
        }
        Ok(refreshed)
    }

    /// Updates a copy of the index in memory, which is used until the index itself can be written.
    fn use_memory_copy(&mut self, update: &Update, why: &StoreError) -> Result<(), StoreError> {
        let failed = StoreError::at("copying the index of", &self.path);
        let mut copy = || {
            let copy = self.db.transaction()?;
            copy.execute_batch(COPY_TABLES)?;
            update.apply(&copy)?;
            copy.commit()
        };
        copy().map_err(failed)?;
        self.is_in_memory = true;
        tracing::warn!("{}: what is new in the runs is known to this process only", with_causes(why));
        Ok(())
    }

    /// Uses the index itself again.
    fn drop_memory_copy(&mut self) -> Result<(), StoreError> {
        if std::mem::take(&mut self.is_in_memory) {
            let dropped = self.db.execute_batch("DROP TABLE temp.coefficients; DROP TABLE temp.runs");
            dropped.map_err(self.failed("leaving the copy of"))?;
        }
        Ok(())
    }

    /// The times of change of the folders whose lines are known; of lines from before losses were counted none that any folder has.
    fn known(&self) -> Result<HashMap<String, i64>, StoreError> {
        let query = "SELECT id, iif(json_type(summary, '$.losses') IS NULL, -1, modified_ns) FROM runs";
        Ok(self.rows(query, [], |row| Ok((row.get(0)?, row.get(1)?)))?.into_iter().collect())
    }

    /// The newest `most` runs, oldest first, as the index has them.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn runs(&self, most: usize) -> Result<Vec<Summary>, StoreError> {
        self.runs_before(None, most)
    }

    /// The newest `most` of the runs that are older than `before`, oldest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn runs_before(&self, before: Option<&str>, most: usize) -> Result<Vec<Summary>, StoreError> {
        let query = "SELECT summary FROM runs WHERE ?1 IS NULL OR (summary ->> '$.number', id) < \
                     (coalesce((SELECT summary ->> '$.number' FROM runs WHERE id = ?1), 0), ?1) \
                     ORDER BY summary ->> '$.number' DESC, id DESC LIMIT ?2";
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        let lines: Vec<String> = self.rows(query, params![before, most], |row| row.get(0))?;
        let read = |line: &String| serde_json::from_str(line).map_err(|error| self.damaged(&error));
        lines.iter().rev().map(read).collect()
    }

    /// How many runs there are, by how they ended.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn runs_by_status(&self) -> Result<Vec<(String, u32)>, StoreError> {
        let query = "SELECT summary ->> '$.status' AS status, count(*) FROM runs GROUP BY status";
        self.rows(query, [], |row| Ok((row.get(0)?, row.get(1)?)))
    }

    /// How `name` was found, run after run.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn trend(&self, name: &str) -> Result<Vec<Coefficient>, StoreError> {
        let query = "SELECT run, name, unit, value, std, determined, lower, upper FROM coefficients JOIN runs ON run = id WHERE name = ?1 \
                     ORDER BY summary ->> '$.number', run";
        self.rows(query, [name], |row| {
            Ok(Coefficient {
                run: row.get(0)?,
                name: row.get(1)?,
                unit: row.get(2)?,
                value: row.get(3)?,
                std: row.get(4)?,
                determined: row.get(5)?,
                lower: row.get(6)?,
                upper: row.get(7)?,
            })
        })
    }

    pub(super) fn damaged(&self, error: &serde_json::Error) -> StoreError {
        let what = format!("{error}; `rig runs index` makes the index again");
        StoreError::Damaged { path: self.path.clone(), what }
    }

    /// The names of all coefficients that any run's fit found.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn coefficient_names(&self) -> Result<Vec<String>, StoreError> {
        self.rows("SELECT DISTINCT name FROM coefficients ORDER BY name", [], |row| row.get(0))
    }
}

#[cfg(test)]
pub(super) mod tests;
