//! The config of a rig, and of a mock rig's tank.

use std::fmt::Write as _;

use super::chain::{Chain, Drive, Link, Scale};
use super::{MODEL, TANK, TRUTH, tidy};
use camera::Encoding;
use config::{MotionKind, Mount};

/// Quoted and escaped.
fn text(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn mount_name(mount: Mount) -> &'static str {
    match mount {
        Mount::Hanging => "hanging",
        Mount::Upright => "upright",
        Mount::Horizontal => "horizontal",
    }
}

/// One key, with what it means behind it.
fn key(out: &mut String, assignment: String, comment: &str) {
    let _ = match comment {
        "" => writeln!(out, "{assignment}"),
        comment => writeln!(out, "{assignment:<32} # {comment}"),
    };
}

/// How long a mock rig's diagnosis may search \[s\], chosen: with film and fit the first report is there within a minute.
const FIRST_LOOK_S: f64 = 20.0;

/// The rig's config.
pub(super) fn rig(name: &str, chain: &Chain) -> String {
    let mock = chain.drive == Drive::Mock;
    let driven = chain.motion == MotionKind::Driven;
    let mut out = String::from(if mock {
        "# On the mock rig: `rig run` runs it as it is.\n"
    } else {
        "# For real hardware: read docs/real-tank.md first, then replace or measure every value marked YOUR.\n"
    });
    out += "# Every option is explained in configs/chain-driven-hanging.toml.\n\n[run]\n";
    key(&mut out, format!("name = {}", text(name)), "in reports");
    let kind = if driven {
        ("driven", "the servo plays [profile]")
    } else {
        ("drop", "at rest, then let go by hand")
    };
    key(&mut out, format!("kind = \"{}\"", kind.0), kind.1);
    key(&mut out, format!("model = \"{MODEL}\""), "where the fit starts");
    if driven && !mock {
        key(&mut out, "prescribed = true".into(), "the first link follows the servo, however stiff that is");
    }
    let film_s = if driven { 1.0 } else { 6.0 };
    key(&mut out, format!("film_s = {film_s:?}"), "filming goes on for so long afterwards [s]");
    if !mock {
        key(&mut out, "settle_s = 5.0".into(), "still water, or the fit explains the waves [s]");
    }
    let chain_m = tidy(chain.chain_m());
    key(&mut out, format!("characteristic_length_m = {chain_m}"), "what errors are stated in percent of [m]");
    if driven {
        servo(&mut out, chain);
    }
    camera(&mut out, chain);
    calibration(&mut out, chain);
    mechanism(&mut out, chain);
    if mock {
        out += "\n[mock]\n";
        key(&mut out, format!("tank = \"{TANK}\""), "what it really is; the fit never sees it");
        out += "\n[diagnose]\n";
        let limit = "for a first look [s]; without it 60 s, which find more";
        key(&mut out, format!("limit_s = {FIRST_LOOK_S:?}"), limit);
    }
    out
}

fn servo(out: &mut String, chain: &Chain) {
    *out += "\n[profile]\n";
    key(out, "amplitude_rad = 0.6".into(), "half the sweep [rad]");
    key(out, "ccw_s = 1.0".into(), "a counter-clockwise stroke, as the camera sees it [s]");
    key(out, "cw_s = 0.5".into(), "a clockwise one: 2:1 [s]");
    key(out, "cycles = 3".into(), "pairs of strokes at full amplitude");
    key(out, "soft_start_cycles = 1".into(), "pairs before them with growing amplitude");
    *out += "\n[servo]\n";
    let real = match &chain.drive {
        Drive::Mock => {
            key(out, "kind = \"mock\"".into(), "a board behind a pseudo-terminal");
            key(out, "dead_man_ms = 2000".into(), "the host may be a busy desktop [ms]");
            false
        }
        Drive::Real { port, .. } => {
            key(out, "kind = \"serial\"".into(), "");
            key(out, format!("port = {}", text(port)), "YOUR board: `rig list`");
            true
        }
    };
    *out += "\n[[servo.channel]]\n";
    key(out, "id = 0".into(), "number on the board");
    key(out, "name = \"servo\"".into(), "");
    key(out, "actuator = \"servo\"".into(), "the model's");
    key(out, "min_pulse_us = 1000".into(), "shortest pulse [us]");
    let travel = if real { "longest [us]: YOUR mechanism's travel, not the servo's" } else { "longest [us]" };
    key(out, "max_pulse_us = 2000".into(), travel);
    if real {
        key(
            out,
            "zero_pulse_us = 1500.0".into(),
            "YOUR servo: the pulse at which the first link is at zero [us]",
        );
        key(out, "us_per_rad = 636.6".into(), "YOUR servo: two pulses, two angles [us/rad]");
    }
    key(out, "max_rate_us_per_s = 4000".into(), "fastest change of the pulse [us/s]");
    let safe = match chain.mount {
        Mount::Upright => ("hold", "when the board stops by itself; limp, the first link would move off"),
        Mount::Hanging | Mount::Horizontal => ("detach", "when the board stops by itself: limp"),
    };
    key(out, format!("safe_state = \"{}\"", safe.0), safe.1);
    match real {
        true => {
            *out += "# calibrated = true             # once both are measured; until then the first motion is small and slow\n"
        }
        false => key(out, "calibrated = true".into(), ""),
    }
}

