//! The mechanism and its runs: nominal, and as one seed draws them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};

use super::camera::images;
use super::chain::{Chain, Link, Plane};
use super::drive::Servo;
use super::fluid::{Coefficients, Ellipsoid};
use super::motion::{Drive, Motion};
use super::terms::Hidden;

/// Links of the chain.
pub const LINKS: usize = 3;
/// The nominal model, where a fit starts.
pub const MODEL: &str = include_str!("../../data/hidden/chain.xml");
/// MuJoCo's own coefficients, those of the nominal model.
pub const NOMINAL: Coefficients = [0.5, 0.25, 1.5, 1.0, 1.0];
/// Damping of each pivot in the nominal model \[N m s/rad\].
pub const NOMINAL_DAMPING: f64 = 2e-6;
/// Time between images \[s\].
pub const IMAGE_S: f64 = 0.01;
/// How long a run is watched after its motion starts \[s\].
pub const WATCHED_S: f64 = 2.5;
/// Steps of the data \[s\].
pub const FINE_S: f64 = 2e-4;
/// Steps of derivatives \[s\].
pub const COARSE_S: f64 = 1e-3;
/// Time between the servo's rows \[s\].
const ROW_S: f64 = 0.01;

/// Random numbers by name of use, so that one more draw here moves nothing there.
#[derive(Debug)]
pub struct Draw(ChaCha8Rng);

impl Draw {
    /// The numbers of `seed` for the use `stream`.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        Self(random)
    }

    /// From the standard normal distribution.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Evenly from `low` to `high`.
    pub fn even(&mut self, low: f64, high: f64) -> f64 {
        let share: f64 = StandardUniform.sample(&mut self.0);
        low + share * (high - low)
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.even(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 }
    }

    /// One of `count` places.
    pub fn place(&mut self, count: usize) -> usize {
        (self.even(0.0, count as f64) as usize).min(count - 1)
    }
}

/// The three links of `data/hidden/chain.xml` with these coefficients and pivot dampings \[N m s/rad\].
pub fn chain(coefficients: [Coefficients; LINKS], damping: [f64; LINKS]) -> Chain<LINKS> {
    const SIDES_M: [f64; 3] = [0.03, 0.01, 0.005];
    let [long, wide, deep] = SIDES_M;
    let mass_kg = 1240.0 * long * wide * deep;
    let shape = Ellipsoid::new(SIDES_M.map(|side| side / 2.0), NOMINAL);
    let links = std::array::from_fn(|i| Link {
        length_m: if i + 1 == LINKS { 0.0275 } else { 0.025 },
        centre_m: 0.0125,
        mass_kg,
        held_kg: mass_kg * 0.806452,
        inertia_kg_m2: mass_kg / 12.0 * (long * long + wide * wide),
        damping: damping[i],
        shape: shape.with(coefficients[i]),
    });
    Chain { links, gravity: 9.81, density: 1000.0, viscosity: 0.00095 }
}

/// A run: how it goes, and when it is seen.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its name in the experiment.
    pub id: String,
    /// Whether it is never fitted.
    pub held_out: bool,
    /// How it goes.
    pub motion: Motion<LINKS>,
    /// When images are taken \[s\].
    pub times_s: Vec<f64>,
}

impl Run {
    /// Whether the servo turns the first link.
    pub fn is_driven(&self) -> bool {
        !matches!(self.motion.drive, Drive::None)
    }
}

/// A mechanism and its runs.
#[derive(Debug, Clone)]
pub struct Bench {
    /// The true mechanism, without what is hidden.
    pub chain: Chain<LINKS>,
    /// Whether the fit also has the dampings of the passive pivots, which are then not the nominal ones.
    pub fits_damping: bool,
    /// The nominal model, where a fit starts.
    pub model: &'static str,
    /// Its runs: those to fit first.
    pub runs: Vec<Run>,
}

/// A swing between -`amplitude_rad` and `amplitude_rad` with strokes of two thirds and one third of `period_s`, at rest until
/// `start_s`.
pub fn profile(amplitude_rad: f64, period_s: f64, start_s: f64, end_s: f64) -> Servo {
    let [slow, quick] = [2.0, 1.0].map(|share| share * period_s / 3.0);
    let angle = |time_s: f64| {
        let passed = (time_s - start_s).max(0.0) % period_s;
        let share = if passed < slow { passed / slow } else { 1.0 - (passed - slow) / quick };
        -amplitude_rad * (std::f64::consts::PI * share).cos()
    };
    // rows to a microsecond, as a file has them
    let rows = 2 + ((end_s - start_s) / ROW_S).ceil() as usize;
    let mut time_s = vec![0.0];
    time_s.extend((0..rows).map(|row| start_s + row as f64 * ROW_S).map(|t| (t * 1e6).round() / 1e6));
    let angle_rad = time_s.iter().map(|&t| (angle(t) * 1e7).round() / 1e7).collect();
    Servo { time_s, angle_rad }
}

