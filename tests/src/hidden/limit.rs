//! The smallest size of a cause that a case's runs can show: Fisher information by finite differences of the generator.
//!
//! What a fit may change by itself (coefficients, dampings, poses) is projected out of the difference that a cause makes, both
//! whitened by the noise. What is left has a chi-square; the limit is where it is 30.

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};

use super::bench::{Bench, DERIVATIVE_STEP_S, Mechanism, Run};
use super::chain::{Link, Plane};
use super::hide::Hideout;
use super::rivals::Rivals;
use super::terms::Hidden;
use super::three_links::{LINKS, THREE_LINKS};
use super::write::correlation;

/// The chi-square at which an effect counts as detectable.
pub const DETECTION_CHI_SQUARE: f64 = 30.0;
/// Standard deviation of a keypoint coordinate \[m\].
pub const NOISE_M: f64 = 4e-4;

/// How far a fit's bounds let its numbers go, as standard deviations: coefficients, dampings \[N m s/rad\], angles \[rad\].
const COEFFICIENT_STD: f64 = 3.0;
const DAMPING_STD_N_M_S_PER_RAD: f64 = 1e-5;
const ANGLE_STD_RAD: f64 = 1.0;
/// Springs and dampings of what is of one piece, as shares of themselves.
const SPRING_STD_SHARE: f64 = 5.0;
/// Steps of the finite differences: shares of coefficients and dampings, and an angle \[rad\].
const DIFFERENCE_STEP_SHARE: f64 = 0.02;
const DIFFERENCE_STEP_RAD: f64 = 1e-3;

/// Keypoints in the images of a run.
type Film = Vec<Vec<Plane>>;
/// A column of seen coordinates over several runs.
type Column = Vec<f64>;

/// What a fit of some runs of a bench can imitate.
#[derive(Debug)]
pub struct Imitation<const N: usize> {
    /// The runs that are fitted.
    pub(super) runs: Vec<Run<N>>,
    /// What is seen in them without any cause.
    plain: Vec<Film>,
    basis: DMatrix<f64>,
    correlation: f64,
}

fn flat(run: &[Vec<Plane>]) -> impl Iterator<Item = f64> + '_ {
    run.iter().flatten().flatten().copied()
}

/// The runs of `bench` that are fitted.
fn fitted<const N: usize>(bench: &Bench<N>) -> impl Iterator<Item = &Run<N>> {
    bench.runs.iter().filter(|run| !run.held_out)
}

/// Noise of unit size whose neighbours in time, `width` coordinates apart, correlate.
fn whitened(runs: &[Vec<f64>], width: usize, correlation: f64) -> Column {
    let rest = (1.0 - correlation * correlation).sqrt();
    let each = runs.iter().flat_map(|run| {
        (0..run.len()).map(move |k| match k.checked_sub(width) {
            Some(before) => (run[k] - correlation * run[before]) / (rest * NOISE_M),
            None => run[k] / NOISE_M,
        })
    });
    each.collect()
}

/// A number of one link.
#[derive(Debug, Clone, Copy)]
enum Place {
    Coefficient(usize),
    Damping,
    Spring(usize),
}

impl Place {
    fn in_link(self, link: &mut Link) -> &mut f64 {
        match self {
            Self::Coefficient(which) => &mut link.shape.coefficients[which],
            Self::Damping => &mut link.damping,
            Self::Spring(which) => &mut link.springs[which],
        }
    }
}

/// The numbers that a fit of `bench` turns, each with the links that share it, and how far bounds let the first of these go.
fn numbers<const N: usize>(bench: &Bench<N>) -> Vec<(Place, Vec<usize>, f64)> {
    let coefficients = (0..5).map(|which| (Place::Coefficient(which), COEFFICIENT_STD));
    if bench.mechanism.of_one_piece {
        let all = coefficients.map(|(place, loose)| (place, (0..N).collect(), loose));
        let loose = |place: Place, first: usize| {
            SPRING_STD_SHARE * *place.in_link(&mut bench.chain.links[first].clone())
        };
        let joints = [(Place::Damping, 0), (Place::Spring(0), 1), (Place::Spring(1), 1)];
        let joints = joints.map(|(place, first)| (place, (first..N).collect(), loose(place, first)));
        return all.chain(joints.into_iter().filter(|_| bench.fits_joints)).collect();
    }
    let each =
        (0..N).flat_map(|link| coefficients.clone().map(move |(place, loose)| (place, vec![link], loose)));
    let dampings = (1..N).map(|link| (Place::Damping, vec![link], DAMPING_STD_N_M_S_PER_RAD));
    each.chain(dampings.filter(|_| bench.fits_joints)).collect()
}

