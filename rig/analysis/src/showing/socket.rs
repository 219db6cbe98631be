//! The thread that shows, and who is connected to it.

use std::io::{ErrorKind, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError};
use std::thread::Thread;
use std::time::{Duration, Instant};

use super::state::State;
use super::{LAST_WORDS, Slots, Told};
use ground::urgency::Urgency;

/// Between two looks at what was handed over: five pictures a second.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Where nothing has changed, all of it is told again after so long: for who came late or missed some.
const AGAIN_AFTER: Duration = Duration::from_secs(2);
/// More may not listen: it is meant for the daemon.
const MOST_LISTENERS: usize = 4;

/// Begins to show what is told, on a socket at `path`.
///
/// # Errors
/// What the system says, for instance of a path of more than 107 bytes.
pub(super) fn start(
    path: &Path,
    job: i64,
    told: Receiver<Told>,
    slots: Arc<Slots>,
) -> std::io::Result<Thread> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let listener = UnixListener::bind(path)?;
    listener.set_nonblocking(true)?;
    let path = path.to_owned();
    let shower = Shower { listener, told, slots, state: State::new(job), listeners: Vec::new() };
    let thread = std::thread::Builder::new().name("showing".into()).spawn(move || {
        Urgency::Computing.take();
        let asks = shower.show();
        // one that is left behind would only mislead
        let _ = std::fs::remove_file(path);
        if let Some(asks) = asks {
            let _ = asks.try_send(());
        }
    })?;
    Ok(thread.thread().clone())
}

struct Shower {
    listener: UnixListener,
    told: Receiver<Told>,
    slots: Arc<Slots>,
    state: State,
    listeners: Vec<Listener>,
}

impl Shower {
    /// Until nobody tells anything any more; gives who waits for that.
    fn show(mut self) -> Option<SyncSender<()>> {
        let mut told_at: Option<Instant> = None;
        loop {
            let (mut changed, mut over) = (false, None);
            loop {
                match self.told.try_recv() {
                    Ok(Told::End(asks)) => over = Some(Some(asks)),
                    Ok(told) => {
                        self.state.hear(told);
                        changed = true;
                    }
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => {
                        over = over.or(Some(None));
                        break;
                    }
                }
            }
            changed |= self.state.look(&self.slots);
            let is_new = self.welcome();
            if !self.listeners.is_empty() {
                let again = told_at.is_none_or(|at| at.elapsed() >= AGAIN_AFTER);
                let picture = self.state.picture(&self.slots, is_new || again || over.is_some());
                if changed || is_new || again || picture.is_some() {
                    if again || picture.is_some() {
                        told_at = Some(Instant::now());
                    }
                    let line = self.state.line(picture);
                    match over {
                        Some(_) => self.end(&line),
                        None => self.tell(&line),
                    }
                }
            }
            if let Some(asks) = over {
                return asks;
            }
            std::thread::park_timeout(LOOK_EVERY);
        }
    }

    /// Lets in who knocks; whether somebody did.
    fn welcome(&mut self) -> bool {
        let mut is_new = false;
        while let Ok((stream, _)) = self.listener.accept() {
            if self.listeners.len() < MOST_LISTENERS && stream.set_nonblocking(true).is_ok() {
                self.listeners.push(Listener { stream, begun: Vec::new() });
                is_new = true;
            }
        }
        self.slots.watched.store(!self.listeners.is_empty(), Ordering::Relaxed);
        is_new
    }

    fn tell(&mut self, line: &[u8]) {
        self.listeners.retain_mut(|listener| listener.offer(line).is_ok());
    }

    /// The last line, for which no later one makes up: it waits a moment for who reads slowly.
    fn end(&mut self, line: &[u8]) {
        let ends = Instant::now() + LAST_WORDS / 2;
        for Listener { mut stream, begun } in self.listeners.drain(..) {
            let left = ends.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            let patient = stream.set_nonblocking(false).and_then(|()| stream.set_write_timeout(Some(left)));
            // who does not take it has gone, or will look at what the job left
            let _ = patient.and_then(|()| stream.write_all(&begun)).and_then(|()| stream.write_all(line));
        }
    }
}

/// Somebody who is connected.
struct Listener {
    stream: UnixStream,
    /// What is left of a line that was begun.
    begun: Vec<u8>,
}

impl Listener {
    /// Sends `line`, or as much of it as there is room for; nothing of it as long as an earlier one is not through.
    ///
    /// # Errors
    /// Where nobody listens any more.
    fn offer(&mut self, line: &[u8]) -> std::io::Result<()> {
        let mut begun = std::mem::take(&mut self.begun);
        let sent = send(&mut self.stream, &begun)?;
        if sent < begun.len() {
            self.begun = begun.split_off(sent);
            return Ok(());
        }
        let sent = send(&mut self.stream, line)?;
        self.begun = line[sent..].to_vec();
        Ok(())
    }
}

/// Writes what there is room for; gives how much that was.
fn send(stream: &mut UnixStream, bytes: &[u8]) -> std::io::Result<usize> {
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
    fn listener_that_stalls_misses_whole_lines_and_gets_no_broken_ones() {
        let (near, mut far) = UnixStream::pair().unwrap();
        near.set_nonblocking(true).unwrap();
        let mut listener = Listener { stream: near, begun: Vec::new() };
        let line = |k: u32| format!("{k} {}\n", "x".repeat(50_000)).into_bytes();
        (0..100).for_each(|k| listener.offer(&line(k)).unwrap());
        // it reads again
        far.set_nonblocking(true).unwrap();
        let (mut lines, mut came) = (Lines::default(), Vec::new());
        for k in 100..110 {
            let mut piece = [0; 10_000];
            while let Ok(count) = far.read(&mut piece) {
                came.extend(lines.newest(&piece[..count]).unwrap());
            }
            listener.offer(&line(k)).unwrap();
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
        assert!(listener.offer(b"gone\n").is_err());
    }
}
