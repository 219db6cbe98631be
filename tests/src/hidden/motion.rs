//! Moves the chain through a run: classical Runge-Kutta, fine even steps, history by direct quadrature.

use super::chain::{Chain, Plane, Root, State, add};
use super::drive::{Followed, Path, Servo};
use super::terms::{Hidden, Terms};

/// A position servo on the first pivot.
#[derive(Debug, Clone, Copy)]
pub struct PositionServo {
    /// Stiffness \[N m/rad\].
    pub kp: f64,
    /// Damping \[N m s/rad\].
    pub kv: f64,
    /// Greatest torque \[N m\].
    pub most: f64,
}

/// What moves the first link.
#[derive(Debug, Clone)]
pub enum Drive {
    /// Nothing.
    None,
    /// The command, exactly.
    Exact(Servo),
    /// A servo that pulls towards the command.
    Servo(Servo, PositionServo),
}

/// How a run goes.
#[derive(Debug, Clone)]
pub struct Motion<const N: usize> {
    /// Absolute angles until the motion starts \[rad\]; a drive that follows exactly sets the first.
    pub held: [f64; N],
    /// When the motion starts \[s\].
    pub start_s: f64,
    /// Until when it is watched \[s\].
    pub end_s: f64,
    /// What drives it.
    pub drive: Drive,
    /// Its place among the runs.
    pub run: usize,
}

/// The links' ends and their velocities, evenly sampled.
#[derive(Debug, Clone)]
pub struct Record<const N: usize> {
    /// When the motion starts \[s\].
    pub start_s: f64,
    /// Between instants \[s\].
    pub step_s: f64,
    /// Position \[m\] and velocity \[m/s\] of each link's end at each instant.
    pub ends: Vec<[(Plane, Plane); N]>,
    /// Angles and rates at each instant.
    pub states: Vec<State<N>>,
}

impl<const N: usize> Chain<N> {
    /// Moves the chain through `motion` with what is `hidden`, in steps of `step_s`.
    pub fn run(&self, motion: &Motion<N>, hidden: &Hidden, step_s: f64) -> Record<N> {
        self.changed(hidden).moved(motion, hidden, step_s)
    }

    fn moved(&self, motion: &Motion<N>, hidden: &Hidden, step_s: f64) -> Record<N> {
        let mut terms = Terms::new(hidden, motion.run, N);
        let path = match &motion.drive {
            Drive::None => None,
            Drive::Exact(servo) | Drive::Servo(servo, _) => Some(Path::new(servo, hidden, motion.end_s)),
        };
        let exact = matches!(motion.drive, Drive::Exact(_));
        let followed = path.as_ref().filter(|_| exact);
        let followed = followed.map(|path| Followed::new(path, motion.start_s, motion.end_s, step_s));
        let mut state = State { angle: motion.held, rate: [0.0; N] };
        if let Some(followed) = &followed {
            let [angle, rate, _] = followed.at(motion.start_s);
            state.angle[0] = angle;
            state.rate = self.struck(&state, rate, &terms);
        }
        let steps = ((motion.end_s - motion.start_s) / step_s).ceil() as usize;
        let mut past = Past::new(step_s);
        let mut record = Record { start_s: motion.start_s, step_s, ends: Vec::new(), states: Vec::new() };
        for step in 0..=steps {
            let time_s = motion.start_s + step as f64 * step_s;
            let poses = self.poses(&state);
            record.ends.push(poses.map(|pose| (pose.end, pose.end_velocity)));
            record.states.push(state);
            terms.shed(&poses, step_s);
            let memories = (terms.basset > 0.0).then(|| {
                let water = terms.water(time_s);
                past.pass(poses.map(|pose| add(pose.velocity, water, -1.0)));
                [0.0, 0.5, 1.0].map(|share| past.sums(share))
            });
            let rates = |share: f64, at: &State<N>| -> (State<N>, [f64; N]) {
                let (mut at, now) = (*at, time_s + share * step_s);
                let root = match (&followed, &motion.drive, &path) {
                    (Some(followed), ..) => {
                        let [angle, rate, acceleration] = followed.at(now);
                        (at.angle[0], at.rate[0]) = (angle, rate);
                        Root::Prescribed(acceleration)
                    }
                    (None, Drive::Servo(_, servo), Some(path)) => {
                        let pull = servo.kp * (path.at(now) - at.angle[0]) - servo.kv * at.rate[0];
                        Root::Torque(pull.clamp(-servo.most, servo.most))
                    }
                    _ => Root::Free,
                };
                let memory = match &memories {
                    Some(sums) => {
                        let water = terms.water(now);
                        let moving = self.poses(&at).map(|pose| add(pose.velocity, water, -1.0));
                        past.force(&sums[(2.0 * share) as usize], &moving, share, terms.basset)
                    }
                    None => [[0.0; 2]; N],
                };
                let acceleration = self.accelerations(now, &at, root, &terms, &memory);
                (at, acceleration)
            };
            state = runge_kutta(&state, step_s, rates);
            if let Some(followed) = &followed {
                let [angle, rate, _] = followed.at(time_s + step_s);
                (state.angle[0], state.rate[0]) = (angle, rate);
            }
        }
        record
    }
}

