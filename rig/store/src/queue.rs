//! The queue: what is to be done, what is being done, and how it ended. Nothing leaves it.

use rusqlite::{OptionalExtension, Row, params};

use super::job::{Job, JobId, JobResult, Lane, NewJob, State};
use super::limits::{self, Limit};
use super::{Store, StoreError, now, text};
use record::run_id::RunId;

/// What layout 3 has added: the slot of a job that the schedule wants, and the key under which a job was asked for.
pub(super) const SLOTS_AND_KEYS: &str = "
    ALTER TABLE jobs ADD COLUMN slot TEXT;
    ALTER TABLE jobs ADD COLUMN key TEXT;
    ALTER TABLE jobs ADD COLUMN warnings TEXT;
    CREATE UNIQUE INDEX jobs_by_key ON jobs (key) WHERE key IS NOT NULL;
";

const COLUMNS: &str = "id, work, priority, state, cancel, why, retry_of, not_before, added, began, ended, pid, status, run, out, verdict, error, slot, warnings";

fn read(row: &Row<'_>) -> rusqlite::Result<Job> {
    let unreadable = |column, error: Box<dyn std::error::Error + Send + Sync>| {
        rusqlite::Error::FromSqlConversionFailure(column, rusqlite::types::Type::Text, error)
    };
    let work: String = row.get(1)?;
    let work = serde_json::from_str(&work).map_err(|error| unreadable(1, error.into()))?;
    let state: String = row.get(3)?;
    let state = State::ALL.iter().find(|(_, name)| *name == state).map(|(state, _)| *state);
    Ok(Job {
        id: JobId(row.get(0)?),
        work,
        priority: row.get(2)?,
        state: state.ok_or_else(|| unreadable(3, "not a job's state".into()))?,
        cancel: row.get(4)?,
        why: row.get(5)?,
        retry_of: row.get::<_, Option<i64>>(6)?.map(JobId),
        not_before: row.get(7)?,
        added: row.get(8)?,
        began: row.get(9)?,
        ended: row.get(10)?,
        pid: row.get(11)?,
        result: JobResult {
            status: row.get(12)?,
            run: row.get(13)?,
            out: row.get(14)?,
            verdict: row.get(15)?,
            error: row.get(16)?,
            warnings: match row.get::<_, Option<String>>(18)? {
                None => Vec::new(),
                Some(list) => serde_json::from_str(&list).map_err(|error| unreadable(18, error.into()))?,
            },
        },
        slot: row.get(17)?,
    })
}

impl Store {
    /// Adds a job that somebody asks for; it is on the disk when this returns.
    ///
    /// # Errors
    /// [`StoreError::Limit`] for too much, in it or in the queue, or as the database says.
    pub fn add(&mut self, job: &NewJob) -> Result<JobId, StoreError> {
        job.check()?;
        let waiting = self.waiting(Lane::Motion)?.saturating_add(self.waiting(Lane::Analysis)?);
        if waiting >= limits::WAITING_JOBS_MAX {
            return Err(Limit::Waiting(waiting).into());
        }
        self.add_unlimited(job)
    }

    /// Adds a job of the schedule, or one that follows from a job that has ended, without the limits of [`Self::add`].
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn add_unlimited(&mut self, job: &NewJob) -> Result<JobId, StoreError> {
        let work = serde_json::to_string(&job.work)
            .map_err(|error| StoreError::Damaged { path: self.path.clone(), what: error.to_string() })?;
        let (id, is_same) = self.change("adding a job to", |db| {
            let before = "SELECT id, work = ?2 FROM jobs WHERE key = ?1";
            let before = db.query_row(before, params![job.key, work], |row| Ok((row.get(0)?, row.get(1)?)));
            if let Some((id, is_same)) = before.optional()? {
                return Ok((JobId(id), is_same));
            }
            db.execute(
                "INSERT INTO jobs (lane, work, priority, state, why, retry_of, not_before, added, slot, key) \
                 VALUES (?1, ?2, ?3, 'queued', ?4, ?5, ?6, ?7, ?8, ?9)",
                params![
                    job.work.lane().name(),
                    work,
                    job.priority,
                    job.why,
                    job.retry_of.map(|id| id.0),
                    job.not_before.map(text),
                    now(),
                    job.slot.map(text),
                    job.key,
                ],
            )?;
            Ok((JobId(db.last_insert_rowid()), true))
        })?;
        if is_same { Ok(id) } else { Err(StoreError::SameKey(id)) }
    }

