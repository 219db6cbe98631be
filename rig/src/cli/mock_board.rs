//! `rig mock-board`: a mock board as a process of its own, to be killed, stalled and unplugged from outside.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use anyhow::Context as _;

use super::{Failure, Outcome};
use ground::clock::MonotonicNs;
use record::outputs::Outputs;
use servo::pulse_log::PulseLogWriter;
use servo::{BoardFault, MockBoard, MockOptions};

/// The port's name in the tank's folder.
pub const PORT_LINK: &str = "board";
/// The pulses' file in the tank's folder.
pub const PULSE_LOG: &str = "servo.log";

/// A mock servo board behind a pseudo-terminal. Prints the port to open; runs until killed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder shared with `rig mock-camera`: `board` becomes a link to the port, `servo.log` gets the pulses.
    #[arg(long)]
    tank: PathBuf,
    /// How fast the board's clock runs against this computer's \[ppm\].
    #[arg(long, default_value_t = 35.0, allow_negative_numbers = true)]
    drift_ppm: f64,
    /// A fault and when it begins, in seconds from now: off, stuck, garbage, slow or reset, e.g. `stuck@5`.
    #[arg(long = "fault", value_name = "KIND@SECONDS", value_parser = parse_fault)]
    faults: Vec<(f64, BoardFault)>,
}

fn parse_fault(text: &str) -> Result<(f64, BoardFault), String> {
    let (kind, at) = text.split_once('@').ok_or("a fault is KIND@SECONDS, e.g. stuck@5")?;
    let at_s = at.parse::<f64>().ok().filter(|s| s.is_finite() && *s >= 0.0);
    Ok((at_s.ok_or_else(|| format!("`{at}` is no time in seconds"))?, kind.parse()?))
}

/// Runs the board until the process is killed.
///
/// # Errors
/// [`Failure::Input`] when the tank's folder cannot be written to.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let board = start(args).map_err(Failure::Input)?;
    // Not the outcome's text: whoever started this waits for the line.
    let mut out = std::io::stdout().lock();
    std::io::Write::write_all(&mut out, format!("{}\n", board.port().display()).as_bytes())
        .map_err(Failure::internal)?;
    drop(out);
    loop {
        std::thread::sleep(Duration::from_secs(3600));
    }
}

fn start(args: &Args) -> anyhow::Result<MockBoard> {
    if !args.drift_ppm.is_finite() || args.drift_ppm.abs() > 1e5 {
        anyhow::bail!("--drift-ppm {} must be between -100000 and 100000", args.drift_ppm);
    }
    let tank = Outputs::default().folder(&args.tank, &[PORT_LINK, PULSE_LOG])?;
    tank.create()?;
    let log = args.tank.join(PULSE_LOG);
    let sink = PulseLogWriter::append(&log).with_context(|| format!("opening {}", log.display()))?;
    let options = MockOptions {
        drift_ppm: args.drift_ppm,
        faults: args.faults.clone(),
        run_start: OnceLock::from(MonotonicNs::now()).into(),
        ..MockOptions::default()
    };
    let board = MockBoard::start(options, Box::new(sink)).context("making a pseudo-terminal")?;
    link(board.port(), &args.tank.join(PORT_LINK))?;
    Ok(board)
}

/// Puts the link in place in one step, so that nobody ever finds none or half of one.
fn link(port: &Path, link: &Path) -> anyhow::Result<()> {
    if link.symlink_metadata().is_ok_and(|there| !there.is_symlink()) {
        anyhow::bail!(
            "{} is there and no link to a port: move it away, or choose another --tank",
            link.display()
        );
    }
    let new = link.with_extension("new");
    match std::fs::remove_file(&new) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
        _ => {}
    }
    std::os::unix::fs::symlink(port, &new)
        .and_then(|()| std::fs::rename(&new, link))
        .with_context(|| format!("linking {} to {}", link.display(), port.display()))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use servo::fixtures::example;
    use servo::pulse_log::{Logged, PulseLogReader};
    use servo::{SerialBoard, ServoBoard as _, ServoConfig, ServoError, StopOutcome};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn pulses_of_a_board_behind_the_link_reach_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let tank = folder.path().join("tank");
        let line = Line::parse_from(["mock-board", "--tank", tank.to_str().unwrap(), "--fault", "off@3600"]);
        // A second start takes the link over.
        let first = start(&line.args).unwrap();
        let second = start(&line.args).unwrap();
        assert_eq!(std::fs::read_link(tank.join(PORT_LINK)).unwrap(), second.port());
        drop(first);

        let before = MonotonicNs::now();
        let port = tank.join(PORT_LINK);
        let mut board = SerialBoard::open(port.to_str().unwrap(), &example()).unwrap();
        board.jog(0, 1600, 0.0).unwrap();
        let pulses = PulseLogReader::new(&tank.join(PULSE_LOG)).poll();
        let moved = |(_, logged): &&(_, _)| matches!(logged, Logged::Pulse { .. });
        let &(at, pulse) = pulses.iter().find(moved).unwrap();
        assert_eq!(pulse, Logged::Pulse { channel: 0, pulse_us: Some(1600) });
        assert!(at > before && at < MonotonicNs::now());
    }

    /// Not a test of its own: the process that the next one kills.
    #[test]
    fn board_in_a_process_of_its_own() {
        let Some(tank) = std::env::var_os("MOCK_BOARD_TANK") else { return };
        let args = Args { tank: tank.into(), drift_ppm: 35.0, faults: Vec::new() };
        let _board = start(&args).unwrap();
        std::thread::sleep(Duration::from_secs(60));
    }

    #[test]
    fn killed_board_is_lost_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut process = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "cli::mock_board::tests::board_in_a_process_of_its_own"])
            .env("MOCK_BOARD_TANK", folder.path())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let port = folder.path().join(PORT_LINK);
        let began = std::time::Instant::now();
        while !port.exists() {
            assert!(began.elapsed() < Duration::from_secs(20), "no port");
            std::thread::sleep(Duration::from_millis(10));
        }
        let config = ServoConfig { dead_man_ms: 2000, ..example() };
        let mut board = SerialBoard::open(port.to_str().unwrap(), &config).unwrap();
        board.jog(0, 1500, 0.0).unwrap();
        board.jog(0, 2000, 2.0).unwrap();
        process.kill().unwrap();
        process.wait().unwrap();
        let killed = std::time::Instant::now();
        let error = loop {
            match board.poll() {
                Err(error) => break error,
                Ok(_) => std::thread::sleep(Duration::from_millis(1)),
            }
        };
        println!("{error}, {:?} after the kill", killed.elapsed());
        assert!(matches!(error, ServoError::Lost { .. }), "{error}");
        // Far below the dead-man's time: the port itself says so.
        assert!(killed.elapsed() < Duration::from_millis(500));
        let asked = std::time::Instant::now();
        assert_eq!(board.stop(), StopOutcome::LeftToDeadMan);
        drop(board);
        assert!(asked.elapsed() < Duration::from_millis(500), "{:?}", asked.elapsed());
    }

    #[test]
    fn faults_are_kind_and_time() {
        assert_eq!(parse_fault("stuck@2.5"), Ok((2.5, BoardFault::Stuck)));
        assert_eq!(parse_fault("board-off@0"), Ok((0.0, BoardFault::Off)));
        for bad in ["stuck", "stuck@", "stuck@-1", "stuck@nan", "sticky@1"] {
            assert!(parse_fault(bad).is_err(), "{bad}");
        }
    }
}
