//! Opens the devices that a config names: board and camera, with the simulated tank behind mock ones and the recorded run behind
//! replayed ones.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use ground::strict;

use super::error::RunError;
use super::listener::{Listener, Notice};
use super::recorded;
use camera::mock::{CameraFault, Scene, StampTruth};
use camera::{self, Camera};
use config::{FaultKind, RigConfig};
use ground::claim::Claim;
use ground::clock::MonotonicNs;
use ground::hold::Latch;
use record::folder::RunFolder;
use servo::PulseSink;
use servo::bus::{BusFault, BusOptions};
use servo::{self, BoardFault, BoardKind, HeldBoard, MockOptions, ServoBoard, ServoConfig};
use tank::{Tank, TankError};

/// The devices of a run.
pub struct Opened {
    /// The camera, not started yet.
    pub camera: Box<dyn Camera>,
    /// The board, where there is one.
    pub board: Option<Box<dyn ServoBoard>>,
    /// Lets go of a simulated mechanism.
    pub hand: Option<Hand>,
    tank: Option<Tank>,
    run_start: Arc<OnceLock<MonotonicNs>>,
    /// The claim on the port, to be held until the servo has stopped.
    pub claim: Option<Claim>,
}

/// Lets go of the mechanism in a simulated tank, as a person would of a real one.
#[derive(Debug)]
pub struct Hand(Tank);

impl Listener for Hand {
    fn hear(&mut self, notice: &Notice) {
        if matches!(notice, Notice::LetGo) {
            self.0.ask_release(MonotonicNs::now());
        }
    }
}

impl Opened {
    /// The run begins at `origin`: faults of the mocks are timed from there.
    pub fn begin(&mut self, origin: MonotonicNs) {
        if let Some(tank) = &self.tank {
            tank.begin_run(origin);
        }
        // Set once: a second run opens its devices again.
        let _ = self.run_start.set(origin);
    }
}

/// The latch of the rig of `config`, whose runs are in `runs_dir`: it says whether the rig is held.
pub fn latch(config: &RigConfig, runs_dir: Option<&Path>) -> Latch {
    Latch::of(runs_dir, config.servo.as_ref().and_then(ServoConfig::outside_port))
}

/// Opens all devices of `config`; relative paths start at `base`.
///
/// # Errors
/// [`RunError`] naming the device, and what to do; [`ServoError::Held`](servo::ServoError::Held) where nothing may move, whether there
/// is a board or not.
pub fn open(config: &RigConfig, base: &Path, runs_dir: Option<&Path>) -> Result<Opened, RunError> {
    if let Some(hold) = latch(config, runs_dir).held() {
        return Err(servo::ServoError::Held(hold).into());
    }
    let tank = tank(config, base)?;
    let run_start = Arc::default();
    let (board, port) = match &config.servo {
        Some(servo) if servo.kind != BoardKind::None => {
            let (board, claim) = open_board(config, base, runs_dir, servo, tank.as_ref(), &run_start)?;
            (Some(board), claim)
        }
        _ => (None, None),
    };
    let camera = open_camera(config, base, tank.as_ref(), &run_start)?;
    let hand = tank.clone().map(Hand);
    Ok(Opened { camera, board, hand, tank, run_start, claim: port })
}

/// Opens the board alone.
///
/// # Errors
/// As [`open`].
pub fn board(
    config: &RigConfig,
    base: &Path,
    runs_dir: Option<&Path>,
) -> Result<(Box<dyn ServoBoard>, Option<Claim>), RunError> {
    let none = ServoConfig::none();
    let servo = config.servo.as_ref().unwrap_or(&none);
    open_board(config, base, runs_dir, servo, tank(config, base)?.as_ref(), &Arc::default())
}

/// Opens the camera alone, for a preview; mocks and recordings are timed from now.
///
/// # Errors
/// As [`open`].
pub fn camera(config: &RigConfig, base: &Path) -> Result<Box<dyn Camera>, RunError> {
    let tank = tank(config, base)?;
    open_camera(config, base, tank.as_ref(), &Arc::new(OnceLock::from(MonotonicNs::now())))
}