impl<const N: usize> Imitation<N> {
    /// For `runs` of `bench`, seen with noise that correlates by `correlation` from image to image.
    pub fn new<'r>(bench: &Bench<N>, runs: impl IntoIterator<Item = &'r Run<N>>, correlation: f64) -> Self {
        let width = 2 * bench.mechanism.keypoints.len();
        let runs: Vec<Run<N>> = runs.into_iter().cloned().collect();
        let seen = |bench: &Bench<N>| -> Vec<Film> {
            runs.iter().map(|run| bench.watch(run, &Hidden::default(), DERIVATIVE_STEP_S)).collect()
        };
        let between = |a: &[Film], b: &[Film], step: f64| -> Column {
            let runs = a.iter().zip(b);
            let slopes = runs.map(|(a, b)| flat(a).zip(flat(b)).map(|(a, b)| (a - b) / step).collect());
            whitened(&slopes.collect::<Vec<Vec<f64>>>(), width, correlation)
        };
        let plain = seen(bench);
        let mut columns: Vec<(Column, f64)> = Vec::new();
        for (place, links, loose) in numbers(bench) {
            let (mut up, mut down) = (bench.clone(), bench.clone());
            let step =
                |link: usize| DIFFERENCE_STEP_SHARE * *place.in_link(&mut bench.chain.links[link].clone());
            for &link in &links {
                *place.in_link(&mut up.chain.links[link]) += step(link);
                *place.in_link(&mut down.chain.links[link]) -= step(link);
            }
            let step = step(links[0]);
            columns.push((between(&seen(&up), &seen(&down), 2.0 * step), loose));
        }
        for (place, run) in runs.iter().enumerate() {
            for link in usize::from(run.is_driven())..N {
                let turned = |by: f64| {
                    let mut run = run.clone();
                    run.motion.held[link] += by;
                    bench.watch(&run, &Hidden::default(), DERIVATIVE_STEP_S)
                };
                let (mut up, mut down) = (plain.clone(), plain.clone());
                (up[place], down[place]) = (turned(DIFFERENCE_STEP_RAD), turned(-DIFFERENCE_STEP_RAD));
                columns.push((between(&up, &down, 2.0 * DIFFERENCE_STEP_RAD), ANGLE_STD_RAD));
            }
        }
        let (rows, count) = (columns[0].0.len(), columns.len());
        let mut matrix = DMatrix::zeros(rows + count, count);
        for (place, (column, loose)) in columns.into_iter().enumerate() {
            let mut column = DVector::from_vec(column).push(0.0).resize_vertically(rows + count, 0.0);
            column[rows + place] = 1.0 / loose;
            matrix.set_column(place, &column.normalize());
        }
        Self { runs, plain, basis: matrix.qr().q(), correlation }
    }

    /// The difference that `hidden` makes, whitened, beyond what a fit can imitate.
    pub(super) fn left(&self, bench: &Bench<N>, hidden: &Hidden) -> DVector<f64> {
        self.left_beside(bench, hidden, &Hidden::default())
    }

    /// The same, beside `base`.
    fn left_beside(&self, bench: &Bench<N>, hidden: &Hidden, base: &Hidden) -> DVector<f64> {
        let runs = self.runs.iter().zip(&self.plain).map(|(run, plain)| {
            let with = bench.watch(run, hidden, DERIVATIVE_STEP_S);
            match base.0.is_empty() {
                true => flat(&with).zip(flat(plain)).map(|(a, b)| a - b).collect(),
                false => {
                    let without = bench.watch(run, base, DERIVATIVE_STEP_S);
                    flat(&with).zip(flat(&without)).map(|(a, b)| a - b).collect::<Vec<f64>>()
                }
            }
        });
        let difference =
            whitened(&runs.collect::<Vec<_>>(), 2 * bench.mechanism.keypoints.len(), self.correlation);
        let rows = self.basis.nrows();
        let difference = DVector::from_vec(difference).resize_vertically(rows, 0.0);
        &difference - &self.basis * self.basis.tr_mul(&difference)
    }

    /// The chi-square by which the runs show `hidden` beyond all that a fit can imitate.
    pub fn chi_square(&self, bench: &Bench<N>, hidden: &Hidden) -> f64 {
        self.left(bench, hidden).norm_squared()
    }

    /// The same, with the partner `other` of a pair at work beside it and each of its numbers free: one is changed in each of
    /// `nudged`.
    pub fn chi_square_beside(
        &self,
        bench: &Bench<N>,
        both: &Hidden,
        other: &Hidden,
        nudged: &[Hidden],
    ) -> f64 {
        let own = self.left_beside(bench, both, other);
        let theirs = orthonormal(nudged.iter().map(|nudged| self.left_beside(bench, nudged, both)));
        own.norm_squared() - theirs.iter().map(|along| along.dot(&own).powi(2)).sum::<f64>()
    }

    /// The size at which `at(size)` shows a chi-square of [`DETECTION_CHI_SQUARE`], from a first step: in proportion, then twice
    /// with the true difference. `None` where the runs show nothing.
    pub fn limit(&self, step: f64, chi_square: impl Fn(f64) -> f64) -> Option<f64> {
        let mut size = step;
        for _ in 0..4 {
            let shown = chi_square(size);
            if shown.is_nan() || shown < 1e-9 {
                return None;
            }
            size *= (DETECTION_CHI_SQUARE / shown).sqrt().clamp(0.01, 100.0);
        }
        Some(size)
    }
}