fn camera(out: &mut String, chain: &Chain) {
    let picture = &chain.picture;
    *out += "\n[camera]\n";
    match &chain.drive {
        Drive::Mock => {
            key(out, "kind = \"mock\"".into(), "the simulated tank");
            key(out, "stall_s = 1.0".into(), "without an image for so long it counts as stalled [s]");
        }
        Drive::Real { device, .. } => {
            key(out, "kind = \"v4l\"".into(), "");
            key(out, format!("device = {}", text(device)), "YOUR camera: `rig list`");
            let format = match picture.format {
                Encoding::Grey => "grey",
                Encoding::Yuyv => "yuyv",
                Encoding::Jpeg => "jpeg",
                Encoding::Png => "png",
            };
            key(out, format!("format = \"{format}\""), "how images leave it");
            key(
                out,
                format!("exposure_s = {}", tidy(picture.exposure_s)),
                "short: a tip at 0.25 m/s blurs by 1 mm in 4 ms [s]",
            );
            key(out, "latency_s = 0.0".into(), "YOUR camera: docs/real-tank.md says how to measure it [s]");
        }
    }
    let [width, height] = picture.size_px;
    key(out, format!("width_px = {width}"), "");
    key(out, format!("height_px = {height}"), "");
    key(
        out,
        format!("fps = {}", tidy(picture.fps)),
        "images a second, as the camera offers them at this size",
    );
}

fn calibration(out: &mut String, chain: &Chain) {
    *out += "\n[calibration]\n";
    match &chain.picture.scale {
        Scale::File(file) => {
            key(out, format!("file = {}", text(&file.to_string_lossy())), "by `rig calibrate camera`")
        }
        Scale::Square { metres_per_pixel, origin_px: [column, row], measured } => {
            let from = match (&chain.drive, measured) {
                (Drive::Mock, _) | (_, true) => "[m/px]",
                (_, false) => {
                    "YOUR scale [m/px]: a guess; or instead of both keys file = \"tank.toml\", by `rig calibrate camera`"
                }
            };
            key(out, format!("metres_per_pixel = {}", tidy(*metres_per_pixel)), from);
            let seen = if chain.drive == Drive::Mock { "" } else { "YOUR picture: " };
            key(
                out,
                format!("origin_px = [{column:?}, {row:?}]"),
                &format!(
                    "{seen}where the first pivot is seen, column and row [px]; a click in `rig preview` sets it"
                ),
            );
        }
    }
}

fn mechanism(out: &mut String, chain: &Chain) {
    *out += "\n[mechanism]\n";
    key(out, format!("mount = \"{}\"", mount_name(chain.mount)), "");
    let table = |weight: fn(&Link) -> Option<f64>| -> String {
        let weights = chain.links.iter().enumerate();
        let weights =
            weights.filter_map(|(i, link)| Some(format!("link{} = {}", i + 1, tidy(weight(link)?))));
        weights.collect::<Vec<_>>().join(", ")
    };
    if chain.weighed {
        key(out, format!("dry_mass_kg = {{ {} }}", table(|link| Some(link.dry_kg))), "in air [kg]");
        let wet = table(|link| link.wet_kg);
        if !wet.is_empty() {
            key(out, format!("wet_mass_kg = {{ {wet} }}"), "in water [kg]");
        }
        key(out, format!("std_kg = {}", tidy(chain.balance_std_kg)), "of the balance, 1 sigma [kg]");
    } else if chain.drive != Drive::Mock {
        let guess = table(|link| Some(link.dry_kg));
        let _ = writeln!(
            out,
            "# Weights are a density of {} kg/m3 times the shape; YOUR links on a balance:\n# dry_mass_kg = {{ {guess} }}\n# std_kg = {}",
            tidy(chain.density_kg_per_m3),
            tidy(chain.balance_std_kg)
        );
    }
    *out += "\n[water]\n";
    key(out, format!("temperature_c = {}", tidy(chain.water_temperature_c)), "[degC]");
    key(out, format!("salinity_g_per_kg = {}", tidy(chain.salinity_g_per_kg)), "[g/kg]");
}

/// The mock rig's tank.
pub(super) fn tank(chain: &Chain) -> String {
    let mut out = String::from(
        "# What the mock rig really is; a fit never sees it. Every option is explained in configs/tanks/chain-driven-hanging.toml.\n\n",
    );
    key(&mut out, format!("model = \"{TRUTH}\""), "");
    if chain.motion == MotionKind::Drop {
        let mut pose = vec!["0.0"; chain.links.len()];
        pose[0] = "1.5708";
        key(&mut out, format!("initial_qpos = [{}]", pose.join(", ")), "held straight out to the side [rad]");
        out += "hold = \"release\"\n\n[release]\n";
        key(&mut out, "after_s = 1.0".into(), "a hand: from being asked to letting go [s]");
    } else {
        out += "\n[[servo]]\n";
        key(&mut out, "actuator = \"servo\"".into(), "the model's");
        key(&mut out, "us_per_rad = 636.61977".into(), "[us/rad]");
        key(&mut out, "lag_s = 0.002".into(), "time constant of its controller [s]");
        key(&mut out, "period_s = 0.001".into(), "it looks at its pulse so often [s]");
    }
    out += "\n[view]\n";
    if let Scale::Square { metres_per_pixel, origin_px: [column, row], .. } = chain.picture.scale {
        key(&mut out, format!("metres_per_pixel = {}", tidy(metres_per_pixel)), "");
        key(&mut out, format!("origin_px = [{column:?}, {row:?}]"), "");
    }
    key(&mut out, "stamp_jitter_s = 0.0002".into(), "standard deviation of the stamps [s]");
    out
}
