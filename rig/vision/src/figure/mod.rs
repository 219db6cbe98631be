//! The mechanism's outline as the camera sees it, moved until it lies on the edges that the picture shows.
//!
//! A silhouette is what a threshold leaves: a bracket before the root, a bar behind, a bubble beside the mechanism become
//! part of it. A [`Figure`] knows what can be seen of the mechanism and nothing else: [`edges`] looks for its outline's
//! edges across it, [`fit`] moves it onto them with Tukey's weights, [`film`] learns from a sample what is the same in
//! all images (where P0 is held, how long and wide the mechanism is).

pub(super) mod arm;
pub(super) mod canvas;
pub(super) mod chain;
pub(super) mod edges;
pub(super) mod film;
pub(super) mod fit;
mod prior;

pub(super) use prior::Prior;

use camera::calibration::Px;

/// Places on an outline, on the canvas.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// Where, outward direction, part.
    pub(super) rims: Vec<edges::Rim>,
    /// Derivatives of each along its outward direction by all parameters, shape (places, size).
    pub(super) slopes: Vec<f64>,
}

/// An outline that a few numbers move: first those that all images share, then those of each.
pub(super) trait Figure: std::fmt::Debug + Send + Sync {
    /// How many numbers.
    fn size(&self) -> usize;

    /// How many of them all images share.
    fn shared(&self) -> usize;

    /// How many parts its outline's places are told apart by.
    fn parts(&self) -> usize;

    /// Places on the outline of `pose` that nothing of the mechanism itself hides, evenly spaced.
    fn places(&self, pose: &[f64]) -> Places;

    /// P0..Pn on the canvas, and their derivatives by all numbers, shape (2 (n + 1), size).
    fn points(&self, pose: &[f64]) -> (Vec<Px>, Vec<f64>);

    /// The pose whose middle lies about on `line`, base first, with the `shared` numbers given; the line may begin after the
    /// base.
    fn start(&self, shared: &[f64], line: &[Px]) -> Vec<f64>;

    /// What single numbers of one image are held by, whatever the picture: precision, shape (size, size).
    fn stiffness(&self) -> nalgebra::DMatrix<f64>;

    /// Middle line of `pose`, base first.
    fn line(&self, pose: &[f64]) -> Vec<Px>;

    /// Convex polygons on the canvas that are the mechanism in `pose` together.
    fn polygons(&self, pose: &[f64]) -> Vec<Vec<Px>>;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places on the outline move outward as `figure` says when a number changes, or along the outline.
    pub(super) fn slopes_are_the_derivatives(figure: &dyn Figure, pose: &[f64]) {
        const STEP: f64 = 1e-5;
        let (places, size) = (figure.places(pose), figure.size());
        assert!(places.rims.len() > 50);
        let (_, slopes) = figure.points(pose);
        for parameter in 0..size {
            let changed = |by: f64| {
                let mut pose = pose.to_vec();
                pose[parameter] += by;
                (figure.places(&pose).rims, figure.points(&pose).0)
            };
            let ((less, few), (more, many)) = (changed(-STEP), changed(STEP));
            for (i, rim) in places.rims.iter().enumerate() {
                let by = |axis: usize| (more[i].at[axis] - less[i].at[axis]) / (2.0 * STEP);
                let out = rim.outward[0] * by(0) + rim.outward[1] * by(1);
                let said = places.slopes[i * size + parameter];
                assert!(
                    (out - said).abs() < 1e-4 * (1.0 + out.abs()),
                    "{parameter} {i} {out} {said} {rim:?}"
                );
            }
            for (i, (less, more)) in few.iter().zip(&many).enumerate() {
                for axis in 0..2 {
                    let by = (more[axis] - less[axis]) / (2.0 * STEP);
                    let said = slopes[(2 * i + axis) * size + parameter];
                    assert!((by - said).abs() < 1e-4 * (1.0 + by.abs()), "{parameter} P{i} {by} {said}");
                }
            }
        }
    }
}