    /// Cancels all jobs that wait; gives how many.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn cancel_waiting(&mut self, why: &str) -> Result<usize, StoreError> {
        self.change("cancelling the jobs of", |db| {
            db.execute(
                "UPDATE jobs SET cancel = ?1, ended = ?2, state = 'cancelled' WHERE state = 'queued'",
                params![limits::cut(why), now()],
            )
        })
    }

    /// How many of the newest jobs that moved the rig and ended after `since`, UTC, were ended by hardware, one after the other.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn failures_in_a_row(&self, most: usize, since: &str) -> Result<usize, StoreError> {
        let query = "SELECT state = 'lost' OR status IS 'hardware-fault' FROM jobs \
                     WHERE lane = 'motion' AND state IN ('done', 'failed', 'lost') AND ended > ?2 \
                     ORDER BY ended DESC, id DESC LIMIT ?1";
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        let failed: Vec<bool> = self.rows(query, params![most, since], |row| row.get(0))?;
        Ok(failed.into_iter().take_while(|&failed| failed).count())
    }

    /// The job `id`.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], or as the database says.
    pub fn job(&self, id: JobId) -> Result<Job, StoreError> {
        let query = format!("SELECT {COLUMNS} FROM jobs WHERE id = ?1");
        let found = self.db.query_row(&query, [id.0], read).optional();
        found.map_err(self.failed("reading"))?.ok_or(StoreError::NoJob(id))
    }

    /// The newest `most` jobs, those that run and wait among them first, in the order of their turns.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn jobs(&self, most: usize) -> Result<Vec<Job>, StoreError> {
        let query = format!(
            "SELECT {COLUMNS} FROM jobs ORDER BY CASE state WHEN 'running' THEN 0 WHEN 'queued' THEN 1 ELSE 2 END, \
             CASE WHEN state IN ('running', 'queued') THEN -priority END, \
             CASE WHEN state IN ('running', 'queued') THEN id ELSE -id END LIMIT ?1"
        );
        self.rows(&query, [i64::try_from(most).unwrap_or(i64::MAX)], read)
    }

    /// The jobs that run, as the database has it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn running(&self) -> Result<Vec<Job>, StoreError> {
        let query = format!("SELECT {COLUMNS} FROM jobs WHERE state = 'running' ORDER BY id");
        self.rows(&query, [], read)
    }

    /// The runs that waiting or running jobs need.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn runs_wanted(&self) -> Result<Vec<RunId>, StoreError> {
        let query = format!("SELECT {COLUMNS} FROM jobs WHERE state IN ('queued', 'running')");
        let jobs = self.rows(&query, [], read)?;
        Ok(jobs.iter().flat_map(|job| job.work.runs()).cloned().collect())
    }

    /// How many jobs of `lane` wait.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn waiting(&self, lane: Lane) -> Result<u32, StoreError> {
        let query = "SELECT count(*) FROM jobs WHERE state = 'queued' AND lane = ?1";
        self.row(query, [lane.name()], |row| row.get(0))
    }

    /// How many jobs are over, by how they ended.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn jobs_by_state(&self) -> Result<Vec<(String, u32)>, StoreError> {
        let query =
            "SELECT state, count(*) FROM jobs WHERE state NOT IN ('queued', 'running') GROUP BY state";
        self.rows(query, [], |row| Ok((row.get(0)?, row.get(1)?)))
    }

    /// How many jobs `id` is the repetition of: itself repeats one, which repeats one, and so on.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn repeats(&self, id: JobId) -> Result<u32, StoreError> {
        let query = "WITH RECURSIVE chain (id) AS (\
             SELECT retry_of FROM jobs WHERE id = ?1 \
             UNION ALL SELECT jobs.retry_of FROM jobs JOIN chain ON jobs.id = chain.id) \
             SELECT count(id) FROM chain";
        self.row(query, [id.0], |row| row.get(0))
    }

    /// The first of the jobs that `id` is the repetition of; itself where it repeats none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn origin(&self, id: JobId) -> Result<JobId, StoreError> {
        let query = "WITH RECURSIVE chain (id) AS (\
             SELECT ?1 UNION ALL SELECT jobs.retry_of FROM jobs JOIN chain ON jobs.id = chain.id) \
             SELECT min(id) FROM chain";
        self.row(query, [id.0], |row| row.get(0).map(JobId))
    }

    /// Takes the job of `lane` whose turn it is: it counts as running from now on.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn take(&mut self, lane: Lane) -> Result<Option<Job>, StoreError> {
        let query = format!(
            "UPDATE jobs SET state = 'running', began = ?2 WHERE id = (\
             SELECT id FROM jobs WHERE state = 'queued' AND lane = ?1 AND (not_before IS NULL OR not_before <= ?2) \
             ORDER BY priority DESC, id LIMIT 1) RETURNING {COLUMNS}"
        );
        self.change("taking a job of", |db| {
            db.query_row(&query, params![lane.name(), now()], read).optional()
        })
    }

    /// Records the process that does the job.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn began(&mut self, id: JobId, pid: u32) -> Result<(), StoreError> {
        self.change("writing a job of", |db| {
            db.execute("UPDATE jobs SET pid = ?2 WHERE id = ?1", params![id.0, pid])
        })?;
        Ok(())
    }

    /// Records that a running job has ended.
    ///
    /// # Errors
    /// [`StoreError::Database`]; [`StoreError::Over`] where it had ended before, which stays as it is.
    pub fn end(&mut self, id: JobId, state: State, result: &JobResult) -> Result<(), StoreError> {
        let warnings = (!result.warnings.is_empty()).then(|| serde_json::json!(result.warnings).to_string());
        let changed = self.change("ending a job of", |db| {
            db.execute(
                "UPDATE jobs SET state = ?2, ended = ?3, status = ?4, run = ?5, out = ?6, verdict = ?7, error = ?8, \
                 warnings = ?9 WHERE id = ?1 AND state = 'running'",
                params![
                    id.0,
                    state.name(),
                    now(),
                    result.status,
                    result.run,
                    result.out,
                    result.verdict,
                    result.error,
                    warnings
                ],
            )
        })?;
        match changed {
            0 => Err(StoreError::Over { id, state: self.job(id)?.state }),
            _ => Ok(()),
        }
    }

    /// Puts a running job of which nothing was begun back into the queue.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn put_back(&mut self, id: JobId) -> Result<(), StoreError> {
        self.change("writing a job of", |db| {
            db.execute(
                "UPDATE jobs SET state = 'queued', began = NULL, pid = NULL WHERE id = ?1 AND state = 'running'",
                [id.0],
            )
        })?;
        Ok(())
    }

    /// Cancels a job, for a reason, which is cut where it is too long: one that waits at once, one that runs when whoever does it has stopped it. Gives where it
    /// stands then.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::Over`], or as the database says.
    pub fn cancel(&mut self, id: JobId, why: &str) -> Result<State, StoreError> {
        let changed = self.change("cancelling a job of", |db| {
            db.execute(
                "UPDATE jobs SET cancel = ?2, \
                 ended = CASE state WHEN 'queued' THEN ?3 END, \
                 state = CASE state WHEN 'queued' THEN 'cancelled' ELSE state END \
                 WHERE id = ?1 AND state IN ('queued', 'running')",
                params![id.0, limits::cut(why), now()],
            )
        })?;
        let state = self.job(id)?.state;
        if changed == 0 { Err(StoreError::Over { id, state }) } else { Ok(state) }
    }

    /// Adds a job that does again what `id` should have done, for a reason.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::NotOver`], [`StoreError::Limit`], or as the database says.
    pub fn retry(&mut self, id: JobId, why: Option<String>) -> Result<JobId, StoreError> {
        let job = self.job(id)?;
        if !job.state.is_over() {
            return Err(StoreError::NotOver { id, state: job.state });
        }
        if job.state == State::Done && job.work.lane() == Lane::Motion {
            return Err(StoreError::Done(id));
        }
        self.add(&NewJob { priority: job.priority, why, retry_of: Some(id), ..NewJob::new(job.work) })
    }
}

