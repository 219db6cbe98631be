//! Alerts: stored in the database, and delivered to the places that `[alerts]` names, one at a time on a thread of its own. A failed
//! delivery is tried again after increasing delays, also by a daemon that is restarted.

use std::io::{Read as _, Write as _};
use std::process::{Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};
use serde_json::json;

use super::webhook;
use config::AlertsConfig;
use store::alerts::Delivery;
use store::job::JobId;
use store::{Store, StoreError};

/// An alert program that runs longer is killed and tried again. Chosen.
const DELIVERY_TIMEOUT: Duration = Duration::from_secs(30);
/// Delay before the second try; each further delay is three times as long, up to [`MAX_RETRY_DELAY`]. Chosen.
const FIRST_RETRY_DELAY: SignedDuration = SignedDuration::from_secs(10);
const MAX_RETRY_DELAY: SignedDuration = SignedDuration::from_hours(1);
/// Tries at most, over about a week. Chosen.
const MAX_TRIES: u32 = 170;

/// Raises the alerts of one rig and delivers them.
#[derive(Debug)]
pub(super) struct Alerts {
    rig: String,
    config: AlertsConfig,
    under_way: Option<(Delivery, JoinHandle<Result<(), String>>)>,
}

impl Alerts {
    /// Those of the rig called `rig`.
    pub(super) fn new(rig: String, config: Option<AlertsConfig>) -> Self {
        Self { rig, config: config.unwrap_or_default(), under_way: None }
    }

    /// Raises an alert.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(super) fn raise(
        &self,
        store: &mut Store,
        kind: &str,
        what: &str,
        job: Option<JobId>,
    ) -> Result<(), StoreError> {
        store.raise(kind, what, job, &self.config.places())
    }

    /// Goes on with the deliveries.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(super) fn tick(&mut self, store: &mut Store) -> Result<(), StoreError> {
        if let Some((delivery, thread)) = self.under_way.take_if(|(_, thread)| thread.is_finished()) {
            let delivered = thread.join().unwrap_or_else(|_| Err("its delivery panicked".into()));
            let trouble = delivered.err();
            if let Some(trouble) = &trouble {
                tracing::warn!(
                    "alert {} could not be delivered to the {}: {trouble}",
                    delivery.alert.id,
                    delivery.place
                );
            }
            let next = next_try(delivery.tries + 1, Timestamp::now());
            store.delivered(&delivery, trouble.as_deref().map(|trouble| (trouble, next)))?;
        }
        Ok(())
    }

    /// Begins the next delivery, if its time has come.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(super) fn begin(&mut self, store: &mut Store) -> Result<(), StoreError> {
        if self.under_way.is_some() {
            return Ok(());
        }
        let Some(delivery) = store.due()? else { return Ok(()) };
        let message = self.message(&delivery);
        let thread = std::thread::Builder::new().name("alert".into());
        let thread = match (self.config.command.split_first(), &self.config.webhook) {
            (Some((program, arguments)), _) if delivery.place == AlertsConfig::COMMAND => {
                let mut command = Command::new(program);
                command.args(arguments);
                command.env("RIG_ALERT", &delivery.alert.kind).env("RIG_ALERT_TEXT", &delivery.alert.text);
                thread.spawn(move || run_program(command, &message))
            }
            (_, Some(hook)) if delivery.place == AlertsConfig::WEBHOOK => {
                let hook = hook.clone();
                thread.spawn(move || webhook::post(&hook, &message))
            }
            // the config has changed since
            _ => return store.delivered(&delivery, Some(("[alerts] no longer names it", None))),
        };
        match thread {
            Ok(thread) => self.under_way = Some((delivery, thread)),
            Err(error) => {
                let next = next_try(delivery.tries + 1, Timestamp::now());
                store.delivered(&delivery, Some((&error.to_string(), next)))?;
            }
        }
        Ok(())
    }

    fn message(&self, Delivery { alert, .. }: &Delivery) -> String {
        let mut message =
            json!({ "rig": self.rig, "text": alert.text, "kind": alert.kind, "raised": alert.raised });
        if let Some(job) = alert.job {
            message["job"] = job.into();
        }
        message.to_string()
    }
}

/// When to try again after so many tries; not at all after too many.
fn next_try(tries: u32, now: Timestamp) -> Option<Timestamp> {
    let longer = 3_i32.saturating_pow(tries.saturating_sub(1));
    let wait = FIRST_RETRY_DELAY.checked_mul(longer).unwrap_or(MAX_RETRY_DELAY).min(MAX_RETRY_DELAY);
    (tries < MAX_TRIES).then(|| now.saturating_add(wait).ok()).flatten()
}

/// Runs `command` with `input` to its end.
fn run_program(mut command: Command, input: &str) -> Result<(), String> {
    let program = command.get_program().to_string_lossy().into_owned();
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|error| format!("starting {program}: {error}"))?;
    if let Some(mut stdin) = child.stdin.take() {
        // a program need not read its input
        let _ = stdin.write_all(input.as_bytes());
    }
    let began = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if began.elapsed() > DELIVERY_TIMEOUT => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("{program} did not end within {} s", DELIVERY_TIMEOUT.as_secs()));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(20)),
            Err(error) => return Err(format!("waiting for {program}: {error}")),
        }
    };
    if status.success() {
        return Ok(());
    }
    let mut said = String::new();
    if let Some(stderr) = child.stderr.take() {
        let _ = stderr.take(1000).read_to_string(&mut said);
    }
    Err(format!("{program}: {status} {}", said.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tries_are_further_and_further_apart_for_about_a_week() {
        let start = Timestamp::UNIX_EPOCH;
        let wait = |tries| next_try(tries, start).map(|next| next.as_second());
        assert_eq!([wait(1), wait(2), wait(3), wait(9)], [Some(10), Some(30), Some(90), Some(3600)]);
        let all: i64 = (1..MAX_TRIES).filter_map(wait).sum();
        assert!((6 * 86_400..8 * 86_400).contains(&all), "{all} s");
        assert_eq!(wait(MAX_TRIES), None);
    }

    #[test]
    fn a_command_is_heard_to_its_end_and_says_what_is_wrong() {
        let shell = |script: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            command
        };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("said");
        run_program(shell(&format!("cat > {}", file.display())), "{}").unwrap();
        assert_eq!(std::fs::read_to_string(file).unwrap(), "{}");
        let said = run_program(shell("echo no line >&2; exit 3"), "").unwrap_err();
        assert!(said.contains("no line") && said.contains('3'), "{said}");
        assert!(run_program(Command::new("/no/such/program"), "").unwrap_err().contains("/no/such/program"));
    }
}
