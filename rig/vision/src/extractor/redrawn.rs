//! What an extractor knows of the mechanism, as another may draw it.

use super::Extractor;
use crate::background::{Background, Contrast};
use camera::calibration::Px;

impl Extractor {
    /// The empty tank that it knows.
    pub(crate) fn background(&self) -> &Background {
        &self.background
    }

    /// Corner radius of the mechanism's free ends, as a share of its half width there; none where nothing told.
    pub(crate) fn end_rounding(&self) -> Option<f64> {
        self.outline.end_rounding
    }

    /// The mechanism whose middle lies on `line`: convex polygons that are it together, and P0..Pn \[px\]; none where nobody knows
    /// its outline.
    pub(crate) fn drawn(&self, line: &[Px]) -> Option<(Vec<Vec<Px>>, Vec<Px>)> {
        let film = self.film.as_ref().filter(|_| line.len() > 1)?;
        Some(film.drawn(&film.start(line)))
    }

    /// The slopes of the edges in a picture of the mechanism on `line`, each as a share of its step \[1/px\].
    pub(crate) fn edge_slopes(&self, contrast: &Contrast, line: &[Px]) -> Vec<f64> {
        match self.film.as_ref().filter(|_| line.len() > 1) {
            Some(film) => film.edge_slopes(&self.view(contrast), &film.start(line)),
            None => Vec::new(),
        }
    }
}
