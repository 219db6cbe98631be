//! A planar chain of links in water, from scratch: Lagrange's equations in absolute link angles.
//!
//! The picture's plane is all there is: x to the right, z up, angles counter-clockwise, 0 for a link that hangs. Link i has
//! the unit vectors u = (sin a, -cos a) along it and n = (cos a, sin a) across it; its centre moves with
//! sum_j arm_ij n_j da_j/dt, which gives the mass matrix and, differentiated again, everything else.

use super::fluid::Ellipsoid;
use super::terms::{Hidden, Terms};

/// A vector in the picture's plane: x to the right, z up.
pub type Plane = [f64; 2];

pub(super) fn dot(a: Plane, b: Plane) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn add(a: Plane, b: Plane, factor: f64) -> Plane {
    [a[0] + factor * b[0], a[1] + factor * b[1]]
}

/// A rigid link.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// From its pivot to the next one, or to the last keypoint \[m\].
    pub length_m: f64,
    /// From its pivot to its centre of mass and of volume \[m\].
    pub centre_m: f64,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Mass of the water that carries it \[kg\].
    pub held_kg: f64,
    /// Moment of inertia about its centre \[kg m2\].
    pub inertia_kg_m2: f64,
    /// Damping of its pivot \[N m s/rad\].
    pub damping: f64,
    /// Springs of its pivot that push back from either side and, beside it, from positive angles \[N m/rad\]; the first link has none.
    pub springs: [f64; 2],
    /// Its shape in the water.
    pub shape: Ellipsoid,
}

/// What holds the first link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Root {
    /// Nothing: its pivot turns freely.
    Free,
    /// A drive that follows exactly: the angular acceleration is given \[rad/s2\].
    Prescribed(f64),
    /// A torque on the first pivot \[N m\].
    Torque(f64),
}

/// Angles \[rad\] and rates \[rad/s\] of the links, absolute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const N: usize> {
    /// Angles.
    pub angle: [f64; N],
    /// Rates.
    pub rate: [f64; N],
}

/// Links in a row, the first one's pivot at the origin, and the water around.
#[derive(Debug, Clone)]
pub struct Chain<const N: usize> {
    /// The links, from the fixed pivot on.
    pub links: [Link; N],
    /// Gravity \[m/s2\], downwards.
    pub gravity: f64,
    /// Density of the water \[kg/m3\].
    pub density: f64,
    /// Dynamic viscosity of the water \[Pa s\].
    pub viscosity: f64,
}

/// Where one link is and how it moves.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pose {
    /// Along the link.
    pub along: Plane,
    /// Across it, a quarter turn counter-clockwise.
    pub across: Plane,
    /// Its centre \[m\].
    pub centre: Plane,
    /// Its centre's velocity \[m/s\].
    pub velocity: Plane,
    /// Its far end \[m\].
    pub end: Plane,
    /// Its far end's velocity \[m/s\].
    pub end_velocity: Plane,
    /// Its rate \[rad/s\].
    pub rate: f64,
}

impl<const N: usize> Chain<N> {
    /// The chain whose single links are as `hidden` has them: another weight, inertia or length.
    pub(super) fn changed(&self, hidden: &Hidden) -> Self {
        let mut chain = self.clone();
        for (i, link) in chain.links.iter_mut().enumerate() {
            let own = |cause: &str| hidden.get(&format!("{cause}/link{}", i + 1), 0.0);
            let heavier = 1.0 + own("link_mass");
            link.mass_kg *= heavier;
            link.inertia_kg_m2 *= heavier * (1.0 + hidden.get("inertia/scale", 0.0) + own("inertia"));
            link.held_kg *= 1.0 + own("buoyancy");
            link.length_m += own("link_length");
        }
        chain
    }

    /// Where the links are.
    pub fn poses(&self, state: &State<N>) -> [Pose; N] {
        let (mut pivot, mut velocity) = ([0.0; 2], [0.0; 2]);
        std::array::from_fn(|i| {
            let (link, rate) = (&self.links[i], state.rate[i]);
            let (sin, cos) = state.angle[i].sin_cos();
            let (along, across) = ([sin, -cos], [cos, sin]);
            let pose = Pose {
                along,
                across,
                centre: add(pivot, along, link.centre_m),
                velocity: add(velocity, across, link.centre_m * rate),
                end: add(pivot, along, link.length_m),
                end_velocity: add(velocity, across, link.length_m * rate),
                rate,
            };
            (pivot, velocity) = (pose.end, pose.end_velocity);
            pose
        })
    }

    /// How far out on link `j` the centre of link `i` hangs from it \[m\].
    fn arm(&self, i: usize, j: usize) -> f64 {
        if i == j { self.links[j].centre_m } else { self.links[j].length_m }
    }

