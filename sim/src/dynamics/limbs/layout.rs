//! Which branches ride in planes, and their constants.

use std::ops::Range;

use super::inertia::Articulated;
use crate::dynamics::plant::Plant;
use crate::fluid::{Immersed, ImmersedBox};
use crate::math::{Mat3, Vec3};
use crate::model::{Body, Model};
use crate::scalar::Scalar;
use crate::space::{Planar, Plane, ShapeAxes, Space, Spatial, Turn};

/// A body that hangs from the world, with its limbs.
#[derive(Debug, Clone)]
pub(super) struct Base<T: Scalar> {
    pub(super) link: usize,
    pub(super) dofs: Range<usize>,
    /// Among all limbs.
    pub(super) limbs: Range<usize>,
    /// Where the rows of its matrix begin among the factors, in rows.
    pub(super) rows: usize,
    /// Its own inertia about its origin, its own axes.
    pub(super) inertia: Articulated<T>,
    /// Shapes of its own, by their places in the plant's lists.
    pub(super) geoms: Vec<usize>,
    pub(super) bodies: Vec<usize>,
}

/// A branch in its plane. Its origin is the foot of the base's origin on the plane.
#[derive(Debug, Clone)]
pub(super) struct Limb<T> {
    /// `limb_from_base`: two axes in the plane and the one across it, by rows.
    pub(super) axes: Mat3<T>,
    /// How far the plane is from the base's origin, along the axis across \[m\].
    pub(super) depth: T,
    /// Of all its bodies \[kg\].
    pub(super) mass: T,
    /// Among all segments.
    pub(super) segments: Range<usize>,
}

/// A body of a limb. At the reference its axes are the limb's. Its geometry is the same in every lane.
#[derive(Debug, Clone)]
pub(super) struct Segment<T: Scalar> {
    /// The segment that carries it, counted within the limb; `None` for the base.
    pub(super) parent: Option<usize>,
    pub(super) pos: [f64; 2],
    pub(super) hinge: Option<Hinge>,
    pub(super) mass: T,
    pub(super) com: [f64; 2],
    /// Inertia about the centre of mass, for turns in the plane \[kg m2\].
    pub(super) inertia: T,
    /// The same for turns about axes in the plane: (xx + yy) / 2, (xx - yy) / 2 and xy.
    pub(super) tilting: [T; 3],
    /// Mass times gravity compensation; `None` for 0.
    pub(super) held_mass: Option<T>,
    /// Among all shapes.
    pub(super) shapes: Range<usize>,
}

/// The joint of a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hinge {
    /// 1 across the plane, -1 against it.
    pub(super) axis: f64,
    /// Anchor; `None` at the segment's origin.
    pub(super) pos: Option<[f64; 2]>,
    pub(super) q: usize,
    pub(super) dof: usize,
    pub(super) reference: f64,
}

/// What feels the water on a segment.
#[derive(Debug, Clone)]
pub(super) struct Shape<T: Scalar> {
    /// Centre; `None` at the centre of mass.
    pub(super) pos: Option<[f64; 2]>,
    /// Cosine and sine of `segment_from_shape`; `None` for the identity.
    pub(super) rot: Option<[f64; 2]>,
    pub(super) law: Law<T>,
}

/// How the water acts on a shape, whose third axis points across the plane.
#[derive(Debug, Clone)]
pub(super) enum Law<T: Scalar> {
    Ellipsoid(Immersed<Spatial<T>>),
    InertiaBox(ImmersedBox<Spatial<T>>),
}

/// Everything that depends on the model alone.
#[derive(Debug, Clone)]
pub(super) struct Layout<T: Scalar> {
    pub(super) bases: Vec<Base<T>>,
    pub(super) limbs: Vec<Limb<T>>,
    pub(super) segments: Vec<Segment<T>>,
    pub(super) shapes: Vec<Shape<T>>,
    /// Rows of the factors: one for each dof and one more for each of a base.
    pub(super) rows: usize,
}

/// Degrees of freedom of a base, at most: more would be a mechanism of its own.
pub(super) const BASE_DOFS: usize = 6;

