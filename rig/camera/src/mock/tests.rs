use super::*;
use ground::strict::{Finite, NonNegative, Positive};

/// How late a host under load may deliver an image \[s\], chosen.
const BUSY_HOST_DELAY_S: f64 = 0.25;

/// Every picture shows its own time in microseconds, in its first eight pixels.
struct Clockface;

impl Scene for Clockface {
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String> {
        let mut picture = GrayImage::new(16, 8);
        picture.as_mut()[..8].copy_from_slice(&at.0.to_le_bytes());
        Ok(picture)
    }
}

fn shown(image: &CameraImage) -> MonotonicNs {
    MonotonicNs(u64::from_le_bytes(image.data[..8].try_into().unwrap()))
}

const EXACT_STAMPS: StampTruth = StampTruth { latency_s: 0.0, jitter_s: 0.0, seed: 1 };
const TIMEOUT: Duration = Duration::from_millis(500);

fn config() -> CameraConfig {
    CameraConfig {
        width_px: 16,
        height_px: 8,
        fps: Positive::new(200.0),
        exposure_s: Positive::new(0.002),
        ..CameraConfig::default()
    }
}

fn camera(truth: StampTruth, faults: &[(f64, CameraFaultKind)]) -> MockCamera {
    let faults = faults
        .iter()
        .map(|&(at_s, kind)| CameraFault { at_s: NonNegative::new(at_s).unwrap(), kind })
        .collect();
    let mut camera = MockCamera::new(&config(), Box::new(Clockface), truth, faults).unwrap();
    camera.start().unwrap();
    camera
}

#[test]
fn images_come_in_real_time_and_show_their_mid_exposure() {
    let mut camera = camera(EXACT_STAMPS, &[]);
    let images: Vec<_> = (0..20).map(|_| camera.next_image(TIMEOUT).unwrap()).collect();
    let now = MonotonicNs::now();
    for image in &images {
        assert_eq!(image.mid_exposure, shown(image));
        assert_eq!(image.stamp.plus_seconds(0.001), image.mid_exposure);
        assert!(image.mid_exposure < now);
    }
    let last = images.last().unwrap();
    assert!(now.seconds_since(last.mid_exposure) < BUSY_HOST_DELAY_S);
    let period_s = last.mid_exposure.seconds_since(images[0].mid_exposure)
        / f64::from(last.sequence - images[0].sequence);
    assert!((period_s - 0.005).abs() < 1e-8, "{period_s}");
}

#[test]
fn unknown_latency_shows_as_late_stamps_and_a_configured_one_is_taken_back() {
    let truth = StampTruth { latency_s: 0.020, ..EXACT_STAMPS };
    let late = camera(truth, &[]).next_image(TIMEOUT).unwrap();
    assert!((late.mid_exposure.seconds_since(shown(&late)) - 0.020).abs() < 1e-8);

    let config = CameraConfig { latency_s: Finite::new(0.020).unwrap(), ..config() };
    let mut knowing = MockCamera::new(&config, Box::new(Clockface), truth, Vec::new()).unwrap();
    knowing.start().unwrap();
    let image = knowing.next_image(TIMEOUT).unwrap();
    assert!(image.mid_exposure.seconds_since(shown(&image)).abs() < 1e-8);
}

#[test]
fn jitter_spreads_stamps_as_stated_and_leaves_exposure_alone() {
    let mut camera = camera(StampTruth { jitter_s: 0.001, ..EXACT_STAMPS }, &[]);
    let errors: Vec<f64> = (0..100)
        .map(|_| {
            let image = camera.next_image(TIMEOUT).unwrap();
            image.mid_exposure.seconds_since(shown(&image))
        })
        .collect();
    let spread = (errors.iter().map(|e| e * e).sum::<f64>() / 100.0).sqrt();
    // 100 samples: the estimate of a standard deviation is itself good to 7 %; five of these.
    assert!((spread - 0.001).abs() < 0.000_35, "{spread}");
}

#[test]
fn jitter_is_another_one_in_each_film() {
    let first_error_s = || {
        let image = camera(StampTruth { jitter_s: 0.001, ..EXACT_STAMPS }, &[]).next_image(TIMEOUT).unwrap();
        image.mid_exposure.seconds_since(shown(&image))
    };
    assert_ne!(first_error_s(), first_error_s());
}

