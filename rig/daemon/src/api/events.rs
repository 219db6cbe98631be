//! What happens, as server-sent events: a snapshot of each rig whenever it changes. One task looks for all who listen; a listener
//! that stalls holds up itself only, and then gets the newest snapshot and none in between.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures_util::stream::{self, Stream, StreamExt};
use serde::Serialize;
use tokio::sync::watch;

use super::{Api, Beat};
use crate::state::RigState;
use store::Store;
use store::job::Job;

/// Between two looks at a rig.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// A snapshot is told again although nothing has changed: who hears nothing for twice as long knows nothing.
const TELL_EVERY: Duration = Duration::from_secs(1);
/// What the loop that looks after the rigs has not seen for so long is not told \[s\].
const LATEST_S: f64 = 1.0;
/// Jobs in a snapshot.
const MOST_JOBS: usize = 20;

#[derive(Serialize)]
struct Snapshot<'a> {
    rig: &'a RigState,
    jobs: &'a [Job],
}

/// Watches a rig through its database and its state, until nobody wants to know.
pub(super) fn watch_rig(
    store: Store,
    mut state: watch::Receiver<RigState>,
    beat: Arc<Beat>,
) -> watch::Receiver<Arc<str>> {
    let (tell, told) = watch::channel(Arc::from(""));
    tokio::task::spawn_blocking(move || {
        let (mut seen, mut at, mut jobs) = (None, Instant::now(), Vec::new());
        while !tell.is_closed() && state.has_changed().is_ok() {
            // what the rig does is told although its database is not to be read
            let version = store.version().ok();
            let has_news = seen != version || state.has_changed().unwrap_or(false);
            if (has_news || at.elapsed() >= TELL_EVERY) && beat.age_s() < LATEST_S {
                if let Ok(newest) = store.jobs(MOST_JOBS) {
                    (seen, jobs) = (version, newest);
                }
                at = Instant::now();
                let text = serde_json::to_string(&Snapshot { rig: &state.borrow_and_update(), jobs: &jobs });
                tell.send_replace(text.unwrap_or_default().into());
            }
            std::thread::sleep(LOOK_EVERY);
        }
    });
    told
}

/// Snapshots of all rigs, as server-sent events called `rig`: `{"rig": RigState, "jobs": [Job]}`, at once, whenever one changes, and once a
/// second at least: what was told more than two seconds ago says nothing of now.
#[utoipa::path(get, path = "/api/v1/events", responses((status = 200, description = "Snapshots.", content_type = "text/event-stream", body = String)))]
pub(super) async fn events(
    State(api): State<Arc<Api>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    newest("rig", api.rigs.iter().map(|rig| rig.snapshot.clone()).collect())
}

/// What is told by any of `told`, at once and whenever it changes, as events called `name`; who reads too slowly gets the newest.
pub(super) fn newest(
    name: &'static str,
    told: Vec<watch::Receiver<Arc<str>>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let each = told.into_iter().map(|mut told| {
        told.mark_changed();
        stream::unfold(told, async |mut told| {
            told.changed().await.ok()?;
            let newest = told.borrow_and_update().clone();
            Some((newest, told))
        })
        .boxed()
    });
    let snapshots = stream::select_all(each).filter(|snapshot| std::future::ready(!snapshot.is_empty()));
    let events = snapshots.map(move |snapshot| Ok(Event::default().event(name).data(&*snapshot)));
    Sse::new(events).keep_alive(KeepAlive::default())
}
