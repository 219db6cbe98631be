//! Three rigid links, seen at every joint: the chain of `data/hidden/chain.xml`.

use super::bench::{Bench, Draw, Mechanism, NOMINAL, Run};
use super::cases::HIDDEN;
use super::chain::{Chain, Link};
use super::fluid::{Coefficients, Ellipsoid};

/// Links of the chain.
pub const LINKS: usize = 3;
/// The nominal model, where a fit starts.
const MODEL: &str = include_str!("../../data/hidden/chain.xml");
/// Damping of each pivot in the nominal model \[N m s/rad\].
const NOMINAL_DAMPING: f64 = 2e-6;

/// What all chains have in common.
pub static THREE_LINKS: Mechanism<LINKS> = Mechanism {
    name: "chain",
    keypoints: &[0, 1, 2],
    of_one_piece: false,
    distance: 1.0,
    causes: &HIDDEN,
    of_joints: &["joint_damping"],
    draw,
};

/// The links of `data/hidden/chain.xml` with these coefficients and pivot dampings \[N m s/rad\].
pub fn chain(coefficients: [Coefficients; LINKS], damping: [f64; LINKS]) -> Chain<LINKS> {
    const SIDES_M: [f64; 3] = [0.03, 0.01, 0.005];
    let [long, wide, deep] = SIDES_M;
    let mass_kg = 1240.0 * long * wide * deep;
    let shape = Ellipsoid::new(SIDES_M.map(|side| side / 2.0), NOMINAL);
    let links = std::array::from_fn(|i| Link {
        length_m: if i + 1 == LINKS { 0.0275 } else { 0.025 },
        centre_m: 0.0125,
        mass_kg,
        held_kg: mass_kg * 0.806452,
        inertia_kg_m2: mass_kg / 12.0 * (long * long + wide * wide),
        damping: damping[i],
        springs: [0.0; 2],
        shape: shape.with(coefficients[i]),
    });
    Chain { links, gravity: 9.81, density: 1000.0, viscosity: 0.00095 }
}

/// What `seed` draws: true coefficients about the nominal ones, and two drops and two driven runs to fit, one of each
/// held out. With `fits_damping` the dampings are drawn too.
pub fn draw(seed: u64, fits_damping: bool) -> Bench<LINKS> {
    let mut draw = Draw::new(seed, 1);
    let coefficients = std::array::from_fn(|_| NOMINAL.map(|c| c * (0.35 * draw.normal()).exp()));
    let mut damping = [NOMINAL_DAMPING; LINKS];
    for damping in &mut damping[1..] {
        let drawn = NOMINAL_DAMPING * (0.4 * draw.normal()).exp();
        if fits_damping {
            *damping = drawn;
        }
    }
    let mut runs: Vec<Run<LINKS>> = Vec::new();
    let poses: [[f64; LINKS]; 3] = [[1.57, 1.57, 1.57], [-1.57, -0.3, 0.1], [1.1, 0.2, -0.9]];
    let swings = [[0.6, 1.5], [0.4, 0.9], [0.5, 1.2]];
    // hanging from the turned first link, roughly
    let hanging = |amplitude: f64, draw: &mut Draw| [-amplitude, 0.05 * draw.normal(), 0.05 * draw.normal()];
    for k in [0, 1] {
        let held = poses[k].map(|angle| angle + 0.08 * draw.normal());
        runs.push(Run::drop(&format!("drop-{}", k + 1), held, &mut draw));
    }
    for (k, swing) in swings[..2].iter().enumerate() {
        runs.push(Run::driven(&format!("driven-{}", k + 1), *swing, hanging, &mut draw));
    }
    let held = poses[2].map(|angle| angle + 0.08 * draw.normal());
    runs.push(Run::drop("drop-held-out", held, &mut draw));
    runs.push(Run::driven("driven-held-out", swings[2], hanging, &mut draw));
    Bench {
        mechanism: &THREE_LINKS,
        chain: chain(coefficients, damping),
        fits_joints: fits_damping,
        model: MODEL,
        runs: Bench::in_order(runs),
    }
}
