//! Sets a V4L2 camera up and compares every answer with what was asked.

use ground::strict::Positive;
use rustix::io::Errno;
use v4l::control::{Control, Value};
use v4l::format::FieldOrder;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use crate::{CameraConfig, CameraError, Encoding};

/// Automatic exposure mode, exposure time in units of 100 µs, and whether exposure may lower the image rate
/// (linux/v4l2-controls.h).
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
const EXPOSURE_AUTO_PRIORITY: u32 = 0x009a_0903;
const EXPOSURE_UNIT_S: f64 = 1e-4;
const EXPOSURE_MANUAL: i64 = 1;

/// Other controls that cameras change by themselves: gain, white balance, focus.
const OTHER_AUTOMATIC_CONTROLS: [(u32, &str); 3] =
    [(0x0098_0912, "automatic gain"), (0x0098_090c, "automatic white balance"), (0x009a_090c, "autofocus")];

/// Greatest relative difference of the image rate from the one asked for, chosen.
const FPS_TOLERANCE_SHARE: f64 = 0.05;
/// Greatest relative difference of the exposure time from the one asked for, chosen; the driver's next step is always accepted.
const EXPOSURE_TOLERANCE_SHARE: f64 = 0.1;

/// The camera's settings as read back after setting up.
pub(super) struct Setup {
    pub(super) name: String,
    pub(super) fps: f64,
    pub(super) stride: usize,
    pub(super) exposure_s: Option<Positive>,
}

/// Why the node cannot be opened, and what to do.
pub(super) fn open_error(camera: &str, error: &std::io::Error) -> CameraError {
    let what = match error.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::NOENT) => "no such device; `rig list` shows what is there".into(),
        Some(Errno::ACCESS | Errno::PERM) => {
            "no right to open it; add this user to the group `video` and log in again".into()
        }
        Some(Errno::BUSY) => "another program uses it; end that one (`fuser` names it)".into(),
        _ => format!("cannot be opened: {error}"),
    };
    CameraError::Refused { camera: camera.into(), what }
}

/// Format, rate, exposure: asked, read back, compared.
pub(super) fn configure(device: &Device, config: &CameraConfig, path: &str) -> Result<Setup, CameraError> {
    let refused = |what: String| CameraError::Refused { camera: path.into(), what };
    let failed = |doing: &str, error: std::io::Error| match error.raw_os_error().map(Errno::from_raw_os_error)
    {
        Some(Errno::BUSY) => {
            refused(format!("{doing}: another program uses it; end that one (`fuser` names it)"))
        }
        Some(Errno::NODEV) => CameraError::Gone { camera: path.into() },
        _ => refused(format!("{doing}: {error}")),
    };
    let caps = device.query_caps().map_err(|error| failed("asking what it is", error))?;
    let can = |flag| caps.capabilities.contains(flag);
    if !can(v4l::capability::Flags::VIDEO_CAPTURE) || !can(v4l::capability::Flags::STREAMING) {
        return Err(refused(format!(
            "{} is no camera that streams images; take another of its /dev/video nodes",
            caps.card
        )));
    }

    let asked = Format::new(config.width_px, config.height_px, fourcc(config)?);
    let got = device.set_format(&asked).map_err(|error| failed("setting the format", error))?;
    if (got.width, got.height, got.fourcc) != (asked.width, asked.height, asked.fourcc) {
        return Err(refused(format!(
            "asked for {}x{} {}, the driver gives {}x{} {}; change `width_px`, `height_px` or `format` in [camera] (`v4l2-ctl --list-formats-ext` lists what it can)",
            asked.width, asked.height, asked.fourcc, got.width, got.height, got.fourcc
        )));
    }
    if !matches!(got.field_order, FieldOrder::Any | FieldOrder::Progressive) {
        return Err(refused(format!(
            "gives interlaced images ({}); use a progressive input",
            got.field_order
        )));
    }

    let fps = config.fps()?;
    let got_rate = device
        .set_params(&Parameters::new(interval(fps)))
        .map_err(|error| failed("setting the image rate", error))?
        .interval;
    let got_fps = f64::from(got_rate.denominator) / f64::from(got_rate.numerator.max(1));
    if (got_fps - fps).abs() > FPS_TOLERANCE_SHARE * fps {
        return Err(refused(format!(
            "asked for {fps} images a second, the driver gives {got_fps:.2}; change `fps` or the size in [camera]"
        )));
    }

    let exposure_s = expose(device, config, path)?;
    Ok(Setup {
        name: format!("{} ({path})", caps.card),
        fps: got_fps,
        stride: got.stride as usize,
        exposure_s,
    })
}

