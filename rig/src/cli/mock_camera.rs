//! `rig mock-camera`: a mock camera as a process of its own, to be killed, stalled and unplugged from outside.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use ground::strict::NonNegative;

use super::mock_board::PULSE_LOG;
use super::{Failure, Outcome};
use camera::mock::{CameraFault, MockCamera};
use camera::socket;
use ground::clock::MonotonicNs;
use servo::PulseSink as _;
use servo::pulse_log::PulseLogReader;
use tank::Tank;

/// Whoever creates this file in the tank's folder asks for the release.
pub const RELEASE: &str = "release";

/// A mock camera on the socket `camera.sock` in the tank's folder. Prints the socket's path; runs until killed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder with `tank.toml` and the model it names. The pulses in its `servo.log` move the mechanism, as `rig
    /// mock-board` writes them; a file `release` that appears in it lets the mechanism go.
    #[arg(long)]
    tank: PathBuf,
    /// A fault and when it begins, in seconds from now: off, stuck, slow, intermittent or garbage, e.g. `slow@5`.
    #[arg(long = "fault", value_name = "KIND@SECONDS", value_parser = parse_fault)]
    faults: Vec<CameraFault>,
}

fn parse_fault(text: &str) -> Result<CameraFault, String> {
    let (kind, at) = text.split_once('@').ok_or("a fault is KIND@SECONDS, e.g. slow@5")?;
    let at_s = at.parse().ok().and_then(NonNegative::new);
    Ok(CameraFault {
        at_s: at_s.ok_or_else(|| format!("`{at}` is no time in seconds"))?,
        kind: kind.parse()?,
    })
}

/// Serves images until the process is killed.
///
/// # Errors
/// [`Failure::Input`] when the tank's folder does not describe a tank, [`Failure::Hardware`] when the camera is, by a
/// fault asked for, gone.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let tank = Tank::read(&args.tank).map_err(Failure::input)?;
    let listener = socket::listen(&args.tank)
        .with_context(|| format!("listening on {}", args.tank.join(socket::SOCKET_NAME).display()))
        .map_err(Failure::Input)?;
    tank.begin_run(MonotonicNs::now());
    // Not the outcome's text: whoever started this waits for the line.
    let mut out = std::io::stdout().lock();
    std::io::Write::write_all(
        &mut out,
        format!("{}\n", args.tank.join(socket::SOCKET_NAME).display()).as_bytes(),
    )
    .map_err(Failure::internal)?;
    drop(out);
    follow(tank.clone(), &args.tank).map_err(Failure::Input)?;
    for client in listener.incoming() {
        let client = client.map_err(Failure::internal)?;
        socket::serve(client, |config| {
            MockCamera::new(config, Box::new(tank.scene(config)), tank.stamp_truth(), args.faults.clone())
        })
        .or_else(|error| match error {
            // What the client asked for was wrong: the next may do better.
            camera::CameraError::Refused { .. } => {
                tracing::warn!("{error}");
                Ok(())
            }
            gone => Err(Failure::hardware(gone)),
        })?;
    }
    Ok(Outcome::default())
}

/// Interval at which the log is read. Chosen.
const LOG_POLL_INTERVAL: Duration = Duration::from_millis(2);
/// Age at which log entries count as complete where the log does not say so itself \[s\]: a board reads its clock every 5 ms.
const LOG_COMPLETE_AFTER_S: f64 = 0.012;
/// A board that has not reported completeness for this long is gone \[s\]. Chosen.
const BOARD_TIMEOUT_S: f64 = 0.3;

