//! Which branches ride in planes, and their constants.

use std::ops::Range;

use super::articulated::Articulated;
use crate::dynamics::plant::{JointPlanKind, Plant};
use crate::fluid::{Immersed, ImmersedBox};
use crate::math::{Mat3, Sym3, Vec1, Vec2, Vec3};
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

/// A body of a limb. At the reference its axes are the limb's.
#[derive(Debug, Clone)]
pub(super) struct Segment<T: Scalar> {
    /// The segment that carries it, counted within the limb; `None` for the base.
    pub(super) parent: Option<usize>,
    pub(super) pos: Vec2<T>,
    pub(super) hinge: Option<Hinge<T>>,
    pub(super) mass: T,
    pub(super) com: Vec2<T>,
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
pub(super) struct Hinge<T> {
    pub(super) axis: Vec1<T>,
    /// Anchor; `None` at the segment's origin.
    pub(super) pos: Option<Vec2<T>>,
    pub(super) q: usize,
    pub(super) dof: usize,
    pub(super) reference: T,
}

/// What feels the water on a segment.
#[derive(Debug, Clone)]
pub(super) struct Shape<T: Scalar> {
    pub(super) pos: Vec2<T>,
    /// `segment_from_shape`; `None` for the identity.
    pub(super) rot: Option<Turn<T>>,
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
    /// The layout of `model`, if what its bases carry rides in planes.
    pub(super) fn of(model: &Model<T>, plant: &Plant<Spatial<T>>) -> Option<Self> {
        let mut layout = Self {
            bases: Vec::new(),
            limbs: Vec::new(),
            segments: Vec::new(),
            shapes: Vec::new(),
            rows: plant.nv,
        };
        let children =
            |parent: usize| (1..plant.links.len()).filter(move |&i| plant.links[i].parent == parent);
        for link in children(0) {
            let first = layout.limbs.len();
            for root in children(link) {
                layout.add_limb(model, plant, root)?;
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

    /// Adds the branch that begins with the body `root`, if it rides in a plane.
    fn add_limb(&mut self, model: &Model<T>, plant: &Plant<Spatial<T>>, root: usize) -> Option<()> {
        let mut branch = vec![root];
        for index in root + 1..model.bodies.len() {
            if branch.contains(&model.bodies[index].parent) {
                branch.push(index);
            }
        }
        let (plane, depth) = Plane::riding(model, &branch)?;
        let first = self.segments.len();
        for &index in &branch {
            let link = &plant.links[index];
            let body = &model.bodies[index];
            let shapes = self.add_shapes(model, plant, &plane, index);
            self.segments.push(Segment {
                parent: branch.iter().position(|&other| other == link.parent),
                pos: Planar::vector(&plane, link.parent, body.pos),
                hinge: plant.joints[link.joints.clone()].first().map(|joint| {
                    let JointPlanKind::Hinge { axis, .. } = joint.kind else {
                        unreachable!("hinges alone move what rides in a plane")
                    };
                    let own = model.joints.iter().find(|own| own.dof_address == joint.dof);
                    let pos = own.map_or(Vec3::ZERO, |own| own.pos);
                    Hinge {
                        axis: Planar::spin(&plane, index, axis),
                        pos: joint.pos.is_some().then(|| Planar::vector(&plane, index, pos)),
                        q: joint.q,
                        dof: joint.dof,
                        reference: joint.reference,
                    }
                }),
                mass: body.mass,
                com: Planar::vector(&plane, index, body.com),
                inertia: Planar::inertia(&plane, index, link.inertia),
                tilting: tilting(&plane, index, body),
                held_mass: link.held_mass,
                shapes,
            });
        }
        let mut mass = T::ZERO;
        for segment in &self.segments[first..] {
            mass += segment.mass;
        }
        let axes = *plane.axes(plant.links[root].parent);
        self.limbs.push(Limb { axes, depth, mass, segments: first..self.segments.len() });
        Some(())
    }

    fn add_shapes(
        &mut self,
        model: &Model<T>,
        plant: &Plant<Spatial<T>>,
        plane: &Plane<T>,
        index: usize,
    ) -> Range<usize> {
        let first = self.shapes.len();
        let mut add = |pos, quat, law: &dyn Fn(ShapeAxes) -> Law<T>| {
            let (rot, axes) = Planar::shape_axes(plane, index, quat);
            self.shapes.push(Shape { pos: Planar::vector(plane, index, pos), rot, law: law(axes) });
        };
        for wet in plant.fluid_geoms.iter().filter(|wet| wet.body == index) {
            let geom = &model.geoms[wet.geom];
            add(geom.pos, geom.quat, &|axes| Law::Ellipsoid(wet.shape.on_axes(axes)));
        }
        for wet in plant.fluid_bodies.iter().filter(|wet| wet.body == index) {
            let body = &model.bodies[index];
            add(body.com, body.principal, &|axes| Law::InertiaBox(wet.shape.on_axes(axes)));
        }
        first..self.shapes.len()
    }
}

fn tilting<T: Scalar>(plane: &Plane<T>, index: usize, body: &Body<T>) -> [T; 3] {
    let principal = plane.axes(index).product(&body.principal.matrix());
    let [xx, yy, _, xy, ..] = Sym3::rotated_diagonal(&principal, body.inertia).0;
    let half = T::from_f64(0.5);
    [(xx + yy) * half, (xx - yy) * half, xy]
}
