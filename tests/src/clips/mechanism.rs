//! What is filmed, and how it moves.

use rand_chacha::ChaCha8Rng;

use super::picture::between;
use super::shape::{Px, Shape};

/// A mechanism that hangs from P0.
#[derive(Debug, Clone)]
pub enum Mechanism {
    /// Rigid links \[px\].
    Chain {
        /// Pivot to pivot, the last to the tip.
        lengths: Vec<f64>,
        /// How far a link reaches past its pivots.
        overhang: f64,
        /// Half the links' width.
        half: f64,
        /// Radius of the corners.
        round: f64,
    },
    /// A soft arm \[px\].
    Arm {
        /// Its length.
        length: f64,
        /// Half its width at root and tip.
        half: [f64; 2],
        /// Keypoints P1..Pn at these shares of its length.
        shares: Vec<f64>,
    },
}

/// Sums of sines: amplitude \[rad\], frequency \[Hz\], phase \[rad\].
#[derive(Debug, Clone)]
pub struct Motion(Vec<[[f64; 3]; 2]>);

/// Points of an arm's line.
const ARM_LINE_POINTS: usize = 60;

impl Mechanism {
    /// The three-link chain of the shipped sizes, at this scale \[m/px\].
    pub fn shipped_chain(metres_per_pixel: f64) -> Self {
        let px = |metres: f64| metres / metres_per_pixel;
        let lengths = [0.025, 0.025, 0.0275].map(px).to_vec();
        Self::Chain { lengths, overhang: px(0.0025), half: px(0.005), round: 0.0 }
    }

    /// That chain, or for odd draws another one; at this scale \[m/px\].
    pub fn chain(random: &mut ChaCha8Rng, metres_per_pixel: f64, own: bool) -> Self {
        let px = |metres: f64| metres / metres_per_pixel;
        if !own {
            return Self::shipped_chain(metres_per_pixel);
        }
        let links = 2 + (between(random, 0.0, 2.99) as usize);
        let half = px(between(random, 0.003, 0.005));
        Self::Chain {
            lengths: (0..links).map(|_| px(between(random, 0.018, 0.03))).collect(),
            overhang: px(between(random, 0.001, 0.003)),
            half,
            round: if between(random, 0.0, 1.0) < 0.5 { 0.0 } else { half },
        }
    }

    /// A soft arm of the shipped sizes.
    pub fn arm(metres_per_pixel: f64) -> Self {
        let px = |metres: f64| metres / metres_per_pixel;
        Self::Arm { length: px(0.16), half: [px(0.012), px(0.004)], shares: vec![0.5, 1.0] }
    }

    fn joints(&self) -> usize {
        match self {
            Self::Chain { lengths, .. } => lengths.len(),
            Self::Arm { .. } => 3,
        }
    }

    /// A motion of it.
    pub fn motion(&self, random: &mut ChaCha8Rng) -> Motion {
        let wide = matches!(self, Self::Chain { .. });
        let mut sine = |amplitude: f64| {
            [
                amplitude * between(random, 0.4, 1.0),
                between(random, 0.3, 1.1),
                between(random, 0.0, std::f64::consts::TAU),
            ]
        };
        let amplitude = if wide { 0.55 } else { 0.45 };
        Motion((0..self.joints()).map(|_| [sine(amplitude), sine(amplitude / 2.0)]).collect())
    }

    /// Outline and P0..Pn at `time_s`, hanging from `base`.
    pub fn at(&self, motion: &Motion, base: Px, time_s: f64) -> (Vec<Shape>, Vec<Px>) {
        let angle = |joint: usize| -> f64 {
            let sine = |[a, f, p]: &[f64; 3]| a * (std::f64::consts::TAU * f * time_s + p).sin();
            motion.0[joint].iter().map(sine).sum()
        };
        match self {
            Self::Chain { lengths, .. } => {
                let (mut points, mut heading) = (vec![base], 0.0);
                for (joint, length) in lengths.iter().enumerate() {
                    heading += angle(joint);
                    let [x, y] = points[joint];
                    points.push([x + length * f64::sin(heading), y + length * f64::cos(heading)]);
                }
                (self.through(&points), points)
            }
            Self::Arm { length, half, shares } => {
                let step = length / ARM_LINE_POINTS as f64;
                let mut line = vec![base];
                // Curvature of three shapes, and the root's own turn.
                for i in 0..ARM_LINE_POINTS {
                    let s = (i as f64 + 0.5) / ARM_LINE_POINTS as f64;
                    let heading = 0.6 * angle(0) + angle(1) * s * s + 0.6 * angle(2) * (4.0 * s).sin() * s;
                    let [x, y] = line[i];
                    line.push([x + step * heading.sin(), y + step * heading.cos()]);
                }
                let width = |i: usize| half[0] + (half[1] - half[0]) * i as f64 / ARM_LINE_POINTS as f64;
                let halves = (0..=ARM_LINE_POINTS).map(width).collect();
                let place = |share: &f64| {
                    let s = share * ARM_LINE_POINTS as f64;
                    let i = (s as usize).min(ARM_LINE_POINTS - 1);
                    [0, 1].map(|axis| line[i][axis] + (s - i as f64) * (line[i + 1][axis] - line[i][axis]))
                };
                let points = std::iter::once(base).chain(shares.iter().map(place)).collect();
                (vec![Shape::Band { line, half: halves }], points)
            }
        }
    }

    /// Outline of a chain whose P0..Pn are `points`; an arm bends between its points, and has none by them alone.
    pub fn through(&self, points: &[Px]) -> Vec<Shape> {
        let Self::Chain { lengths, overhang, half, round } = self else { return Vec::new() };
        let bar = |(i, pair): (usize, &[Px])| Shape::Bar {
            ends: [pair[0], pair[1]],
            past: [*overhang, if i + 1 == lengths.len() { 0.0 } else { *overhang }],
            half: *half,
            round: *round,
        };
        points.windows(2).enumerate().map(bar).collect()
    }
}
