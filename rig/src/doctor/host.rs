//! Checks of the host: disk, folder, serial bridge.

use std::path::Path;

use super::Check;

/// A bridge that holds bytes back for longer than this biases the clock fit by about half of it \[ms\].
const MAX_LATENCY_TIMER_MS: u32 = 1;

/// Whether `folder` can be written to and has room for twice `expected_bytes`.
pub fn runs_folder(folder: &Path, expected_bytes: u64) -> Vec<Check> {
    let subject = "runs folder";
    if let Err(error) = std::fs::create_dir_all(folder) {
        return vec![Check::bad(subject, format!("{} cannot be made: {error}", folder.display()))];
    }
    let probe = folder.join(".write-probe");
    let writable = std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe));
    if let Err(error) = writable {
        return vec![Check::bad(subject, format!("{} cannot be written to: {error}", folder.display()))];
    }
    let disk = match rustix::fs::statvfs(folder) {
        Ok(fs) => disk_room(fs.f_bavail.saturating_mul(fs.f_frsize), expected_bytes),
        Err(error) => Check::doubtful("disk", format!("free space of {} unknown: {error}", folder.display())),
    };
    vec![Check::good(subject, folder.display().to_string()), disk]
}

fn disk_room(free_bytes: u64, expected_bytes: u64) -> Check {
    let megabytes = |bytes: u64| bytes / 1_000_000;
    let finding = format!(
        "{} MB free, a run of this config takes about {} MB",
        megabytes(free_bytes),
        megabytes(expected_bytes)
    );
    if free_bytes < expected_bytes.saturating_mul(2) {
        Check::bad(
            "disk",
            format!("{finding}; twice that is wanted: free some, or choose another --runs-dir"),
        )
    } else {
        Check::good("disk", finding)
    }
}

/// The latency timer of the USB serial bridge behind `port`, where it has one (FTDI chips do).
pub fn latency_timer(port: &Path) -> Option<Check> {
    let device = std::fs::canonicalize(port).ok()?;
    let timer = Path::new("/sys/class/tty").join(device.file_name()?).join("device/latency_timer");
    let milliseconds: u32 = std::fs::read_to_string(&timer).ok()?.trim().parse().ok()?;
    Some(latency_finding(milliseconds, &timer))
}

fn latency_finding(milliseconds: u32, timer: &Path) -> Check {
    let finding = format!("{milliseconds} ms");
    if milliseconds > MAX_LATENCY_TIMER_MS {
        let bias = f64::from(milliseconds) / 2.0;
        Check::doubtful(
            "serial latency",
            format!("{finding}: biases the clock by up to {bias} ms; as root: echo 1 > {}", timer.display()),
        )
    } else {
        Check::good("serial latency", finding)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Health;
    use super::*;

    #[test]
    fn too_little_room_forbids_a_run_and_says_how_much_is_missing() {
        assert_eq!(disk_room(700_000_000, 300_000_000).health, Health::Good);
        let full = disk_room(500_000_000, 300_000_000);
        assert_eq!(full.health, Health::Bad);
        assert!(full.finding.contains("500 MB free") && full.finding.contains("300 MB"));
    }

    #[test]
    fn folder_below_a_file_is_refused_by_name() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let checks = runs_folder(&file.path().join("runs"), 1);
        assert_eq!(checks[0].health, Health::Bad);
        assert!(checks[0].finding.contains("runs cannot be made"), "{}", checks[0].finding);
    }

    #[test]
    fn slow_latency_timer_comes_with_its_remedy() {
        let check = latency_finding(16, Path::new("/sys/class/tty/ttyUSB0/device/latency_timer"));
        assert_eq!(check.health, Health::Doubtful);
        assert!(check.finding.contains("up to 8 ms") && check.finding.contains("echo 1 >"));
    }
}