#[test]
fn program_that_is_away_for_long_loses_images_and_sees_the_gap() {
    let mut camera = camera(EXACT_STAMPS, &[]);
    let before = camera.next_image(TIMEOUT).unwrap().sequence;
    std::thread::sleep(Duration::from_millis(100));
    let kept: Vec<_> = (0..IMAGE_BUFFERS).map(|_| camera.next_image(TIMEOUT).unwrap().sequence).collect();
    assert_eq!(
        kept,
        (before + 1..=before + IMAGE_BUFFERS).collect::<Vec<_>>(),
        "what the buffers had room for"
    );
    let after = camera.next_image(TIMEOUT).unwrap().sequence;
    assert!(after > before + IMAGE_BUFFERS + 5, "{after}");
}

#[test]
fn camera_off_is_gone() {
    let mut camera = camera(EXACT_STAMPS, &[(0.0, CameraFaultKind::Off)]);
    assert!(matches!(camera.next_image(TIMEOUT), Err(CameraError::Gone { .. })));
}

#[test]
fn slow_camera_stalls_for_the_whole_timeout_and_no_longer() {
    let mut camera = camera(EXACT_STAMPS, &[(0.02, CameraFaultKind::Slow)]);
    let begun = MonotonicNs::now();
    let error = loop {
        match camera.next_image(Duration::from_millis(60)) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(matches!(error, CameraError::Stalled { waited_ms: 60, .. }));
    let took = MonotonicNs::now().seconds_since(begun);
    assert!((0.06..0.08 + BUSY_HOST_DELAY_S).contains(&took), "{took}");
}

#[test]
fn stuck_camera_repeats_its_picture_with_fresh_stamps() {
    let mut camera = camera(EXACT_STAMPS, &[(0.02, CameraFaultKind::Stuck)]);
    let images: Vec<_> = (0..20).map(|_| camera.next_image(TIMEOUT).unwrap()).collect();
    let last = &images[18..];
    assert_eq!(last[0].data, last[1].data);
    assert!(last[0].stamp < last[1].stamp);
    assert_ne!(images[0].data, images[1].data);
}

#[test]
fn intermittent_camera_leaves_gaps_in_the_count() {
    let mut camera = camera(EXACT_STAMPS, &[(0.0, CameraFaultKind::Intermittent)]);
    let sequences: Vec<_> = (0..40).map(|_| camera.next_image(TIMEOUT).unwrap().sequence).collect();
    assert!(sequences.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(sequences.windows(2).filter(|pair| pair[1] != pair[0] + 1).count() > 3, "{sequences:?}");
}

#[test]
fn garbage_spoils_bytes_but_never_the_header() {
    let mut camera = camera(EXACT_STAMPS, &[(0.0, CameraFaultKind::Garbage)]);
    let images: Vec<_> = (0..20).map(|_| camera.next_image(TIMEOUT).unwrap()).collect();
    assert!(images.iter().all(|image| (image.width_px, image.height_px) == (16, 8)));
    assert!(images.iter().any(|image| image.data.len() < 128));
    assert!(images.iter().any(|image| image.data[..].iter().skip(8).any(|&byte| byte != 0)));
}

#[test]
fn every_encoding_holds_the_same_picture() {
    let picture = GrayImage::from_fn(16, 8, |x, y| image::Luma([(x * 10 + y) as u8]));
    assert_eq!(encode(&picture, Encoding::Grey).unwrap(), *picture.as_raw());
    let yuyv = encode(&picture, Encoding::Yuyv).unwrap();
    assert!(yuyv.iter().step_by(2).eq(picture.as_raw()));
    let png = image::load_from_memory(&encode(&picture, Encoding::Png).unwrap()).unwrap();
    assert_eq!(png.to_luma8(), picture);
    let jpeg = image::load_from_memory(&encode(&picture, Encoding::Jpeg).unwrap()).unwrap().to_luma8();
    let worst = jpeg.as_raw().iter().zip(picture.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    // Quality 90 on a smooth ramp.
    assert!(worst <= 6, "{worst}");
}

#[test]
fn exposure_longer_than_a_period_is_refused() {
    let config = CameraConfig { exposure_s: Positive::new(0.01), ..config() };
    assert!(MockCamera::new(&config, Box::new(Clockface), EXACT_STAMPS, Vec::new()).is_err());
}