impl<T: Scalar> Layout<T> {
    /// The layout of `model`, if what its bases carry rides in planes, in all lanes alike.
    pub(super) fn of(model: &Model<T>, plant: &Plant<Spatial<T>>) -> Option<Self> {
        let mut layout = Self {
            bases: Vec::new(),
            limbs: Vec::new(),
            segments: Vec::new(),
            shapes: Vec::new(),
            rows: plant.nv,
        };
        // a number that varies is none and fits no plane
        let plain = model.map(|x| x.as_constant().unwrap_or(f64::NAN));
        let children =
            |parent: usize| (1..plant.links.len()).filter(move |&i| plant.links[i].parent == parent);
        for link in children(0) {
            let first = layout.limbs.len();
            for root in children(link) {
                layout.add_limb(model, &plain, plant, root)?;
            }
            let (body, dofs) = (&model.bodies[link], plant.links[link].dofs.clone());
            if dofs.len() > BASE_DOFS {
                return None;
            }
            let own = |body: usize| body == link;
            layout.bases.push(Base {
                link,
                rows: layout.rows,
                limbs: first..layout.limbs.len(),
                inertia: Articulated::of_body(body.mass, body.com, plant.links[link].inertia),
                geoms: (0..plant.fluid_geoms.len()).filter(|&i| own(plant.fluid_geoms[i].body)).collect(),
                bodies: (0..plant.fluid_bodies.len()).filter(|&i| own(plant.fluid_bodies[i].body)).collect(),
                dofs: dofs.clone(),
            });
            layout.rows += dofs.len();
        }
        (!layout.limbs.is_empty()).then_some(layout)
    }

    /// Adds the branch that begins with the body `root`, if it rides in a plane. `plain` has the model's constants.
    fn add_limb(
        &mut self,
        model: &Model<T>,
        plain: &Model<f64>,
        plant: &Plant<Spatial<T>>,
        root: usize,
    ) -> Option<()> {
        let mut branch = vec![root];
        for index in root + 1..plain.bodies.len() {
            if branch.contains(&plain.bodies[index].parent) {
                branch.push(index);
            }
        }
        let (plane, depth) = Plane::riding(plain, &branch)?;
        let (first, mut mass) = (self.segments.len(), T::ZERO);
        for &index in &branch {
            let body = &plain.bodies[index];
            let shapes = self.add_shapes(plain, plant, &plane, index);
            let joint = plain.joints.iter().find(|joint| joint.body == index);
            let (inertia, tilting) = inertia(&plane, index, body, model.bodies[index].inertia);
            mass += model.bodies[index].mass;
            self.segments.push(Segment {
                parent: branch.iter().position(|&other| other == body.parent),
                pos: Planar::vector(&plane, body.parent, body.pos).0,
                hinge: joint.map(|joint| Hinge {
                    axis: Planar::spin(&plane, index, joint.axis).0[0],
                    pos: (joint.pos != Vec3::ZERO).then(|| Planar::vector(&plane, index, joint.pos).0),
                    q: joint.qpos_address,
                    dof: joint.dof_address,
                    reference: joint.reference,
                }),
                mass: model.bodies[index].mass,
                com: Planar::vector(&plane, index, body.com).0,
                inertia,
                tilting,
                held_mass: plant.links[index].held_mass,
                shapes,
            });
        }
        let axes = plane.axes(plain.bodies[root].parent).0.map(|row| row.map(T::from_f64));
        let (axes, depth) = (Mat3(axes), T::from_f64(depth));
        self.limbs.push(Limb { axes, depth, mass, segments: first..self.segments.len() });
        Some(())
    }

    fn add_shapes(
        &mut self,
        plain: &Model<f64>,
        plant: &Plant<Spatial<T>>,
        plane: &Plane<f64>,
        index: usize,
    ) -> Range<usize> {
        let first = self.shapes.len();
        let body = &plain.bodies[index];
        let mut add = |pos: Vec3<f64>, quat, law: &dyn Fn(ShapeAxes) -> Law<T>| {
            let (rot, axes) = Planar::shape_axes(plane, index, quat);
            self.shapes.push(Shape {
                pos: (pos != body.com).then(|| Planar::vector(plane, index, pos).0),
                rot: rot.map(|Turn { cos, sin }| [cos, sin]),
                law: law(axes),
            });
        };
        for wet in plant.fluid_geoms.iter().filter(|wet| wet.body == index) {
            let geom = &plain.geoms[wet.geom];
            add(geom.pos, geom.quat, &|axes| Law::Ellipsoid(wet.shape.on_axes(axes)));
        }
        for wet in plant.fluid_bodies.iter().filter(|wet| wet.body == index) {
            add(body.com, body.principal, &|axes| Law::InertiaBox(wet.shape.on_axes(axes)));
        }
        first..self.shapes.len()
    }
}

/// A segment's inertia with these principal moments: [`Segment::inertia`] and [`Segment::tilting`].
fn inertia<T: Scalar>(plane: &Plane<f64>, index: usize, body: &Body<f64>, moments: Vec3<T>) -> (T, [T; 3]) {
    let [x, y, z] = plane.axes(index).product(&body.principal.matrix()).0;
    let sum = |a: [f64; 3], b: [f64; 3]| {
        let share: [f64; 3] = std::array::from_fn(|k| a[k] * b[k]);
        Vec3::constant(share).dot(moments)
    };
    let (xx, yy, xy, half) = (sum(x, x), sum(y, y), sum(x, y), T::from_f64(0.5));
    (sum(z, z), [(xx + yy) * half, (xx - yy) * half, xy])
}
