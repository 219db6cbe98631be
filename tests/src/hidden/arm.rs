//! A soft arm: eight tapered segments with springs, seen in the middle and at the tip; `configs/models/arm8.xml`.

use super::bench::{Bench, Draw, Mechanism, NOMINAL, Run};
use super::chain::{Chain, Link};
use super::fluid::{Coefficients, Ellipsoid};

/// Its segments.
pub const SEGMENTS: usize = 8;
/// The nominal model, where a fit starts.
const MODEL: &str = include_str!("../../../configs/models/arm8.xml");
/// Length of a segment \[m\].
const LENGTH_M: f64 = 0.02;
/// Half thicknesses, in the picture, and half widths, in depth, of the first segment and of the last \[m\]; even steps between.
const THICKNESS_M: [f64; 2] = [0.003, 0.0015];
const WIDTH_M: [f64; 2] = [0.012, 0.004];
const DENSITY: f64 = 1080.0;
/// Springs, soft and one-sided \[N/m3/rad\], and damping \[N s/m3/rad\] of a pivot, per cubic half thickness and half width.
const SPRINGS: [f64; 2] = [1.6e7, 9.44e8];
const DAMPING: f64 = 2e5;
/// Damping of the driven pivot \[N m s/rad\].
const ROOT_DAMPING: f64 = 1e-4;

/// What all arms have in common.
pub static ARM: Mechanism<SEGMENTS> = Mechanism {
    name: "arm",
    // half and all of the arc length
    keypoints: &[SEGMENTS / 2 - 1, SEGMENTS - 1],
    of_one_piece: true,
    // its tip swings about as much further
    distance: 1.5,
    causes: &CAUSES,
    of_joints: &["joint_damping", "stiffness"],
    draw,
};

/// The causes that are hidden in it: neither stops nor springs of one side, which it has of its own, nor bearings that rub.
const CAUSES: [&str; 26] = [
    "current",
    "buoyancy",
    "link_mass",
    "joint_damping",
    "stiffness",
    "keypoint_slip",
    "added_mass",
    "slosh",
    "cob_offset",
    "linear_drag",
    "drag_exponent",
    "wall",
    "basset",
    "tether",
    "servo_gain",
    "servo_rate_limit",
    "servo_lag",
    "backlash",
    "servo_delay",
    "joint_zero",
    "camera_delay",
    "rolling_shutter",
    "lens",
    "camera_tilt",
    "camera_scale",
    "camera_rotation",
];

/// The arm with `coefficients` in all segments, its springs and dampings so many times the nominal ones.
pub fn arm(coefficients: Coefficients, springs: [f64; 2], damping: f64) -> Chain<SEGMENTS> {
    let links = std::array::from_fn(|i| {
        let share = i as f64 / (SEGMENTS - 1) as f64;
        let [thick, wide] = [THICKNESS_M, WIDTH_M].map(|[first, last]| first + share * (last - first));
        let bending = thick.powi(3) * wide;
        let volume_m3 = LENGTH_M * 2.0 * thick * 2.0 * wide;
        let mass_kg = DENSITY * volume_m3;
        Link {
            length_m: LENGTH_M,
            centre_m: LENGTH_M / 2.0,
            mass_kg,
            held_kg: mass_kg * 0.925926,
            inertia_kg_m2: mass_kg / 12.0 * (LENGTH_M * LENGTH_M + 4.0 * thick * thick),
            damping: damping * if i == 0 { ROOT_DAMPING } else { DAMPING * bending },
            springs: match i {
                0 => [0.0; 2],
                _ => std::array::from_fn(|side| springs[side] * SPRINGS[side] * bending),
            },
            shape: Ellipsoid::new([LENGTH_M / 2.0, thick, wide], coefficients),
        }
    });
    Chain { links, gravity: 9.81, density: 1000.0, viscosity: 0.00095 }
}

/// What `seed` draws: true coefficients about the nominal ones, a release and two driven runs to fit, one of each held out. With
/// `fits_joints` springs and dampings are drawn too, each kind by one factor.
pub fn draw(seed: u64, fits_joints: bool) -> Bench<SEGMENTS> {
    let mut draw = Draw::new(seed, 1);
    let coefficients = NOMINAL.map(|c| c * (0.35 * draw.normal()).exp());
    let mut factor = |spread: f64| {
        let drawn = (spread * draw.normal()).exp();
        if fits_joints { drawn } else { 1.0 }
    };
    let (springs, damping) = ([factor(0.2), factor(0.2)], factor(0.4));
    // straight, but for what a hand or its own weight does
    let straight = |angle: f64, draw: &mut Draw| {
        let mut at = angle;
        std::array::from_fn(|i| {
            at += if i == 0 { 0.0 } else { 0.01 * draw.normal() };
            at
        })
    };
    let aside = |amplitude: f64, draw: &mut Draw| straight(-amplitude, draw);
    let [let_go, held_out] = [1.2, -0.9].map(|angle| angle + 0.08 * draw.normal());
    let runs = vec![
        Run::drop("drop-1", straight(let_go, &mut draw), &mut draw),
        Run::driven("driven-1", [0.6, 1.5], aside, &mut draw),
        Run::driven("driven-2", [0.4, 0.9], aside, &mut draw),
        Run::drop("drop-held-out", straight(held_out, &mut draw), &mut draw),
        Run::driven("driven-held-out", [0.5, 1.2], aside, &mut draw),
    ];
    Bench {
        mechanism: &ARM,
        chain: arm(coefficients, springs, damping),
        fits_joints,
        model: MODEL,
        runs: Bench::in_order(runs),
    }
}