    /// Angular accelerations \[rad/s2\] at `time_s` with the causes in `terms`; `memory` is the water's history force on
    /// each link \[N\].
    pub fn accelerations(
        &self,
        time_s: f64,
        state: &State<N>,
        root: Root,
        terms: &Terms,
        memory: &[Plane; N],
    ) -> [f64; N] {
        let (mut matrix, mut right, forces) = self.equations(time_s, state, root, terms, memory);
        if let Root::Prescribed(acceleration) = root {
            matrix[0] = std::array::from_fn(|k| if k == 0 { 1.0 } else { 0.0 });
            right[0] = acceleration;
        }
        let free = solve(matrix, right);
        if terms.bearing_m == 0.0 {
            return free;
        }
        // what the hinges bear as the chain moves without their rubbing
        let poses = self.poses(state);
        let mut borne = [0.0; 2];
        for i in (0..N).rev() {
            let outward = (0..=i).fold([0.0; 2], |a, j| add(a, poses[j].across, self.arm(i, j) * free[j]));
            borne = add(add(borne, forces[i], 1.0), outward, -self.links[i].mass_kg);
            let before = i.checked_sub(1).map_or(0.0, |before| state.rate[before]);
            let torque = terms.bearing(state.rate[i] - before, borne);
            if i > 0 || !matches!(root, Root::Prescribed(_)) {
                right[i] += torque;
            }
            if i > 1 || i == 1 && !matches!(root, Root::Prescribed(_)) {
                right[i - 1] -= torque;
            }
        }
        solve(matrix, right)
    }

    /// The rates \[rad/s\] of the links, at rest, once the first is struck to turn at `rate`.
    pub fn struck(&self, state: &State<N>, rate: f64, terms: &Terms) -> [f64; N] {
        let still = State { angle: state.angle, rate: [0.0; N] };
        let (mut matrix, ..) = self.equations(0.0, &still, Root::Free, terms, &[[0.0; 2]; N]);
        matrix[0] = std::array::from_fn(|k| if k == 0 { 1.0 } else { 0.0 });
        solve(matrix, std::array::from_fn(|k| if k == 0 { rate } else { 0.0 }))
    }

    /// Mass matrix, generalised forces, and the force that moves each link while no rate changes \[N\].
    fn equations(
        &self,
        time_s: f64,
        state: &State<N>,
        root: Root,
        terms: &Terms,
        memory: &[Plane; N],
    ) -> ([[f64; N]; N], [f64; N], [Plane; N]) {
        let poses = self.poses(state);
        let (mut matrix, mut right, mut forces) = ([[0.0; N]; N], [0.0; N], [[0.0; 2]; N]);
        let water = terms.water(time_s);
        for (i, link) in self.links.iter().enumerate() {
            let pose = &poses[i];
            let mut swing = [0.0; 2];
            for (j, other) in poses[..=i].iter().enumerate() {
                swing = add(swing, other.along, -self.arm(i, j) * other.rate * other.rate);
            }
            let wet = self.wet(i, &poses, water, terms, memory[i]);
            let mass = link.mass_kg * (1.0 + terms.link_mass);
            // symmetric: along, mixed and across, turned into the world
            let [ma, mn] = wet.added_kg;
            let (u, n) = (pose.along, pose.across);
            let tensor = [
                [mass + ma * u[0] * u[0] + mn * n[0] * n[0], ma * u[0] * u[1] + mn * n[0] * n[1]],
                [ma * u[0] * u[1] + mn * n[0] * n[1], mass + ma * u[1] * u[1] + mn * n[1] * n[1]],
            ];
            let times = |a: Plane| [dot(tensor[0], a), dot(tensor[1], a)];
            let held = link.held_kg * (1.0 + terms.buoyancy);
            let weight = [0.0, (held - mass) * self.gravity];
            let force = add(add(wet.force, weight, 1.0), times(swing), -1.0);
            forces[i] = force;
            for j in 0..=i {
                right[j] += self.arm(i, j) * dot(poses[j].across, force);
                let pushed = times(poses[j].across);
                for k in 0..=i {
                    matrix[j][k] += self.arm(i, j) * self.arm(i, k) * dot(poses[k].across, pushed);
                }
            }
            matrix[i][i] += link.inertia_kg_m2 * (1.0 + terms.link_mass) + wet.added_kg_m2;
            let offset = add([0.0; 2], pose.along, terms.cob_along);
            let offset = add(offset, pose.across, terms.cob_across);
            right[i] += wet.torque + offset[0] * held * self.gravity;
        }
        self.tip_force(&poses, terms, &mut right);
        self.medium(&poses, terms.medium, &mut right);
        for i in 0..N {
            let before = i.checked_sub(1).map(|before| (state.angle[before], state.rate[before]));
            let (angle, rate) = before.unwrap_or((0.0, 0.0));
            let (bend, turn) = (state.angle[i] - angle, state.rate[i] - rate);
            let mut torque = -self.links[i].damping * turn + terms.hinge(i, turn);
            if i > 0 {
                let [either, positive] = self.links[i].springs;
                torque += terms.spring(i, bend, turn) - either * bend - positive * bend.max(0.0);
                right[i - 1] -= torque;
            } else if let Root::Torque(drive) = root {
                torque += drive;
            }
            right[i] += torque;
        }
        (matrix, right, forces)
    }

