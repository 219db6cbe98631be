//! Server-sent events: a snapshot of each rig whenever it changes. One task makes the snapshots for all clients; a client that stalls
//! delays only itself, and then gets the newest snapshot and none in between.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures_util::stream::{self, Stream, StreamExt};
use serde::Serialize;
use tokio::sync::watch;

use super::{Api, Heartbeat};
use crate::state::RigState;
use store::Store;
use store::job::Job;

/// Time between two checks of a rig. Chosen.
const CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// An unchanged snapshot is sent again after this time; a client that gets none for twice as long must take the state as unknown. Chosen.
const RESEND_INTERVAL: Duration = Duration::from_secs(1);
/// A state is not sent if the daemon's loop has not run for this time \[s\]. Chosen.
const HEARTBEAT_AGE_LIMIT_S: f64 = 1.0;
/// Jobs in a snapshot at most. Chosen.
const SNAPSHOT_JOBS_MAX: usize = 20;

#[derive(Serialize)]
struct Snapshot<'a> {
    rig: &'a RigState,
    jobs: &'a [Job],
}

/// Makes snapshots of a rig from its database and its state, until there are no receivers.
pub(super) fn watch_rig(
    store: Store,
    mut state: watch::Receiver<RigState>,
    heartbeat: Arc<Heartbeat>,
) -> watch::Receiver<Arc<str>> {
    let (sender, receiver) = watch::channel(Arc::from(""));
    tokio::task::spawn_blocking(move || {
        let (mut last_version, mut at, mut jobs) = (None, Instant::now(), Vec::new());
        while !sender.is_closed() && state.has_changed().is_ok() {
            // the state is sent even if the database cannot be read
            let version = store.version().ok();
            let has_news = last_version != version || state.has_changed().unwrap_or(false);
            if (has_news || at.elapsed() >= RESEND_INTERVAL) && heartbeat.age_s() < HEARTBEAT_AGE_LIMIT_S {
                if let Ok(newest) = store.jobs(SNAPSHOT_JOBS_MAX) {
                    (last_version, jobs) = (version, newest);
                }
                at = Instant::now();
                let text = serde_json::to_string(&Snapshot { rig: &state.borrow_and_update(), jobs: &jobs });
                sender.send_replace(text.unwrap_or_default().into());
            }
            std::thread::sleep(CHECK_INTERVAL);
        }
    });
    receiver
}

/// Snapshots of all rigs, as server-sent events called `rig`: `{"rig": RigState, "jobs": [Job]}`, at once, whenever one changes, and once a
/// second at least: a snapshot older than two seconds says nothing about the present.
#[utoipa::path(get, path = "/api/v1/events", responses((status = 200, description = "Snapshots.", content_type = "text/event-stream", body = String)))]
pub(super) async fn events(
    State(api): State<Arc<Api>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    newest("rig", api.rigs.iter().map(|rig| rig.snapshot.clone()).collect())
}

/// The snapshots of all `receivers` as events called `name`, at once and whenever one changes; a slow client gets the newest.
pub(super) fn newest(
    name: &'static str,
    receivers: Vec<watch::Receiver<Arc<str>>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let each = receivers.into_iter().map(|mut receiver| {
        receiver.mark_changed();
        stream::unfold(receiver, async |mut receiver| {
            receiver.changed().await.ok()?;
            let newest = receiver.borrow_and_update().clone();
            Some((newest, receiver))
        })
        .boxed()
    });
    let snapshots = stream::select_all(each).filter(|snapshot| std::future::ready(!snapshot.is_empty()));
    let events = snapshots.map(move |snapshot| Ok(Event::default().event(name).data(&*snapshot)));
    Sse::new(events).keep_alive(KeepAlive::default())
}
