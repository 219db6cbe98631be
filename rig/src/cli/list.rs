//! `rig list`: serial ports and cameras on this machine, and what keeps each from being used.

use std::fmt::Write as _;
use std::io::ErrorKind;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use super::{Failure, Outcome};

/// `rig list`.
#[derive(clap::Args, Debug)]
pub struct Args {}

/// Lists serial ports and cameras.
///
/// # Errors
/// None: what cannot be looked at is said in the list.
pub fn run(_args: &Args) -> Result<Outcome, Failure> {
    let mut text = String::new();
    section(
        &mut text,
        "serial ports",
        &serial_ports(),
        "connect a servo board or a servo bus's adapter, or use the mock board",
    );
    section(&mut text, "cameras", &cameras(), "connect a camera, or use the mock camera");
    Ok(Outcome { text, ..Outcome::default() })
}

/// A device node and what is known about it.
#[derive(Debug)]
pub(super) struct Device {
    /// The name to put into a config: one that stays the same after a replug, where there is one.
    pub(super) path: PathBuf,
    what: String,
    /// Why it cannot be used now.
    pub(super) obstacle: Option<String>,
}

fn section(text: &mut String, title: &str, devices: &[Device], none: &str) {
    let _ = writeln!(text, "{title}:");
    if devices.is_empty() {
        let _ = writeln!(text, "  none found; {none}");
    }
    for device in devices {
        let state = device.obstacle.as_deref().unwrap_or("ready");
        let _ = writeln!(text, "  {}  {}  [{state}]", device.path.display(), device.what);
    }
}

pub(super) fn serial_ports() -> Vec<Device> {
    // The library takes /sys/class/tty for granted, which a container may lack.
    let known = if Path::new("/sys/class/tty").exists() {
        serialport::available_ports().unwrap_or_default()
    } else {
        Vec::new()
    };
    let mut ports: Vec<(PathBuf, String)> = known
        .into_iter()
        .filter_map(|port| match port.port_type {
            serialport::SerialPortType::UsbPort(usb) => {
                let product = usb.product.unwrap_or_else(|| "USB serial port".into());
                Some((port.port_name.into(), format!("{product} ({:04x}:{:04x})", usb.vid, usb.pid)))
            }
            // Ports of the board's own chips exist in name on every PC.
            _ => None,
        })
        .collect();
    for node in nodes(Path::new("/dev"), &["ttyACM", "ttyUSB"]) {
        if !ports.iter().any(|(path, _)| *path == node) {
            ports.push((node, "serial port".into()));
        }
    }
    ports.sort();
    let stable = by_target(Path::new("/dev/serial/by-id"));
    ports
        .into_iter()
        .map(|(node, what)| Device {
            obstacle: rights(&node, "dialout").or_else(|| holder(&node)),
            path: stable_name(&stable, &node),
            what,
        })
        .collect()
}

pub(super) fn cameras() -> Vec<Device> {
    let stable = by_target(Path::new("/dev/v4l/by-id"));
    nodes(Path::new("/dev"), &["video"])
        .into_iter()
        .filter_map(|node| {
            let (what, obstacle) = match rights(&node, "video") {
                Some(obstacle) => ("camera".into(), Some(obstacle)),
                None => look_at_camera(&node)?,
            };
            Some(Device { path: stable_name(&stable, &node), what, obstacle })
        })
        .collect()
}

/// What a camera says it is; none for a node that is no camera (cameras also have one for metadata).
fn look_at_camera(node: &Path) -> Option<(String, Option<String>)> {
    // The library panics on names that are not UTF-8.
    let asked =
        std::panic::catch_unwind(|| v4l::Device::with_path(node).and_then(|device| device.query_caps()));
    match asked {
        Ok(Ok(caps)) => {
            let captures = caps.capabilities.contains(v4l::capability::Flags::VIDEO_CAPTURE);
            captures.then(|| (format!("{} ({})", caps.card, caps.driver), holder(node)))
        }
        Ok(Err(error)) if error.kind() == ErrorKind::ResourceBusy => {
            Some(("camera".into(), Some("another program uses it".into())))
        }
        Ok(Err(error)) => Some(("camera".into(), Some(error.to_string()))),
        Err(_) => Some(("camera".into(), Some("gives an answer that cannot be read".into()))),
    }
}

