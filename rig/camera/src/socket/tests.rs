use super::*;
use crate::fixtures;
use crate::mock::{CameraFault, CameraFaultKind, MockCamera, Scene, StampTruth};
use ground::clock::MonotonicNs;
use ground::strict::{NonNegative, Positive};

struct Grey;

impl Scene for Grey {
    fn picture(&mut self, at: MonotonicNs) -> Result<image::GrayImage, String> {
        Ok(image::GrayImage::from_pixel(64, 48, image::Luma([at.0 as u8])))
    }
}

const TIMEOUT: Duration = Duration::from_millis(300);

fn config(tank: &Path) -> CameraConfig {
    CameraConfig {
        tank: Some(tank.into()),
        width_px: 64,
        height_px: 48,
        fps: Positive::new(100.0),
        ..CameraConfig::default()
    }
}

/// A server for one client in a thread of its own.
fn server(tank: &Path, faults: Vec<CameraFault>) -> std::thread::JoinHandle<Result<(), CameraError>> {
    let listener = listen(tank).unwrap();
    let truth = StampTruth { latency_s: 0.0, jitter_s: 0.0, seed: 1 };
    std::thread::spawn(move || {
        let (client, _) = listener.accept().unwrap();
        serve(client, |config| MockCamera::new(config, Box::new(Grey), truth, faults))
    })
}

fn fault(at_s: f64, kind: CameraFaultKind) -> Vec<CameraFault> {
    vec![CameraFault { at_s: NonNegative::new(at_s).unwrap(), kind }]
}

fn connected(tank: &Path) -> Result<SocketCamera, CameraError> {
    SocketCamera::open(&config(tank), Path::new(""))
}

#[test]
fn images_arrive_as_they_were_taken_and_the_server_ends_with_its_client() {
    let tank = tempfile::tempdir().unwrap();
    let server = server(tank.path(), Vec::new());
    let mut camera = connected(tank.path()).unwrap();
    assert_eq!((camera.info().width_px, camera.info().fps), (64, 100.0));
    camera.start().unwrap();
    for _ in 0..10 {
        let image = camera.next_image(TIMEOUT).unwrap();
        assert_eq!(image.data, vec![image.mid_exposure.0 as u8; 64 * 48]);
    }
    camera.stop();
    server.join().unwrap().unwrap();
}

#[test]
fn server_that_goes_is_gone() {
    let tank = tempfile::tempdir().unwrap();
    let server = server(tank.path(), fault(0.05, CameraFaultKind::Off));
    let mut camera = connected(tank.path()).unwrap();
    camera.start().unwrap();
    let error = loop {
        match camera.next_image(TIMEOUT) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(matches!(error, CameraError::Gone { .. }), "{error}");
    assert!(matches!(server.join().unwrap(), Err(CameraError::Gone { .. })));
}

#[test]
fn silent_server_is_a_stall() {
    let tank = tempfile::tempdir().unwrap();
    let server = server(tank.path(), fault(0.05, CameraFaultKind::Slow));
    let mut camera = connected(tank.path()).unwrap();
    camera.start().unwrap();
    let error = loop {
        match camera.next_image(TIMEOUT) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(matches!(error, CameraError::Stalled { waited_ms: 300, .. }), "{error}");
    camera.stop();
    server.join().unwrap().unwrap();
}

#[test]
fn message_that_comes_in_pieces_across_timeouts_is_put_together() {
    let (mut far, near) = UnixStream::pair().unwrap();
    let mut camera = SocketCamera {
        info: fixtures::info((2, 1)),
        path: PathBuf::new(),
        config: CameraConfig::default(),
        stream: Some(near),
        pending: Vec::new(),
    };
    let image = fixtures::image(5, MonotonicNs(1), (2, 1));
    let message = [wire::header(&image).as_slice(), &image.data].concat();
    let brief = Duration::from_millis(5);
    for piece in message[..37].chunks(10) {
        far.write_all(piece).unwrap();
        assert!(matches!(camera.next_image(brief), Err(CameraError::Stalled { .. })));
    }
    far.write_all(&message[37..]).unwrap();
    let got = camera.next_image(brief).unwrap();
    assert_eq!((got.sequence, got.data), (5, vec![5, 5]));
}

#[test]
fn refusal_of_the_camera_reaches_the_client_with_its_reason() {
    let tank = tempfile::tempdir().unwrap();
    let server = server(tank.path(), Vec::new());
    let config = CameraConfig { exposure_s: Positive::new(0.5), ..config(tank.path()) };
    let error = SocketCamera::open(&config, Path::new("")).err().unwrap().to_string();
    assert!(error.contains("0.5 s") && error.contains("100"), "{error}");
    assert!(server.join().unwrap().is_err());
}

#[test]
fn nobody_listening_is_told_with_what_to_start() {
    let tank = tempfile::tempdir().unwrap();
    let error = connected(tank.path()).err().unwrap().to_string();
    assert!(error.contains("rig mock-camera"), "{error}");
}

#[test]
fn second_server_on_a_tank_is_refused_and_a_dead_ones_socket_replaced() {
    let tank = tempfile::tempdir().unwrap();
    let first = listen(tank.path()).unwrap();
    assert_eq!(listen(tank.path()).unwrap_err().kind(), ErrorKind::AddrInUse);
    drop(first);
    assert!(listen(tank.path()).is_ok());
}
