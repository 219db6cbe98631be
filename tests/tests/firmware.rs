//! `rig firmware flash`: what it tells avrdude, and that it asks the board afterwards. The board is the mock's, avrdude one that only
//! takes notes; that the written binary is a board is tested on the binary itself, in `firmware-protocol`.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use system_tests::{Background, in_real_time, printed, rig, wait_until};

/// An avrdude in `folder` that writes down its arguments and then does what `script` says.
fn avrdude(folder: &Path, script: &str) -> PathBuf {
    let tools = folder.join("tools");
    std::fs::create_dir_all(&tools).expect("a folder");
    let path = tools.join("avrdude");
    std::fs::write(&path, format!("#!/bin/sh\necho \"$@\" > \"$(dirname \"$0\")/said\"\n{script}\n"))
        .expect("a script");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("rights");
    tools
}

fn flash(tools: Option<&Path>, board: &str, port: &str, image: &Path) -> Output {
    let mut command: Command = rig(["firmware", "flash", "--board", board, "--port", port, "--image"]);
    command.arg(image);
    let usual = std::env::var("PATH").unwrap_or_default();
    match tools {
        Some(tools) => command.env("PATH", format!("{}:{usual}", tools.display())),
        None => command.env("PATH", "/nonexistent"),
    };
    command.output().expect("rig starts")
}

#[test]
fn flash_writes_by_avrdude_and_asks_the_board() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let image = at.join("uno.hex");
    std::fs::write(&image, ":00000001FF\n").expect("an image");
    let _board = Background::start(rig(["mock-board".as_ref(), "--tank".as_ref(), at.as_os_str()]));
    let port = at.join("board");
    wait_until("the board's port", 10.0, || port.exists());
    let port = port.to_str().expect("text");

    let tools = avrdude(at, "exit 0");
    let output = flash(Some(&tools), "uno", port, &image);
    let text = printed(&output);
    assert!(output.status.success() && text.contains("answers: Idle"), "{text}");
    let said = std::fs::read_to_string(tools.join("said")).expect("what avrdude was told");
    let image_path = image.canonicalize().expect("a path");
    let wanted =
        format!("-p atmega328p -c arduino -P {port} -b 115200 -D -U flash:w:{}:i", image_path.display());
    assert_eq!(said.trim(), wanted);

    let tools = avrdude(at, "echo 'stk500_recv(): programmer is not responding' >&2; exit 1");
    let output = flash(Some(&tools), "nano-old", port, &image);
    let text = printed(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("at 57600 baud") && text.contains("not responding"), "{text}");
}

#[test]
fn flash_says_what_is_missing() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let image = at.join("uno.hex");
    std::fs::write(&image, ":00000001FF\n").expect("an image");
    let no_tool = printed(&flash(None, "uno", "/dev/null", &image));
    assert!(no_tool.contains("apt-get install avrdude"), "{no_tool}");
    let no_image = printed(&flash(None, "uno", "/dev/null", &at.join("none.hex")));
    assert!(no_image.contains("none.hex") && no_image.contains("firmware-protocol/uno/build"), "{no_image}");
    std::fs::write(&image, "\x7fELF").expect("another image");
    let no_hex = printed(&flash(None, "uno", "/dev/null", &image));
    assert!(no_hex.contains("no Intel hex file"), "{no_hex}");
    let by_hand = printed(&flash(None, "pico", "/dev/null", &image));
    assert!(by_hand.contains("BOOTSEL") && by_hand.contains("RPI-RP2"), "{by_hand}");
    // a board that does not answer after the writing is no success
    let tools = avrdude(at, "exit 0");
    std::fs::write(&image, ":00000001FF\n").expect("an image");
    let silent = flash(Some(&tools), "uno", at.join("nowhere").to_str().expect("text"), &image);
    assert_eq!(silent.status.code(), Some(3), "{}", printed(&silent));
}
