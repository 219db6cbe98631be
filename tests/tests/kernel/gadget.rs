//! A USB serial port: a CDC-ACM gadget on the kernel's dummy host controller, with something behind it.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use system_tests::wait_until;

use crate::bench::{comes_first, must, write};

/// Where `rig` finds the port.
pub(crate) const PORT: &str = "/dev/ttyACM0";
/// The gadget's own end of the line.
const GADGET_END: &str = "/dev/ttyGS0";
const GADGETS: &str = "/sys/kernel/config/usb_gadget";
/// How long the line waits for bytes before it looks whether it is to end or the gadget is back.
const PAUSE: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// Ends a packet.
const END: u8 = 0;
/// A bridge's buffer.
const MOST_COLLECTED: usize = 64;

/// The gadget, plugged in, with a line to what is behind it.
pub(crate) struct Gadget {
    udc: PathBuf,
    stop: Arc<AtomicBool>,
    line: Option<JoinHandle<()>>,
}

impl Gadget {
    /// Plugs it in, the pseudo-terminal `behind` being the board that it belongs to.
    pub(crate) fn plugged_in(behind: &Path) -> Self {
        for module in ["dummy_hcd", "libcomposite", "usb_f_acm", "cdc_acm"] {
            must("modprobe", &[module]);
        }
        let gadget = Path::new(GADGETS).join("board");
        if !gadget.exists() {
            if !Path::new(GADGETS).exists() {
                must("mount", &["-t", "configfs", "none", "/sys/kernel/config"]);
            }
            for folder in ["strings/0x409", "configs/c.1", "functions/acm.0"] {
                std::fs::create_dir_all(gadget.join(folder)).expect("a gadget's folder");
            }
            write(&gadget.join("idVendor"), "0x2341");
            write(&gadget.join("idProduct"), "0x0043");
            write(&gadget.join("strings/0x409/product"), "Uno");
            write(&gadget.join("strings/0x409/serialnumber"), "1");
            std::os::unix::fs::symlink(gadget.join("functions/acm.0"), gadget.join("configs/c.1/acm.0"))
                .expect("the function belongs to the configuration");
        }
        let stop = Arc::new(AtomicBool::new(false));
        let (behind, stops) = (behind.to_owned(), Arc::clone(&stop));
        let line = std::thread::spawn(move || join(&behind, &stops));
        let gadget = Self { udc: gadget.join("UDC"), stop, line: Some(line) };
        gadget.plug();
        gadget
    }

    pub(crate) fn plug(&self) {
        write(&self.udc, "dummy_udc.0");
        wait_until("the port", 10.0, || Path::new(PORT).exists());
    }

    pub(crate) fn unplug(&self) {
        write(&self.udc, "\n");
    }
}

impl Drop for Gadget {
    fn drop(&mut self) {
        // A test that failed may have left it unplugged.
        let _ = std::fs::write(&self.udc, "\n");
        self.stop.store(true, Ordering::Relaxed);
        if let Some(line) = self.line.take() {
            let _ = line.join();
        }
    }
}

/// Opens a terminal as a plain line that keeps nobody waiting.
fn terminal(path: &Path) -> std::io::Result<File> {
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
    let file = OpenOptions::new().read(true).write(true).custom_flags(flags).open(path)?;
    let mut attributes = tcgetattr(&file)?;
    attributes.make_raw();
    tcsetattr(&file, OptionalActions::Now, &attributes)?;
    Ok(file)
}

/// Hands bytes on, until told to stop. While the gadget is unplugged what the board says is lost, as it is on a real one.
fn join(behind: &Path, stop: &AtomicBool) {
    comes_first(None);
    let mut board = terminal(behind).expect("the emulated board's pseudo-terminal");
    let mut gadget: Option<File> = None;
    let (mut bytes, mut said) = ([0; 512], Vec::new());
    while !stop.load(Ordering::Relaxed) {
        if gadget.is_none() {
            gadget = terminal(Path::new(GADGET_END)).ok();
        }
        let mut idle = true;
        if let Some(length) = read(&mut board, &mut bytes).expect("the emulated board lives") {
            idle = false;
            said.extend_from_slice(&bytes[..length]);
            // By whole packets, as a USB bridge collects bytes too: each transfer costs this computer as much as its bytes took.
            if bytes[..length].contains(&END) || said.len() > MOST_COLLECTED {
                if let Some(end) = &mut gadget
                    && end.write_all(&said).is_err()
                {
                    gadget = None;
                }
                said.clear();
            }
        }
        if let Some(end) = &mut gadget {
            match read(end, &mut bytes) {
                Ok(Some(length)) => {
                    idle = false;
                    board.write_all(&bytes[..length]).expect("the emulated board takes it");
                }
                Ok(None) => {}
                Err(_) => gadget = None,
            }
        }
        if idle {
            // A sleep would add to the round trip, which a run's clock is known by.
            let ends = std::iter::once(&board).chain(&gadget);
            let mut ends: Vec<_> = ends.map(|end| PollFd::new(end, PollFlags::IN)).collect();
            let _ = poll(&mut ends, Some(&PAUSE));
        }
    }
}

/// What there is; an error when the line is cut.
fn read(from: &mut File, bytes: &mut [u8]) -> std::io::Result<Option<usize>> {
    match from.read(bytes) {
        Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
        Ok(length) => Ok(Some(length)),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(None),
        Err(error) => Err(error),
    }
}
