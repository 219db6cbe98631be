//! How late a pseudo-terminal passes bytes on, and who was waiting then: the threads at its ends, or the kernel's own that lies between.
//! Load the machine as you like and run `cargo run --release -p system-tests --example pty_lateness -- SECONDS`.

#![expect(clippy::print_stdout, reason = "prints what it measures")]

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Between two chunks of bytes.
const PERIOD: Duration = Duration::from_millis(5);
/// So often the waits are noted anew \[s\].
const NOTE_EVERY_S: f64 = 0.5;

/// How long each thread that passes bytes on has waited for a processor so far \[s\], by its name.
fn kernel_waits_s() -> BTreeMap<String, f64> {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let wait = |folder: std::path::PathBuf| {
        let name = std::fs::read_to_string(folder.join("comm")).ok()?;
        let pid = folder.file_name()?.to_str()?.to_owned();
        name.starts_with("kworker/u").then(|| Some((pid, waited_s(&folder.join("schedstat"))?))).flatten()
    };
    processes.filter_map(|process| wait(process.path())).collect()
}

fn waited_s(schedstat: &std::path::Path) -> Option<f64> {
    let text = std::fs::read_to_string(schedstat).ok()?;
    Some(text.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1e-9)
}

fn main() {
    let seconds: f64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(60.0);
    let near = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
    rustix::pty::grantpt(&near).expect("its right");
    rustix::pty::unlockpt(&near).expect("its lock");
    let name = rustix::pty::ptsname(&near, Vec::new()).expect("its name");
    let far = rustix::fs::open(name.as_c_str(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty())
        .expect("its other end");
    let mut raw = tcgetattr(&far).expect("its settings");
    raw.make_raw();
    tcsetattr(&far, OptionalActions::Now, &raw).expect("its settings");

    let (began, over) = (Instant::now(), AtomicBool::new(false));
    let now_s = || began.elapsed().as_secs_f64();
    // The longest that a thread which only sleeps was kept from it, and the writer with it [ns].
    let [writer_ns, bystander_ns] = [AtomicU64::new(0), AtomicU64::new(0)];
    let sleep = |longest: &AtomicU64| {
        let asleep = Instant::now();
        std::thread::sleep(PERIOD);
        longest.fetch_max((asleep.elapsed() - PERIOD).as_nanos() as u64, Ordering::Relaxed);
    };
    let (mut lateness_s, mut worst) = (Vec::new(), (0.0, 0.0, 0.0));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                rustix::io::write(&near, &now_s().to_le_bytes()).expect("bytes go in");
                sleep(&writer_ns);
            }
            // The reader may be waiting for one more.
            let _ = rustix::io::write(&near, &now_s().to_le_bytes());
        });
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                sleep(&bystander_ns);
            }
        });
        let own = std::path::Path::new("/proc/thread-self/schedstat");
        let own_s = || waited_s(own).unwrap_or(0.0);
        let (mut noted_s, mut kernel_s, mut reader_s) = (0.0, kernel_waits_s(), own_s());
        while now_s() < seconds {
            let mut stamp = [0; 8];
            rustix::io::read(&far, &mut stamp).expect("bytes come out");
            let late_s = now_s() - f64::from_le_bytes(stamp);
            lateness_s.push(late_s);
            if late_s > worst.0 {
                let waits = kernel_waits_s().into_iter().filter_map(|(pid, s)| Some(s - kernel_s.get(&pid)?));
                worst = (late_s, waits.fold(0.0, f64::max), own_s() - reader_s);
            } else if now_s() - noted_s > NOTE_EVERY_S && late_s < 0.02 {
                (noted_s, kernel_s, reader_s) = (now_s(), kernel_waits_s(), own_s());
            }
        }
        over.store(true, Ordering::Relaxed);
    });
    let beyond = |limit_s: f64| lateness_s.iter().filter(|&&late_s| late_s > limit_s).count();
    let longest_s = |of: &AtomicU64| of.load(Ordering::Relaxed) as f64 * 1e-9;
    let (late_s, kernel_s, reader_s) = worst;
    println!(
        "{} chunks, {} later than 20 ms, {} than 100 ms; the latest by {late_s:.3} s, of which a kernel's thread waited {kernel_s:.3} s for a \
         processor and the reader {reader_s:.3} s; the writer was never kept waiting for more than {:.3} s, a bystander {:.3} s",
        lateness_s.len(),
        beyond(0.02),
        beyond(0.1),
        longest_s(&writer_ns),
        longest_s(&bystander_ns)
    );
}
