//! A pseudo-terminal, so that a mock is reached as a device on a serial port is.

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use super::{BoardInfo, PulseProfile, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;
use ground::urgency::Urgency;

/// The board's end of a pseudo-terminal.
pub(super) struct Pty {
    pub(super) board: OwnedFd,
    /// Kept open so that reads do not fail while no host has the port.
    _host: OwnedFd,
}

impl Pty {
    pub(super) fn open() -> std::io::Result<(Self, PathBuf)> {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        use rustix::{fs, termios};
        let board = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&board)?;
        unlockpt(&board)?;
        let name = ptsname(&board, Vec::new())?;
        let port = PathBuf::from(name.to_string_lossy().into_owned());
        let flags = fs::OFlags::RDWR | fs::OFlags::NOCTTY | fs::OFlags::CLOEXEC;
        let host = fs::open(&port, flags, fs::Mode::empty())?;
        // Raw from the start: nothing is echoed or altered even before a host opens it.
        let mut settings = termios::tcgetattr(&host)?;
        settings.make_raw();
        termios::tcsetattr(&host, termios::OptionalActions::Now, &settings)?;
        // A full line must not hold up the board: what it cannot send is lost.
        let flags = fs::fcntl_getfl(&board)?;
        fs::fcntl_setfl(&board, flags | fs::OFlags::NONBLOCK)?;
        Ok((Self { board, _host: host }, port))
    }
}

/// A mock behind a pseudo-terminal, on a thread of its own; it ends when dropped.
#[derive(Debug)]
pub(super) struct Device {
    port: PathBuf,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Device {
    /// Opens a pseudo-terminal and lets `run` have it, on a thread called `name`, until the flag says to quit.
    ///
    /// # Errors
    /// What the system says when it has no pseudo-terminal left.
    pub(super) fn start(
        name: &str,
        run: impl FnOnce(Pty, &AtomicBool) + Send + 'static,
    ) -> std::io::Result<Self> {
        let (pty, port) = Pty::open()?;
        let quit = Arc::new(AtomicBool::new(false));
        let quits = Arc::clone(&quit);
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            Urgency::Servo.take();
            run(pty, &quits);
        })?;
        Ok(Self { port, quit, thread: Some(thread) })
    }

    /// The serial port to open.
    pub(super) fn port(&self) -> &Path {
        &self.port
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A mock and the connection to it, as one board.
pub struct Attached<B, M> {
    // Dropped in this order: the board's goodbye needs the mock to receive it.
    board: B,
    _mock: M,
}

impl<B, M> Attached<B, M> {
    /// Connects to a `mock` that was just started.
    ///
    /// # Errors
    /// [`ServoError::Open`] where it was not, and what `connect` says.
    pub(super) fn new(
        mock: std::io::Result<M>,
        connect: impl FnOnce(&M) -> Result<B, ServoError>,
    ) -> Result<Self, ServoError> {
        let mock = mock.map_err(|error| ServoError::Open { port: "mock".into(), why: error.to_string() })?;
        Ok(Self { board: connect(&mock)?, _mock: mock })
    }
}

impl<B: ServoBoard, M: Send> ServoBoard for Attached<B, M> {
    fn info(&self) -> &BoardInfo {
        self.board.info()
    }

    fn arm(&mut self, profile: &PulseProfile, start: MonotonicNs) -> Result<(), ServoError> {
        self.board.arm(profile, start)
    }

    fn jog(&mut self, channel: u8, pulse: u16, duration_s: f64) -> Result<(), ServoError> {
        self.board.jog(channel, pulse, duration_s)
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        self.board.poll()
    }

    fn stop(&mut self) -> StopOutcome {
        self.board.stop()
    }

    fn leave(&mut self) -> StopOutcome {
        self.board.leave()
    }
}
