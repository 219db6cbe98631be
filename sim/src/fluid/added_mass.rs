//! Added mass of an ellipsoid by potential flow, with MuJoCo's quadrature.

use std::f64::consts::PI;

/// Below this a denominator counts as 0 (MuJoCo's least value).
const DENOMINATOR_MIN: f64 = 1e-15;

/// Nodes and weights of the 15-point Kronrod rule on \[0, 1\], the lower half and the middle, rounded to 8
/// decimals as MuJoCo has them: with the exact ones the coefficients would differ in the ninth digit.
const KRONROD: [(f64, f64); 8] = [
    (0.00427231, 0.01146766),
    (0.02544604, 0.03154605),
    (0.06756779, 0.05239501),
    (0.12923441, 0.07032663),
    (0.20695638, 0.08450236),
    (0.29707742, 0.09517529),
    (0.39610752, 0.10221647),
    (0.5, 0.10474107),
];

/// Inertia of the fluid carried along, per unit of its density, on the ellipsoid's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AddedMass {
    /// Added mass over density \[m3\].
    pub mass: [f64; 3],
    /// Added rotational inertia over density \[m5\].
    pub inertia: [f64; 3],
}

/// Added mass of the ellipsoid with semi-axes `r` \[m\].
///
/// mA_i = V k_i / (2 - k_i), IA_i = V/5 d^2 |k_k - k_j| / |2 d + s (k_j - k_k)| with d, s = r_j^2 -+ r_k^2 and
/// k_i = rx ry rz int_0^inf dl / sqrt((r_i^2 + l)^3 (r_j^2 + l) (r_k^2 + l)) (Lamb, Hydrodynamics, 1932, section 114).
pub fn added_mass(r: [f64; 3]) -> AddedMass {
    let volume = 4.0 / 3.0 * PI * r[0] * r[1] * r[2];
    let k: [f64; 3] = std::array::from_fn(|i| kappa(r[i], r[(i + 1) % 3], r[(i + 2) % 3]));
    let mass = k.map(|k| volume * k / (2.0 - k).max(DENOMINATOR_MIN));
    let inertia = std::array::from_fn(|i| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (difference, sum) = (r[a] * r[a] - r[b] * r[b], r[a] * r[a] + r[b] * r[b]);
        let denominator = (2.0 * difference + sum * (k[a] - k[b])).abs().max(DENOMINATOR_MIN);
        volume / 5.0 * difference * difference * (k[b] - k[a]).abs() / denominator
    });
    AddedMass { mass, inertia }
}

/// The integral above with l = scale x^3 / (1 - x)^2, x from 0 to 1.
fn kappa(a: f64, b: f64, c: f64) -> f64 {
    let scale = (a * a * a * b * c).powf(0.4);
    let term = |x: f64, weight: f64| {
        let rest = 1.0 - x;
        let l = scale * x * x * x / (rest * rest);
        let slope = scale * x * x * (3.0 - x) / (rest * rest * rest);
        let along = 1.0 + l / (a * a);
        weight * slope / (along * (along * (1.0 + l / (b * b)) * (1.0 + l / (c * c))).sqrt())
    };
    let sum: f64 = KRONROD
        .iter()
        .map(|&(x, weight)| term(x, weight) + if x < 0.5 { term(1.0 - x, weight) } else { 0.0 })
        .sum();
    sum / (a * a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The quadrature's own error on a smooth integrand.
    const QUADRATURE: f64 = 1e-5;

    #[test]
    fn a_sphere_carries_half_its_displaced_mass() {
        let r: f64 = 0.02;
        let AddedMass { mass, inertia } = added_mass([r; 3]);
        let half = 2.0 / 3.0 * PI * r.powi(3);
        assert!(mass.iter().all(|m| (m / half - 1.0).abs() < QUADRATURE), "{mass:?} {half}");
        assert_eq!(inertia, [0.0; 3]);
    }

    #[test]
    fn a_long_ellipsoid_carries_its_displaced_mass_sideways_and_little_ahead() {
        let r = [0.001, 0.001, 0.1];
        let mass = added_mass(r).mass;
        let displaced = 4.0 / 3.0 * PI * r[0] * r[1] * r[2];
        // a cylinder in cross flow carries just what it displaces; the ends take a little off
        assert!((0.98..1.0).contains(&(mass[0] / displaced)), "{}", mass[0] / displaced);
        assert!(mass[2] / displaced < 0.001);
    }
}
