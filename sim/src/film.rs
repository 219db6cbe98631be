//! Positions of the keypoints as the camera sees them, step by step and between steps.

use crate::causes::Looks;
use crate::causes::own::Shifts;
use crate::dynamics::integrate::Hermite;
use crate::dynamics::plant::Plant;
use crate::dynamics::stages::Stages;
use crate::dynamics::{Work, bias, kinematics};
use crate::math::{Vec3, Vector};
use crate::model::{Model, State};
use crate::scalar::{Mask, Scalar, tuned};
use crate::simulator::Engine;
use crate::space::Space;

/// The keypoints' motion over a run and the camera that looks at it.
///
/// Between two steps a point moves on the cubic that has its positions and velocities at both ends, which is as exact as
/// Runge-Kutta's own fourth order and has exact derivatives by time.
#[derive(Debug, Clone)]
pub(crate) struct Film<T: Scalar> {
    looks: Looks<T>,
    shifts: Shifts<T>,
    points: usize,
    /// How many marks there are besides, which no camera sees.
    unseen: usize,
    /// When motion starts \[s\], lane by lane, and about when.
    start_s: T,
    about_s: f64,
    /// When each step ends \[s\], from the start; 0 first.
    ends_s: Vec<f64>,
    /// Each step's positions and velocities at its start and at its end, shape (steps, K).
    spans: Vec<Span<T>>,
    still: Vec<[T; 3]>,
}

/// The first place in the lanes of `mask`, the second one in the others.
#[inline(always)]
pub(crate) fn choose<T: Scalar>(mask: T::Mask, [a, b, c]: [T; 3], [x, y, z]: [T; 3]) -> [T; 3] {
    [T::select(mask, a, x), T::select(mask, b, y), T::select(mask, c, z)]
}

/// Position \[m\] and velocity \[m/s\], world frame.
type Moving<T> = ([T; 3], [T; 3]);

/// One point's motion over one step.
#[derive(Debug, Clone, Copy)]
struct Span<T> {
    from: Moving<T>,
    to: Moving<T>,
}

/// A keypoint's body, and its place on it in the body's axes and in its space's.
pub(crate) type Keypoint<S> = (usize, Vec3<<S as Space>::T>, <S as Space>::Vec);

/// Where the keypoints are in `state` at `time` \[s\], near `about_s`, and how they move: hands each on to `keep`, which gets its place in `sites` too.
fn watch<S: Stages>(
    engine: &mut Engine<S>,
    (state, about_s, time): (&State<S::T>, f64, S::T),
    sites: &[Keypoint<S>],
    mut keep: impl FnMut(usize, Moving<S::T>),
) {
    engine.stand(about_s, time);
    tuned!(S::T, {
        let (plant, work) = (&engine.plant, &mut engine.work);
        kinematics::kinematics(plant, &state.qpos, work);
        bias::velocities(plant, &state.qvel, work);
        for (point, site) in sites.iter().enumerate() {
            keep(point, look(plant, work, site));
        }
    });
}

#[inline(always)]
fn look<S: Space>(plant: &Plant<S>, work: &Work<S>, &(body, own, at): &Keypoint<S>) -> Moving<S::T> {
    let world = work.pos[body] + S::apply(&work.rot[body], at);
    let motion = work.velocity[body];
    let velocity = motion.lin + S::cross(motion.ang, world - work.pos[plant.links[body].root]);
    // the depth is no velocity
    let [x, y, z] = S::lift(&plant.layout, body, own, velocity);
    let [depth_x, depth_y, depth_z] = S::lift(&plant.layout, body, own, S::Vec::ZERO);
    (S::lift(&plant.layout, body, own, world), [x - depth_x, y - depth_y, z - depth_z])
}

impl<T: Scalar> Film<T> {
    /// A camera with the causes of `model`; `None` when it has none.
    pub(crate) fn new(model: &Model<T>, start_s: T, about_s: f64) -> Option<Self> {
        let (looks, shifts) = (Looks::new(model), Shifts::new(model));
        let points = model.keypoint_sites().len();
        (!looks.is_empty() || !shifts.is_empty()).then(|| Self {
            looks,
            shifts,
            points,
            unseen: model.encoders.len(),
            start_s,
            about_s,
            ends_s: vec![0.0],
            spans: Vec::new(),
            still: Vec::new(),
        })
    }

    /// Where the points are until the motion starts.
    pub(crate) fn open<S: Stages<T = T>>(
        &mut self,
        engine: &mut Engine<S>,
        state: &State<T>,
        sites: &[Keypoint<S>],
    ) {
        self.still.clear();
        watch(engine, (state, self.about_s, self.start_s), sites, |_, (at, _)| self.still.push(at));
    }

