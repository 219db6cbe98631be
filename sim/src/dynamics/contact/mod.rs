//! Stage 7, where geoms may meet: contact as MuJoCo has it, solved in one problem with friction loss and end stops.
//!
//! Every point where two geoms are closer than their margins is a constraint: how hard it pushes follows from its depth, its
//! speed and the inertia behind it (`solref`, `solimp`); friction along the surface stays in a pyramid or an elliptic cone.
//! Source: MuJoCo, Computation, "Constraint model"; Modeling, "Contact parameters" and "Solver parameters".
//!
//! Only numbers with one lane come here ([`crate::simulator`] sees to it), so this code branches.

mod boxes;
mod points;
mod problem;

pub(crate) use points::Point;

use super::Work;
use super::friction_and_limits::{Solver, longest_step_s};
use super::inertia::solve;
use super::plant::Plant;
use super::stages::ContactStage;
use crate::math::{Quat, Vec3};
use crate::model::{Cone, GeomKind, JointKind, Model, Softness, Surface};
use crate::scalar::Scalar;
use crate::space::{Motion, Spatial};
use points::{Meet, Placed, less, meeting, rank};
use problem::{CONTACT_ROWS_MAX, Law, Problem, Row};

/// MuJoCo's smallest friction and smallest divisor.
const FRICTION_MIN: f64 = 1e-5;
const DIVISOR_MIN: f64 = 1e-15;

/// A geom on its body.
#[derive(Debug, Clone)]
struct Shape<T> {
    body: usize,
    size: [f64; 3],
    pos: Vec3<T>,
    quat: Quat<T>,
}

/// Two geoms that may meet, and what acts between them.
#[derive(Debug, Clone)]
struct Pair<T> {
    shapes: [usize; 2],
    meet: Meet<T>,
    /// The sum of the radii of balls around each; infinite for a plane.
    radii: f64,
    /// Points this close are looked for, and those this close push \[m\].
    reach: f64,
    margin: f64,
    condim: usize,
    friction: [f64; 5],
    softness: Softness,
}

/// All contacts of a model.
#[derive(Debug, Clone)]
pub(crate) struct Contacts<T> {
    cone: Cone,
    impratio: f64,
    shapes: Vec<Shape<T>>,
    pairs: Vec<Pair<T>>,
    /// By body: acceleration of its centre of mass per unit of force \[1/kg\], at the reference, over all directions.
    mobility: Vec<T>,
    /// The points now, by pair.
    found: Vec<(usize, Point<T>)>,
    room: Vec<Point<T>>,
    problem: Problem<T>,
    speed: Vec<T>,
    /// Points and zones now, and when a step began.
    state: [Vec<i32>; 2],
    changed: bool,
}

impl<T: Scalar> ContactStage<Spatial<T>> for Contacts<T> {
    fn new(model: &Model<T>, plant: &Plant<Spatial<T>>) -> Option<Self> {
        let place = |name: &String| model.geoms.iter().position(|geom| geom.name == *name);
        let pairs: Vec<Pair<T>> = model
            .possible_contacts()
            .iter()
            .filter(|possible| possible.simulated)
            .filter_map(|possible| {
                let [a, b] = &possible.geoms;
                let [a, b] = [place(a)?, place(b)?];
                let kind = |geom: usize| model.geoms[geom].kind;
                let shapes = if rank(kind(a)) <= rank(kind(b)) { [a, b] } else { [b, a] };
                Some(Pair::new(model, shapes, meeting(kind(shapes[0]), kind(shapes[1]))?))
            })
            .collect();
        let shape = |geom: &crate::model::Geom<T>| Shape {
            body: geom.body,
            size: geom.size,
            pos: geom.pos,
            quat: geom.quat,
        };
        (!pairs.is_empty()).then(|| Self {
            cone: model.settings.cone,
            impratio: model.settings.impratio,
            shapes: model.geoms.iter().map(shape).collect(),
            pairs,
            mobility: vec![T::ZERO; plant.links.len()],
            found: Vec::new(),
            room: Vec::new(),
            problem: Problem::new(plant.nv),
            speed: Vec::new(),
            state: [Vec::new(), Vec::new()],
            changed: false,
        })
    }

