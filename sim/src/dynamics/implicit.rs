//! The slope of the velocity-dependent forces, for the integrator that takes them implicitly.
//!
//! Fluid: the exact 6 x 6 slope of each wrench against (w, v), symmetrised and summed over what a body carries
//! like an inertia, so that it shares the mass matrix's pattern. The bias is left explicit. Only for free bodies that carry nothing that moves all
//! slopes are taken as they are, that of the bias among them: six equations of their own.

use super::Work;
use super::fluid::relative;
use super::plant::Plant;
use super::stages::SlopeStage;
use crate::dual::Dual;
use crate::fluid::{Immersed, ImmersedBox};
use crate::math::{Mat3, Sym3, Vec3};
use crate::scalar::{Mask, Scalar};
use crate::space::{Inertia, Motion, Spatial, Wrench};

/// A number with its derivatives by angular and linear velocity.
type Probe<T> = Dual<T, 6>;

/// A symmetric 6 x 6 matrix from motions to wrenches.
type Slope<T> = [[T; 6]; 6];

/// The fluid's shapes made ready for differentiation, and room for their slopes.
#[derive(Debug, Clone)]
pub(crate) struct FluidSlope<T: Scalar> {
    density: Probe<T>,
    viscosity: Probe<T>,
    geoms: Vec<Immersed<Spatial<Probe<T>>>>,
    bodies: Vec<ImmersedBox<Spatial<Probe<T>>>>,
    /// Per body: with all it carries, once summed.
    slopes: Vec<Slope<T>>,
}

impl<T: Scalar> SlopeStage<Spatial<T>> for FluidSlope<T> {
    fn new(plant: &Plant<Spatial<T>>) -> Option<Self> {
        Some(Self {
            density: Probe::constant(plant.density),
            viscosity: Probe::constant(plant.viscosity),
            geoms: plant.fluid_geoms.iter().map(|geom| geom.shape.map(Probe::constant)).collect(),
            bodies: plant.fluid_bodies.iter().map(|body| body.shape.map(Probe::constant)).collect(),
            slopes: vec![[[T::ZERO; 6]; 6]; plant.links.len()],
        })
    }

    fn add(&mut self, plant: &Plant<Spatial<T>>, work: &Work<Spatial<T>>, h: T, matrix: &mut [T]) {
        self.slopes.fill([[T::ZERO; 6]; 6]);
        let (density, viscosity) = (self.density, self.viscosity);
        for (geom, shape) in plant.fluid_geoms.iter().zip(&self.geoms) {
            let (at, rot) = geom.place(plant, work);
            let (w, v) = probes(relative::<Spatial<T>>(work.velocity[geom.body], work.water, at, &rot));
            let wrench = shape.wrench(density, viscosity, w, v);
            let symmetric = !plant.lone.contains(&plant.links[geom.body].root);
            add_about_root(wrench, at, &rot, symmetric, &mut self.slopes[geom.body]);
        }
        for (body, shape) in plant.fluid_bodies.iter().zip(&self.bodies) {
            let (at, rot) = body.place(work);
            let (w, v) = probes(relative::<Spatial<T>>(work.velocity[body.body], work.water, at, &rot));
            let wrench = shape.wrench(density, viscosity, w, v);
            add_about_root(wrench, at, &rot, true, &mut self.slopes[body.body]);
        }
        for index in (1..plant.links.len()).rev() {
            let parent = plant.links[index].parent;
            if parent != 0 {
                let own = self.slopes[index];
                for (sum, row) in self.slopes[parent].iter_mut().zip(own) {
                    for (sum, x) in sum.iter_mut().zip(row) {
                        *sum += x;
                    }
                }
            }
        }
        for dof in (0..plant.nv).filter(|dof| !plant.lone.contains(&plant.dof_body[*dof])) {
            let push = apply(&self.slopes[plant.dof_body[dof]], work.axes[dof]);
            let row = plant.row[dof]..plant.row[dof + 1];
            for (entry, &other) in matrix[row.clone()].iter_mut().zip(&plant.chain[row]) {
                *entry -= h * work.axes[other].power(push);
            }
        }
    }

    fn alone(
        &self,
        (plant, work): (&Plant<Spatial<T>>, &Work<Spatial<T>>),
        qvel: &[T],
        h: T,
        matrix: &[T],
        force: &[T],
    ) -> Vec<(usize, [T; 6])> {
        let equations = |&body: &usize| {
            let first = plant.links[body].dofs.start;
            let mut slopes = [[T::ZERO; 6]; 6];
            for dof in first..first + 6 {
                let row = plant.row[dof]..plant.row[dof + 1];
                for (&entry, &other) in matrix[row.clone()].iter().zip(&plant.chain[row]) {
                    slopes[dof - first][other - first] = entry;
                    slopes[other - first][dof - first] = entry;
                }
            }
            let bias = bias_slope(&work.composite[body], &work.rot[body], &qvel[first + 3..]);
            for along in 0..6 {
                let push = apply(&self.slopes[body], work.axes[first + along]);
                for dof in 0..6 {
                    slopes[dof][along] -= h * work.axes[first + dof].power(push);
                    slopes[dof][along] += h * bias[dof][along];
                }
            }
            (first, solved(slopes, std::array::from_fn(|dof| force[first + dof])))
        };
        plant.lone.iter().map(equations).collect()
    }
}

