//! Moves a figure until its outline lies on the edges that a picture shows.

use ground::statistics::{MEDIAN_TO_SIGMA, TUKEY_SIGMAS, median};
use nalgebra::{DMatrix, DVector};

use super::canvas::Canvas;
use super::edges::{Rim, Seen, View};
use super::{Figure, Prior};
use crate::keypoints::Sigma;
use camera::calibration::Px;

/// A figure where a picture shows it.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    /// Its numbers.
    pub(crate) pose: Vec<f64>,
    /// What the picture alone says of them: inverse covariance, shape (size, size).
    pub(crate) information: DMatrix<f64>,
    /// Covariance of them, with what was known before.
    pub(crate) covariance: DMatrix<f64>,
    /// How many places of each part could have been seen, and at how many an edge is.
    pub(crate) support: Vec<Support>,
    /// How badly the outline explains what is seen at the places that could be: Tukey's mean at a fixed scale, from 0 to 1.
    pub(crate) misfit: f64,
}

/// How much of a part's outline is there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Support {
    /// Places on it.
    pub(crate) places: usize,
    /// Those that nothing hides.
    pub(crate) open: usize,
    /// Those where an edge is.
    pub(crate) found: usize,
}

/// What pixel sampling leaves of an edge however often it is seen, 1 sigma \[px\]; measured on renders.
const FLOOR_PX: f64 = 0.03;
/// What is wrong with a keypoint, which many edges tell, by how these lie on the pixels, 1 sigma \[px\]: every image of a pose repeats
/// it. Measured on the mock's pictures (0.02 to 0.03) and on the clips of `tests/src/clips` (0.01 to 0.02).
const POSE_FLOOR_PX: f64 = 0.02;
/// Neighbouring places share pixels, and so their noise.
const CORRELATED_PLACES: f64 = 1.5;
/// How the reach shrinks, and its end \[px\].
const REACH_SHRINK_SHARE: f64 = 0.5;
const LEAST_REACH_PX: f64 = 3.0;
/// Steps at each reach, and at the last one.
const STEPS: usize = 3;
const LAST_STEPS: usize = 8;
/// A step by which no edge moves more than this ends the fit \[px\].
const SETTLED_PX: f64 = 2e-3;
/// A step that moves the outline farther than so many reaches has lost it.
const MOST_STEPS_REACH: f64 = 4.0;
/// An edge nearer than this to the outline, or than so many sigmas, is the outline's \[px\].
const OWN_EDGE_PX: f64 = 1.0;
const OWN_EDGE_SIGMAS: f64 = 4.0;
/// Scale at which fits of other outlines are compared \[px\]: what blurred edges leave.
const MISFIT_SCALE_PX: f64 = 0.3;

/// The edges seen across an outline.
struct Look {
    rims: Vec<Rim>,
    seen: Vec<Seen>,
    /// Derivatives of each edge's distance by all numbers, shape (rims, size).
    slopes: Vec<f64>,
}

impl Look {
    fn new(figure: &dyn Figure, canvas: &Canvas, view: &View, pose: &[f64], reach: f64) -> Self {
        let mut places = figure.places(pose);
        let size = figure.size();
        for (rim, slopes) in places.rims.iter_mut().zip(places.slopes.chunks_exact_mut(size)) {
            let [[a, b], [c, d]] = canvas.jacobian(rim.at);
            let determinant = a * d - b * c;
            let [x, y] = rim.outward;
            // A line's normal goes by the inverse transpose.
            let normal = [(d * x - c * y) / determinant, (a * y - b * x) / determinant];
            let length = normal[0].hypot(normal[1]);
            slopes.iter_mut().for_each(|slope| *slope /= length);
            *rim = Rim { at: canvas.px(rim.at), outward: normal.map(|one| one / length), ..*rim };
        }
        let seen = places.rims.iter().map(|rim| view.look(rim, reach)).collect();
        Self { rims: places.rims, seen, slopes: places.slopes }
    }

    fn edges(&self) -> impl Iterator<Item = (f64, &[f64])> {
        let size = self.slopes.len() / self.rims.len().max(1);
        let rows = self.slopes.chunks_exact(size.max(1));
        self.seen.iter().zip(rows).filter_map(|(seen, row)| match seen {
            Seen::Edge(off) => Some((*off, row)),
            Seen::Nothing | Seen::Hidden => None,
        })
    }

    fn scatter_px(&self) -> f64 {
        let mut sizes: Vec<f64> = self.edges().map(|(off, _)| off.abs()).collect();
        (MEDIAN_TO_SIGMA * median(&mut sizes, f64::total_cmp).unwrap_or(0.0)).max(FLOOR_PX)
    }

