//! Priors and bounds of a fit and a diagnosis from the measured latency of the camera and the calibration of the servo.

use camera::CameraConfig;
use ground::strict::{Finite, Positive};
use ident::experiment::{DiagnoseConfig, FitConfig, Prior};
use servo::ServoConfig;
use servo::calibration::{Measured, ServoCalibration};

/// The error of the images' times, as a parameter of a fit.
const CLOCK_ERROR_PARAMETER: &str = "camera_delay/delay";
/// Bound of that error in standard deviations. Chosen.
const CLOCK_ERROR_LIMIT_SIGMAS: f64 = 4.0;
/// Largest bound of that error: the cause's own \[s\].
const CLOCK_ERROR_LIMIT_S: f64 = 0.2;
/// Least standard deviation of a prior of the gain, as a share: pulses are whole microseconds, and a camera's tilt does not average out.
const GAIN_STD_MIN_SHARE: f64 = 1e-3;
/// A dead band of less than this many standard errors is ignored. Chosen.
const DEADBAND_MIN_SIGMAS: f64 = 3.0;

/// Adds priors and bounds from the measured latency of the camera and the calibrated servo. Those that `fit` and `diagnose` have stay.
pub fn put_into(
    camera: &CameraConfig,
    servo: Option<&ServoConfig>,
    fit: &mut FitConfig,
    diagnose: &mut DiagnoseConfig,
) {
    put_clock_into(camera, fit);
    if let Some(servo) = servo.and_then(calibrated) {
        put_servo_into(servo, fit, diagnose);
    }
}

/// Limits the error of the images' clock against the servo's to what is measured. A prior alone is not enough: of two delays that explain
/// the runs equally well, also held-out ones, a fit never gives up the one that it has already.
fn put_clock_into(camera: &CameraConfig, fit: &mut FitConfig) {
    let finite = |x: f64| Finite::new(x).unwrap_or_else(|| unreachable!("{x} is finite"));
    if let Some(std) = camera.latency_std_s {
        let most_s = (CLOCK_ERROR_LIMIT_SIGMAS * std.get()).min(CLOCK_ERROR_LIMIT_S);
        fit.prior.entry(CLOCK_ERROR_PARAMETER.into()).or_insert(Prior { mean: finite(0.0), std });
        fit.bounds.entry(CLOCK_ERROR_PARAMETER.into()).or_insert([finite(-most_s), finite(most_s)]);
    }
}

/// The calibration of the only driving servo; none with several, as a model has one set of servo parameters for all.
fn calibrated(servo: &ServoConfig) -> Option<&ServoCalibration> {
    let mut driven = servo.driven();
    let (channel, _) = driven.next()?;
    if driven.next().is_some() { None } else { channel.measured.as_deref() }
}

/// What a servo's calibration tells a fit beforehand: the gain, which the table has put right, is off by no more than the table is; lag
/// and play are as measured. A look at the pulse comes up to a period late, half of it on average.
/// Looks and a limit of the rate are not in a model until a diagnosis puts them there, and their numbers are known then.
fn put_servo_into(servo: &ServoCalibration, fit: &mut FitConfig, diagnose: &mut DiagnoseConfig) {
    let prior = |mean: f64, std: f64| Some(Prior { mean: Finite::new(mean)?, std: Positive::new(std)? });
    let gain_std = (servo.us_per_rad.std.get() / servo.us_per_rad.value.get()).max(GAIN_STD_MIN_SHARE);
    let lag_s = servo.lag_s.value.get().max(0.0);
    let period_s = servo.refresh_s.map_or(0.0, |period| period.value.get());
    let delay_s = (servo.delay_s.value.get() + period_s / 2.0).max(0.0);
    let delay_std_s = servo.delay_s.std.get().hypot(period_s / 12_f64.sqrt());
    let play = servo.deadband_rad;
    let has_play = play.value.get() > DEADBAND_MIN_SIGMAS * play.std.get();
    let whole = |measured: Measured| prior(measured.value.get(), measured.std.get());
    let known = [
        ("servo_gain/scale", prior(0.0, gain_std)),
        ("servo_lag/time", prior(lag_s, servo.lag_s.std.get())),
        ("servo_delay/delay", prior(delay_s, delay_std_s)),
        ("backlash/half_width", whole(play).filter(|_| has_play)),
    ];
    for (name, prior) in known {
        if let Some(prior) = prior {
            fit.prior.entry(name.into()).or_insert(prior);
        }
    }
    let suspected = [
        ("servo_refresh/period", servo.refresh_s.and_then(whole)),
        ("servo_rate_limit/rate", servo.rate_limit_rad_per_s.and_then(whole)),
    ];
    for (name, prior) in suspected {
        if let Some(prior) = prior {
            diagnose.prior.entry(name.into()).or_insert(prior);
        }
    }
}

#[cfg(test)]
mod tests {
    use ground::strict::NonNegative;
    use servo::calibration::{Row, Table};

    use super::*;

    #[test]
    fn what_was_measured_is_what_a_fit_begins_with() {
        let measured = |value: f64, std: f64| Measured {
            value: Finite::new(value).unwrap(),
            std: Positive::new(std).unwrap(),
        };
        let row = |[pulse, angle]: [f64; 2]| Row {
            pulse_us: Positive::new(pulse).unwrap(),
            angle_rad: Finite::new(angle).unwrap(),
            std_rad: Positive::literal(1e-3),
        };
        let table = Table::try_from(vec![row([1000.0, 0.8]), row([2000.0, -0.8])]).unwrap();
        let calibration = ServoCalibration {
            date: "2026-11-26T00:00:00Z".into(),
            channel: "servo".into(),
            run: "run".into(),
            mirrored: true,
            zero_pulse_us: measured(1500.0, 0.1),
            us_per_rad: measured(600.0, 0.1),
            off_line_rad: NonNegative::new(0.0).unwrap(),
            deadband_rad: measured(0.006, 0.0001),
            repeatability_rad: Positive::literal(1e-4),
            lag_s: measured(0.02, 0.001),
            delay_s: measured(0.001, 0.0005),
            rate_limit_rad_per_s: None,
            refresh_s: Some(measured(0.02, 0.00002)),
            table,
        };
        let (mut fit, mut diagnose) = (FitConfig::default(), DiagnoseConfig::default());
        put_servo_into(&calibration, &mut fit, &mut diagnose);
        let of = |name: &str| [fit.prior[name].mean.get(), fit.prior[name].std.get()];
        assert_eq!(of("servo_lag/time"), [0.02, 0.001]);
        assert_eq!(of("servo_gain/scale"), [0.0, 1e-3]);
        assert_eq!(of("backlash/half_width"), [0.006, 0.0001]);
        // a command waits for the next look from 0 to 20 ms
        assert_eq!(of("servo_delay/delay")[0], 0.011);
        assert!((of("servo_delay/delay")[1] - 0.0005_f64.hypot(0.02 / 12_f64.sqrt())).abs() < 1e-12);
        assert_eq!(diagnose.prior.keys().collect::<Vec<_>>(), ["servo_refresh/period"]);
    }
}
