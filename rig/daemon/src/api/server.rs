//! The server's connections: so many and no more, each with its time for a request. When there are too many the one goes that has waited
//! longest, those that have never shown the token first: whoever has it, and wants to stop the rig, always finds room.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::net::TcpListener;
use tokio::sync::Notify;
use tower_service::Service as _;

/// Connections at a time.
const MOST_CONNECTIONS: usize = 256;
/// A request's head takes no longer.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// After a connection could not be taken.
const PAUSE: Duration = Duration::from_millis(10);

/// A connection, for whoever answers what is asked on it.
#[derive(Debug, Default)]
pub(super) struct Connection {
    has_token: AtomicBool,
    let_go: Notify,
}

impl Connection {
    /// Whoever asks has shown the token.
    pub(super) fn shows_token(&self) {
        self.has_token.store(true, Ordering::Relaxed);
    }
}

#[derive(Debug, Default)]
struct Connections(Mutex<VecDeque<Arc<Connection>>>);

impl Connections {
    fn all(&self) -> MutexGuard<'_, VecDeque<Arc<Connection>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes one more, in place of another where there are enough.
    fn take(&self) -> Arc<Connection> {
        if self.all().len() >= MOST_CONNECTIONS {
            self.let_one_go();
        }
        let connection = Arc::new(Connection::default());
        self.all().push_back(Arc::clone(&connection));
        connection
    }

    fn let_one_go(&self) {
        let mut all = self.all();
        let stranger = all.iter().position(|connection| !connection.has_token.load(Ordering::Relaxed));
        if let Some(connection) = all.remove(stranger.unwrap_or(0)) {
            connection.let_go.notify_one();
        }
    }

    fn forget(&self, over: &Arc<Connection>) {
        self.all().retain(|connection| !Arc::ptr_eq(connection, over));
    }
}

/// Serves `router` to whoever comes to `listener`, until it is dropped.
pub(super) async fn serve(listener: TcpListener, router: Router) -> io::Result<()> {
    allow_descriptors();
    let connections = Arc::new(Connections::default());
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // no descriptor is left for it: there is one when another has gone
            connections.let_one_go();
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        // an answer of a few bytes is not held back
        let _ = stream.set_nodelay(true);
        let connection = connections.take();
        let (router, connections) = (router.clone(), Arc::clone(&connections));
        tokio::spawn(async move {
            let on = Arc::clone(&connection);
            let answer = service_fn(move |mut request: Request<Incoming>| {
                request.extensions_mut().insert(Arc::clone(&on));
                router.clone().call(request)
            });
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIMEOUT);
            tokio::select! {
                // how a connection ends is its client's business
                _ = http.serve_connection(TokioIo::new(stream), answer) => {}
                () = connection.let_go.notified() => {}
            }
            connections.forget(&connection);
        });
    }
}

/// As many open files as the system allows: half of the usual 1024 may be connections.
fn allow_descriptors() {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    // where it cannot be, connections are let go the sooner
    let _ = setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strangers_go_first_and_whoever_waited_longest_of_them() {
        let connections = Connections::default();
        let first = connections.take();
        first.shows_token();
        let second = connections.take();
        for _ in 2..MOST_CONNECTIONS {
            connections.take();
        }
        let newest = connections.take();
        let all = connections.all().clone();
        let there = |wanted: &Arc<Connection>| all.iter().any(|one| Arc::ptr_eq(one, wanted));
        assert_eq!(
            (all.len(), there(&first), there(&second), there(&newest)),
            (MOST_CONNECTIONS, true, false, true)
        );
    }
}
