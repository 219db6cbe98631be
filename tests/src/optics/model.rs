//! The mechanism as a MuJoCo model, written as the shipped ones are.

use crate::optics::mechanism::{Kind, Link, Mechanism};
use crate::optics::octopus::{HUB_HALF_M, ROOT_TILT_RAD};
use std::f64::consts::FRAC_PI_4;
use std::fmt::Write;

const DEFAULTS: &str = "  <default>\n    <geom type=\"box\" contype=\"0\" conaffinity=\"0\" fluidshape=\"ellipsoid\"/>\n    \
<joint type=\"hinge\" axis=\"0 -1 0\"/>\n    <site size=\"0.001\"/>\n  </default>\n";

/// Springs and damping of the passive hinges of `arm8.xml`.
const ARM_SPRINGS: [(&str, &str); 7] = [
    ("0.0048819", "0.000112659"),
    ("0.00343556", "7.92822e-05"),
    ("0.00233493", "5.3883e-05"),
    ("0.00152037", "3.50854e-05"),
    ("0.000937832", "2.16423e-05"),
    ("0.000538911", "1.24364e-05"),
    ("0.0002808", "6.48e-06"),
];

/// The text of `model.xml`.
pub(crate) fn mjcf(m: &Mechanism) -> String {
    let (name, timestep, integrator) = match m.kind {
        Kind::Chain => ("chain", "0.001", "Euler"),
        Kind::Arm => ("arm8", "0.0002", "implicitfast"),
        Kind::Octopus => ("octopus8", "0.0002", "implicitfast"),
    };
    let mut x = format!(
        "<mujoco model=\"{name}\">\n  <compiler angle=\"radian\" autolimits=\"true\"/>\n  <option timestep=\"{timestep}\" \
         integrator=\"{integrator}\" gravity=\"0 0 -9.81\" density=\"1000\" viscosity=\"0.00095\"/>\n{DEFAULTS}  <worldbody>\n"
    );
    let mut motors = String::new();
    match m.kind {
        Kind::Chain => {
            chain(&mut x, m);
            motors.push_str("    <position name=\"servo\" joint=\"q1\" kp=\"0.05\" kv=\"3e-4\" forcerange=\"-0.03 0.03\"/>\n");
        }
        Kind::Arm => {
            arm(&mut x, m, "", "0 0 0", "", 2);
            motors.push_str("    <position name=\"servo\" joint=\"q1\" kp=\"0.5\" kv=\"4e-3\" forcerange=\"-0.3 0.3\"/>\n");
        }
        Kind::Octopus => {
            let h = HUB_HALF_M;
            let _ = write!(
                x,
                "    <body name=\"hub\" gravcomp=\"1.06497169251\">\n      <freejoint name=\"root\"/>\n      <geom name=\"hub\" \
                 type=\"ellipsoid\" size=\"{} {} {}\" density=\"941.067198215\" fluidcoef=\"0.9 0.4 1.9 0.7 0.8\"/>\n      \
                 <site name=\"P0\"/>\n",
                h.x, h.y, h.z
            );
            for i in 0..8 {
                let azimuth = i as f64 * FRAC_PI_4;
                // About z by the azimuth, then about the arm's own -y by the tilt.
                let ((sa, ca), (st, ct)) = ((azimuth / 2.0).sin_cos(), (-ROOT_TILT_RAD / 2.0).sin_cos());
                let quat =
                    format!(" quat=\"{:.12} {:.12} {:.12} {:.12}\"", ca * ct, -sa * st, ca * st, sa * ct);
                let pos = format!("{:.12} {:.12} 0", h.x * azimuth.cos(), h.x * azimuth.sin());
                arm(&mut x, m, &format!("a{}", i + 1), &pos, &quat, 3);
                let _ = writeln!(
                    motors,
                    "    <position name=\"a{0}servo\" joint=\"a{0}q1\" kp=\"0.5\" kv=\"4e-3\" forcerange=\"-0.3 0.3\"/>",
                    i + 1
                );
            }
            x.push_str("    </body>\n");
        }
    }
    let _ = write!(x, "  </worldbody>\n  <actuator>\n{motors}  </actuator>\n</mujoco>\n");
    x
}

fn sizes(l: &Link) -> String {
    format!(
        "size=\"{:.9} {:.9} {:.9}\" pos=\"0 0 {:.9}\"",
        l.half_m[0], l.half_m[1], l.half_m[2], -l.middle_m
    )
}

fn chain(x: &mut String, m: &Mechanism) {
    let coefficients = ["0.6 0.2 1.6 0.9 0.8", "0.75 0.15 1.2 1.1 0.6", "0.55 0.3 2 0.7 0.9"];
    for (i, l) in m.links.iter().enumerate() {
        let (n, pad) = (i + 1, "  ".repeat(2 + i));
        let at = if i == 0 { "0 0 0".to_string() } else { format!("0 0 {:.9}", -m.links[i - 1].pitch_m) };
        let rub = if i == 0 { "" } else { " damping=\"2.4e-06\" frictionloss=\"1.8e-06\"" };
        let _ = writeln!(x, "{pad}<body name=\"link{n}\" pos=\"{at}\" gravcomp=\"0.803213\">");
        let _ = writeln!(x, "{pad}  <joint name=\"q{n}\"{rub}/>");
        let _ = writeln!(
            x,
            "{pad}  <geom name=\"g{n}\" {} density=\"1245\" fluidcoef=\"{}\"/>",
            sizes(l),
            coefficients[i % 3]
        );
        if i == 0 {
            let _ = writeln!(x, "{pad}  <site name=\"P0\"/>");
        }
        let _ = writeln!(x, "{pad}  <site name=\"P{n}\" pos=\"0 0 {:.9}\"/>", -l.pitch_m);
    }
    for i in (0..m.links.len()).rev() {
        let _ = writeln!(x, "{}</body>", "  ".repeat(2 + i));
    }
}

fn arm(x: &mut String, m: &Mechanism, prefix: &str, pos: &str, quat: &str, depth: usize) {
    for (i, l) in m.links.iter().enumerate() {
        let (n, pad) = (i + 1, "  ".repeat(depth + i));
        let at = if i == 0 { pos.to_string() } else { format!("0 0 {:.9}", -m.links[i - 1].pitch_m) };
        let quat = if i == 0 { quat } else { "" };
        let spring = match i {
            0 => " damping=\"1e-4\"".to_string(),
            _ => format!(" stiffness=\"{}\" damping=\"{}\"", ARM_SPRINGS[i - 1].0, ARM_SPRINGS[i - 1].1),
        };
        let _ = writeln!(x, "{pad}<body name=\"{prefix}s{n}\" pos=\"{at}\"{quat} gravcomp=\"0.923361\">");
        let _ = writeln!(x, "{pad}  <joint name=\"{prefix}q{n}\"{spring}/>");
        if i == 0 {
            let _ = writeln!(x, "{pad}  <site name=\"{prefix}P0\"/>");
        }
        let _ = writeln!(
            x,
            "{pad}  <geom name=\"{prefix}g{n}\" {} density=\"1083\" fluidcoef=\"0.65 0.2 1.3 0.85 0.8\"/>",
            sizes(l)
        );
        if i == 3 || i == 7 {
            let _ = writeln!(
                x,
                "{pad}  <site name=\"{prefix}P{}\" pos=\"0 0 {:.9}\"/>",
                if i == 3 { 1 } else { 2 },
                -l.pitch_m
            );
        }
    }
    for i in (0..m.links.len()).rev() {
        let _ = writeln!(x, "{}</body>", "  ".repeat(depth + i));
    }
}