fn fourcc(config: &CameraConfig) -> Result<FourCC, CameraError> {
    match config.format {
        Encoding::Grey => Ok(FourCC::new(b"GREY")),
        Encoding::Yuyv => Ok(FourCC::new(b"YUYV")),
        Encoding::Jpeg => Ok(FourCC::new(b"MJPG")),
        Encoding::Png => Err(CameraError::Refused {
            camera: "v4l".into(),
            what: "no camera sends `format = \"png\"`; use grey, yuyv or jpeg".into(),
        }),
    }
}

/// The period of `fps` images a second, to a thousandth of an image.
fn interval(fps: f64) -> Fraction {
    if fps.fract() == 0.0 {
        Fraction::new(1, fps as u32)
    } else {
        Fraction::new(1000, (fps * 1000.0).round() as u32)
    }
}

/// The controls of a camera.
trait Controls {
    fn read(&self, id: u32) -> std::io::Result<i64>;
    fn write(&self, id: u32, value: Value) -> std::io::Result<()>;
}

impl Controls for Device {
    fn read(&self, id: u32) -> std::io::Result<i64> {
        match self.control(id)?.value {
            Value::Integer(number) => Ok(number),
            Value::Boolean(is_on) => Ok(i64::from(is_on)),
            _ => Err(std::io::ErrorKind::InvalidData.into()),
        }
    }

    fn write(&self, id: u32, value: Value) -> std::io::Result<()> {
        self.set_control(Control { id, value })
    }
}