impl Bench {
    /// What `seed` draws: true coefficients about the nominal ones, and two drops and two driven runs to fit, one of each
    /// held out. With `fits_damping` the dampings are drawn too.
    pub fn draw(seed: u64, fits_damping: bool) -> Self {
        let mut draw = Draw::new(seed, 1);
        let coefficients = std::array::from_fn(|_| NOMINAL.map(|c| c * (0.35 * draw.normal()).exp()));
        let mut damping = [NOMINAL_DAMPING; LINKS];
        for damping in &mut damping[1..] {
            let drawn = NOMINAL_DAMPING * (0.4 * draw.normal()).exp();
            if fits_damping {
                *damping = drawn;
            }
        }
        let mut runs: Vec<Run> = Vec::new();
        let poses: [[f64; LINKS]; 3] = [[1.57, 1.57, 1.57], [-1.57, -0.3, 0.1], [1.1, 0.2, -0.9]];
        let swings = [(0.6, 1.5), (0.4, 0.9), (0.5, 1.2)];
        for k in [0, 1] {
            let held = poses[k].map(|angle| angle + 0.08 * draw.normal());
            runs.push(Self::drop(&format!("drop-{}", k + 1), held, &mut draw));
        }
        for (k, swing) in swings[..2].iter().enumerate() {
            runs.push(Self::driven(&format!("driven-{}", k + 1), *swing, &mut draw));
        }
        let held = poses[2].map(|angle| angle + 0.08 * draw.normal());
        runs.push(Self::drop("drop-held-out", held, &mut draw));
        runs.push(Self::driven("driven-held-out", swings[2], &mut draw));
        for (place, run) in runs.iter_mut().enumerate() {
            run.motion.run = place;
            run.held_out = place >= 4;
        }
        Self { chain: chain(coefficients, damping), fits_damping, model: MODEL, runs }
    }

    fn drop(id: &str, held: [f64; LINKS], draw: &mut Draw) -> Run {
        Self::seen(id, held, Drive::None, draw.even(0.1, 0.2))
    }

    fn driven(id: &str, (amplitude, period_s): (f64, f64), draw: &mut Draw) -> Run {
        let (amplitude, period_s) = (amplitude * draw.even(0.9, 1.1), period_s * draw.even(0.9, 1.1));
        let start_s = draw.even(0.1, 0.2);
        let start_s = (start_s * 1e4).round() / 1e4;
        let servo = profile(amplitude, period_s, start_s, start_s + WATCHED_S + 0.3);
        // hanging from the turned first link, roughly
        let held = [-amplitude, 0.05 * draw.normal(), 0.05 * draw.normal()];
        Self::seen(id, held, Drive::Exact(servo), start_s)
    }

    fn seen(id: &str, held: [f64; LINKS], drive: Drive, start_s: f64) -> Run {
        let start_s = (start_s * 1e4).round() / 1e4;
        let count = ((start_s + WATCHED_S) / IMAGE_S) as usize + 1;
        // an image may show a later instant than its time says
        let motion = Motion { held, start_s, end_s: start_s + WATCHED_S + 0.25, drive, run: 0 };
        Run {
            id: id.into(),
            held_out: false,
            motion,
            times_s: (0..count).map(|k| (k as f64 * IMAGE_S * 1e6).round() / 1e6).collect(),
        }
    }

    /// What a perfect eye reads from the images of `run` with what is `hidden`, in steps of `step_s`.
    pub fn watch(&self, run: &Run, hidden: &Hidden, step_s: f64) -> Vec<[Plane; LINKS]> {
        // a memory of every step since the start costs the square of their number
        let step_s = if hidden.get("basset/history", 0.0) > 0.0 { step_s.max(COARSE_S) } else { step_s };
        let hidden = &hidden.in_run(run.motion.run);
        images(&self.chain.run(&run.motion, hidden, step_s), hidden, &run.times_s)
    }
}
