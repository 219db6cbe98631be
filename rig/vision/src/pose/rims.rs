//! What the mechanism's rim looks like: lit from above, its upper rims are brighter than its faces, its lower ones darker, and an edge is
//! then seen beside where the outline is. Learned from all edges of a sample by the direction that they face.

use super::edge::normal_share;

/// Directions that rims are told apart by, chosen.
pub(super) const DIRECTIONS: usize = 8;
/// Width of a bin of a profile \[px\], and where the profile begins and ends.
const BIN_PX: f64 = 0.5;
const PROFILE_PX: [f64; 2] = [-5.0, 3.5];
const BINS: usize = ((PROFILE_PX[1] - PROFILE_PX[0]) / BIN_PX) as usize;

/// The rim on one side of the mechanism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rim {
    /// How wide it is seen \[px\]; 0: no rim.
    pub(super) width_px: f64,
    /// Its light: 1 as the face, 0 as the tank.
    pub(super) light: f64,
}

/// A mechanism without rims.
pub(super) const NO_RIM: Rim = Rim { width_px: 0.0, light: 1.0 };

impl Rim {
    /// The share of the tank's light so far outside the outline \[px\].
    pub(super) fn tank_share(&self, outside_px: f64, blur_px: f64) -> f64 {
        let inside = |edge_px: f64| normal_share(-(outside_px - edge_px) / blur_px);
        1.0 - (self.light * inside(0.0) + (1.0 - self.light) * inside(-self.width_px))
    }
}

/// Towards what lights the mechanism, by how much its rims there are lighter than its faces, and those opposite darker \[px\]: the light that
/// is missing or too much at an edge is as much as that of such a strip of the face.
pub(super) fn lit_from(rims: &[Rim; DIRECTIONS]) -> [f64; 2] {
    let mut lit = [0.0; 2];
    for (i, rim) in rims.iter().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / DIRECTIONS as f64).sin_cos();
        let excess = rim.width_px * (rim.light - 1.0) * 2.0 / DIRECTIONS as f64;
        lit[0] += excess * cos;
        lit[1] += excess * sin;
    }
    lit
}

/// The direction class of an outward normal in the picture.
pub(super) fn direction(normal: [f64; 2]) -> usize {
    let turn = normal[1].atan2(normal[0]) / std::f64::consts::TAU;
    ((turn * DIRECTIONS as f64).round() as isize).rem_euclid(DIRECTIONS as isize) as usize
}

/// The light across edges of one direction: means of many.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Profile {
    sums: [f64; BINS],
    weights: [f64; BINS],
}

impl Default for Profile {
    fn default() -> Self {
        Self { sums: [0.0; BINS], weights: [0.0; BINS] }
    }
}

impl Profile {
    /// Takes in the light (1 as the face, 0 as the tank) so far outside an edge \[px\].
    pub(super) fn add(&mut self, outside_px: f64, light: f64, weight: f64) {
        let bin = ((outside_px - PROFILE_PX[0]) / BIN_PX).floor();
        if bin >= 0.0 && (bin as usize) < BINS {
            self.sums[bin as usize] += weight * light;
            self.weights[bin as usize] += weight;
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        for bin in 0..BINS {
            self.sums[bin] += other.sums[bin];
            self.weights[bin] += other.weights[bin];
        }
    }

    /// The rim that explains it best, wherever the outline is.
    pub(super) fn rim(&self, blur_px: f64) -> Rim {
        /// A rim must explain the profile so much better than none.
        const BETTER: f64 = 0.7;
        /// A profile of an edge without rim is met by less than this mean square.
        const MET: f64 = 3e-4;
        /// A narrower rim is no more than another blur, in quarters of a pixel.
        const WIDTHS: std::ops::RangeInclusive<usize> = 4..=12;
        const LIGHTS: usize = 20;
        const SHIFTS: usize = 24;
        let filled: Vec<usize> = (0..BINS).filter(|&bin| self.weights[bin] > 0.0).collect();
        if filled.len() + 1 < BINS {
            return NO_RIM;
        }
        let misfit = |rim: &Rim, shift: f64| -> f64 {
            filled
                .iter()
                .map(|&bin| {
                    let outside = PROFILE_PX[0] + (bin as f64 + 0.5) * BIN_PX - shift;
                    (self.sums[bin] / self.weights[bin] - 1.0 + rim.tank_share(outside, blur_px)).powi(2)
                })
                .sum()
        };
        let shifts = || (0..=SHIFTS).map(|i| -1.0 + 0.125 * i as f64);
        let none = shifts().map(|shift| misfit(&NO_RIM, shift)).fold(f64::INFINITY, f64::min);
        let mut best = (f64::INFINITY, NO_RIM);
        for i in WIDTHS {
            for j in 0..=LIGHTS {
                let rim = Rim { width_px: 0.25 * i as f64, light: 0.1 * j as f64 };
                for shift in shifts() {
                    let misfit = misfit(&rim, shift);
                    if misfit < best.0 {
                        best = (misfit, rim);
                    }
                }
            }
        }
        let is_met = none < MET * filled.len() as f64;
        if !is_met && best.0 < BETTER * none { best.1 } else { NO_RIM }
    }
}

#[cfg(test)]
mod tests {
    use super::super::edge::USUAL_BLUR_PX;
    use super::*;

    /// The profile of edges with `rim`, whose places were found to `off_px`.
    fn seen(rim: &Rim, off_px: f64) -> Profile {
        let mut profile = Profile::default();
        for i in 0..200 {
            let outside = PROFILE_PX[0] + 0.0425 * f64::from(i);
            profile.add(outside, 1.0 - rim.tank_share(outside + off_px, USUAL_BLUR_PX), 1.0);
        }
        profile
    }

    #[test]
    fn a_rim_is_found_wherever_the_edge_was_seen_and_none_where_there_is_none() {
        for rim in [Rim { width_px: 2.0, light: 0.5 }, Rim { width_px: 2.5, light: 1.4 }] {
            for off_px in [-0.3, 0.0, 0.6] {
                let found = seen(&rim, off_px).rim(USUAL_BLUR_PX);
                assert!((found.width_px - rim.width_px).abs() <= 0.5, "{found:?}");
                assert!((found.light - rim.light).abs() <= 0.1, "{found:?}");
            }
        }
        assert_eq!(seen(&NO_RIM, 0.2).rim(USUAL_BLUR_PX), NO_RIM);
        assert_eq!(Profile::default().rim(USUAL_BLUR_PX), NO_RIM);
    }

    #[test]
    fn light_comes_from_where_rims_are_bright_and_those_opposite_dark() {
        let mut rims = [NO_RIM; DIRECTIONS];
        let up = direction([0.0, -1.0]);
        rims[up] = Rim { width_px: 2.0, light: 1.5 };
        rims[direction([0.0, 1.0])] = Rim { width_px: 2.0, light: 0.5 };
        let [across, down] = lit_from(&rims);
        assert!(across.abs() < 1e-9 && (down + 0.5).abs() < 1e-9, "{across} {down}");
        // lit from all sides alike is lit from none
        assert!(lit_from(&[rims[up]; DIRECTIONS]).iter().all(|part| part.abs() < 1e-9));
    }
}
