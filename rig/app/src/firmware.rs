//! Firmware onto a servo board, and whether the board then answers.

use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, anyhow};
use firmware_protocol::event::Status;

use super::Failure;
use ground::choice::Choice;
use ground::claim::{Claim, port_lock};
use servo::serial::query_status;

/// Speed of the firmware's own line \[baud\].
const FIRMWARE_BAUD: u32 = 115_200;

/// A kind of board, and how firmware gets onto it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoardKind {
    /// Arduino Uno, or a newer Nano
    Uno,
    /// Arduino Nano with the old bootloader
    NanoOld,
    /// Raspberry Pi Pico
    Pico,
}

impl Choice for BoardKind {
    const ALL: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Uno, "uno", "Arduino Uno, or a newer Nano"),
        (Self::NanoOld, "nano-old", "Arduino Nano with the old bootloader"),
        (Self::Pico, "pico", "Raspberry Pi Pico"),
    ];
}

/// How firmware gets onto a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// By avrdude, with the bootloader at this speed \[baud\].
    Avrdude {
        /// Speed.
        baud: u32,
    },
    /// By hand, as a file on the drive that the board is while its button is held.
    Drive,
}

impl BoardKind {
    fn way(self) -> Way {
        match self {
            Self::Uno => Way::Avrdude { baud: 115_200 },
            Self::NanoOld => Way::Avrdude { baud: 57_600 },
            Self::Pico => Way::Drive,
        }
    }
}

/// Puts the firmware in `image` onto the board of this `kind` on `port`, and asks how it is.
///
/// # Errors
/// [`Failure::Input`] where the image is none or the board wants a hand; [`Failure::Hardware`] where the port is in use, writing fails or
/// nothing answers afterwards.
pub fn flash(kind: BoardKind, port: &str, image: &Path) -> Result<Status, Failure> {
    let Way::Avrdude { baud } = kind.way() else {
        let file = image.display();
        return Err(Failure::Input(anyhow!(
            "a Pico takes its firmware while BOOTSEL is held as it is plugged in: copy {file} onto the drive RPI-RP2 if it is a UF2 \
             file, `picotool load -x -t elf {file}` if it is what cargo has built; then ask `rig doctor CONFIG` whether it answers"
        )));
    };
    let image = intel_hex(image).map_err(Failure::Input)?;
    if let Some(pid) = Claim::holder(&port_lock(port)) {
        return Err(Failure::Hardware(anyhow!("{port} is driven by process {pid}; end that one first")));
    }
    write(port, baud, &image)?;
    query_status(port, FIRMWARE_BAUD)
        .with_context(|| format!("the firmware was written, but the board on {port} does not answer to it"))
        .map_err(Failure::Hardware)
}

/// The absolute path of `image`, which must be what avrdude reads.
fn intel_hex(image: &Path) -> anyhow::Result<String> {
    let build = "firmware-protocol/uno/build FOLDER makes it";
    let text =
        std::fs::read_to_string(image).with_context(|| format!("reading {}; {build}", image.display()))?;
    if !text.starts_with(':') {
        anyhow::bail!("{} is no Intel hex file, which begins with a colon; {build}", image.display());
    }
    let path = image.canonicalize()?.into_os_string().into_string();
    let path = path.map_err(|path| anyhow!("{} is no text", path.display()))?;
    // avrdude takes what follows a colon for the format
    anyhow::ensure!(!path.contains(':'), "{path}: avrdude takes no path with a colon; move the file");
    Ok(path)
}

/// Has avrdude write and read back.
///
/// # Source
/// ArduinoCore-avr, `boards.txt` and `platform.txt`: programmer `arduino`, chip not erased (`-D`), these bootloaders' speeds.
fn write(port: &str, baud: u32, image: &str) -> Result<(), Failure> {
    let baud = baud.to_string();
    let task = format!("flash:w:{image}:i");
    let mut avrdude = Command::new("avrdude");
    avrdude.args(["-p", "atmega328p", "-c", "arduino", "-P", port, "-b", &baud, "-D", "-U", &task]);
    let output = avrdude.output().map_err(|error| match error.kind() {
        ErrorKind::NotFound => {
            Failure::Input(anyhow!("avrdude is not installed: sudo apt-get install avrdude"))
        }
        _ => Failure::Internal(anyhow!("starting avrdude: {error}")),
    })?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let last: Vec<&str> = said.lines().filter(|line| !line.trim().is_empty()).collect();
    let last = last[last.len().saturating_sub(4)..].join("\n");
    Err(Failure::Hardware(anyhow!(
        "avrdude could not write to the board on {port} at {baud} baud:\n{last}\nCheck cable and port (`rig list`); a Nano with the \
         old bootloader wants --board nano-old"
    )))
}
