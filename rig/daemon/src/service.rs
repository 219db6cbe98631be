//! What a daemon tells the service manager that started it: that it is ready, what it does, that it is alive, that it ends.
//!
//! The protocol is systemd's `sd_notify(3)`: lines in a datagram to the socket that `NOTIFY_SOCKET` names. Written out here because
//! the socket may have an abstract name (containers), because a manager that hangs must not hold up a loop, and because tests then
//! need no environment of their own.

use std::ffi::{OsStr, OsString};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use tracing::{debug, warn};

/// A manager that does not read holds up its service for no longer.
const SEND_TIMEOUT: Duration = Duration::from_millis(20);
/// The watchdog is fed so many times in its period, however often the loop comes by.
const FEEDS_PER_PERIOD: u32 = 4;

/// The service manager, or none: then nothing is said and nothing is an error.
#[derive(Debug, Default)]
pub struct Service {
    manager: Option<UnixDatagram>,
    watchdog: Option<Watchdog>,
}

#[derive(Debug)]
struct Watchdog {
    feed_period: Duration,
    fed: Mutex<Option<Instant>>,
}

impl Service {
    /// The manager that this process's environment names.
    pub fn from_env() -> Self {
        Self::from_vars(|name| std::env::var_os(name))
    }

    fn from_vars(var: impl Fn(&str) -> Option<OsString>) -> Self {
        let Some(address) = var("NOTIFY_SOCKET").filter(|address| !address.is_empty()) else {
            return Self::default();
        };
        match connected(&address) {
            Ok(manager) => Self { manager: Some(manager), watchdog: Watchdog::from_vars(var) },
            Err(error) => {
                warn!("no service manager hears of this: NOTIFY_SOCKET={}: {error}", address.display());
                Self::default()
            }
        }
    }

    /// The start is over: what waits for this service may go on.
    pub fn ready(&self) {
        self.send("READY=1");
    }

    /// What the service does, for `systemctl status`.
    pub fn status(&self, what: &str) {
        // A line break would begin another variable.
        self.send(&format!("STATUS={}", what.replace(['\r', '\n'], " ")));
    }

    /// The loop came by. To be called at least every half of the manager's `WatchdogSec`, and as often as is handy: a quarter of it
    /// passes between two messages. Only the loop whose hanging should restart the service may call it.
    pub fn alive(&self) {
        if self.watchdog.as_ref().is_some_and(|watchdog| watchdog.is_hungry(Instant::now())) {
            self.send("WATCHDOG=1");
        }
    }

    /// The end has begun.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    fn send(&self, message: &str) {
        if let Some(Err(error)) = self.manager.as_ref().map(|manager| manager.send(message.as_bytes())) {
            debug!("the service manager was not told {message}: {error}");
        }
    }
}

impl Watchdog {
    /// Of `WATCHDOG_USEC`, where it is meant for this process and not for its parent.
    fn from_vars(var: impl Fn(&str) -> Option<OsString>) -> Option<Self> {
        let number = |name| var(name)?.to_str()?.parse::<u64>().ok();
        if number("WATCHDOG_PID").is_some_and(|pid| pid != u64::from(std::process::id())) {
            return None;
        }
        let period = Duration::from_micros(number("WATCHDOG_USEC").filter(|&period| period > 0)?);
        Some(Self { feed_period: period / FEEDS_PER_PERIOD, fed: Mutex::new(None) })
    }

    fn is_hungry(&self, now: Instant) -> bool {
        let mut fed = self.fed.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let hungry = fed.is_none_or(|fed| now.saturating_duration_since(fed) >= self.feed_period);
        if hungry {
            *fed = Some(now);
        }
        hungry
    }
}

