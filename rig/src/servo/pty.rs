//! A pseudo-terminal, behind which a mock is found as behind a serial port.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

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
