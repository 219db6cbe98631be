//! Laying an outline of few parameters on the edges that a picture shows.

use ground::statistics::{MEDIAN_TO_SIGMA, TUKEY_SIGMAS, median};
use nalgebra::{DMatrix, DVector};

use crate::figure::edges::{Rim, Seen, View};
use crate::spline::moved;
use camera::calibration::Px;

/// What is laid on a picture.
pub(super) trait Outline {
    /// Places of the outline at `pose`, always as many.
    fn rims(&self, pose: &[f64]) -> Vec<Rim>;
    /// A change of each parameter that moves the outline by about a pixel.
    fn steps(&self) -> &[f64];
    /// What is known of `pose` without the picture: rows of weights that `pose` should be 0 under, in sigmas.
    fn prior(&self, _pose: &[f64]) -> Vec<(Vec<f64>, f64)> {
        Vec::new()
    }
    /// Whether something else of the swimmer covers `px`.
    fn covered(&self, px: Px) -> bool;
}

/// An outline where the picture shows its edges.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    pub(super) pose: Vec<f64>,
    /// Of the pose, in squares of its units.
    pub(super) covariance: DMatrix<f64>,
    /// How far the edges are from the outline, robust 1 sigma \[px\].
    pub(super) scatter_px: f64,
    /// How far outward they are on average, of those that were believed \[px\].
    pub(super) outward_px: f64,
    /// Places where an edge is, and those where one should be.
    pub(super) found: usize,
    pub(super) open: usize,
}

/// Edges are looked for within these, one after the other \[px\].
const REACHES_PX: [f64; 9] = [8.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.5, 2.5, 2.5];
/// No edge is better known, and neighbours share what light and lens do to them \[px\].
const EDGE_STD_PX: f64 = 0.25;
/// What lies so far outward and is dark is another part of the swimmer \[px\].
const BESIDE_PX: f64 = 4.0;

/// `outline` from `start` on; none where the edges do not hold it.
pub(super) fn settle(view: &View, outline: &impl Outline, start: &[f64]) -> Option<Settled> {
    let half = f64::from(view.contrast.level) / 2.0;
    let (mut pose, steps) = (start.to_vec(), outline.steps());
    let count = pose.len();
    let mut last = None;
    for reach in REACHES_PX {
        let rims = outline.rims(&pose);
        let moved_rims: Vec<Vec<Rim>> = (0..count)
            .map(|k| {
                let mut other = pose.clone();
                other[k] += steps[k];
                outline.rims(&other)
            })
            .collect();
        let (mut rows, mut offs, mut open) = (Vec::new(), Vec::new(), 0);
        for (i, rim) in rims.iter().enumerate() {
            if outline.covered(rim.at) {
                continue;
            }
            match view.look(rim, reach) {
                Seen::Edge(off) => {
                    open += 1;
                    let [dx, dy] = rim.outward;
                    let along = |other: &Vec<Rim>| {
                        (other[i].at[0] - rim.at[0]) * dx + (other[i].at[1] - rim.at[1]) * dy
                    };
                    rows.push(moved_rims.iter().map(along).collect::<Vec<f64>>());
                    offs.push(off);
                }
                // Where it is dark on both sides another part goes on.
                Seen::Nothing if view.contrast.at(moved(rim.at, rim.outward, BESIDE_PX)) < half => open += 1,
                Seen::Nothing | Seen::Hidden => {}
            }
        }
        let found = offs.len();
        if found < count.max(4) {
            return None;
        }
        let mut sizes: Vec<f64> = offs.iter().map(|off: &f64| off.abs()).collect();
        let scatter = MEDIAN_TO_SIGMA * median(&mut sizes, f64::total_cmp)?;
        let limit = TUKEY_SIGMAS * scatter.max(EDGE_STD_PX);
        let weights: Vec<f64> = offs
            .iter()
            .map(|off| if off.abs() < limit { (1.0 - (off / limit).powi(2)).powi(2) } else { 0.0 })
            .collect();
        let sigma = scatter.max(EDGE_STD_PX);
        let (mut normal, mut right) = (DMatrix::<f64>::zeros(count, count), DVector::<f64>::zeros(count));
        let mut take = |row: &[f64], off: f64, weight: f64| {
            let row = DVector::from_column_slice(row);
            normal += &row * row.transpose() * weight;
            right += row * (weight * off);
        };
        for ((row, off), weight) in rows.iter().zip(&offs).zip(&weights) {
            take(row, *off, weight / (sigma * sigma));
        }
        for (row, off) in outline.prior(&pose) {
            let scaled: Vec<f64> = row.iter().zip(steps).map(|(weight, step)| weight * step).collect();
            take(&scaled, -off, 1.0);
        }
        let factor = normal.cholesky()?;
        let by = factor.solve(&right);
        pose.iter_mut().zip(by.iter()).zip(steps).for_each(|((value, by), step)| *value += by * step);
        let scale = DMatrix::from_diagonal(&DVector::from_column_slice(steps));
        let outward = offs.iter().zip(&weights).map(|(off, weight)| off * weight).sum::<f64>();
        last = Some(Settled {
            pose: pose.clone(),
            covariance: &scale * factor.inverse() * &scale,
            scatter_px: scatter,
            outward_px: outward / weights.iter().sum::<f64>().max(f64::MIN_POSITIVE),
            found,
            open,
        });
    }
    last
}