    /// The tether and the magnet, on the last link's end.
    fn tip_force(&self, poses: &[Pose; N], terms: &Terms, right: &mut [f64; N]) {
        let force = terms.at_tip(poses[N - 1].end);
        for (j, pose) in poses.iter().enumerate() {
            right[j] += self.links[j].length_m * dot(pose.across, force);
        }
    }

    /// Resistance of the medium to each link's motion across itself, by Simpson's rule along it.
    fn medium(&self, poses: &[Pose; N], drag: f64, right: &mut [f64; N]) {
        const PARTS: usize = 40;
        if drag == 0.0 {
            return;
        }
        for (i, (link, pose)) in self.links.iter().zip(poses).enumerate() {
            let part_m = link.length_m / PARTS as f64;
            for k in 0..=PARTS {
                let weight = if k == 0 || k == PARTS { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 } / 3.0;
                let out_m = k as f64 * part_m;
                let velocity = add(pose.velocity, pose.across, (out_m - link.centre_m) * pose.rate);
                let across = dot(velocity, pose.across);
                let force = -drag * across.abs() * across * weight * part_m;
                for (j, other) in poses[..=i].iter().enumerate() {
                    let arm = if i == j { out_m } else { self.links[j].length_m };
                    right[j] += arm * force * dot(other.across, pose.across);
                }
            }
        }
    }

    /// What the water does to link `i`.
    fn wet(&self, i: usize, poses: &[Pose; N], water: Plane, terms: &Terms, memory: Plane) -> Wet {
        let (pose, link) = (&poses[i], &self.links[i]);
        let relative = add(pose.velocity, water, -1.0);
        let own = [dot(relative, pose.along), dot(relative, pose.across)];
        let w = pose.rate;
        let facing = link.shape.facing(own);
        let carried = link.shape.carried(self.density, own, w, &facing);
        let drag = link.shape.drag(self.density, self.viscosity, w, &facing);
        let speed = facing.speed;
        let quadratic = drag.quadratic * terms.speed_law(speed);
        let near = terms.nearness(pose.centre[0]) * terms.shelter(i, poses, relative);
        let resisted = near * (drag.slow + quadratic) + terms.linear_drag;
        let side = terms.shedding(i, self.density, speed, own);
        let added = link.shape.added_kg(self.density).map(|kg| kg * terms.added_mass);
        // what of the added inertia goes with velocities, beside the mass matrix: w x v in the link's axes
        let local = [
            carried.force[0] - resisted * own[0] + side[0] - added[0] * w * own[1],
            carried.force[1] - resisted * own[1] + side[1] + added[1] * w * own[0],
        ];
        let force = add(add(memory, pose.along, local[0]), pose.across, local[1]);
        Wet {
            force,
            torque: carried.torque - near * (drag.slow_turning + drag.turning) * w,
            added_kg: added,
            added_kg_m2: link.shape.added_kg_m2(self.density) * terms.added_mass,
        }
    }

    /// Energy of motion and of height \[J\], without springs.
    pub fn energy(&self, state: &State<N>) -> f64 {
        let poses = self.poses(state);
        let links = self.links.iter().zip(&poses);
        links
            .map(|(link, pose)| {
                let speed = dot(pose.velocity, pose.velocity);
                0.5 * (link.mass_kg * speed + link.inertia_kg_m2 * pose.rate * pose.rate)
                    + (link.mass_kg - link.held_kg) * self.gravity * pose.centre[1]
            })
            .sum()
    }
}

/// The water's hold on a link.
struct Wet {
    force: Plane,
    torque: f64,
    /// Along and across.
    added_kg: Plane,
    added_kg_m2: f64,
}

/// Gaussian elimination with pivoting.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> [f64; N] {
    for column in 0..N {
        let pivot = (column..N)
            .max_by(|&a, &b| matrix[a][column].abs().total_cmp(&matrix[b][column].abs()))
            .unwrap_or(column);
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..N {
            let share = matrix[row][column] / matrix[column][column];
            let above = matrix[column];
            for (entry, above) in matrix[row].iter_mut().zip(above).skip(column) {
                *entry -= share * above;
            }
            right[row] -= share * right[column];
        }
    }
    let mut x = [0.0; N];
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| matrix[row][k] * x[k]).sum();
        x[row] = (right[row] - known) / matrix[row][row];
    }
    x
}
