//! A panic in any thread of a run, or in the coordinator itself: the servo is stopped, or left to the dead-man where its own thread
//! is gone, and the run ends with a fault.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use super::*;
use camera::{Camera, CameraInfo, fixtures};
use config::MotionKind;
use record::recording::RecorderOptions;
use servo::{BoardInfo, PulseProfile, ServoBoard, ServoError};

const SIZE_PX: (u32, u32) = (8, 4);
/// Images before the camera or the coordinator panics.
const IMAGES_BEFORE_PANIC: u32 = 20;

/// Where something panics.
#[derive(Debug, Clone, Copy, PartialEq)]
enum In {
    Camera,
    Servo,
    Recording,
    Coordinator,
}

struct Board {
    info: BoardInfo,
    panics: bool,
    stops: Arc<AtomicU32>,
}

impl ServoBoard for Board {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn arm(&mut self, _: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        Ok(())
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Ok(())
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        assert!(!self.panics, "a test");
        Ok(Vec::new())
    }

    fn stop(&mut self) -> StopOutcome {
        self.stops.fetch_add(1, Ordering::SeqCst);
        StopOutcome::Acknowledged
    }
}

struct Film {
    info: CameraInfo,
    count: u32,
    panics: In,
}

impl Camera for Film {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn next_image(&mut self, _: Duration) -> Result<CameraImage, CameraError> {
        std::thread::sleep(Duration::from_millis(5));
        self.count += 1;
        assert!(self.panics != In::Camera || self.count < IMAGES_BEFORE_PANIC, "a test");
        let image = fixtures::image(self.count, MonotonicNs::now(), SIZE_PX);
        Ok(CameraImage { data: vec![self.count as u8; (SIZE_PX.0 * SIZE_PX.1) as usize], ..image })
    }

    fn stop(&mut self) {}
}

/// Films until something panics; how that ended, and how often the board was stopped.
fn filmed(panics: In, folder: &Path) -> (std::thread::Result<Filmed>, u32) {
    let stops = Arc::new(AtomicU32::new(0));
    let info = BoardInfo { name: "test".into(), protocol_version: 1, boot_id: 1, channels: 1 };
    let board = Board { info, panics: panics == In::Servo, stops: Arc::clone(&stops) };
    let camera = fixtures::info(SIZE_PX);
    let path = folder.join("recording.mcap");
    let recorder = match panics {
        In::Recording => Recorder::panicking(&path),
        _ => {
            Recorder::create(&path, Some(&camera), RecorderOptions { reserve_bytes: 0, ..Default::default() })
                .unwrap()
        }
    };
    let setup = Setup {
        plan: Plan {
            kind: MotionKind::Driven,
            approach_s: 0.0,
            settle_s: 60.0,
            film_s: 1.0,
            profile_s: 1.0,
            lead_s: 0.4,
            release_timeout_s: 60.0,
            still_share: 0.0,
        },
        camera: Box::new(Film { info: camera, count: 0, panics }),
        stall: Duration::from_secs(5),
        drive: Some((Box::new(board), PulseProfile { tracks: Vec::new() })),
        recorder,
    };
    let mut images = 0;
    let mut listener = |notice: &Notice| {
        images += u32::from(matches!(notice, Notice::Image(_)));
        assert!(panics != In::Coordinator || images < IMAGES_BEFORE_PANIC, "a test");
    };
    let filming = std::panic::AssertUnwindSafe(|| {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_time().build().unwrap();
        runtime.block_on(film(setup, std::future::pending(), &mut listener))
    });
    let ended = std::panic::catch_unwind(filming);
    (ended, stops.load(Ordering::SeqCst))
}

#[test]
fn panic_of_any_thread_ends_the_run_with_the_servo_safe() {
    for (panics, says, outcome) in [
        (In::Camera, "camera thread panicked", StopOutcome::Acknowledged),
        (In::Servo, "servo thread panicked", StopOutcome::LeftToDeadMan),
        (In::Recording, "the recording's thread panicked", StopOutcome::Acknowledged),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (ended, stops) = filmed(panics, folder.path());
        let filmed = ended.unwrap_or_else(|_| panic!("{panics:?} took the coordinator with it"));
        let Ending::Fail(reason) = &filmed.ending else { panic!("{panics:?}: {filmed:?}") };
        assert!(reason.contains(says), "{panics:?}: {reason}");
        assert_eq!((filmed.servo, stops), (outcome, u32::from(panics != In::Servo)), "{panics:?}");
    }
}

#[test]
fn panic_of_the_coordinator_stops_the_servo_on_its_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let (ended, stops) = filmed(In::Coordinator, folder.path());
    assert!(ended.is_err());
    assert_eq!(stops, 1);
    // what was filmed before is there
    let recording = record::reader::Recording::open(&folder.path().join("recording.mcap")).unwrap();
    assert!(recording.filter(|item| item.is_ok()).count() >= IMAGES_BEFORE_PANIC as usize - 1);
}
