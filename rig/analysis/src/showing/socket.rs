//! The thread that sends snapshots, and the clients connected to it.

use std::io::{ErrorKind, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError};
use std::thread::Thread;
use std::time::{Duration, Instant};

use super::state::State;
use super::{FINAL_SNAPSHOT_TIMEOUT, Message, Slots};
use ground::urgency::Urgency;

/// Time between two snapshots: five pictures a second. Chosen.
const SNAPSHOT_INTERVAL: Duration = Duration::from_millis(200);
/// Where nothing has changed, the whole snapshot is sent again after this time, for clients that missed one. Chosen.
const RESEND_INTERVAL: Duration = Duration::from_secs(2);
/// Clients at most; the socket is meant for the daemon alone. Chosen.
const MAX_CLIENTS: usize = 4;

/// Starts the thread that sends snapshots made of `messages` and `slots` on a socket at `path`.
///
/// # Errors
/// What the system says, for instance of a path of more than 107 bytes.
pub(super) fn start(
    path: &Path,
    job: i64,
    messages: Receiver<Message>,
    slots: Arc<Slots>,
) -> std::io::Result<Thread> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let listener = UnixListener::bind(path)?;
    listener.set_nonblocking(true)?;
    let path = path.to_owned();
    let server = Server { listener, messages, slots, state: State::new(job), clients: Vec::new() };
    let thread = std::thread::Builder::new().name("showing".into()).spawn(move || {
        Urgency::Computing.take();
        let end_request = server.serve();
        // a socket file without a server would only mislead
        let _ = std::fs::remove_file(path);
        if let Some(end_request) = end_request {
            let _ = end_request.try_send(());
        }
    })?;
    Ok(thread.thread().clone())
}

struct Server {
    listener: UnixListener,
    messages: Receiver<Message>,
    slots: Arc<Slots>,
    state: State,
    clients: Vec<Client>,
}

impl Server {
    /// Sends snapshots until the end is requested or all senders are gone; returns where to acknowledge a requested end.
    fn serve(mut self) -> Option<SyncSender<()>> {
        let mut sent_at: Option<Instant> = None;
        loop {
            let (mut changed, mut over) = (false, None);
            loop {
                match self.messages.try_recv() {
                    Ok(Message::End(end_request)) => over = Some(Some(end_request)),
                    Ok(message) => {
                        self.state.apply(message);
                        changed = true;
                    }
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => {
                        over = over.or(Some(None));
                        break;
                    }
                }
            }
            changed |= self.state.poll(&self.slots);
            let is_new = self.accept_clients();
            if !self.clients.is_empty() {
                let again = sent_at.is_none_or(|at| at.elapsed() >= RESEND_INTERVAL);
                let picture = self.state.picture(&self.slots, is_new || again || over.is_some());
                if changed || is_new || again || picture.is_some() {
                    if again || picture.is_some() {
                        sent_at = Some(Instant::now());
                    }
                    let line = self.state.line(picture);
                    match over {
                        Some(_) => self.end(&line),
                        None => self.send(&line),
                    }
                }
            }
            if let Some(end_request) = over {
                return end_request;
            }
            std::thread::park_timeout(SNAPSHOT_INTERVAL);
        }
    }

    /// Accepts new clients; whether there were any.
    fn accept_clients(&mut self) -> bool {
        let mut is_new = false;
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < MAX_CLIENTS && stream.set_nonblocking(true).is_ok() {
                self.clients.push(Client { stream, unsent: Vec::new() });
                is_new = true;
            }
        }
        self.slots.watched.store(!self.clients.is_empty(), Ordering::Relaxed);
        is_new
    }

    fn send(&mut self, line: &[u8]) {
        self.clients.retain_mut(|client| client.send(line).is_ok());
    }

    /// Sends the last line. No later one replaces it, so slow clients get a moment to read it.
    fn end(&mut self, line: &[u8]) {
        let ends = Instant::now() + FINAL_SNAPSHOT_TIMEOUT / 2;
        for Client { mut stream, unsent } in self.clients.drain(..) {
            let left = ends.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            let patient = stream.set_nonblocking(false).and_then(|()| stream.set_write_timeout(Some(left)));
            // a client that does not take it has gone, or will read the job's files
            let _ = patient.and_then(|()| stream.write_all(&unsent)).and_then(|()| stream.write_all(line));
        }
    }
}

/// A connected client.
struct Client {
    stream: UnixStream,
    /// The rest of a line of which a part was sent.
    unsent: Vec<u8>,
}

impl Client {
    /// Sends `line`, or as much of it as there is room for; nothing of it before the rest of an earlier line is sent.
    ///
    /// # Errors
    /// Where the client has disconnected.
    fn send(&mut self, line: &[u8]) -> std::io::Result<()> {
        let mut unsent = std::mem::take(&mut self.unsent);
        let sent = write_available(&mut self.stream, &unsent)?;
        if sent < unsent.len() {
            self.unsent = unsent.split_off(sent);
            return Ok(());
        }
        let sent = write_available(&mut self.stream, line)?;
        self.unsent = line[sent..].to_vec();
        Ok(())
    }
}

/// Writes as much as there is room for; returns the number of bytes.
fn write_available(stream: &mut UnixStream, bytes: &[u8]) -> std::io::Result<usize> {
    let mut sent = 0;
    while sent < bytes.len() {
        match stream.write(&bytes[sent..]) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => sent += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => break,
            Err(error) => return Err(error),
        }
    }
    Ok(sent)
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::showing::lines::Lines;

    #[test]
    fn client_that_stalls_misses_whole_lines_and_gets_no_broken_ones() {
        let (near, mut far) = UnixStream::pair().unwrap();
        near.set_nonblocking(true).unwrap();
        let mut client = Client { stream: near, unsent: Vec::new() };
        let line = |k: u32| format!("{k} {}\n", "x".repeat(50_000)).into_bytes();
        (0..100).for_each(|k| client.send(&line(k)).unwrap());
        // it reads again
        far.set_nonblocking(true).unwrap();
        let (mut lines, mut came) = (Lines::default(), Vec::new());
        for k in 100..110 {
            let mut piece = [0; 10_000];
            while let Ok(count) = far.read(&mut piece) {
                came.extend(lines.newest(&piece[..count]).unwrap());
            }
            client.send(&line(k)).unwrap();
        }
        let numbers: Vec<u32> = came
            .iter()
            .map(|line| {
                let (number, rest) = line.split_once(' ').unwrap();
                assert_eq!(rest.len(), 50_000);
                number.parse().unwrap()
            })
            .collect();
        assert!(numbers.is_sorted() && numbers.len() > 9, "{numbers:?}");
        assert!(numbers.windows(2).any(|pair| pair[1] > pair[0] + 50), "it missed some: {numbers:?}");
        assert_eq!(numbers.last(), Some(&108));
        drop(far);
        assert!(client.send(b"gone\n").is_err());
    }
}