fn open_camera(
    config: &RigConfig,
    base: &Path,
    tank: Option<&Tank>,
    run_start: &Arc<OnceLock<MonotonicNs>>,
) -> Result<Box<dyn Camera>, RunError> {
    let mock = tank.map(|tank| -> (Box<dyn Scene>, StampTruth, Vec<CameraFault>) {
        (Box::new(tank.scene(&config.camera)), tank.stamp_truth(), camera_faults(config))
    });
    let film = replayed(config, base)?.map(|run| recorded::film(&run, run_start)).transpose()?.flatten();
    Ok(camera::open(camera::Opening { config: &config.camera, folder: base, mock, film })?)
}

fn replayed(config: &RigConfig, base: &Path) -> Result<Option<RunFolder>, RunError> {
    Ok(config.replay.as_ref().map(|replay| RunFolder::open(&base.join(&replay.run))).transpose()?)
}

fn tank(config: &RigConfig, base: &Path) -> Result<Option<Tank>, RunError> {
    let Some(mock) = &config.mock else { return Ok(None) };
    let path = base.join(&mock.tank);
    let tank = strict::read(&path).map_err(TankError::Config)?;
    Ok(Some(Tank::new(&tank, path.parent().unwrap_or(base))?))
}

fn open_board(
    config: &RigConfig,
    base: &Path,
    runs_dir: Option<&Path>,
    servo: &ServoConfig,
    tank: Option<&Tank>,
    run_start: &Arc<OnceLock<MonotonicNs>>,
) -> Result<(Box<dyn ServoBoard>, Option<Claim>), RunError> {
    // claimed before the latch is read: whoever stops the rig waits until nobody has the port
    let claim = servo.outside_port().map(Claim::take_port).transpose()?;
    let options = MockOptions {
        faults: board_faults(config),
        run_start: Arc::clone(run_start),
        ..MockOptions::default()
    };
    let sink: Box<dyn PulseSink> = match tank {
        Some(tank) => Box::new(tank.clone()),
        None => Box::new(Nowhere),
    };
    let replay = replayed(config, base)?.map(|run| recorded::board(&run, run_start)).transpose()?.flatten();
    let bus = BusOptions::of(servo).map(|bus| BusOptions {
        faults: bus_faults(config),
        run_start: Arc::clone(run_start),
        ..bus
    });
    let opening = servo::Opening { config: servo, mock: (options, sink), bus, replay };
    let board = HeldBoard::open(latch(config, runs_dir), runs_dir, || servo::open(opening))?;
    Ok((Box::new(board), claim))
}

fn board_faults(config: &RigConfig) -> Vec<(f64, BoardFault)> {
    let faults = config.mock.iter().flat_map(|mock| &mock.faults);
    faults
        .filter_map(|fault| match fault.kind {
            FaultKind::Board(kind) => Some((fault.at_s.get(), kind)),
            FaultKind::Bus(_) | FaultKind::Camera(_) => None,
        })
        .collect()
}

fn bus_faults(config: &RigConfig) -> Vec<(f64, BusFault)> {
    let faults = config.mock.iter().flat_map(|mock| &mock.faults);
    faults
        .filter_map(|fault| match fault.kind {
            FaultKind::Bus(kind) => Some((fault.at_s.get(), kind)),
            FaultKind::Board(_) | FaultKind::Camera(_) => None,
        })
        .collect()
}

fn camera_faults(config: &RigConfig) -> Vec<CameraFault> {
    let faults = config.mock.iter().flat_map(|mock| &mock.faults);
    faults
        .filter_map(|fault| match fault.kind {
            FaultKind::Camera(kind) => Some(CameraFault { at_s: fault.at_s, kind }),
            FaultKind::Board(_) | FaultKind::Bus(_) => None,
        })
        .collect()
}

/// A mock board without a tank moves nothing.
struct Nowhere;

impl PulseSink for Nowhere {
    fn pulse(&mut self, _: u8, _: Option<u16>, _: MonotonicNs) {}
}