    fn weigh(&mut self, model: &Model<T>, plant: &Plant<Spatial<T>>, work: &Work<Spatial<T>>, factors: &[T]) {
        let third = T::from_f64(1.0 / 3.0);
        for body in 1..plant.links.len() {
            if slides_only(model, body) {
                self.mobility[body] = T::ONE / model.bodies[body].mass;
                continue;
            }
            let at = work.com[body] + work.pos[plant.links[body].root];
            let mut sum = T::ZERO;
            for k in 0..3 {
                let mut row = vec![T::ZERO; plant.nv];
                each_dof(plant, body, |dof| row[dof] = motion_at(plant, work, body, dof, at)[0][k]);
                let mut moved = row.clone();
                solve(plant, factors, &mut moved);
                for (&row, &moved) in row.iter().zip(&moved) {
                    sum += row * moved;
                }
            }
            self.mobility[body] = sum * third;
        }
    }

    fn find(&mut self, work: &Work<Spatial<T>>) -> bool {
        self.found.clear();
        for (index, pair) in self.pairs.iter().enumerate() {
            let [a, b] = pair.shapes.map(|shape| {
                let Shape { body, size, pos, quat } = self.shapes[shape];
                let rot = &work.rot[body];
                Placed { size, at: work.pos[body] + rot.apply(pos), rot: rot.product(&quat.matrix()) }
            });
            let reach = T::from_f64(pair.reach);
            if pair.radii.is_finite() && less(T::from_f64(pair.radii + pair.reach), (b.at - a.at).norm()) {
                continue;
            }
            self.room.clear();
            (pair.meet)(&a, &b, reach, &mut self.room);
            let margin = T::from_f64(pair.margin);
            let near = self.room.iter().filter(|point| less(point.distance, margin));
            self.found.extend(near.map(|&point| (index, point)));
        }
        !self.found.is_empty()
    }

    fn resolve(
        &mut self,
        (plant, work): (&Plant<Spatial<T>>, &Work<Spatial<T>>),
        (held, h): (&[bool], f64),
        (qpos, qvel): (&[T], &[T]),
        restraints: Option<&mut Solver<T>>,
        force: &mut [T],
    ) {
        let nv = plant.nv;
        self.problem.clear();
        let found = std::mem::take(&mut self.found);
        for (pair, point) in &found {
            self.add(plant, work, (*pair, point), h, qvel);
        }
        self.found = found;
        // what is prescribed pushes as it moves, but does not accelerate
        for (dof, _) in held.iter().enumerate().filter(|(_, held)| **held) {
            self.problem.jacobian.iter_mut().skip(dof).step_by(nv).for_each(|entry| *entry = T::ZERO);
        }
        let mut restraints = restraints;
        if let Some(restraints) = &mut restraints {
            restraints.add_rows(plant, qpos, qvel, held, h);
            for (dof, sign, reference, weight, bounds) in restraints.bounded() {
                self.problem.rows.push(Row { law: Law::Bounded(bounds), reference, weight });
                let from = self.problem.jacobian.len();
                self.problem.jacobian.resize(from + nv, T::ZERO);
                self.problem.jacobian[from + dof] = sign;
            }
        }
        let mass = &mut self.problem.mass;
        mass.fill(T::ZERO);
        for dof in 0..nv {
            let row = plant.row[dof]..plant.row[dof + 1];
            for (&entry, &other) in work.mass[row.clone()].iter().zip(&plant.chain[row]) {
                let entry = match (held[dof] || held[other], dof == other) {
                    (false, _) => entry,
                    (true, same) => T::from_f64(f64::from(u8::from(same))),
                };
                mass[dof * nv + other] = entry;
                mass[other * nv + dof] = entry;
            }
        }
        self.problem.solve(force);
        for (row, &push) in self.problem.force.iter().enumerate() {
            for (force, &entry) in force.iter_mut().zip(&self.problem.jacobian[row * nv..(row + 1) * nv]) {
                *force += push * entry;
            }
        }
        if let Some(restraints) = restraints {
            restraints.settle(&self.problem.acceleration);
        }
    }

