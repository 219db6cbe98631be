//! A mechanism and its runs, as one seed draws them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};

use super::camera::images;
use super::chain::{Chain, Plane};
use super::drive::Servo;
use super::fluid::Coefficients;
use super::motion::{Drive, Motion};
use super::terms::Hidden;

/// MuJoCo's own coefficients, those of the nominal models.
pub const NOMINAL: Coefficients = [0.5, 0.25, 1.5, 1.0, 1.0];
/// Time between images \[s\].
pub const IMAGE_INTERVAL_S: f64 = 0.01;
/// How long a run is watched after its motion starts \[s\].
pub const MOTION_LENGTH_S: f64 = 2.5;
/// Steps of the data \[s\].
pub const DATA_STEP_S: f64 = 2e-4;
/// Steps of derivatives \[s\].
pub const DERIVATIVE_STEP_S: f64 = 1e-3;
/// Time between the servo's rows \[s\].
const SERVO_ROW_INTERVAL_S: f64 = 0.01;

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

/// A run: how it goes, and when it is seen.
#[derive(Debug, Clone)]
pub struct Run<const N: usize> {
    /// Its name in the experiment.
    pub id: String,
    /// Whether it is never fitted.
    pub held_out: bool,
    /// How it goes.
    pub motion: Motion<N>,
    /// When images are taken \[s\].
    pub times_s: Vec<f64>,
}

impl<const N: usize> Run<N> {
    /// Let go from `held`.
    pub fn drop(id: &str, held: [f64; N], draw: &mut Draw) -> Self {
        Self::seen(id, held, Drive::None, draw.even(0.1, 0.2))
    }

    /// Driven with about this amplitude \[rad\] and period \[s\], from where `held` puts the links at the amplitude.
    pub fn driven(
        id: &str,
        [amplitude, period_s]: [f64; 2],
        held: impl FnOnce(f64, &mut Draw) -> [f64; N],
        draw: &mut Draw,
    ) -> Self {
        let (amplitude, period_s) = (amplitude * draw.even(0.9, 1.1), period_s * draw.even(0.9, 1.1));
        let start_s = draw.even(0.1, 0.2);
        let start_s = (start_s * 1e4).round() / 1e4;
        let servo = profile(amplitude, period_s, start_s, start_s + MOTION_LENGTH_S + 0.3);
        let held = held(amplitude, draw);
        Self::seen(id, held, Drive::Exact(servo), start_s)
    }

    fn seen(id: &str, held: [f64; N], drive: Drive, start_s: f64) -> Self {
        let start_s = (start_s * 1e4).round() / 1e4;
        let count = ((start_s + MOTION_LENGTH_S) / IMAGE_INTERVAL_S) as usize + 1;
        // an image may show a later instant than its time says
        let motion = Motion { held, start_s, end_s: start_s + MOTION_LENGTH_S + 0.25, drive, run: 0 };
        Self {
            id: id.into(),
            held_out: false,
            motion,
            times_s: (0..count).map(|k| (k as f64 * IMAGE_INTERVAL_S * 1e6).round() / 1e6).collect(),
        }
    }

    /// Whether the servo turns the first link.
    pub fn is_driven(&self) -> bool {
        !matches!(self.motion.drive, Drive::None)
    }
}

/// What all benches of a mechanism have in common.
#[derive(Debug)]
pub struct Mechanism<const N: usize> {
    /// Its name, also that of its model's file.
    pub name: &'static str,
    /// The links at whose ends the keypoints P1, P2, ... are.
    pub keypoints: &'static [usize],
    /// Whether it is of one material: each coefficient is one number for all links, and so is by what springs and dampings differ from the
    /// model's.
    pub of_one_piece: bool,
    /// How far away walls and cables are, as a share of those of the three links.
    pub distance: f64,
    /// What is hidden in it, in an order that pairs are drawn from.
    pub causes: &'static [&'static str],
    /// Those of them that are numbers of its joints, which a fit may have already.
    pub of_joints: &'static [&'static str],
    /// The bench of a seed, with its joints' own numbers fitted or known.
    pub draw: fn(u64, bool) -> Bench<N>,
}

/// A mechanism and its runs.
#[derive(Debug, Clone)]
pub struct Bench<const N: usize> {
    /// What it is.
    pub mechanism: &'static Mechanism<N>,
    /// The true mechanism, without what is hidden.
    pub chain: Chain<N>,
    /// Whether the fit also has the joints' own numbers, which are then not the nominal ones.
    pub fits_joints: bool,
    /// The nominal model, where a fit starts.
    pub model: &'static str,
    /// Its runs: those to fit first.
    pub runs: Vec<Run<N>>,
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
    let rows = 2 + ((end_s - start_s) / SERVO_ROW_INTERVAL_S).ceil() as usize;
    let mut time_s = vec![0.0];
    time_s.extend(
        (0..rows).map(|row| start_s + row as f64 * SERVO_ROW_INTERVAL_S).map(|t| (t * 1e6).round() / 1e6),
    );
    let angle_rad = time_s.iter().map(|&t| (angle(t) * 1e7).round() / 1e7).collect();
    Servo { time_s, angle_rad }
}

impl<const N: usize> Bench<N> {
    /// `runs` in their places, the last two held out.
    pub fn in_order(mut runs: Vec<Run<N>>) -> Vec<Run<N>> {
        let fitted = runs.len() - 2;
        for (place, run) in runs.iter_mut().enumerate() {
            run.motion.run = place;
            run.held_out = place >= fitted;
        }
        runs
    }

    /// Names of the keypoints.
    pub fn keypoints(&self) -> Vec<String> {
        (1..=self.mechanism.keypoints.len()).map(|k| format!("P{k}")).collect()
    }

    /// Whether the fit has what the cause called `name` would change.
    pub fn fits(&self, name: &str) -> bool {
        self.fits_joints && self.mechanism.of_joints.contains(&name)
    }

    /// What a perfect eye reads from the images of `run` with what is `hidden`, in steps of `step_s`.
    pub fn watch(&self, run: &Run<N>, hidden: &Hidden, step_s: f64) -> Vec<Vec<Plane>> {
        // a memory of every step since the start costs the square of their number
        let step_s =
            if hidden.get("basset/history", 0.0) > 0.0 { step_s.max(DERIVATIVE_STEP_S) } else { step_s };
        let hidden = &hidden.in_run(run.motion.run);
        images(&self.chain.run(&run.motion, hidden, step_s), self.mechanism.keypoints, hidden, &run.times_s)
    }
}