/// Locks what moves by itself and sets the exposure, reading each back; the exposure time as the camera says it.
fn expose(
    device: &impl Controls,
    config: &CameraConfig,
    path: &str,
) -> Result<Option<Positive>, CameraError> {
    let refused = |what: String| CameraError::Refused { camera: path.into(), what };
    let has = |id| device.read(id).is_ok();
    // Why it is not as it was set; none where it is.
    let set = |id, value: Value, number: i64| match device.write(id, value).and_then(|()| device.read(id)) {
        Ok(now) if now == number => None,
        Ok(now) => Some(format!("the driver takes {number} and keeps {now}")),
        Err(error) => Some(error.to_string()),
    };

    if config.lock_exposure {
        if has(EXPOSURE_AUTO)
            && let Some(why) = set(EXPOSURE_AUTO, Value::Integer(EXPOSURE_MANUAL), EXPOSURE_MANUAL)
        {
            return Err(refused(format!(
                "cannot switch automatic exposure off ({why}); set `lock_exposure = false`"
            )));
        }
        for (id, name) in
            [(EXPOSURE_AUTO_PRIORITY, "exposure priority")].iter().chain(&OTHER_AUTOMATIC_CONTROLS)
        {
            if has(*id)
                && let Some(why) = set(*id, Value::Boolean(false), 0)
            {
                tracing::warn!("camera {path}: cannot switch {name} off: {why}");
            }
        }
    }
    if let Some(exposure) = config.exposure_s
        && has(EXPOSURE_ABSOLUTE)
    {
        let asked = (exposure.get() / EXPOSURE_UNIT_S).round().max(1.0);
        let failed = |why: String| {
            refused(format!("asked for an exposure of {} s, {why}; change `exposure_s`", exposure.get()))
        };
        device
            .write(EXPOSURE_ABSOLUTE, Value::Integer(asked as i64))
            .map_err(|error| failed(format!("refused: {error}")))?;
        let got = device.read(EXPOSURE_ABSOLUTE).map_err(|error| failed(error.to_string()))? as f64;
        if (got - asked).abs() > (EXPOSURE_TOLERANCE_SHARE * asked).max(1.0) {
            return Err(failed(format!("the driver gives {} s", got * EXPOSURE_UNIT_S)));
        }
    }
    let units = device.read(EXPOSURE_ABSOLUTE).ok();
    let read = units.and_then(|units| Positive::new(units as f64 * EXPOSURE_UNIT_S));
    if read.is_none() && config.exposure_s.is_none() {
        tracing::warn!("camera {path}: exposure time unknown, taken as 0; set `exposure_s` in [camera]");
    }
    Ok(read.or(config.exposure_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    /// A camera that keeps its controls within limits: lowest, value, highest.
    struct Limited(RefCell<BTreeMap<u32, [i64; 3]>>);

    impl Controls for Limited {
        fn read(&self, id: u32) -> std::io::Result<i64> {
            self.0
                .borrow()
                .get(&id)
                .map(|[_, value, _]| *value)
                .ok_or(std::io::ErrorKind::InvalidInput.into())
        }

        fn write(&self, id: u32, value: Value) -> std::io::Result<()> {
            let asked = match value {
                Value::Integer(number) => number,
                Value::Boolean(is_on) => i64::from(is_on),
                _ => return Err(std::io::ErrorKind::InvalidInput.into()),
            };
            self.0
                .borrow_mut()
                .get_mut(&id)
                .map(|[lowest, value, highest]| *value = asked.clamp(*lowest, *highest))
                .ok_or(std::io::ErrorKind::InvalidInput.into())
        }
    }

    const GAIN_AUTOMATIC: u32 = OTHER_AUTOMATIC_CONTROLS[0].0;

    fn limited(controls: &[(u32, [i64; 3])]) -> Limited {
        Limited(RefCell::new(controls.iter().copied().collect()))
    }

    fn asking(exposure_s: f64) -> CameraConfig {
        CameraConfig { exposure_s: Positive::new(exposure_s), ..CameraConfig::default() }
    }

    #[test]
    fn automatics_are_off_and_the_exposure_is_what_the_camera_says() {
        let camera = limited(&[
            (EXPOSURE_AUTO, [0, 3, 3]),
            (EXPOSURE_ABSOLUTE, [3, 250, 2047]),
            (GAIN_AUTOMATIC, [0, 1, 1]),
        ]);
        let exposure_s = expose(&camera, &asking(0.004), "test").unwrap().unwrap();
        assert!((exposure_s.get() - 0.004).abs() < 1e-12);
        assert_eq!(
            [EXPOSURE_AUTO, EXPOSURE_ABSOLUTE, GAIN_AUTOMATIC].map(|id| camera.read(id).unwrap()),
            [1, 40, 0]
        );

        let camera = limited(&[(EXPOSURE_AUTO, [0, 3, 3])]);
        let as_it_is = CameraConfig { lock_exposure: false, ..CameraConfig::default() };
        assert_eq!(expose(&camera, &as_it_is, "test").unwrap(), None);
        assert_eq!(camera.read(EXPOSURE_AUTO).unwrap(), 3);
    }

    #[test]
    fn automatic_exposure_that_stays_on_and_another_exposure_time_are_refused() {
        let stubborn = limited(&[(EXPOSURE_AUTO, [2, 3, 3])]);
        let says = expose(&stubborn, &asking(0.004), "test").unwrap_err().to_string();
        assert!(says.contains("takes 1 and keeps 2") && says.contains("lock_exposure = false"), "{says}");

        let slow = limited(&[(EXPOSURE_ABSOLUTE, [50, 250, 2047])]);
        let says = expose(&slow, &asking(0.004), "test").unwrap_err().to_string();
        assert!(says.contains("asked for an exposure of 0.004 s, the driver gives 0.005 s"), "{says}");
    }

    #[test]
    fn interval_is_the_period_to_a_thousandth() {
        let period = |fps| {
            let fraction = interval(fps);
            (fraction.numerator, fraction.denominator)
        };
        assert_eq!(period(60.0), (1, 60));
        assert_eq!(period(29.97), (1000, 29970));
    }
}