/// Device nodes in `folder` whose names begin with one of `prefixes` and go on with a number, in order of these.
fn nodes(folder: &Path, prefixes: &[&str]) -> Vec<PathBuf> {
    let mut found: Vec<(usize, u32, PathBuf)> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let numbered = |(kind, prefix): (usize, &&str)| {
                name.strip_prefix(prefix).and_then(|rest| rest.parse().ok()).map(|number| (kind, number))
            };
            let (kind, number) = prefixes.iter().enumerate().find_map(numbered)?;
            entry.file_type().ok()?.is_char_device().then(|| (kind, number, entry.path()))
        })
        .collect();
    found.sort();
    found.into_iter().map(|(_, _, path)| path).collect()
}

/// Links in `folder`, each with what it leads to.
fn by_target(folder: &Path) -> Vec<(PathBuf, PathBuf)> {
    std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Some((std::fs::canonicalize(entry.path()).ok()?, entry.path())))
        .collect()
}

fn stable_name(links: &[(PathBuf, PathBuf)], node: &Path) -> PathBuf {
    links.iter().find(|(target, _)| target == node).map_or_else(|| node.into(), |(_, link)| link.clone())
}

/// Why this user may not open the node; asked of the node itself, since a wrong hint is worse than none.
fn rights(node: &Path, group: &str) -> Option<String> {
    match access(node, Access::READ_OK | Access::WRITE_OK) {
        Ok(()) => None,
        Err(rustix::io::Errno::NOENT) => Some("just went away".into()),
        Err(_) => Some(format!("no right to open it: add this user to the group `{group}` and log in again")),
    }
}

/// The process that has the node open, as far as this user may see. Asked of the system and not by opening the node: that
/// would reset many boards.
fn holder(node: &Path) -> Option<String> {
    let own = std::process::id();
    let mut processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes.find_map(|process| {
        let pid: u32 = process.file_name().to_str()?.parse().ok().filter(|&pid| pid != own)?;
        let mut open = std::fs::read_dir(process.path().join("fd")).ok()?.flatten();
        open.find(|link| std::fs::read_link(link.path()).is_ok_and(|target| target == node))?;
        let name = std::fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        Some(format!("in use by {} (process {pid}); end that one", name.trim()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_listed_in_order_of_their_numbers() {
        let ptys: Vec<_> = (0..3)
            .map(|_| rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR).unwrap())
            .map(|pty| {
                let name = rustix::pty::ptsname(&pty, Vec::new()).unwrap().into_string().unwrap();
                (pty, PathBuf::from(name))
            })
            .collect();
        let found = nodes(Path::new("/dev/pts"), &[""]);
        assert!(ptys.iter().all(|(_, name)| found.contains(name)), "{found:?}");
        let number = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().parse::<u32>().unwrap();
        assert!(found.iter().map(number).is_sorted());
    }

    #[test]
    fn program_that_holds_a_node_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let node = dir.path().join("ttyACM0");
        let file = std::fs::File::create(&node).unwrap();
        assert_eq!(holder(&node), None, "this process itself does not count");
        let mut child = std::process::Command::new("sleep").arg("10").stdin(file).spawn().unwrap();
        let named = holder(&node);
        child.kill().unwrap();
        child.wait().unwrap();
        let expected = format!("(process {})", child.id());
        assert!(named.as_deref().is_some_and(|text| text.contains(&expected)), "{named:?}");
    }

    #[test]
    fn stable_link_wins_over_the_node_it_leads_to() {
        let dir = tempfile::tempdir().unwrap();
        let node = dir.path().join("video0");
        std::fs::write(&node, "").unwrap();
        let links = dir.path().join("by-id");
        std::fs::create_dir(&links).unwrap();
        std::os::unix::fs::symlink("../video0", links.join("usb-maker-camera")).unwrap();
        let node = std::fs::canonicalize(node).unwrap();
        assert!(stable_name(&by_target(&links), &node).ends_with("by-id/usb-maker-camera"));
        assert_eq!(stable_name(&[], &node), node);
    }

    #[test]
    fn list_says_what_to_do_where_there_is_nothing() {
        let text = run(&Args {}).unwrap().text;
        assert!(text.contains("serial ports:") && text.contains("cameras:"), "{text}");
        let mut empty = String::new();
        section(&mut empty, "cameras", &[], "connect a camera");
        assert_eq!(empty, "cameras:\n  none found; connect a camera\n");
    }
}
