//! A flat wall between camera and water: maps the pixels of one plane to a plane behind it by Snell's law.

use std::str::FromStr;

use ground::strict::{NonNegative, Positive};

/// What light passes on its way to the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Port {
    /// From the camera's entrance pupil to the wall \[m\].
    pub air_m: Positive,
    /// Thickness of the wall \[m\].
    pub glass_m: NonNegative,
    /// From the wall to the board \[m\].
    pub water_m: Positive,
}

/// Refractive index of the wall: glass 1.52, acrylic 1.49; 0.02 more or less of a wall of 10 mm moves a point by 0.02 mm.
const WALL_REFRACTIVE_INDEX: f64 = 1.5;
/// Refractive index of water at 20 °C in yellow light.
const WATER_REFRACTIVE_INDEX: f64 = 1.333;

/// `AIR_M:GLASS_M:WATER_M` was something else.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "`{0}` is no port: say AIR_M:GLASS_M:WATER_M, the metres of air, wall and water between camera and board, e.g. 0.5:0.01:0.3"
)]
pub struct PortError(String);

impl FromStr for Port {
    type Err = PortError;

    fn from_str(text: &str) -> Result<Self, PortError> {
        let numbers: Vec<f64> = text.split(':').map_while(|part| part.parse().ok()).collect();
        let port = match (numbers.as_slice(), text.split(':').count()) {
            (&[air, glass, water], 3) => Positive::new(air)
                .zip(NonNegative::new(glass))
                .zip(Positive::new(water))
                .map(|((air_m, glass_m), water_m)| Self { air_m, glass_m, water_m }),
            _ => None,
        };
        port.ok_or_else(|| PortError(text.into()))
    }
}

impl Port {
    /// How far from the foot of the camera's plumb on the wall a ray meets a plane `behind_m` farther than the board \[m\], which meets
    /// the board `board_m` from it \[m\].
    ///
    /// r = air tan a + glass tan g + water tan w, where sin a = n_glass sin g = n_water sin w.
    pub fn farther(&self, board_m: f64, behind_m: f64) -> f64 {
        let distance = |sine: f64, water_m: f64| {
            let tangent = |index: f64| {
                let sine = sine / index;
                sine / (1.0 - sine * sine).sqrt()
            };
            self.air_m.get() * tangent(1.0)
                + self.glass_m.get() * tangent(WALL_REFRACTIVE_INDEX)
                + water_m * tangent(WATER_REFRACTIVE_INDEX)
        };
        // The distance grows with the angle from 0 to infinity: halving finds it.
        let (mut below, mut above) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = (below + above) / 2.0;
            if distance(middle, self.water_m.get()) < board_m { below = middle } else { above = middle }
        }
        distance(below, self.water_m.get() + behind_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steep_and_shallow_rays_go_on_by_snells_law() {
        let port: Port = "0.5:0.01:0.3".parse().unwrap();
        // Near the axis every tangent is its sine.
        let near = 0.5 + 0.01 / WALL_REFRACTIVE_INDEX + 0.3 / WATER_REFRACTIVE_INDEX;
        let share = (near + 0.02 / WATER_REFRACTIVE_INDEX) / near;
        assert!((port.farther(1e-4, 0.02) / 1e-4 - share).abs() < 1e-6);
        // A ray 30 degrees off the axis, by hand.
        let sine: f64 = 0.5;
        let tangent = |index: f64| (sine / index).asin().tan();
        let board = 0.5 * tangent(1.0)
            + 0.01 * tangent(WALL_REFRACTIVE_INDEX)
            + 0.3 * tangent(WATER_REFRACTIVE_INDEX);
        assert!((port.farther(board, -0.05) - (board - 0.05 * tangent(WATER_REFRACTIVE_INDEX))).abs() < 1e-9);
        assert!((port.farther(board, 0.0) - board).abs() < 1e-9);
        assert_eq!(port.farther(0.0, 0.02), 0.0);
    }

    #[test]
    fn port_that_is_none_says_how_to_write_one() {
        for text in ["0.5:0.01", "0.5:0.01:0.3:1", "0:0.01:0.3", "a:b:c", "0.5:-0.01:0.3", "nan:0.01:0.3", ""]
        {
            let message = text.parse::<Port>().unwrap_err().to_string();
            assert!(message.contains("AIR_M:GLASS_M:WATER_M"), "{message}");
        }
    }
}