/// Feeds the tank, from a thread of its own, with the pulses in the folder's log and with the request to let go.
fn follow(mut tank: Tank, folder: &Path) -> anyhow::Result<()> {
    let mut log = PulseLogReader::new(&folder.join(PULSE_LOG));
    let release = folder.join(RELEASE);
    // One left over from an earlier run asks for nothing.
    match std::fs::remove_file(&release) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            return Err(error).with_context(|| format!("removing {}", release.display()));
        }
        _ => {}
    }
    let mut asked = false;
    // Until when the log says that it is complete, and since when it has said so.
    let mut known = (None, MonotonicNs::now());
    std::thread::Builder::new().name("follow-board".into()).spawn(move || {
        loop {
            let (now, complete_until) = (MonotonicNs::now(), log.complete_until());
            if complete_until != known.0 {
                known = (complete_until, now);
            }
            for (at, logged) in log.poll() {
                logged.send_to(at, &mut tank);
            }
            tank.complete(match known {
                (Some(until), since) if now.seconds_since(since) < BOARD_TIMEOUT_S => until,
                _ => now.plus_seconds(-LOG_COMPLETE_AFTER_S),
            });
            if !asked && release.exists() {
                asked = true;
                tank.ask_release(MonotonicNs::now());
            }
            std::thread::sleep(LOG_POLL_INTERVAL);
        }
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use ground::strict::Positive;

    use super::*;
    use camera::mock::CameraFaultKind;
    use camera::socket::SocketCamera;
    use camera::{Camera as _, CameraConfig, CameraError, CameraImage};
    use servo::pulse_log::PulseLogWriter;

    #[test]
    fn faults_are_kind_and_time() {
        let fault = parse_fault("slow@2.5").unwrap();
        assert_eq!((fault.kind, fault.at_s.get()), (CameraFaultKind::Slow, 2.5));
        assert_eq!(parse_fault("camera-off@0").unwrap().kind, CameraFaultKind::Off);
        for bad in ["slow", "slow@", "slow@-1", "slow@nan", "sleepy@1"] {
            assert!(parse_fault(bad).is_err(), "{bad}");
        }
    }

    const MODEL: &str = r#"
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" gravity="0 0 -9.81" density="1000" viscosity="0.00095"/>
  <worldbody>
    <body name="link1" gravcomp="0.8">
      <joint name="q1" type="hinge" axis="0 -1 0" damping="1e-4"/>
      <geom name="g1" type="box" size="0.005 0.0025 0.025" pos="0 0 -0.025" density="1250" fluidshape="ellipsoid"/>
      <site name="P0"/>
      <site name="P1" pos="0 0 -0.05"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="q1" kp="0.5" kv="5e-3"/></actuator>
</mujoco>"#;

    const TANK: &str = r#"
model = "model.xml"
[[servo]]
actuator = "servo"
us_per_rad = 500.0
[view]
metres_per_pixel = 0.001
origin_px = [80.0, 20.0]
noise_grey = 0.0
"#;

    fn tank() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("model.xml"), MODEL).unwrap();
        std::fs::write(folder.path().join("tank.toml"), TANK).unwrap();
        folder
    }

    /// Where the child process of the tests below finds its tank.
    const CHILD: &str = "RIG_TEST_TANK";

    #[test]
    #[ignore = "the child process of the tests below"]
    fn camera_process() {
        let tank = PathBuf::from(std::env::var_os(CHILD).unwrap());
        run(&Args { tank, faults: Vec::new() }).unwrap();
    }

    struct Process(std::process::Child);

    impl Process {
        fn start(tank: &Path) -> Self {
            let child = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "--ignored", "cli::mock_camera::tests::camera_process"])
                .env(CHILD, tank)
                .stdout(std::process::Stdio::null())
                .spawn()
                .unwrap();
            let deadline = Instant::now() + Duration::from_secs(20);
            while !tank.join(socket::SOCKET_NAME).exists() {
                assert!(Instant::now() < deadline, "the mock camera never listened");
                std::thread::sleep(Duration::from_millis(5));
            }
            Self(child)
        }

        fn signal(&self, signal: rustix::process::Signal) {
            let pid = rustix::process::Pid::from_raw(self.0.id().cast_signed()).unwrap();
            rustix::process::kill_process(pid, signal).unwrap();
        }
    }

    impl Drop for Process {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    fn connect(tank: &Path) -> SocketCamera {
        let mut camera = SocketCamera::open(
            &CameraConfig {
                tank: Some(tank.into()),
                width_px: 160,
                height_px: 90,
                fps: Positive::new(50.0),
                exposure_s: Positive::new(0.002),
                ..CameraConfig::default()
            },
            Path::new(""),
        )
        .unwrap();
        camera.start().unwrap();
        camera
    }

    const TIMEOUT: Duration = Duration::from_millis(1500);

    fn until_it_fails(camera: &mut SocketCamera) -> CameraError {
        (0..10_000).find_map(|_| camera.next_image(TIMEOUT).err()).unwrap()
    }

    #[test]
    fn stopped_process_is_a_stall_a_continued_one_goes_on_and_a_killed_one_is_gone() {
        let tank = tank();
        let process = Process::start(tank.path());
        let mut camera = connect(tank.path());
        let before = camera.next_image(TIMEOUT).unwrap();

        process.signal(rustix::process::Signal::STOP);
        assert!(matches!(until_it_fails(&mut camera), CameraError::Stalled { waited_ms: 1500, .. }));
        process.signal(rustix::process::Signal::CONT);
        // What was exposed while it stood still is lost, and counted; an image on its way may still come.
        let mut sequences = vec![before.sequence];
        sequences.extend((0..20).map(|_| camera.next_image(TIMEOUT).unwrap().sequence));
        assert!(sequences.windows(2).any(|pair| pair[1] > pair[0] + 10), "{sequences:?}");

        process.signal(rustix::process::Signal::KILL);
        assert!(matches!(until_it_fails(&mut camera), CameraError::Gone { .. }));
    }

    /// Column of the darkest pixel in the lowest row that shows the mechanism: its tip \[px\].
    fn tip_column(image: &CameraImage) -> usize {
        let row = image.data.chunks(160).rev().find(|row| row.iter().any(|&grey| grey < 100)).unwrap();
        row.iter().enumerate().min_by_key(|(_, grey)| **grey).unwrap().0
    }

    #[test]
    fn pulses_in_the_log_move_what_the_camera_sees_and_a_longer_pulse_moves_it_right() {
        let tank = tank();
        let _process = Process::start(tank.path());
        let mut camera = connect(tank.path());
        let before = camera.next_image(TIMEOUT).unwrap();
        assert!(tip_column(&before).abs_diff(80) <= 5, "{}", tip_column(&before));

        let mut board = PulseLogWriter::append(&tank.path().join(PULSE_LOG)).unwrap();
        board.pulse(0, Some(1750), MonotonicNs::now());
        let after = (0..60).map(|_| camera.next_image(TIMEOUT).unwrap()).last().unwrap();
        // 0.5 rad counter-clockwise take the tip of a hanging link of 50 px 24 px to the right.
        assert!(tip_column(&after).abs_diff(104) <= 8, "{}", tip_column(&after));
    }
}
