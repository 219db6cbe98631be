//! What all images of a film share, as numbers that are solved for together.

use super::place::Place;

/// What all images of a film share.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shared {
    /// Where P0 is \[m\].
    pub(super) base: Place,
    /// Width over the model's, at the root and at the tip.
    pub(super) width: [f64; 2],
    /// Depth along the camera's view over the model's: where the outline faces away from the camera's foot, and where it faces it. A flank
    /// that looks like the tank has the near face's edge there too: about -1.
    pub(super) depth: [f64; 2],
    /// How far beyond the model it is seen \[m\]: of what bends its round end, which is shaded; of a chain all of its outline, as lens and
    /// camera have it.
    pub(super) beyond_m: f64,
    /// How far each link of a chain is in front of the plane of motion \[m\], shape (links); empty for what bends.
    pub(super) in_front_m: Vec<f64>,
}

/// Places of numbers among those that are shared: P0, widths, depths, what is seen beyond; then how far links are in front.
pub(super) const WIDTH: usize = 2;
pub(super) const DEPTH: usize = 4;
pub(super) const BEYOND: usize = 6;
pub(super) const IN_FRONT: usize = 7;

impl Shared {
    pub(super) fn numbers(&self) -> Vec<f64> {
        let first = [self.base, self.width, self.depth];
        first.into_iter().flatten().chain([self.beyond_m]).chain(self.in_front_m.iter().copied()).collect()
    }

    pub(super) fn of(numbers: &[f64]) -> Self {
        let pair = |at: usize| [numbers[at], numbers[at + 1]];
        Self {
            base: pair(0),
            width: pair(WIDTH),
            depth: pair(DEPTH),
            beyond_m: numbers[BEYOND],
            in_front_m: numbers[IN_FRONT..].to_vec(),
        }
    }
}
