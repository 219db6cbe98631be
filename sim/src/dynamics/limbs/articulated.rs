//! Articulated inertias: the mass matrix factored body by body, tips first, without being written down.
//!
//! What a hinge yields leaves the inertia felt beyond it: I - (I s)(I s)^T / (s^T I s), on motions in the plane. The rest
//! of a limb's inertia is that of its bodies, rigid (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 7.3).

use super::Limbs;
use super::inertia::Articulated;
use super::layout::{BASE_DOFS, Base, Hinge, Layout, Limb};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::{Mat3, Sym3, Vec1, Vec2, Vec3};
use crate::scalar::Scalar;
use crate::space::{Inertia, Motion, Planar, Spatial, Wrench};

/// Symmetric, from motions in a plane (w, x, y) to wrenches: `ww wx wy xx xy yy`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flat<T>([T; 6]);

impl<T: Scalar> Flat<T> {
    pub(super) const ZERO: Self = Self([T::ZERO; 6]);

    #[inline(always)]
    pub(super) fn of(inertia: &Inertia<Planar<T>>) -> Self {
        let Vec2([x, y]) = inertia.moment;
        Self([inertia.rotational, -y, x, inertia.mass, T::ZERO, inertia.mass])
    }

    #[inline(always)]
    fn apply(&self, motion: Motion<Planar<T>>) -> [T; 3] {
        let [ww, wx, wy, xx, xy, yy] = self.0;
        let (Vec1([w]), Vec2([x, y])) = (motion.ang, motion.lin);
        [ww * w + wx * x + wy * y, wx * w + xx * x + xy * y, wy * w + xy * x + yy * y]
    }

    /// Less the product of two parallel columns.
    #[inline(always)]
    fn less(self, a: [T; 3], b: [T; 3]) -> Self {
        let [ww, wx, wy, xx, xy, yy] = self.0;
        Self([
            ww - a[0] * b[0],
            wx - a[0] * b[1],
            wy - a[0] * b[2],
            xx - a[1] * b[1],
            xy - a[1] * b[2],
            yy - a[2] * b[2],
        ])
    }

    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, &x) in self.0.iter_mut().zip(&other.0) {
            *sum += x;
        }
    }
}

/// What a limb's bodies resist motions out of the plane with: moments of mass \[kg m\], and inertia `xx yy xy` about the
/// limb's origin \[kg m2\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Across<T> {
    moment: Vec2<T>,
    inertia: [T; 3],
}

impl<T: Scalar> Across<T> {
    pub(super) const ZERO: Self = Self { moment: Vec2([T::ZERO; 2]), inertia: [T::ZERO; 3] };

    /// Adds a body with this `moment` of mass about the limb's origin and this `inertia` about its centre of mass.
    #[inline(always)]
    pub(super) fn carry(&mut self, moment: Vec2<T>, com: Vec2<T>, [xx, yy, xy]: [T; 3]) {
        self.moment += moment;
        self.inertia[0] += xx + moment[1] * com[1];
        self.inertia[1] += yy + moment[0] * com[0];
        self.inertia[2] += xy - moment[0] * com[1];
    }
}

impl<T: Scalar> Articulated<T> {
    /// Adds a limb's: `flat` as its root feels it in the plane, `across` out of it.
    #[inline(always)]
    pub(super) fn add(&mut self, limb: &Limb<T>, flat: &Flat<T>, across: &Across<T>) {
        let (d, zero) = (limb.depth, T::ZERO);
        let [ww, wx, wy, xx, xy, yy] = flat.0;
        let Vec2([mx, my]) = across.moment;
        let [ixx, iyy, ixy] = across.inertia;
        // about the base's origin, on the limb's axes
        let (dxx, dxy, dyy) = (d * xx, d * xy, d * yy);
        let rotational = Sym3([ixx + d * dyy, iyy + d * dxx, ww, ixy - d * dxy, -(d * wy), d * wx]);
        let coupling = Mat3([[-dxy, -dyy, my], [dxx, dxy, -mx], [wx, wy, zero]]);
        let linear = Sym3([xx, yy, limb.mass, xy, zero, zero]);
        let Mat3([a, b, c]) = limb.axes;
        let back = Mat3([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]]);
        self.rotational = self.rotational + rotational.rotated(&back);
        self.linear = self.linear + linear.rotated(&back);
        let turned = back.product(&coupling).product(&limb.axes);
        for (sum, row) in self.coupling.0.iter_mut().zip(turned.0) {
            for (sum, x) in sum.iter_mut().zip(row) {
                *sum += x;
            }
        }
    }
}

impl<T: Scalar> Limb<T> {
    /// A motion of the base, about its origin on its own axes, as the limb's plane has it about its own.
    #[inline(always)]
    pub(super) fn carried(&self, base: Motion<Spatial<T>>) -> Motion<Spatial<T>> {
        let ang = self.axes.apply(base.ang);
        let Vec3([x, y, z]) = self.axes.apply(base.lin);
        Motion { ang, lin: Vec3([x + self.depth * ang[1], y - self.depth * ang[0], z]) }
    }

