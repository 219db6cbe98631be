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

/// Connections at a time at most. Chosen.
const MAX_CONNECTIONS: usize = 256;
/// Time limit for a request's head. Chosen.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause after a connection could not be accepted. Chosen.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(10);

/// A connection, for whoever answers what is asked on it.
#[derive(Debug, Default)]
pub(super) struct Connection {
    has_token: AtomicBool,
    close: Notify,
}

impl Connection {
    /// Marks that the client has shown the token.
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

    /// Adds a connection; closes another one if there are too many.
    fn take(&self) -> Arc<Connection> {
        if self.all().len() >= MAX_CONNECTIONS {
            self.close_one();
        }
        let connection = Arc::new(Connection::default());
        self.all().push_back(Arc::clone(&connection));
        connection
    }

    fn close_one(&self) {
        let mut all = self.all();
        let stranger = all.iter().position(|connection| !connection.has_token.load(Ordering::Relaxed));
        if let Some(connection) = all.remove(stranger.unwrap_or(0)) {
            connection.close.notify_one();
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
            // no file descriptor is left: closing a connection frees one
            connections.close_one();
            tokio::time::sleep(ACCEPT_RETRY_DELAY).await;
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
                () = connection.close.notified() => {}
            }
            connections.forget(&connection);
        });
    }
}

/// As many open files as the system allows: half of the usual 1024 may be connections.
fn allow_descriptors() {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    // if the limit cannot be raised, connections are closed sooner
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
        for _ in 2..MAX_CONNECTIONS {
            connections.take();
        }
        let newest = connections.take();
        let all = connections.all().clone();
        let there = |wanted: &Arc<Connection>| all.iter().any(|one| Arc::ptr_eq(one, wanted));
        assert_eq!(
            (all.len(), there(&first), there(&second), there(&newest)),
            (MAX_CONNECTIONS, true, false, true)
        );
    }
}