/// `address` is a path, or an abstract name behind an `@`.
fn connected(address: &OsStr) -> std::io::Result<UnixDatagram> {
    let socket = UnixDatagram::unbound()?;
    match address.as_bytes() {
        [b'@', name @ ..] => socket.connect_addr(&SocketAddr::from_abstract_name(name)?)?,
        _ => socket.connect(address)?,
    }
    socket.set_write_timeout(Some(SEND_TIMEOUT))?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A service whose environment is these variables.
    fn service(vars: &[(&str, &str)]) -> Service {
        let value =
            |wanted: &str| vars.iter().find(|(name, _)| *name == wanted).map(|(_, value)| value.into());
        Service::from_vars(value)
    }

    fn received(manager: &UnixDatagram) -> Vec<String> {
        manager.set_nonblocking(true).expect("a socket");
        let mut messages = Vec::new();
        let mut buffer = [0; 256];
        while let Ok(length) = manager.recv(&mut buffer) {
            messages.push(String::from_utf8_lossy(&buffer[..length]).into_owned());
        }
        messages
    }

    #[test]
    fn a_manager_at_a_path_hears_everything_in_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).expect("a socket");
        let service = service(&[("NOTIFY_SOCKET", path.to_str().expect("a readable path"))]);
        service.ready();
        service.status("run 3\nMAINPID=1");
        service.alive();
        service.stopping();
        // No WATCHDOG_USEC: nobody waits for signs of life.
        assert_eq!(received(&manager), ["READY=1", "STATUS=run 3 MAINPID=1", "STOPPING=1"]);
    }

    #[test]
    fn a_manager_with_an_abstract_name_is_found() {
        let name = format!("rig-service-test-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).expect("a name");
        let manager = UnixDatagram::bind_addr(&address).expect("a socket");
        service(&[("NOTIFY_SOCKET", &format!("@{name}"))]).ready();
        assert_eq!(received(&manager), ["READY=1"]);
    }

    #[test]
    fn the_watchdog_is_fed_every_quarter_of_its_period_and_no_oftener() {
        let vars = |name: &str| (name == "WATCHDOG_USEC").then(|| "2000000".into());
        let watchdog = Watchdog::from_vars(vars).expect("a watchdog");
        let start = Instant::now();
        let fed: Vec<u64> = (0..=2000)
            .step_by(10)
            .filter(|&ms| watchdog.is_hungry(start + Duration::from_millis(ms)))
            .collect();
        assert_eq!(fed, [0, 500, 1000, 1500, 2000]);
    }

    #[test]
    fn a_watchdog_of_another_process_or_without_a_period_is_none_of_ours() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).expect("a socket");
        let socket = ("NOTIFY_SOCKET", path.to_str().expect("a readable path"));
        let own = std::process::id().to_string();
        service(&[socket, ("WATCHDOG_USEC", "1000000"), ("WATCHDOG_PID", &own)]).alive();
        assert_eq!(received(&manager), ["WATCHDOG=1"]);
        service(&[socket, ("WATCHDOG_USEC", "1000000"), ("WATCHDOG_PID", "1")]).alive();
        service(&[socket, ("WATCHDOG_USEC", "0"), ("WATCHDOG_PID", &own)]).alive();
        service(&[socket, ("WATCHDOG_USEC", "soon")]).alive();
        assert_eq!(received(&manager), [""; 0]);
    }

    #[test]
    fn without_a_manager_nothing_happens() {
        for address in ["", "/nowhere/notify", "@rig-service-test-nobody", "vsock:2:1"] {
            let service = service(&[("NOTIFY_SOCKET", address), ("WATCHDOG_USEC", "1")]);
            service.ready();
            service.alive();
            service.stopping();
        }
        Service::from_vars(|_| None).ready();
    }

    #[test]
    fn a_manager_that_does_not_read_holds_up_nobody_for_long() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).expect("a socket");
        let service = service(&[("NOTIFY_SOCKET", path.to_str().expect("a readable path"))]);
        let start = Instant::now();
        let tries = 2000;
        for _ in 0..tries {
            service.ready();
            if start.elapsed() > Duration::from_secs(1) {
                break;
            }
        }
        assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
        assert!(received(&manager).len() < tries, "its queue was never full");
    }
}
