//! The forces of contacts, end stops and friction loss together.
//!
//! They are where the cost (a - a0)' M (a - a0) / 2 + s(J a - a_ref) is least, a0 being the acceleration without them: the cost
//! is convex, so the least is one point whoever finds it. Here Newton's method does, with a search along each step.
//! Source: MuJoCo, Computation, "Constraint model" (primal problem, elliptic cones).

use super::points::less;
use crate::scalar::Scalar;

/// Most rows of a contact (MuJoCo's condim 6).
pub(super) const CONTACT_ROWS_MAX: usize = 6;
/// Most Newton steps (chosen); a dozen are many.
const NEWTON_STEPS_MAX: usize = 100;
/// The search along a step ends at this share of its initial slope, or after this many evaluations (both chosen).
const SEARCH_SLOPE_SHARE: f64 = 1e-12;
const SEARCH_EVALUATIONS_MAX: usize = 60;
/// Changes below this share of the acceleration count as rounding (chosen).
const CONVERGED_STEP_SHARE: f64 = 1e-11;

/// What the forces of one or more rows may be.
#[derive(Debug, Clone, Copy)]
pub(super) enum Law<T> {
    /// Between bounds.
    Bounded([T; 2]),
    /// Within an elliptic cone of so many rows, the first along the normal: with its slope, and friction along each other row.
    Cone { rows: usize, slope: f64, friction: [f64; 5] },
    /// A row of the cone before it.
    Within,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Row<T> {
    pub(super) law: Law<T>,
    /// a_ref.
    pub(super) reference: T,
    /// 1 / R.
    pub(super) weight: T,
}

/// Rows with the forces they exert.
#[derive(Debug, Clone)]
pub(super) struct Problem<T> {
    pub(super) rows: Vec<Row<T>>,
    /// Shape (rows, nv).
    pub(super) jacobian: Vec<T>,
    /// Shape (nv, nv).
    pub(super) mass: Vec<T>,
    pub(super) acceleration: Vec<T>,
    pub(super) force: Vec<T>,
    /// Where each row is on its law: 0 between, 1 or -1 at a bound, 2 on a cone's side.
    pub(super) zones: Vec<i8>,
    step: Vec<T>,
    change: Vec<T>,
    residual: Vec<T>,
    matrix: Vec<T>,
    gradient: Vec<T>,
}

/// Forces of the rows of one law, how they fall with each residual, and the zone.
type Push<T> = ([T; CONTACT_ROWS_MAX], [[T; CONTACT_ROWS_MAX]; CONTACT_ROWS_MAX], i8);

impl<T: Scalar> Problem<T> {
    pub(super) fn new(nv: usize) -> Self {
        let zeros = || vec![T::ZERO; nv];
        Self {
            rows: Vec::new(),
            jacobian: Vec::new(),
            mass: vec![T::ZERO; nv * nv],
            acceleration: zeros(),
            force: Vec::new(),
            zones: Vec::new(),
            step: zeros(),
            change: Vec::new(),
            residual: Vec::new(),
            matrix: vec![T::ZERO; nv * nv],
            gradient: zeros(),
        }
    }

    pub(super) fn clear(&mut self) {
        self.rows.clear();
        self.jacobian.clear();
    }

    fn push(&self, first: usize, residual: &[T]) -> (usize, Push<T>) {
        let row = &self.rows[first];
        match row.law {
            Law::Bounded(bounds) => (1, bounded(bounds, row.weight, residual[first])),
            Law::Cone { rows, slope, friction } => {
                let weights = |k: usize| self.rows[first + k].weight;
                (rows, cone(rows, slope, &friction, weights, &residual[first..first + rows]))
            }
            Law::Within => {
                (1, ([T::ZERO; CONTACT_ROWS_MAX], [[T::ZERO; CONTACT_ROWS_MAX]; CONTACT_ROWS_MAX], 0))
            }
        }
    }

