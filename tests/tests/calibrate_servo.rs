//! `rig calibrate servo` on the mock rig: a servo mounted the other way round, off its zero, that plays, lags, looks at its pulse every 20 ms and
//! is slower than it is told. What the file says is held against the tank's truth, and is in the next run and its fit.

use std::path::Path;

use config::RigConfig;
use servo::calibration::{Measured, ServoCalibration};
use system_tests::{changed_config, config, in_real_time, only_run, printed, run_rig, set};

const ZERO_US: f64 = 1520.0;
const US_PER_RAD: f64 = 600.0;
const LAG_S: f64 = 0.02;
const PERIOD_S: f64 = 0.02;
const RATE: f64 = 4.5;
const PLAY_RAD: f64 = 0.006;
/// So many of its standard errors a figure may be off.
const SIGMAS: f64 = 4.0;

fn fill(tank: &Path) {
    let shipped = config("tanks/chain-driven-hanging.toml");
    let mut table: toml::Table = std::fs::read_to_string(&shipped).expect("the tank").parse().expect("TOML");
    let model = shipped.with_file_name(table["model"].as_str().expect("a model"));
    table.insert("model".into(), model.to_str().expect("text").into());
    let servo = table["servo"].as_array_mut().expect("servos")[0].as_table_mut().expect("a table");
    for (key, value) in [
        ("zero_us", ZERO_US),
        ("us_per_rad", -US_PER_RAD),
        ("rate_limit_rad_per_s", RATE),
        ("lag_s", LAG_S),
        ("period_s", PERIOD_S),
    ] {
        servo.insert(key.into(), value.into());
    }
    let play = toml::Table::from_iter([("half_width".to_owned(), PLAY_RAD.into())]);
    set(&mut table, "causes", "backlash", play);
    std::fs::write(tank, table.to_string()).expect("a tank");
}

#[test]
fn a_filmed_staircase_says_how_the_servo_turns() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let tank = folder.path().join("tank.toml");
    fill(&tank);
    let own = changed_config("chain-driven-hanging.toml", folder.path(), |config| {
        set(config, "mock", "tank", tank.to_str().expect("text"));
        set(config, "run", "settle_s", 0.2);
    });
    let runs = folder.path().join("runs");
    let words = ["calibrate", "servo", "--stand-s", "0.3", "--runs-dir"].map(AsRef::as_ref);
    let output = run_rig(words.into_iter().chain([
        runs.as_os_str(),
        "--write".as_ref(),
        own.as_os_str(),
        own.as_os_str(),
    ]));
    assert!(output.status.success(), "{}", printed(&output));
    println!("{}", printed(&output));

    let found = ServoCalibration::read(&folder.path().join("servo.toml")).expect("a calibration");
    let close = |name: &str, got: Measured, wanted: f64, most: f64| {
        let (off, std) = (got.value.get() - wanted, got.std.get());
        println!("{name}: off by {off:.2e}, said to 1 sigma {std:.2e}");
        assert!(off.abs() < SIGMAS * std && std < most, "{name}: {got:?}, {wanted} is true");
    };
    assert!(found.mirrored);
    close("zero [us]", found.zero_pulse_us, ZERO_US, 0.5);
    close("gain [us/rad]", found.us_per_rad, US_PER_RAD, 0.5);
    close("dead band [rad]", found.deadband_rad, PLAY_RAD, 5e-4);
    close("lag [s]", found.lag_s, LAG_S, 2e-3);
    close("delay [s]", found.delay_s, 0.0, 2e-3);
    close("refresh [s]", found.refresh_s.expect("looks"), PERIOD_S, 2e-4);
    close("rate [rad/s]", found.rate_limit_rad_per_s.expect("a limit"), RATE, 0.2);
    assert!(found.repeatability_rad.get() < 1e-3, "{found:?}");

    // The config names the file now, and its table is what commands go by.
    let config = RigConfig::read(&own).expect("the config with its calibration");
    let channel = &config.servo.as_ref().expect("a servo").channels[0];
    assert!(
        (channel.setpoint(0.5, false) - (ZERO_US - 0.5 * US_PER_RAD)).abs() < 1.0,
        "{}",
        channel.setpoint(0.5, false)
    );

    // A recorded run says the same again.
    let run = only_run(&runs).expect("one run");
    let copy = folder.path().join("copy.toml");
    let words = ["calibrate", "servo", "--write"].map(AsRef::as_ref);
    let again = run_rig(words.into_iter().chain([copy.as_os_str(), run.as_os_str()]));
    assert!(again.status.success(), "{}", printed(&again));
    assert_eq!(ServoCalibration::read(&copy).expect("a calibration"), found);

    // What contradicts it is refused.
    let text = std::fs::read_to_string(&own).expect("the config");
    let twisted = folder.path().join("twisted.toml");
    std::fs::write(&twisted, text.replace("[profile]", "[profile]\nmirrored = false")).expect("a config");
    let refused = RigConfig::read(&twisted).expect_err("the sign contradicts the file");
    let refused = std::error::Error::source(&refused).expect("why").to_string();
    assert!(refused.contains("leave `mirrored` out of [profile]"), "{refused}");
}