/// One step of `h`; `rates` gives the rates and accelerations at a share of the step.
fn runge_kutta<const N: usize>(
    state: &State<N>,
    h: f64,
    rates: impl Fn(f64, &State<N>) -> (State<N>, [f64; N]),
) -> State<N> {
    let ahead = |(at, acceleration): &(State<N>, [f64; N]), by: f64| State {
        angle: std::array::from_fn(|i| state.angle[i] + by * at.rate[i]),
        rate: std::array::from_fn(|i| state.rate[i] + by * acceleration[i]),
    };
    let a = rates(0.0, state);
    let b = rates(0.5, &ahead(&a, 0.5 * h));
    let c = rates(0.5, &ahead(&b, 0.5 * h));
    let d = rates(1.0, &ahead(&c, h));
    let mean = |a: f64, b: f64, c: f64, d: f64| h / 6.0 * (a + 2.0 * (b + c) + d);
    State {
        angle: std::array::from_fn(|i| {
            state.angle[i] + mean(a.0.rate[i], b.0.rate[i], c.0.rate[i], d.0.rate[i])
        }),
        rate: std::array::from_fn(|i| state.rate[i] + mean(a.1[i], b.1[i], c.1[i], d.1[i])),
    }
}

/// Velocities of the links' centres against the water at the steps so far, for Basset's integral: the velocity is straight
/// within a step, so each gives its change times the integral of the kernel over it.
struct Past<const N: usize> {
    step_s: f64,
    velocity: Vec<[Plane; N]>,
}

impl<const N: usize> Past<N> {
    fn new(step_s: f64) -> Self {
        Self { step_s, velocity: Vec::new() }
    }

    fn pass(&mut self, velocity: [Plane; N]) {
        self.velocity.push(velocity);
    }

    /// What the whole steps before give at a share of the step after the last one \[m/s^1.5\].
    fn sums(&self, share: f64) -> [Plane; N] {
        let mut sums = [[0.0; 2]; N];
        let last = self.velocity.len() - 1;
        let mut farther = (last as f64 + share).sqrt();
        for k in 0..last {
            let nearer = ((last - k - 1) as f64 + share).sqrt();
            let weight = 2.0 * (farther - nearer) / self.step_s.sqrt();
            farther = nearer;
            for (sum, (before, after)) in
                sums.iter_mut().zip(self.velocity[k].iter().zip(&self.velocity[k + 1]))
            {
                *sum = add(*sum, add(*after, *before, -1.0), weight);
            }
        }
        sums
    }

    /// The force on each link that now moves at `velocity`.
    fn force(&self, sums: &[Plane; N], velocity: &[Plane; N], share: f64, history: f64) -> [Plane; N] {
        let last = self.velocity[self.velocity.len() - 1];
        let weight = if share > 0.0 { 2.0 / (share * self.step_s).sqrt() } else { 0.0 };
        std::array::from_fn(|i| {
            let sum = add(sums[i], add(velocity[i], last[i], -1.0), weight);
            sum.map(|sum| -history * sum)
        })
    }
}

impl<const N: usize> Record<N> {
    /// Where link `i` ends at `time_s`: the cubic through positions and velocities of the instants around.
    pub fn end(&self, i: usize, time_s: f64) -> Plane {
        let place = (time_s - self.start_s) / self.step_s;
        if place <= 0.0 {
            return self.ends[0][i].0;
        }
        let before = (place.floor() as usize).min(self.ends.len() - 2);
        let (s, h) = (place - before as f64, self.step_s);
        let ((x0, v0), (x1, v1)) = (self.ends[before][i], self.ends[before + 1][i]);
        let r = 1.0 - s;
        std::array::from_fn(|axis| {
            let start = (1.0 + 2.0 * s) * r * r * x0[axis] + s * r * r * h * v0[axis];
            start + s * s * (1.0 + 2.0 * r) * x1[axis] - s * s * r * h * v1[axis]
        })
    }
}