    /// A wrench on the limb's root, about its origin on its axes, as the base feels it.
    #[inline(always)]
    pub(super) fn felt(&self, wrench: Wrench<Spatial<T>>) -> Wrench<Spatial<T>> {
        let Vec3([x, y, z]) = wrench.torque;
        let Vec3([fx, fy, _]) = wrench.force;
        let torque = Vec3([x - self.depth * fy, y + self.depth * fx, z]);
        Wrench { torque: self.axes.apply_transposed(torque), force: self.axes.apply_transposed(wrench.force) }
    }
}

/// Numbers in a row of the factors. A hinge's: axis (x, y), (I s) / (s^T I s), 1 / (s^T I s); a base's dof: axis on the base's own
/// axes; then, for each of a base's dofs, its row of the unit triangle and the reciprocal of the diagonal.
pub(super) const ROW: usize = BASE_DOFS;

/// What is left of the inertia and the wrench felt beyond a hinge.
pub(super) struct Yielded<T: Scalar> {
    pub(super) inertia: Flat<T>,
    pub(super) wrench: Wrench<Planar<T>>,
    pub(super) row: [T; ROW],
    /// What pushes the hinge.
    pub(super) rest: T,
}

/// Lets the hinge with `axis` yield to `force` and to the `wrench` beyond it, which meets `inertia` and, at the hinge, `added`.
#[inline(always)]
pub(super) fn yielding<T: Scalar>(
    axis: Motion<Planar<T>>,
    added: T,
    force: T,
    inertia: Flat<T>,
    wrench: Wrench<Planar<T>>,
) -> Yielded<T> {
    let push = inertia.apply(axis);
    let felt = axis.power(Wrench { torque: Vec1([push[0]]), force: Vec2([push[1], push[2]]) });
    let inverse = T::ONE / (felt + added);
    let [sw, sx, sy] = [push[0] * inverse, push[1] * inverse, push[2] * inverse];
    let Vec2([x, y]) = axis.lin;
    let row = [x, y, sw, sx, sy, inverse];
    let rest = force + axis.power(wrench);
    Yielded { inertia: inertia.less([sw, sx, sy], push), wrench: passed(&row, wrench, rest), row, rest }
}

/// What of a wrench passes on beyond a hinge that is pushed by `rest`.
#[inline(always)]
fn passed<T: Scalar>(row: &[T; ROW], wrench: Wrench<Planar<T>>, rest: T) -> Wrench<Planar<T>> {
    let [_, _, sw, sx, sy, _] = *row;
    let (Vec1([z]), Vec2([fx, fy])) = (wrench.torque, wrench.force);
    Wrench { torque: Vec1([z - sw * rest]), force: Vec2([fx - sx * rest, fy - sy * rest]) }
}

/// Axis of a base's dof from its row, on the base's own axes.
#[inline(always)]
pub(super) fn axis<T: Scalar>(row: &[T; ROW]) -> Motion<Spatial<T>> {
    let [a, b, c, x, y, z] = *row;
    Motion { ang: Vec3([a, b, c]), lin: Vec3([x, y, z]) }
}

/// Axis of a hinge from its row.
#[inline(always)]
fn hinge_axis<T: Scalar>(hinge: &Hinge, row: &[T; ROW]) -> Motion<Planar<T>> {
    Motion { ang: Vec1::constant([hinge.axis]), lin: Vec2([row[0], row[1]]) }
}

/// What the diagonal holds besides the bodies' inertia.
#[inline(always)]
pub(super) fn added<T: Scalar>(plant: &Plant<Spatial<T>>, shift: Option<&[T]>, dof: usize) -> T {
    match shift {
        Some(shift) => plant.armature[dof] + shift[dof],
        None => plant.armature[dof],
    }
}

impl<T: Scalar> Base<T> {
    /// Writes its rows: it resists with the articulated inertia `felt`.
    #[inline(always)]
    pub(super) fn factor(
        &self,
        plant: &Plant<Spatial<T>>,
        work: &Work<Spatial<T>>,
        shift: Option<&[T]>,
        felt: &Articulated<T>,
        rows: &mut [[T; ROW]],
    ) {
        let rot = &work.rot[self.link];
        for dof in self.dofs.clone() {
            let Motion { ang, lin } = work.axes[dof];
            let (Vec3([a, b, c]), Vec3([x, y, z])) = (rot.apply_transposed(ang), rot.apply_transposed(lin));
            rows[dof] = [a, b, c, x, y, z];
        }
        let (known, triangle) = rows.split_at_mut(self.rows);
        let axes = &known[self.dofs.clone()];
        for (i, row) in axes.iter().enumerate() {
            let momentum = felt.apply(axis(row));
            for (entry, other) in triangle[i].iter_mut().zip(&axes[..=i]) {
                *entry = axis(other).power(momentum);
            }
            triangle[i][i] += added(plant, shift, self.dofs.start + i);
        }
        factor_triangle(&mut triangle[..axes.len()]);
    }