    /// Gauss and Newton's matrix and right side with Tukey's weights at `scale`.
    fn normal(&self, scale: f64, size: usize) -> (DMatrix<f64>, DVector<f64>) {
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for (off, row) in self.edges() {
            let share = 1.0 - (off / (TUKEY_SIGMAS * scale)).powi(2);
            if share <= 0.0 {
                continue;
            }
            let weight = (share / scale).powi(2);
            for (i, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                right[i] += weight * a * off;
                for (j, b) in row[..=i].iter().enumerate() {
                    normal[(i, j)] += weight * a * b;
                }
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        (normal, right)
    }

    /// How far the outline moves by `step`, at most \[px\].
    fn moved(&self, step: &DVector<f64>) -> f64 {
        let by = |row: &[f64]| row.iter().zip(step.iter()).map(|(a, b)| a * b).sum::<f64>().abs();
        self.edges().map(|(_, row)| by(row)).fold(0.0, f64::max)
    }

    fn support(&self, parts: usize, scale: f64) -> Vec<Support> {
        let mut support = vec![Support::default(); parts];
        let near = OWN_EDGE_PX.max(OWN_EDGE_SIGMAS * scale);
        for (rim, seen) in self.rims.iter().zip(&self.seen) {
            let of = &mut support[rim.part];
            of.places += 1;
            of.open += usize::from(*seen != Seen::Hidden);
            of.found += usize::from(matches!(seen, Seen::Edge(off) if off.abs() <= near));
        }
        support
    }

    fn misfit(&self) -> f64 {
        let rho = |off: f64| 1.0 - (1.0 - (off / (TUKEY_SIGMAS * MISFIT_SCALE_PX)).powi(2).min(1.0)).powi(3);
        let (mut sum, mut open) = (0.0, 0u32);
        for seen in &self.seen {
            match seen {
                Seen::Edge(off) => sum += rho(*off),
                Seen::Nothing => sum += 1.0,
                Seen::Hidden => continue,
            }
            open += 1;
        }
        sum / f64::from(open.max(1))
    }
}

/// Fits `figure` to what `view` shows, beginning at `start`, whose outline is no farther off than `reach` \[px\].
///
/// `None` where too little is seen of it or the fit runs away.
pub(crate) fn fit(
    figure: &dyn Figure,
    canvas: &Canvas,
    view: &View,
    prior: &Prior,
    start: Vec<f64>,
    reach: f64,
) -> Option<Fitted> {
    let size = figure.size();
    let mut pose = start;
    let mut reach = reach.max(LEAST_REACH_PX);
    loop {
        let last = reach <= LEAST_REACH_PX;
        for _ in 0..if last { LAST_STEPS } else { STEPS } {
            let look = Look::new(figure, canvas, view, &pose, reach);
            if look.edges().count() < 2 * size {
                return None;
            }
            let scale = look.scatter_px();
            let (normal, right) = look.normal(scale, size);
            let step = (normal + &prior.precision).cholesky()?.solve(&(right + prior.pull(&pose)));
            let moved = look.moved(&step);
            if !moved.is_finite() || moved > MOST_STEPS_REACH * reach {
                return None;
            }
            pose.iter_mut().zip(step.iter()).for_each(|(number, step)| *number += step);
            if moved < if last { SETTLED_PX } else { reach / 10.0 } {
                break;
            }
        }
        if last {
            break;
        }
        reach = (REACH_SHRINK_SHARE * reach).max(LEAST_REACH_PX);
    }
    let look = Look::new(figure, canvas, view, &pose, LEAST_REACH_PX);
    let scatter_px = look.scatter_px();
    let information = look.normal(scatter_px, size).0 / CORRELATED_PLACES;
    let covariance = (&information + &prior.precision).cholesky()?.inverse();
    Some(Fitted {
        information,
        covariance,
        support: look.support(figure.parts(), scatter_px),
        misfit: look.misfit(),
        pose,
    })
}

/// The slopes of the edges that `view` shows of the outline of `pose`, each as a share of its step \[1/px\].
pub(crate) fn edge_slopes(figure: &dyn Figure, canvas: &Canvas, view: &View, pose: &[f64]) -> Vec<f64> {
    let look = Look::new(figure, canvas, view, pose, LEAST_REACH_PX);
    let edges = look.rims.iter().zip(&look.seen);
    let slopes = edges.filter_map(|(rim, seen)| match seen {
        Seen::Edge(off) => view.slope(rim, *off),
        Seen::Nothing | Seen::Hidden => None,
    });
    slopes.collect()
}

impl Fitted {
    /// P0..Pn in the picture \[px\], and sigma of each per axis.
    pub(crate) fn keypoints(&self, figure: &dyn Figure, canvas: &Canvas) -> (Vec<Px>, Vec<Sigma>) {
        let size = figure.size();
        let (points, slopes) = figure.points(&self.pose);
        let alone = self.covariance_alone(figure);
        let sigmas = slopes.chunks_exact(2 * size).zip(&points).map(|(rows, at)| {
            let [[a, b], [c, d]] = canvas.jacobian(*at);
            let variance = |covariance: &DMatrix<f64>| {
                let of_row = |row: [f64; 2]| {
                    let by = DVector::from_fn(size, |k, _| row[0] * rows[k] + row[1] * rows[size + k]);
                    by.dot(&(covariance * &by))
                };
                ((of_row([a, b]) + of_row([c, d])) / 2.0).max(0.0)
            };
            let (whole, own) = (variance(&self.covariance), variance(&alone));
            let pose_px = (whole - own).max(0.0).sqrt().hypot(POSE_FLOOR_PX);
            Sigma { whole_px: own.min(whole).sqrt().hypot(pose_px), pose_px }
        });
        let sigmas = sigmas.collect();
        (points.into_iter().map(|at| canvas.px(at)).collect(), sigmas)
    }

    /// Covariance of the numbers by what is this picture's own, its noise: were those known that all images share.
    fn covariance_alone(&self, figure: &dyn Figure) -> DMatrix<f64> {
        let (size, shared) = (figure.size(), figure.shared());
        let own = size - shared;
        let stiff = &self.information + figure.stiffness();
        let mut covariance = DMatrix::zeros(size, size);
        if let Some(factor) = stiff.view((shared, shared), (own, own)).into_owned().cholesky() {
            covariance.view_mut((shared, shared), (own, own)).copy_from(&factor.inverse());
        }
        covariance
    }

    /// All parts together.
    pub(crate) fn whole(&self) -> Support {
        self.support.iter().fold(Support::default(), |sum, part| Support {
            places: sum.places + part.places,
            open: sum.open + part.open,
            found: sum.found + part.found,
        })
    }
}