/// The slope of a free body's bias against its velocities: linear in world axes, angular in its own, in which `turning` begins.
/// `inertia`: its own and that of what is fixed to it, about its origin.
fn bias_slope<T: Scalar>(inertia: &Inertia<Spatial<T>>, rot: &Mat3<T>, turning: &[T]) -> Slope<T> {
    let constant = Dual::<T, 3>::constant;
    let w = rot.apply(Vec3(std::array::from_fn(|i| turning[i])));
    let w = Vec3(std::array::from_fn(|i| Dual { value: w[i], partials: rot.0[i] }));
    let (moment, inertia) = (Vec3(inertia.moment.0.map(constant)), Sym3(inertia.rotational.0.map(constant)));
    let (force, torque) = (w.cross(w.cross(moment)), w.cross(inertia.apply(w)));
    let mut slope = [[T::ZERO; 6]; 6];
    for along in 0..3 {
        let part = |v: Vec3<Dual<T, 3>>| Vec3(v.0.map(|x| x.partials[along]));
        let (force, torque) = (part(force), rot.apply_transposed(part(torque)));
        for axis in 0..3 {
            slope[axis][3 + along] = force[axis];
            slope[3 + axis][3 + along] = torque[axis];
        }
    }
    slope
}

/// The solution of six linear equations, by elimination from the largest number of each column on.
fn solved<T: Scalar>(mut matrix: [[T; 6]; 6], mut right: [T; 6]) -> [T; 6] {
    for column in 0..6 {
        let size = |row: usize| matrix[row][column].abs();
        let larger = |best, row| if size(best).less(size(row)).all() { row } else { best };
        let largest = (column + 1..6).fold(column, larger);
        matrix.swap(column, largest);
        right.swap(column, largest);
        let (pivot, pushed) = (matrix[column], right[column]);
        for (row, right) in matrix.iter_mut().zip(&mut right).skip(column + 1) {
            let share = row[column] / pivot[column];
            for (entry, &above) in row.iter_mut().zip(&pivot) {
                *entry -= share * above;
            }
            *right -= share * pushed;
        }
    }
    for row in (0..6).rev() {
        let known = (row + 1..6).fold(T::ZERO, |sum, k| sum + matrix[row][k] * right[k]);
        right[row] = (right[row] - known) / matrix[row][row];
    }
    right
}

/// The two velocities as the six variables.
fn probes<T: Scalar>((w, v): (Vec3<T>, Vec3<T>)) -> (Vec3<Probe<T>>, Vec3<Probe<T>>) {
    let from = |v: Vec3<T>, first: usize| Vec3(std::array::from_fn(|i| Probe::variable(v[i], first + i)));
    (from(w, 0), from(v, 3))
}

fn apply<T: Scalar>(slope: &Slope<T>, motion: Motion<Spatial<T>>) -> Wrench<Spatial<T>> {
    let product = |row: &[T; 6]| {
        Vec3([row[0], row[1], row[2]]).dot(motion.ang) + Vec3([row[3], row[4], row[5]]).dot(motion.lin)
    };
    Wrench {
        torque: Vec3(std::array::from_fn(|i| product(&slope[i]))),
        force: Vec3(std::array::from_fn(|i| product(&slope[3 + i]))),
    }
}

/// Adds the slope of a wrench at `at` in the axes `rot` to `sum`, taken about the root; made `symmetric` where asked for.
fn add_about_root<T: Scalar>(
    (torque, force): (Vec3<Probe<T>>, Vec3<Probe<T>>),
    at: Vec3<T>,
    rot: &Mat3<T>,
    symmetric: bool,
    sum: &mut Slope<T>,
) {
    let rows: [[T; 6]; 6] = std::array::from_fn(|i| if i < 3 { torque[i] } else { force[i - 3] }.partials);
    let half = T::from_f64(0.5);
    let local: Slope<T> = match symmetric {
        true => std::array::from_fn(|i| std::array::from_fn(|j| (rows[i][j] + rows[j][i]) * half)),
        false => rows,
    };
    // column by column: a unit motion about the root, seen at the shape, its wrench, back about the root
    for column in 0..6 {
        let mut unit = [T::ZERO; 6];
        unit[column] = T::ONE;
        let (ang, lin) = (Vec3([unit[0], unit[1], unit[2]]), Vec3([unit[3], unit[4], unit[5]]));
        let motion =
            Motion { ang: rot.apply_transposed(ang), lin: rot.apply_transposed(lin + ang.cross(at)) };
        let Wrench { torque, force } = apply(&local, motion);
        let force = rot.apply(force);
        let torque = rot.apply(torque) + at.cross(force);
        for i in 0..3 {
            sum[i][column] += torque[i];
            sum[3 + i][column] += force[i];
        }
    }
}