    fn watch(&mut self, first: bool) {
        let [now, before] = &mut self.state;
        now.clear();
        if !self.found.is_empty() {
            now.extend(self.found.iter().map(|(pair, _)| *pair as i32));
            now.push(-1);
            now.extend(self.problem.zones.iter().map(|&zone| i32::from(zone)));
        }
        if first {
            before.clone_from(now);
            self.changed = false;
        } else {
            self.changed |= now != before;
        }
    }

    fn changed(&self) -> bool {
        self.changed
    }

    fn longest_step_s(&self) -> f64 {
        longest_step_s(self.pairs.iter().map(|pair| pair.softness.rate_per_s()))
    }
}

/// Calls `each` with every dof that moves `body`.
fn each_dof<T: Scalar>(plant: &Plant<Spatial<T>>, body: usize, mut each: impl FnMut(usize)) {
    let mut body = body;
    while body != 0 {
        plant.links[body].dofs.clone().for_each(&mut each);
        body = plant.links[body].parent;
    }
}

/// Velocity and angular velocity of the point `at` of `body` per unit rate of `dof`.
fn motion_at<T: Scalar>(
    plant: &Plant<Spatial<T>>,
    work: &Work<Spatial<T>>,
    body: usize,
    dof: usize,
    at: Vec3<T>,
) -> [Vec3<T>; 2] {
    let Motion { ang, lin } = work.axes[dof];
    [lin + ang.cross(at - work.pos[plant.links[body].root]), ang]
}

/// A body that only slides along its own axes from the world, of which MuJoCo takes the mass for its mobility.
fn slides_only<T: Scalar>(model: &Model<T>, body: usize) -> bool {
    let own = &model.bodies[body];
    let mut joints = model.joints.iter().filter(|joint| joint.body == body).peekable();
    let straight = |axis: Vec3<T>| axis.0.iter().filter(|&&x| x != T::ZERO).count() == 1;
    let principal = own.principal.0;
    joints.peek().is_some()
        && joints.all(|joint| joint.kind == JointKind::Slide && straight(joint.axis))
        && own.parent == 0
        && own.com == Vec3::ZERO
        && principal[1..].iter().all(|&x| x == T::ZERO)
        && !model.joints.iter().any(|joint| model.bodies[joint.body].parent == body)
}

impl<T: Scalar> Pair<T> {
    fn new(model: &Model<T>, shapes: [usize; 2], meet: Meet<T>) -> Self {
        let [a, b] = shapes.map(|geom| &model.geoms[geom]);
        let Surface { condim, friction, solref, solimp, .. } = a.surface.with(&b.surface);
        let [slide, spin, roll] = friction.map(|friction| friction.max(FRICTION_MIN));
        let margin = a.contact_margin_m + b.contact_margin_m;
        let radius = |geom: &crate::model::Geom<T>| {
            let [x, y, z] = geom.size;
            match geom.kind {
                GeomKind::Plane => f64::INFINITY,
                GeomKind::Sphere => x,
                GeomKind::Capsule => x + y,
                GeomKind::Cylinder => x.hypot(y),
                GeomKind::Ellipsoid => x.max(y).max(z),
                GeomKind::Box => x.hypot(y).hypot(z),
            }
        };
        Self {
            shapes,
            meet,
            radii: radius(a) + radius(b),
            reach: margin + a.surface.gap_m + b.surface.gap_m,
            margin,
            condim,
            friction: [slide, slide, spin, roll, roll],
            softness: Softness { solref, solimp }.in_range(),
        }
    }
}

impl<T: Scalar> Contacts<T> {
    /// What [`ContactStage::find`] found: the geoms' places in the model, and the point.
    pub(crate) fn found(&self) -> impl Iterator<Item = ([usize; 2], &Point<T>)> {
        self.found.iter().map(|(pair, point)| (self.pairs[*pair].shapes, point))
    }