    /// Solves for its accelerations and yields its motion per unit of time, about its origin, on its own axes.
    #[inline(always)]
    pub(super) fn solve(&self, rows: &[[T; ROW]], x: &mut [T]) -> Motion<Spatial<T>> {
        let axes = &rows[self.dofs.clone()];
        let x = &mut x[self.dofs.clone()];
        solve_triangle(&rows[self.rows..self.rows + axes.len()], x);
        let mut moved = Motion::ZERO;
        for (&x, row) in x.iter().zip(axes) {
            moved = moved.plus(axis(row), x);
        }
        moved
    }
}

impl<T: Scalar> Limbs<T> {
    /// The limb `limb` follows its base, tips last: turns what pushes each hinge into its acceleration.
    #[inline(always)]
    pub(super) fn follow(
        layout: &Layout<T>,
        motion: &mut [Motion<Planar<T>>],
        limb: &Limb<T>,
        base: Motion<Spatial<T>>,
        rows: &[[T; ROW]],
        x: &mut [T],
    ) {
        let carried = limb.carried(base);
        let start = Motion { ang: Vec1([carried.ang[2]]), lin: Vec2([carried.lin[0], carried.lin[1]]) };
        for (k, segment) in layout.segments[limb.segments.clone()].iter().enumerate() {
            let mut own = match segment.parent {
                Some(parent) => motion[parent],
                None => start,
            };
            if let Some(hinge) = &segment.hinge {
                let row = &rows[hinge.dof];
                let [_, _, sw, sx, sy, inverse] = *row;
                let a =
                    x[hinge.dof] * inverse - own.power(Wrench { torque: Vec1([sw]), force: Vec2([sx, sy]) });
                x[hinge.dof] = a;
                own = own.plus(hinge_axis(hinge, row), a);
            }
            motion[k] = own;
        }
    }

    /// See [`LimbStage::solve`](crate::space::LimbStage::solve).
    #[inline(always)]
    pub(super) fn solve_rows(&mut self, factors: &[T], x: &mut [T]) {
        let Self { layout, wrenches, motion, .. } = self;
        let (rows, _) = factors.as_chunks::<ROW>();
        for base in &layout.bases {
            let mut total = Wrench::ZERO;
            for limb in &layout.limbs[base.limbs.clone()] {
                let segments = &layout.segments[limb.segments.clone()];
                let wrenches = &mut wrenches[..segments.len()];
                wrenches.fill(Wrench::ZERO);
                let mut root = Wrench::ZERO;
                for (k, segment) in segments.iter().enumerate().rev() {
                    let mut push = wrenches[k];
                    if let Some(hinge) = &segment.hinge {
                        let row = &rows[hinge.dof];
                        let rest = x[hinge.dof] + hinge_axis(hinge, row).power(push);
                        x[hinge.dof] = rest;
                        push = passed(row, push, rest);
                    }
                    match segment.parent {
                        Some(parent) => wrenches[parent] += push,
                        None => root += push,
                    }
                }
                let (Vec1([z]), Vec2([fx, fy])) = (root.torque, root.force);
                let (torque, force) = (Vec3([T::ZERO, T::ZERO, z]), Vec3([fx, fy, T::ZERO]));
                total += limb.felt(Wrench { torque, force });
            }
            for dof in base.dofs.clone() {
                x[dof] += axis(&rows[dof]).power(total);
            }
            let moved = base.solve(rows, x);
            for limb in &layout.limbs[base.limbs.clone()] {
                Self::follow(layout, motion, limb, moved, rows, x);
            }
        }
    }
}

/// Replaces a symmetric matrix, of which the lower triangle counts, by the unit triangle L and the reciprocal of D: L D L^T.
#[inline(always)]
fn factor_triangle<T: Scalar>(m: &mut [[T; ROW]]) {
    for j in 0..m.len() {
        let inverse = T::ONE / m[j][j];
        for i in (j + 1..m.len()).rev() {
            let (above, below) = m.split_at_mut(i);
            let row = &mut below[0];
            let share = row[j] * inverse;
            for (k, other) in above.iter().enumerate().skip(j + 1) {
                row[k] -= share * other[j];
            }
            row[i] -= share * row[j];
            row[j] = share;
        }
        m[j][j] = inverse;
    }
}

#[inline(always)]
fn solve_triangle<T: Scalar>(m: &[[T; ROW]], x: &mut [T]) {
    for i in 0..x.len() {
        for k in 0..i {
            let taken = m[i][k] * x[k];
            x[i] -= taken;
        }
    }
    for i in (0..x.len()).rev() {
        let mut value = x[i] * m[i][i];
        for k in i + 1..x.len() {
            value -= m[k][i] * x[k];
        }
        x[i] = value;
    }
}
