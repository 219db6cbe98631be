//! The live view of a rig's jobs, passed on from their sockets to the clients; without a client no socket is connected and nothing is
//! drawn. One task for each lane reads for all clients; a client that stalls misses snapshots, and delays only itself.

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

/// Time after which a job without an open socket is tried again. Chosen.
const RETRY_INTERVAL: Duration = Duration::from_millis(250);
/// Size of the read buffer \[bytes\]. Chosen.
const READ_BYTES: usize = 64 << 10;

/// The live view of the jobs of one lane.
pub(super) struct LiveView {
    newest: watch::Sender<Arc<str>>,
    /// Notified when a client subscribes.
    wanted: Notify,
}

impl LiveView {
    /// The live view of the rig's jobs in `lane`, whose folders are in `runs_dir`.
    pub(super) fn watch(runs_dir: &Path, lane: Lane, state: watch::Receiver<RigState>) -> Arc<Self> {
        let shown = Arc::new(Self { newest: watch::channel(Arc::from("")).0, wanted: Notify::new() });
        tokio::spawn(Arc::clone(&shown).pass_on(runs_dir.into(), lane, state));
        shown
    }

    /// Subscribes to the snapshots from now on, and to the last one.
    fn listen(&self) -> watch::Receiver<Arc<str>> {
        let newest = self.newest.subscribe();
        self.wanted.notify_one();
        newest
    }

    /// Passes snapshots on until the daemon ends.
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
            // the socket in the job's folder itself, not one that a link leads to
            let socket = running.and_then(|id| hand_in::socket(&runs_dir, JobId(id)).ok());
            if let Some(socket) = socket
                && let Ok(stream) = UnixStream::connect(below::through(&socket)).await
            {
                tokio::select! {
                    () = self.read(&stream) => {}
                    () = self.newest.closed() => continue,
                }
            }
            // its socket is not open yet, or it has none, or it has ended
            tokio::time::sleep(RETRY_INTERVAL).await;
        }
    }

    /// Reads snapshots until the job closes the connection.
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

/// The live view of the rig's running jobs, as server-sent events called `live`: a `Snapshot`, at once and up to five times a
/// second. A picture is left out where it is still the one before, and comes again after two seconds.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/live", params(("rig" = String, Path)), responses((status = 200, description = "Snapshots.", content_type = "text/event-stream", body = String)))]
pub(super) async fn live(
    State(api): State<Arc<Api>>,
    InPath(rig): InRig,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let rig = api.rig(&rig)?;
    Ok(newest("live", rig.shown.iter().map(|shown| shown.listen()).collect()))
}