    /// Finds `acceleration`, `force` and `zones`. `smooth` is the sum of all other forces, shape (nv).
    pub(super) fn solve(&mut self, smooth: &[T]) {
        let nv = smooth.len();
        let rows = self.rows.len();
        self.force.resize(rows, T::ZERO);
        self.zones.resize(rows, 0);
        self.residual.resize(rows, T::ZERO);
        self.change.resize(rows, T::ZERO);
        self.acceleration.copy_from_slice(smooth);
        self.matrix.copy_from_slice(&self.mass);
        cholesky(nv, &mut self.matrix);
        substitute(nv, &self.matrix, &mut self.acceleration);
        let mut has_converged = false;
        for _ in 0..NEWTON_STEPS_MAX {
            self.gradient(smooth);
            self.step.copy_from_slice(&self.gradient);
            cholesky(nv, &mut self.matrix);
            substitute(nv, &self.matrix, &mut self.step);
            // a whole step from the solution: derivatives come with it as the implicit function's, whatever the way here
            let share = if has_converged { T::ONE } else { self.search(smooth) };
            let (mut moved, mut size) = (T::ZERO, T::ZERO);
            for (a, &step) in self.acceleration.iter_mut().zip(&self.step) {
                *a += share * step;
                moved = moved.max((share * step).abs());
                size = size.max(a.abs());
            }
            if has_converged {
                break;
            }
            has_converged = !less(size * T::from_f64(CONVERGED_STEP_SHARE), moved);
        }
        self.gradient(smooth);
    }

    /// Fills `gradient` with minus the cost's, `matrix` with its second derivatives, `residual`, `force` and `zones`.
    fn gradient(&mut self, smooth: &[T]) {
        let nv = smooth.len();
        for (row, residual) in self.residual.iter_mut().enumerate() {
            let jacobian = &self.jacobian[row * nv..(row + 1) * nv];
            *residual = dot(jacobian, &self.acceleration) - self.rows[row].reference;
        }
        self.matrix.copy_from_slice(&self.mass);
        for (dof, gradient) in self.gradient.iter_mut().enumerate() {
            *gradient = smooth[dof] - dot(&self.mass[dof * nv..(dof + 1) * nv], &self.acceleration);
        }
        let mut first = 0;
        while first < self.rows.len() {
            let (rows, (force, slopes, zone)) = self.push(first, &self.residual);
            for k in 0..rows {
                self.force[first + k] = force[k];
                self.zones[first + k] = zone;
                let row_jacobian = &self.jacobian[(first + k) * nv..(first + k + 1) * nv];
                for (gradient, &j) in self.gradient.iter_mut().zip(row_jacobian) {
                    *gradient += force[k] * j;
                }
                for (l, &slope) in slopes[k][..rows].iter().enumerate() {
                    if !less(T::ZERO, slope.abs()) {
                        continue;
                    }
                    let other = &self.jacobian[(first + l) * nv..(first + l + 1) * nv];
                    for (i, &j) in row_jacobian.iter().enumerate() {
                        let share = slope * j;
                        for (entry, &other) in self.matrix[i * nv..i * nv + i + 1].iter_mut().zip(other) {
                            *entry += share * other;
                        }
                    }
                }
            }
            first += rows;
        }
    }

    /// The share of `step` at which the cost is least, no more than 1.
    fn search(&mut self, smooth: &[T]) -> T {
        let nv = smooth.len();
        for (row, change) in self.change.iter_mut().enumerate() {
            *change = dot(&self.jacobian[row * nv..(row + 1) * nv], &self.step);
        }
        let (mut constant, mut linear) = (T::ZERO, T::ZERO);
        for ((row, &smooth), &step) in self.mass.chunks(nv).zip(smooth).zip(&self.step) {
            constant += (dot(row, &self.acceleration) - smooth) * step;
            linear += dot(row, &self.step) * step;
        }
        let mut there = self.residual.clone();
        // slope and curvature of the cost along the step
        let mut along = |share: T| {
            for ((there, &here), &change) in there.iter_mut().zip(&self.residual).zip(&self.change) {
                *there = here + share * change;
            }
            let (mut slope, mut curvature) = (constant + share * linear, linear);
            let mut first = 0;
            while first < self.rows.len() {
                let (rows, (force, slopes, _)) = self.push(first, &there);
                for k in 0..rows {
                    slope -= force[k] * self.change[first + k];
                    for (l, &second) in slopes[k][..rows].iter().enumerate() {
                        curvature += second * self.change[first + k] * self.change[first + l];
                    }
                }
                first += rows;
            }
            (slope, curvature)
        };
        let (start, _) = along(T::ZERO);
        let slope_tolerance = start.abs() * T::from_f64(SEARCH_SLOPE_SHARE);
        let (mut low, mut high, mut share) = (T::ZERO, T::ONE, T::ONE);
        for _ in 0..SEARCH_EVALUATIONS_MAX {
            let (slope, curvature) = along(share);
            // the cost still falls at the whole step, which is taken then
            if !less(slope_tolerance, slope.abs()) || (less(slope, T::ZERO) && !less(share, T::ONE)) {
                break;
            }
            if less(slope, T::ZERO) {
                low = share;
            } else {
                high = share;
            }
            share -= slope / curvature;
            if !(less(low, share) && less(share, high)) {
                share = (low + high) * T::from_f64(0.5);
            }
        }
        share
    }
}

fn dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (&a, &b)| sum + a * b)
}