/// Orthonormal directions that span `columns`.
pub(super) fn orthonormal(columns: impl Iterator<Item = DVector<f64>>) -> Vec<DVector<f64>> {
    let mut directions: Vec<DVector<f64>> = Vec::new();
    for mut left in columns {
        let size = left.norm();
        for other in &directions {
            let along = other.dot(&left);
            left.axpy(-along, other, 1.0);
        }
        // a direction that is the others' but for rounding is none of its own
        if left.norm() > 1e-3 * size {
            directions.push(left.normalize());
        }
    }
    directions
}

/// The largest angle between neighbouring links over the fitted runs \[rad\].
pub fn largest_bend<const N: usize>(bench: &Bench<N>) -> f64 {
    let records =
        fitted(bench).map(|run| bench.chain.run(&run.motion, &Hidden::default(), DERIVATIVE_STEP_S));
    let bends = records.flat_map(|record| {
        record.states.into_iter().flat_map(|state| (1..N).map(move |i| state.angle[i] - state.angle[i - 1]))
    });
    bends.map(f64::abs).fold(0.0, f64::max)
}

/// Benches, what their fits can imitate and the limits of the causes there, made once each.
#[derive(Debug)]
pub struct Benches<const N: usize> {
    mechanism: &'static Mechanism<N>,
    benches: HashMap<(u64, bool), (Bench<N>, Imitation<N>)>,
    limits: HashMap<(u64, bool, String), Option<f64>>,
    /// In all runs, those held out too: a description is scored on them.
    rivals: HashMap<(u64, bool), (Imitation<N>, Rivals)>,
}

impl Default for Benches<LINKS> {
    fn default() -> Self {
        Self::of(&THREE_LINKS)
    }
}

impl<const N: usize> Benches<N> {
    /// None yet, of `mechanism`.
    pub fn of(mechanism: &'static Mechanism<N>) -> Self {
        Self { mechanism, benches: HashMap::new(), limits: HashMap::new(), rivals: HashMap::new() }
    }

    /// What they are benches of.
    pub fn mechanism(&self) -> &'static Mechanism<N> {
        self.mechanism
    }

    /// The bench of `seed`.
    pub fn get(&mut self, seed: u64, fits_joints: bool) -> &(Bench<N>, Imitation<N>) {
        let draw = self.mechanism.draw;
        self.benches.entry((seed, fits_joints)).or_insert_with(|| {
            let bench = draw(seed, fits_joints);
            let imitation = Imitation::new(&bench, fitted(&bench), correlation(seed));
            (bench, imitation)
        })
    }

    /// The rival of `cause`, as `hidden` has it, that is nearest to it on the bench of `seed`, and their chi-square apart.
    pub fn nearest(&mut self, seed: u64, fits_joints: bool, cause: &str, hidden: &Hidden) -> (String, f64) {
        self.get(seed, fits_joints);
        let (bench, _) = &self.benches[&(seed, fits_joints)];
        let (imitation, rivals) = self.rivals.entry((seed, fits_joints)).or_insert_with(|| {
            let imitation = Imitation::new(bench, &bench.runs, correlation(seed));
            let rivals = Rivals::new(bench, &imitation);
            (imitation, rivals)
        });
        rivals.nearest(bench, imitation, cause, hidden)
    }

    /// The limit of `hideout` on the bench of `seed`.
    pub fn limit(&mut self, seed: u64, fits_joints: bool, hideout: &Hideout) -> Option<f64> {
        self.get(seed, fits_joints);
        let key = (seed, fits_joints, hideout.cause.clone());
        let (bench, imitation) = &self.benches[&(seed, fits_joints)];
        *self.limits.entry(key).or_insert_with(|| hideout.limit(bench, imitation, None))
    }
}
