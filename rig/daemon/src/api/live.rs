//! What the jobs of a rig show while they go on, passed on from their sockets to whoever looks: while nobody does, nobody is connected
//! and nothing is drawn. One task for each lane reads for all; a listener that stalls misses snapshots, and holds up itself only.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path as InPath, State};
use axum::response::Sse;
use axum::response::sse::Event;
use futures_util::Stream;
use tokio::net::UnixStream;
use tokio::sync::{Notify, watch};

use super::events::newest;
use super::{Api, InRig, Problem};
use crate::state::RigState;
use analysis::showing::lines::Lines;
use app::hand_in;
use record::below;
use store::job::{JobId, Lane};

/// A job that does not listen, or has hung up, is tried again after so long.
const TRY_EVERY: Duration = Duration::from_millis(250);
/// What is read at once.
const READ_BYTES: usize = 64 << 10;

/// What the jobs of one lane show.
pub(super) struct Shown {
    newest: watch::Sender<Arc<str>>,
    /// Somebody has come to look.
    wanted: Notify,
}

impl Shown {
    /// What the rig's jobs in `lane` show, whose folders are in `runs_dir`.
    pub(super) fn watch(runs_dir: &Path, lane: Lane, state: watch::Receiver<RigState>) -> Arc<Self> {
        let shown = Arc::new(Self { newest: watch::channel(Arc::from("")).0, wanted: Notify::new() });
        tokio::spawn(Arc::clone(&shown).pass_on(runs_dir.into(), lane, state));
        shown
    }

    /// Snapshots from now on, and the last one there was.
    fn listen(&self) -> watch::Receiver<Arc<str>> {
        let newest = self.newest.subscribe();
        self.wanted.notify_one();
        newest
    }

    /// Until the daemon ends.
    async fn pass_on(self: Arc<Self>, runs_dir: PathBuf, lane: Lane, mut state: watch::Receiver<RigState>) {
        let job = |state: &RigState| match lane {
            Lane::Motion => state.motion,
            Lane::Analysis => state.analysis,
        };
        loop {
            while self.newest.receiver_count() == 0 {
                self.wanted.notified().await;
            }
            let Ok(running) = state.wait_for(|state| job(state).is_some()).await.map(|state| job(&state))
            else {
                return;
            };
            // the job's own, and none that a link in its folder leads to
            let socket = running.and_then(|id| hand_in::socket(&runs_dir, JobId(id)).ok());
            if let Some(socket) = socket
                && let Ok(stream) = UnixStream::connect(below::through(&socket)).await
            {
                tokio::select! {
                    () = self.read(&stream) => {}
                    () = self.newest.closed() => continue,
                }
            }
            // it has not begun to show yet, shows nothing, or has ended
            tokio::time::sleep(TRY_EVERY).await;
        }
    }

    /// Until the job hangs up.
    async fn read(&self, stream: &UnixStream) {
        let (mut lines, mut piece) = (Lines::default(), vec![0; READ_BYTES]);
        while stream.readable().await.is_ok() {
            match stream.try_read(&mut piece) {
                Ok(0) => return,
                Ok(count) => match lines.newest(&piece[..count]) {
                    // an event cannot hold a carriage return, and no snapshot does
                    Ok(Some(line)) if !line.contains('\r') => {
                        self.newest.send_replace(line.into());
                    }
                    Ok(_) => {}
                    Err(error) => return tracing::warn!("a job shows {error}"),
                },
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                Err(_) => return,
            }
        }
    }
}

/// What the rig's jobs show while they go on, as server-sent events called `live`: a `Snapshot`, at once and up to five times a
/// second. A picture is left out where it is still the one before, and comes again after two seconds.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/live", params(("rig" = String, Path)), responses((status = 200, description = "Snapshots.", content_type = "text/event-stream", body = String)))]
pub(super) async fn live(
    State(api): State<Arc<Api>>,
    InPath(rig): InRig,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let rig = api.rig(&rig)?;
    Ok(newest("live", rig.shown.iter().map(|shown| shown.listen()).collect()))
}