#[cfg(test)]
mod tests {
    use jiff::Timestamp;

    use super::super::job::{Chosen, Work};
    use super::*;
    use record::run_id::RunId;

    fn run_job(priority: i32) -> NewJob {
        NewJob { priority, ..NewJob::new(Work::Run { config: "rig.toml".into(), film_only: false }) }
    }

    fn fit_job() -> NewJob {
        let run = RunId::try_from("20261120T101503Z-ab12cd".to_owned()).unwrap();
        NewJob::new(Work::Fit(Chosen { runs: vec![run], holdout: Vec::new() }))
    }

    #[test]
    fn jobs_come_by_priority_then_age_each_in_its_lane() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let ids: Vec<JobId> = [run_job(0), fit_job(), run_job(5), run_job(0)]
            .iter()
            .map(|job| store.add(job).unwrap())
            .collect();
        let mut taken = || store.take(Lane::Motion).unwrap().map(|job| job.id);
        assert_eq!([taken(), taken(), taken(), taken()], [Some(ids[2]), Some(ids[0]), Some(ids[3]), None]);
        let fit = store.take(Lane::Analysis).unwrap().unwrap();
        assert_eq!((fit.id, &fit.work), (ids[1], &fit_job().work));
        assert_eq!(store.running().unwrap().len(), 4);
    }

    #[test]
    fn job_waits_for_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let in_an_hour = Timestamp::now() + jiff::SignedDuration::from_hours(1);
        store.add(&NewJob { not_before: Some(in_an_hour), ..run_job(9) }).unwrap();
        assert_eq!(store.take(Lane::Motion).unwrap(), None);
        let past = Timestamp::now() - jiff::SignedDuration::from_secs(1);
        let due = store.add(&NewJob { not_before: Some(past), ..run_job(0) }).unwrap();
        assert_eq!(store.take(Lane::Motion).unwrap().map(|job| job.id), Some(due));
    }

    #[test]
    fn cancelled_while_waiting_is_over_and_while_running_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let (first, second) = (store.add(&run_job(0)).unwrap(), store.add(&run_job(0)).unwrap());
        store.take(Lane::Motion).unwrap();
        assert_eq!(store.cancel(second, "not wanted").unwrap(), State::Cancelled);
        assert_eq!(store.cancel(first, "water on the floor").unwrap(), State::Running);
        assert_eq!(store.job(first).unwrap().cancel.as_deref(), Some("water on the floor"));
        assert!(matches!(store.cancel(second, ""), Err(StoreError::Over { .. })));
        assert!(matches!(store.cancel(JobId(99), ""), Err(StoreError::NoJob(JobId(99)))));
        assert!(matches!(store.retry(first, None), Err(StoreError::NotOver { .. })));
        store.end(first, State::Cancelled, &JobResult::default()).unwrap();
        let again = store.retry(first, Some("dry again".into())).unwrap();
        assert_eq!(store.job(again).unwrap().retry_of, Some(first));
        assert_eq!([first, again].map(|id| store.repeats(id).unwrap()), [0, 1]);
        assert_eq!([first, again].map(|id| store.origin(id).unwrap()), [first, first]);
    }

    #[test]
    fn reasons_lists_and_the_queue_itself_have_bounds_and_what_follows_has_room() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let with_why = |count: usize| NewJob { why: Some("é".repeat(count)), ..run_job(0) };
        let first = store.add(&with_why(200)).unwrap();
        let refusal = |result: Result<JobId, StoreError>| match result {
            Err(error @ StoreError::Limit(_)) => error.to_string(),
            other => panic!("{other:?}"),
        };
        assert!(refusal(store.add(&with_why(201))).contains("201 characters, 200 are the most"));
        let Work::Fit(one) = fit_job().work else { unreachable!() };
        let runs = Chosen { runs: vec![one.runs[0].clone(); 1001], holdout: Vec::new() };
        assert!(refusal(store.add(&NewJob::new(Work::Diagnose(runs)))).contains("1001 runs in one job"));
        for max_runs in [0, 1001, usize::MAX] {
            let work = Work::Campaign { config: "rig.toml".into(), goals: Vec::new(), max_runs };
            assert!(refusal(store.add(&NewJob::new(work))).contains(&format!("`max_runs` = {max_runs} ")));
        }
        // as a thousand calls would: the disk is waited for once
        store
            .change("filling", |db| {
                let many = "WITH RECURSIVE n (i) AS (SELECT 2 UNION ALL SELECT i + 1 FROM n WHERE i < 1000) INSERT INTO jobs \
                            (lane, work, priority, state, added) SELECT lane, work, 0, 'queued', added FROM jobs, n";
                db.execute(many, [])
            })
            .unwrap();
        assert!(refusal(store.add(&fit_job())).contains("1000 jobs wait, 1000 are the most: cancel some"));
        store.add_unlimited(&fit_job()).unwrap();
        assert!(refusal(store.add(&fit_job())).contains("1001 jobs wait"));
        store.cancel(first, &"é".repeat(20_000)).unwrap();
        let why = store.job(first).unwrap().cancel.unwrap();
        assert!(
            why.starts_with(&"é".repeat(200)) && why.ends_with("é ... (20000 characters)"),
            "no end is refused for its words"
        );
        let done = store.take(Lane::Analysis).unwrap().unwrap().id;
        store.end(done, State::Failed, &JobResult::default()).unwrap();
        store.add(&fit_job()).unwrap();
        assert!(refusal(store.retry(done, None)).contains("1000 jobs wait"), "a retry too");
    }

    #[test]
    fn request_that_comes_again_under_its_key_is_one_job() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let keyed = |job: NewJob| NewJob { key: Some("a-b-c".into()), ..job };
        let first = store.add(&keyed(run_job(0))).unwrap();
        assert_eq!(store.add(&keyed(run_job(0))).unwrap(), first);
        assert!(matches!(store.add(&keyed(fit_job())), Err(StoreError::SameKey(id)) if id == first));
        assert_ne!(store.add(&run_job(0)).unwrap(), first);
        assert_eq!(store.waiting(Lane::Motion).unwrap(), 2);
    }

    #[test]
    fn all_that_waits_is_cancelled_at_once_and_a_motion_that_is_done_is_not_repeated() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let first = store.add(&run_job(0)).unwrap();
        store.take(Lane::Motion).unwrap();
        for job in [run_job(0), fit_job()] {
            store.add(&job).unwrap();
        }
        assert_eq!(store.cancel_waiting("enough").unwrap(), 2);
        assert_eq!(store.job(first).unwrap().state, State::Running);
        store.end(first, State::Done, &JobResult::default()).unwrap();
        assert!(matches!(store.retry(first, None), Err(StoreError::Done(_))));
    }

    #[test]
    fn failures_of_hardware_are_counted_until_the_last_run_that_was_none() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let mut ended = |state, status: &str| {
            store.add(&run_job(0)).unwrap();
            let id = store.take(Lane::Motion).unwrap().unwrap().id;
            let result = JobResult { status: Some(status.into()), ..JobResult::default() };
            store.end(id, state, &result).unwrap();
            store.failures_in_a_row(9, "").unwrap()
        };
        assert_eq!(ended(State::Failed, "hardware-fault"), 1);
        assert_eq!(ended(State::Done, "done"), 0);
        assert_eq!(ended(State::Failed, "hardware-fault"), 1);
        assert_eq!(ended(State::Cancelled, "interrupted"), 1, "a person's doing is neither");
        assert_eq!(ended(State::Lost, ""), 2);
        assert_eq!(ended(State::Failed, "input-error"), 0);
        assert_eq!(ended(State::Lost, ""), 1);
        assert_eq!(store.failures_in_a_row(9, "9999").unwrap(), 0, "what was before a release");
    }

    #[test]
    fn what_was_answered_is_there_when_the_database_is_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let id = store.add(&run_job(3)).unwrap();
        let mut other = Store::open(folder.path()).unwrap();
        let version = other.version().unwrap();
        store.take(Lane::Motion).unwrap();
        store.began(id, 4711).unwrap();
        assert_ne!(other.version().unwrap(), version, "another process sees that something changed");
        assert_eq!(other.job(id).unwrap().pid, Some(4711));
        let result = JobResult { run: Some("20261120T101503Z-ab12cd".into()), ..JobResult::default() };
        other.end(id, State::Done, &result).unwrap();
        assert!(matches!(other.end(id, State::Lost, &result), Err(StoreError::Over { .. })));
        drop((store, other));
        let job = Store::open(folder.path()).unwrap().job(id).unwrap();
        assert_eq!((job.state, job.result), (State::Done, result));
    }

    #[test]
    fn newer_layout_is_refused_by_name_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        store.db.pragma_update(None, "user_version", 99).unwrap();
        drop(store);
        let error = Store::open(folder.path()).unwrap_err();
        assert!(error.is_input() && error.to_string().contains("layout 99"), "{error}");
    }
}
