//! Files that are served to others: regular files below a folder, reached without following a link. A runs folder may be written by
//! others than the user who serves it, and a link in it could lead to everything that the server may read.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::fs::{CWD, FileType, Mode, OFlags, fstat, open, openat};
use rustix::io::Errno;

/// Opens the regular file whose folders and name below `root` are `names`, one step after the other: what was looked at is what is
/// opened. `root` itself is the user's own choice and may be a link.
///
/// # Errors
/// As the system says; [`ErrorKind::InvalidInput`] for a name that is more than a step, a link, and whatever else is no regular file.
/// Nothing is waited for: not for who writes into a pipe either.
pub fn file(root: &Path, names: &[&str]) -> Result<File> {
    // whoever reads a regular file never waits; a pipe would wait for a writer
    let file = entry(root, names, OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY)?;
    is(&file, FileType::RegularFile, "no regular file")?;
    Ok(file.into())
}

/// The regular file at `path`, which is no link; the folder that it is in is the user's own choice.
///
/// # Errors
/// As [`file()`].
pub fn at(path: &Path) -> Result<File> {
    let name = path.file_name().and_then(OsStr::to_str).ok_or_else(|| refused("not a name"))?;
    file(path.parent().unwrap_or(Path::new("")), &[name])
}

/// The whole of such a file.
///
/// # Errors
/// As [`file()`].
pub fn read_at(path: &Path) -> Result<Vec<u8>> {
    whole(at(path)?)
}

/// The whole of the file that [`file()`] opens.
///
/// # Errors
/// As [`file()`].
pub fn read(root: &Path, names: &[&str]) -> Result<Vec<u8>> {
    whole(file(root, names)?)
}

fn whole(mut file: File) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Opens such a Unix socket without connecting to it; [`through`] gives the path to connect to, which leads to no other one.
///
/// # Errors
/// As [`file()`], for what is no socket.
pub fn socket(root: &Path, names: &[&str]) -> Result<OwnedFd> {
    let socket = entry(root, names, OFlags::PATH)?;
    is(&socket, FileType::Socket, "no socket")?;
    Ok(socket)
}

/// A path to what `held` refers to, whatever its name leads to by now.
pub fn through(held: &OwnedFd) -> std::path::PathBuf {
    use std::os::fd::AsRawFd as _;
    format!("/proc/self/fd/{}", held.as_raw_fd()).into()
}

fn entry(root: &Path, names: &[&str], flags: OFlags) -> Result<OwnedFd> {
    let is_name = |name: &&str| !["", ".", ".."].contains(name) && !name.contains(['/', '\0']);
    let Some((last, folders)) = names.split_last().filter(|_| names.iter().all(is_name)) else {
        return Err(refused("not a name"));
    };
    let (common, none) = (OFlags::CLOEXEC | OFlags::NOFOLLOW, Mode::empty());
    let folder = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
    let mut held =
        if root.as_os_str().is_empty() { openat(CWD, ".", folder, none) } else { open(root, folder, none) }?;
    for name in folders {
        held = openat(&held, *name, folder | common, none).map_err(link)?;
    }
    openat(&held, *last, flags | common, none).map_err(link)
}

/// The error of a step that ended at a link: a folder's that is one is no folder, a file's that is one is a loop.
fn link(error: Errno) -> Error {
    match error {
        Errno::LOOP => refused("a link, which is not followed"),
        Errno::NOTDIR => refused("no folder, or a link, which is not followed"),
        // what nobody reads from: a socket
        Errno::NXIO => refused("no regular file"),
        other => other.into(),
    }
}

fn is(held: &OwnedFd, wanted: FileType, otherwise: &'static str) -> Result<()> {
    match FileType::from_raw_mode(fstat(held)?.st_mode) {
        found if found == wanted => Ok(()),
        FileType::Symlink => Err(refused("a link, which is not followed")),
        _ => Err(refused(otherwise)),
    }
}

fn refused(why: &'static str) -> Error {
    Error::new(ErrorKind::InvalidInput, why)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::time::{Duration, Instant};

    use super::*;

    /// A folder with a run folder in it, and a secret beside it.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("runs/run")).unwrap();
        std::fs::write(folder.path().join("secret"), "secret").unwrap();
        std::fs::write(folder.path().join("runs/run/fit.json"), "fit").unwrap();
        folder
    }

    #[test]
    fn regular_file_is_read_and_a_link_anywhere_below_is_refused() {
        let folder = folder();
        let runs = folder.path().join("runs");
        assert_eq!(read(&runs, &["run", "fit.json"]).unwrap(), b"fit");
        let why = |names: &[&str]| read(&runs, names).unwrap_err().to_string();
        symlink("../../secret", runs.join("run/servo.csv")).unwrap();
        symlink("fit.json", runs.join("run/beside.json")).unwrap();
        symlink("run", runs.join("other")).unwrap();
        symlink("/proc/self/environ", runs.join("run/environment")).unwrap();
        for names in
            [&["run", "servo.csv"], &["run", "beside.json"], &["other", "fit.json"], &["run", "environment"]]
        {
            assert!(why(names).contains("link"), "{names:?}: {}", why(names));
        }
        for names in [&["..", "secret"][..], &["run/../../secret"], &["run", ""], &["/etc/passwd"], &[]] {
            assert_eq!(why(names), "not a name", "{names:?}");
        }
        assert_eq!(read(&runs, &["run", "none"]).unwrap_err().kind(), ErrorKind::NotFound);
        // the folder itself is whoever's choice it is
        symlink(&runs, folder.path().join("link")).unwrap();
        assert_eq!(read(&folder.path().join("link"), &["run", "fit.json"]).unwrap(), b"fit");
    }

    #[test]
    fn pipes_devices_folders_and_sockets_are_refused_at_once() {
        let folder = folder();
        let runs = folder.path().join("runs");
        rustix::fs::mknodat(CWD, runs.join("run/pipe"), FileType::Fifo, Mode::from_raw_mode(0o600), 0)
            .unwrap();
        std::fs::create_dir(runs.join("run/folder")).unwrap();
        let _listener = UnixListener::bind(runs.join("run/socket")).unwrap();
        let began = Instant::now();
        for name in ["pipe", "folder", "socket"] {
            let error = read(&runs, &["run", name]).unwrap_err();
            assert_eq!(error.to_string(), "no regular file", "{name}");
        }
        assert!(read(Path::new("/dev"), &["zero"]).is_err() && read(Path::new("/dev"), &["null"]).is_err());
        assert!(began.elapsed() < Duration::from_secs(1), "{:?}", began.elapsed());
    }

    #[test]
    fn socket_is_connected_to_only_where_no_link_leads_to_it() {
        let folder = folder();
        let runs = folder.path().join("runs");
        let _elsewhere = UnixListener::bind(folder.path().join("elsewhere")).unwrap();
        symlink("../../elsewhere", runs.join("run/link.sock")).unwrap();
        assert!(socket(&runs, &["run", "link.sock"]).unwrap_err().to_string().contains("link"));
        assert!(socket(&runs, &["run", "fit.json"]).is_err());
        let listener = UnixListener::bind(runs.join("run/live.sock")).unwrap();
        let held = socket(&runs, &["run", "live.sock"]).unwrap();
        // renamed meanwhile: the same socket all the same
        std::fs::rename(runs.join("run/live.sock"), runs.join("run/moved")).unwrap();
        symlink("../../elsewhere", runs.join("run/live.sock")).unwrap();
        UnixStream::connect(through(&held)).unwrap();
        listener.set_nonblocking(true).unwrap();
        listener.accept().unwrap();
    }
}