fn bounded<T: Scalar>([low, high]: [T; 2], weight: T, residual: T) -> Push<T> {
    let (mut force, mut slopes) =
        ([T::ZERO; CONTACT_ROWS_MAX], [[T::ZERO; CONTACT_ROWS_MAX]; CONTACT_ROWS_MAX]);
    let free = -(residual * weight);
    let zone = if !less(low, free) {
        force[0] = low;
        -1
    } else if !less(free, high) {
        force[0] = high;
        1
    } else {
        force[0] = free;
        slopes[0][0] = weight;
        0
    };
    (force, slopes, zone)
}

/// With U = (mu x_0, f_k x_k), N = U_0 and T the length of the rest: no force where N >= mu T, a spring along each row where
/// mu N + T <= 0, and between them the cost D_0 (N - mu T)^2 / (2 mu^2 (1 + mu^2)), which falls towards the cone.
fn cone<T: Scalar>(
    rows: usize,
    mu: f64,
    friction: &[f64; 5],
    weight: impl Fn(usize) -> T,
    x: &[T],
) -> Push<T> {
    let (mut force, mut slopes) =
        ([T::ZERO; CONTACT_ROWS_MAX], [[T::ZERO; CONTACT_ROWS_MAX]; CONTACT_ROWS_MAX]);
    let scale = |k: usize| T::from_f64(if k == 0 { mu } else { friction[k - 1] });
    let mut u = [T::ZERO; CONTACT_ROWS_MAX];
    let mut squared = T::ZERO;
    for k in 0..rows {
        u[k] = scale(k) * x[k];
        if k > 0 {
            squared += u[k] * u[k];
        }
    }
    let (normal, tangential) = (u[0], squared.sqrt());
    let mu = T::from_f64(mu);
    let none = !less(T::ZERO, tangential);
    if !less(normal, mu * tangential) || (none && !less(normal, T::ZERO)) {
        return (force, slopes, -1);
    }
    if !less(T::ZERO, mu * normal + tangential) || none {
        for k in 0..rows {
            force[k] = -(weight(k) * x[k]);
            slopes[k][k] = weight(k);
        }
        return (force, slopes, 0);
    }
    let stiffness = weight(0) / (mu * mu * (T::ONE + mu * mu));
    let depth = normal - mu * tangential;
    // the direction of the tangential part, and the slope of the depth along each of U
    let along: [T; CONTACT_ROWS_MAX] =
        std::array::from_fn(|k| if k == 0 || k >= rows { T::ZERO } else { u[k] / tangential });
    let slope = |k: usize| if k == 0 { T::ONE } else { -(mu * along[k]) };
    for k in 0..rows {
        force[k] = -(stiffness * depth * slope(k) * scale(k));
        for l in 0..rows {
            let mut curvature = slope(k) * slope(l);
            if k > 0 && l > 0 {
                let same = if k == l { T::ONE } else { T::ZERO };
                curvature += -(depth * mu) * (same - along[k] * along[l]) / tangential;
            }
            slopes[k][l] = stiffness * curvature * scale(k) * scale(l);
        }
    }
    (force, slopes, 2)
}

/// Replaces the lower triangle by its factor L, matrix = L L'.
fn cholesky<T: Scalar>(n: usize, matrix: &mut [T]) {
    for i in 0..n {
        for j in 0..=i {
            let mut sum = matrix[i * n + j];
            for k in 0..j {
                sum -= matrix[i * n + k] * matrix[j * n + k];
            }
            matrix[i * n + j] = if i == j { sum.sqrt() } else { sum / matrix[j * n + j] };
        }
    }
}

/// Solves L L' x = b in place.
fn substitute<T: Scalar>(n: usize, factor: &[T], x: &mut [T]) {
    for i in 0..n {
        let sum = x[i] - dot(&factor[i * n..i * n + i], &x[..i]);
        x[i] = sum / factor[i * n + i];
    }
    for i in (0..n).rev() {
        let mut sum = x[i];
        for k in i + 1..n {
            sum -= factor[k * n + i] * x[k];
        }
        x[i] = sum / factor[i * n + i];
    }
}
