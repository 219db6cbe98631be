//! Checks of the host: disk, folder, serial bridge.

#![allow(clippy::disallowed_methods, reason = "a file to try the disk with")]

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Check;
use camera::Encoding;

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
        "{} MB free, a run of this config takes at most about {} MB",
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

/// Duration and size of the write test of the disk at most. Chosen.
const PROBE_DURATION: Duration = Duration::from_secs(1);
const PROBE_BYTES: u64 = 512 << 20;
/// Bytes forced to the disk at a time: about what a recording forces there each second.
const PROBE_BLOCK_BYTES: usize = 32 << 20;

/// Whether the disk below `folder` takes the images of a camera that sends `bytes_per_s`, in this layout. Writes up to 512 MiB,
/// and deletes them; none where the camera's rate is not known.
pub fn write_rate(folder: &Path, bytes_per_s: f64, encoding: Encoding) -> Option<Check> {
    if bytes_per_s <= 0.0 {
        return None;
    }
    let probe = folder.join(".write-probe");
    let rate = written_bytes_per_s(&probe);
    let removed = std::fs::remove_file(&probe);
    Some(match rate.and_then(|rate| removed.map(|()| rate)) {
        Ok(rate) => rate_finding(rate, bytes_per_s, likely_share(encoding)),
        Err(error) => {
            Check::doubtful("disk rate", format!("{} cannot be written to: {error}", probe.display()))
        }
    })
}

fn written_bytes_per_s(probe: &Path) -> std::io::Result<f64> {
    let mut block = vec![0; PROBE_BLOCK_BYTES];
    // Nothing that a file system could compress.
    ChaCha8Rng::seed_from_u64(1).fill_bytes(&mut block);
    let mut file = File::create(probe)?;
    let (begin, mut written) = (Instant::now(), 0);
    while begin.elapsed() < PROBE_DURATION && written < PROBE_BYTES {
        file.write_all(&block)?;
        file.sync_data()?;
        written += block.len() as u64;
    }
    Ok(written as f64 / begin.elapsed().as_secs_f64())
}

/// Share of the bytes received that a recording of noisy images takes; measured in `docs/recording.md`, and rounded up. Compressed
/// images are counted as one byte a pixel, of which a JPEG of high quality has less than this share.
fn likely_share(encoding: Encoding) -> f64 {
    match encoding {
        Encoding::Grey => 0.6,
        Encoding::Yuyv => 0.5,
        Encoding::Jpeg | Encoding::Png => 0.4,
    }
}

fn rate_finding(bytes_per_s: f64, most_bytes_per_s: f64, likely_share: f64) -> Check {
    let subject = "disk rate";
    let megabytes = |bytes: f64| (bytes * 1e-6).ceil();
    let (most, likely) = (megabytes(most_bytes_per_s), megabytes(likely_share * most_bytes_per_s));
    let finding = format!(
        "takes {:.0} MB/s; the camera's images are {likely} MB/s as recorded if they are noisy, {most} MB/s at most",
        bytes_per_s * 1e-6
    );
    let remedy = "another --runs-dir, fewer or smaller images";
    if bytes_per_s < likely_share * most_bytes_per_s {
        Check::bad(subject, format!("{finding}: the run would end when the queue is full; choose {remedy}"))
    } else if bytes_per_s < most_bytes_per_s {
        Check::doubtful(subject, format!("{finding}: little to spare; better {remedy}"))
    } else {
        Check::good(subject, finding)
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
    fn a_disk_is_judged_by_what_the_camera_sends() {
        let health = |disk| rate_finding(disk, 100e6, 0.6).health;
        assert_eq!(
            [health(150e6), health(80e6), health(50e6)],
            [Health::Good, Health::Doubtful, Health::Bad]
        );
        let slow = rate_finding(50e6, 110.6e6, 0.6).finding;
        assert!(slow.contains("50 MB/s") && slow.contains("67 MB/s") && slow.contains("111 MB/s"), "{slow}");
    }

    #[test]
    fn the_disk_is_measured_and_left_as_it_was() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(write_rate(folder.path(), 0.0, Encoding::Grey), None);
        let check = write_rate(folder.path(), 1.0, Encoding::Grey).expect("a finding");
        assert_eq!(check.health, Health::Good, "{}", check.finding);
        assert_eq!(folder.path().read_dir().expect("a folder").count(), 0);
        let nowhere = write_rate(&folder.path().join("none"), 1.0, Encoding::Grey).expect("a finding");
        assert_eq!(nowhere.health, Health::Doubtful, "{}", nowhere.finding);
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