    /// Adds the rows of one point.
    fn add(
        &mut self,
        plant: &Plant<Spatial<T>>,
        work: &Work<Spatial<T>>,
        (pair, point): (usize, &Point<T>),
        h: f64,
        qvel: &[T],
    ) {
        let pair = &self.pairs[pair];
        let nv = plant.nv;
        let directions = directions(point);
        let bodies = pair.shapes.map(|shape| self.shapes[shape].body);
        // rows along the directions, then about them
        let mut rows = vec![T::ZERO; pair.condim * nv];
        for (body, sign) in [(bodies[1], T::ONE), (bodies[0], -T::ONE)] {
            each_dof(plant, body, |dof| {
                let motion = motion_at(plant, work, body, dof, point.at);
                for row in 0..pair.condim {
                    rows[row * nv + dof] += sign * motion[row / 3].dot(directions[row % 3]);
                }
            });
        }
        self.speed.clear();
        self.speed.extend(
            rows.chunks(nv).map(|row| row.iter().zip(qvel).fold(T::ZERO, |sum, (&j, &v)| sum + j * v)),
        );
        let beyond = point.distance - T::from_f64(pair.margin);
        let impedance = pair.softness.impedance(beyond);
        let yielding = (T::ONE - impedance) / impedance;
        let moving = self.mobility[bodies[0]] + self.mobility[bodies[1]];
        let [stiffness, damping] = pair.softness.spring(h).map(T::from_f64);
        let pull = -(stiffness * impedance * beyond);
        let reference = |speed: T| pull - damping * speed;
        let least = T::from_f64(DIVISOR_MIN);
        let pushing = [T::ZERO, T::from_f64(f64::MAX)];
        let slide = pair.friction[0];
        let problem = &mut self.problem;
        match self.cone {
            _ if pair.condim == 1 => {
                let weight = T::ONE / (yielding * moving).max(least);
                let law = Law::Bounded(pushing);
                problem.rows.push(Row { law, reference: reference(self.speed[0]), weight });
                problem.jacobian.extend(rows);
            }
            Cone::Pyramidal => {
                // two edges for each direction of friction, all as stiff as matches the elliptic cone
                let first = (yielding * moving * T::from_f64(1.0 + slide * slide)).max(least);
                let weight = T::ONE / (first * T::from_f64(2.0 * slide * slide / self.impratio));
                for k in 1..pair.condim {
                    for friction in [pair.friction[k - 1], -pair.friction[k - 1]] {
                        let friction = T::from_f64(friction);
                        let speed = self.speed[0] + friction * self.speed[k];
                        let law = Law::Bounded(pushing);
                        problem.rows.push(Row { law, reference: reference(speed), weight });
                        let edge =
                            (0..nv).map(|dof| rows[dof] + friction * rows[k * nv + dof]).collect::<Vec<_>>();
                        problem.jacobian.extend(edge);
                    }
                }
            }
            Cone::Elliptic => {
                let normal = (yielding * moving).max(least);
                let slope = slide / self.impratio.sqrt();
                for k in 0..pair.condim {
                    let (law, reference, resistance) = match k {
                        0 => {
                            let law = Law::Cone { rows: pair.condim, slope, friction: pair.friction };
                            (law, reference(self.speed[0]), normal)
                        }
                        _ => {
                            let ratio = slide / pair.friction[k - 1];
                            let resistance = normal * T::from_f64(ratio * ratio / self.impratio);
                            (Law::Within, -(damping * self.speed[k]), resistance)
                        }
                    };
                    problem.rows.push(Row { law, reference, weight: T::ONE / resistance });
                }
                problem.jacobian.extend(rows);
            }
        }
        debug_assert!(pair.condim <= CONTACT_ROWS_MAX);
    }
}

/// The normal and two directions along the surface: the one that the shapes ask for, or the world's y, or where that is too
/// near the normal its z.
fn directions<T: Scalar>(point: &Point<T>) -> [Vec3<T>; 3] {
    let normal = point.normal;
    let wanted = match point.along {
        Some(along) => along,
        None if less(normal[1].abs(), T::from_f64(0.5)) => Vec3::constant([0.0, 1.0, 0.0]),
        None => Vec3::constant([0.0, 0.0, 1.0]),
    };
    let first = wanted - normal * normal.dot(wanted);
    let first = first * (T::ONE / first.norm());
    [normal, first, normal.cross(first)]
}
