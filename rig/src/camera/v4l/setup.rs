//! Sets a V4L2 camera up and compares every answer with what was asked.

use ident::strict::Positive;
use rustix::io::Errno;
use v4l::control::{Control, Value};
use v4l::format::FieldOrder;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use crate::camera::{CameraConfig, CameraError, Encoding};

/// Automatic exposure mode, exposure time in units of 100 µs, and whether exposure may lower the image rate
/// (linux/v4l2-controls.h).
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
const EXPOSURE_AUTO_PRIORITY: u32 = 0x009a_0903;
const EXPOSURE_UNIT_S: f64 = 1e-4;
const EXPOSURE_MANUAL: i64 = 1;

/// What else cameras change by themselves: gain, white balance, focus.
const OTHER_AUTOMATICS: [(u32, &str); 3] =
    [(0x0098_0912, "automatic gain"), (0x0098_090c, "automatic white balance"), (0x009a_090c, "autofocus")];

/// A rate this far from the one asked for is refused, as a share.
const FPS_TOLERANCE: f64 = 0.05;

/// How the camera stands after setting up.
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
    if (got_fps - fps).abs() > FPS_TOLERANCE * fps {
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

/// Locks what moves by itself and sets the exposure; the exposure time as the camera says it.
fn expose(device: &Device, config: &CameraConfig, path: &str) -> Result<Option<Positive>, CameraError> {
    let refused = |what: String| CameraError::Refused { camera: path.into(), what };
    let has = |id| device.control(id).is_ok();
    let set = |id, value| device.set_control(Control { id, value });

    if config.lock_exposure {
        if has(EXPOSURE_AUTO) {
            set(EXPOSURE_AUTO, Value::Integer(EXPOSURE_MANUAL)).map_err(|error| {
                refused(format!(
                    "cannot switch automatic exposure off ({error}); set `lock_exposure = false`"
                ))
            })?;
        }
        for (id, name) in [(EXPOSURE_AUTO_PRIORITY, "exposure priority")].iter().chain(&OTHER_AUTOMATICS) {
            if has(*id)
                && let Err(error) = set(*id, Value::Boolean(false))
            {
                tracing::warn!("camera {path}: cannot switch {name} off: {error}");
            }
        }
    }
    if let Some(exposure) = config.exposure_s
        && has(EXPOSURE_ABSOLUTE)
    {
        let units = (exposure.get() / EXPOSURE_UNIT_S).round().max(1.0) as i64;
        set(EXPOSURE_ABSOLUTE, Value::Integer(units)).map_err(|error| {
            refused(format!("asked for an exposure of {} s, refused: {error}", exposure.get()))
        })?;
    }
    let read = device.control(EXPOSURE_ABSOLUTE).ok().and_then(|control| match control.value {
        Value::Integer(units) => Positive::new(units as f64 * EXPOSURE_UNIT_S),
        _ => None,
    });
    if read.is_none() && config.exposure_s.is_none() {
        tracing::warn!("camera {path}: exposure time unknown, taken as 0; set `exposure_s` in [camera]");
    }
    Ok(read.or(config.exposure_s))
}

#[cfg(test)]
mod tests {
    use super::*;

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