    /// How the points moved in the step between two states, which ended `end_s` \[s\] after the start.
    pub(crate) fn record<S: Stages<T = T>>(
        &mut self,
        engine: &mut Engine<S>,
        [before, after]: [&State<T>; 2],
        sites: &[Keypoint<S>],
        end_s: f64,
    ) {
        if !self.looks.shifts() {
            return;
        }
        let first = self.spans.len();
        let from_s = self.ends_s[self.ends_s.len() - 1];
        let [begins, ends] = [(before, from_s), (after, end_s)]
            .map(|(state, passed)| (state, self.about_s + passed, self.start_s + T::from_f64(passed)));
        watch(engine, begins, sites, |_, from| self.spans.push(Span { from, to: from }));
        watch(engine, ends, sites, |point, to| self.spans[first + point].to = to);
        self.ends_s.push(end_s);
    }

    /// Whether the motion is known for as long as the images taken at `times_s` \[s\] need.
    pub(crate) fn reaches(&self, times_s: &[f64]) -> bool {
        if !self.looks.shifts() || self.points == 0 {
            return true;
        }
        let end = self.end(self.ends_s.len() - 1);
        times_s.iter().rev().all(|&time_s| {
            let shared = T::from_f64(time_s) + self.late();
            !end.less(shared).any()
                && (0..self.points).all(|point| !end.less(shared + self.later(point, time_s, shared)).any())
        })
    }

    /// By how much later than its time \[s\] an image shows everything; a clock that is off by more than a second is
    /// another fault.
    #[inline(always)]
    fn late(&self) -> T {
        self.looks.late().clamp(-T::ONE, T::ONE)
    }

    /// By how much later still it shows `point`.
    #[inline(always)]
    fn later(&self, point: usize, time_s: f64, shared: T) -> T {
        self.looks.late_at(self.at(point, time_s, shared)).clamp(-T::ONE, T::ONE)
    }

    /// When step `step` ends \[s\], from 1; 0 for the start.
    #[inline(always)]
    fn end(&self, step: usize) -> T {
        self.start_s + T::from_f64(self.ends_s[step])
    }

    /// Where `point` is at `when` \[s\], which is near `time_s`.
    fn at(&self, point: usize, time_s: f64, when: T) -> [T; 3] {
        tuned!(T, {
            let last = self.ends_s.len() - 1;
            if last == 0 {
                return self.still[point];
            }
            let about_s = time_s - self.about_s;
            let mut step = self.ends_s.partition_point(|&end_s| end_s < about_s).clamp(1, last);
            let mut value = self.within(point, step, when);
            // lanes may be in other steps: forward, then back
            while step < last && !when.less(self.end(step)).all() {
                step += 1;
                let later = self.within(point, step, when);
                value = choose(when.less(self.end(step - 1)), value, later);
            }
            while step > 1 && when.less(self.end(step - 1)).any() {
                let before = when.less(self.end(step - 1));
                step -= 1;
                value = choose(before, self.within(point, step, when), value);
            }
            choose(when.less(self.start_s), self.still[point], value)
        })
    }

    /// The cubic of one step, from 1.
    #[inline(always)]
    fn within(&self, point: usize, step: usize, when: T) -> [T; 3] {
        let Span { from: (x0, v0), to: (x1, v1) } = self.spans[(step - 1) * self.points + point];
        let h = self.ends_s[step] - self.ends_s[step - 1];
        let s = (when - self.end(step - 1)) * T::from_f64(1.0 / h);
        let cubic = Hermite::new(T::from_f64(h), s);
        let mut place = x0;
        for (axis, x) in place.iter_mut().enumerate() {
            *x = cubic.blend(x0[axis], v0[axis], x1[axis], v1[axis]);
        }
        place
    }

    /// What the images taken at `times_s` show: `position_m`, shape (N, K), comes in as where the points are then. Encoders, which stand
    /// after the points, stay.
    pub(crate) fn develop(&self, times_s: &[f64], position_m: &mut [[T; 3]]) {
        tuned!(T, self.develop_each(times_s, position_m));
    }

    #[inline(always)]
    fn develop_each(&self, times_s: &[f64], position_m: &mut [[T; 3]]) {
        let width = (self.points + self.unseen).max(1);
        for (&time_s, marks) in times_s.iter().zip(position_m.chunks_exact_mut(width)) {
            for (point, at) in marks.iter_mut().take(self.points).enumerate() {
                if self.looks.shifts() {
                    let shared = T::from_f64(time_s) + self.late();
                    *at = self.at(point, time_s, shared + self.later(point, time_s, shared));
                }
                // another place in the tank, which the camera then looks at
                *at = self.looks.see(self.shifts.see(point, time_s, *at));
            }
        }
    }
}
