//! A cause as one seed draws it: where it pulls, hits or stands, and how strong it must be to be seen.

use std::f64::consts::TAU;

use sim::Cause;
use sim::causes::Role;

use super::bench::{Bench, Draw};
use super::limit::{DETECTION_CHI_SQUARE, Imitation, largest_bend};
use super::terms::Hidden;

/// Effects that no library knows, with the parameter that is their size and a usual value.
pub const OUTSIDE_EFFECTS: [(&str, &str, f64); 4] = [
    ("vortex", "vortex/lift", 0.5),
    ("detent", "detent/torque", 1e-5),
    ("wake", "wake/shelter", 0.3),
    ("magnet", "magnet/force", 1e-3),
];

/// Share of a physical bound that a size may reach.
const BOUND_SHARE: f64 = 0.9;
/// Step of the finite differences, as a share of a number.
const DIFFERENCE_STEP_SHARE: f64 = 0.02;
/// Numbers that a fit does not turn.
const UNFITTED_PARAMETERS: [&str; 2] = ["one_sided_stiffness/side", "servo_rate_limit/share"];

/// Something to hide, its size left open.
#[derive(Debug, Clone)]
pub struct Hideout {
    /// The cause's name.
    pub cause: String,
    /// Parameters that scale with the size, each with its share.
    along: Vec<(String, f64)>,
    /// Parameters that do not.
    fixed: Vec<(String, f64)>,
    /// A usual size.
    usual: f64,
    /// Greatest size by physical bounds.
    most: f64,
    /// The size is 1 over this parameter: less of it is more.
    inverse: bool,
}

/// A cause in its size.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Truth {
    /// Its name.
    pub cause: String,
    /// The numbers that make up its size, by name.
    pub size: Vec<(String, f64)>,
    /// Size at the limit, of the first number.
    pub limit: f64,
    /// Its size as a multiple of the limit, unless its size knows no proportion.
    pub times: f64,
    /// Whether a bound of physics kept it smaller than asked for.
    pub clipped: bool,
    /// The other cause that looks most like it in these runs, and the chi-square by which they differ.
    pub rival: Option<(String, f64)>,
}

impl Hideout {
    /// What `draw` makes of the cause called `name`.
    ///
    /// # Panics
    /// When there is no such cause.
    pub fn draw<const N: usize>(name: &str, bench: &Bench<N>, draw: &mut Draw) -> Self {
        let mut fixed: Vec<(String, f64)> = Vec::new();
        let mut fix = |name: &str, value: f64| fixed.push((name.into(), value));
        if let Some((_, parameter, usual)) = OUTSIDE_EFFECTS.iter().find(|(outside, ..)| *outside == name) {
            if name == "vortex" {
                for run in 0..bench.runs.len() {
                    for link in 0..bench.chain.links.len() {
                        fix(&format!("vortex/phase{link}@{run}"), draw.even(0.0, TAU));
                    }
                }
            }
            let most = if name == "wake" { 0.95 } else { f64::INFINITY };
            let sign = if name == "magnet" { draw.sign() } else { 1.0 };
            return Self {
                cause: name.into(),
                along: vec![((*parameter).into(), sign)],
                fixed,
                usual: *usual,
                most,
                inverse: false,
            };
        }
        let cause: Cause = name.parse().unwrap_or_else(|error| panic!("{error}"));
        let info = cause.info();
        let size =
            info.parameters.iter().find(|parameter| matches!(parameter.role, Role::Size | Role::Switch));
        let size = size.expect("every cause has a size");
        let turn = draw.even(0.0, TAU);
        let sign = if size.bounds[0] < 0.0 { draw.sign() } else { 1.0 };
        let named = |parameter: &str| format!("{name}/{parameter}");
        let mut along = match name {
            "current" | "camera_tilt" => vec![(named("x"), turn.cos()), (named("z"), turn.sin())],
            "cob_offset" => vec![(named("along"), turn.cos()), (named("across"), turn.sin())],
            "slosh" => (0..bench.runs.len())
                .flat_map(|run| {
                    let phase = draw.even(0.0, TAU);
                    [(format!("slosh/sin@{run}"), phase.cos()), (format!("slosh/cos@{run}"), phase.sin())]
                })
                .collect(),
            "keypoint_slip" => {
                let keypoints = bench.keypoints();
                vec![(named(&keypoints[draw.place(keypoints.len())]), sign)]
            }
            "joint_zero" => vec![(named("q1"), sign)],
            // what is of one piece ages in one place
            "stiffness" | "joint_damping" if bench.mechanism.of_one_piece => {
                vec![(named(&format!("q{}", 2 + draw.place(N - 1))), sign)]
            }
            _ => vec![(named(size.name), sign)],
        };
        let mut inverse = false;
        let distance = bench.mechanism.distance;
        match name {
            "slosh" => fix("slosh/frequency", draw.even(0.7, 1.8)),
            "wall" => fix("wall/x", draw.sign() * draw.even(0.075, 0.095) * distance),
            "tether" => {
                fix("tether/x", draw.sign() * draw.even(0.04, 0.1) * distance);
                fix("tether/z", draw.even(-0.1, 0.1) * distance);
            }
            "one_sided_stiffness" => fix("one_sided_stiffness/side", draw.sign()),
            "end_stop" => fix("end_stop/angle", draw.even(0.45, 0.7) * largest_bend(bench)),
            "servo_rate_limit" => {
                fix("servo_rate_limit/share", 1.0);
                along = vec![("servo_rate_limit/rate".into(), 1.0)];
                inverse = true;
            }
            _ => {}
        }
        let most = BOUND_SHARE * size.bounds[1].abs();
        Self { cause: name.into(), along, fixed, usual: size.typical, most, inverse }
    }

    /// The numbers at `size`.
    pub fn at(&self, size: f64) -> Hidden {
        let scaled = self.along.iter().map(|(name, share)| {
            (name.clone(), if self.inverse { 1.0 / size.max(1e-9) } else { size * share })
        });
        Hidden(scaled.chain(self.fixed.iter().cloned()).collect())
    }

    /// `hidden`, of which this is a part, with each of its own numbers a little changed: by what a fit would turn.
    fn nudged<const N: usize>(&self, bench: &Bench<N>, hidden: &Hidden) -> Vec<Hidden> {
        let own = hidden.0.iter().map(|(name, &value)| (name.clone(), value));
        let own = own.filter(|(name, _)| name.split('/').next() == Some(&self.cause));
        let mut numbers: Vec<(String, f64)> =
            own.filter(|(name, _)| !UNFITTED_PARAMETERS.contains(&&**name)).collect();
        if self.cause == "keypoint_slip" {
            let others = bench.keypoints().into_iter().map(|point| (format!("keypoint_slip/{point}"), 0.0));
            numbers.extend(others.filter(|(name, _)| !hidden.0.contains_key(name)));
        }
        let nudge = |(name, value): (String, f64)| {
            let by = DIFFERENCE_STEP_SHARE * if value == 0.0 { self.usual } else { value };
            hidden.clone().with(&name, value + by)
        };
        numbers.into_iter().map(nudge).collect()
    }

    /// The smallest size that the fitted runs of `bench` show, beside `partner`; `None` where they show none.
    pub fn limit<const N: usize>(
        &self,
        bench: &Bench<N>,
        imitation: &Imitation<N>,
        partner: Option<(&Self, &Hidden)>,
    ) -> Option<f64> {
        let chi_square = |size: f64| self.chi_square(bench, imitation, partner, size);
        match self.inverse {
            true => seek(chi_square, DETECTION_CHI_SQUARE),
            false => imitation.limit(0.05 * self.usual, chi_square),
        }
    }

    fn chi_square<const N: usize>(
        &self,
        bench: &Bench<N>,
        imitation: &Imitation<N>,
        partner: Option<(&Self, &Hidden)>,
        size: f64,
    ) -> f64 {
        let own = self.at(size);
        let Some((other, partner)) = partner else { return imitation.chi_square(bench, &own) };
        let mut both = own;
        both.0.extend(partner.0.clone());
        imitation.chi_square_beside(bench, &both, partner, &other.nudged(bench, &both))
    }

    /// The cause at `times` its `limit`; `None` where no size is so strong.
    pub fn hide<const N: usize>(
        &self,
        bench: &Bench<N>,
        imitation: &Imitation<N>,
        limit: f64,
        times: f64,
    ) -> Option<(Hidden, Truth)> {
        let size = if self.inverse {
            // how much of the rate is missing has no proportion: the size is sought too
            let chi_square = |size: f64| self.chi_square(bench, imitation, None, size);
            seek(chi_square, DETECTION_CHI_SQUARE * times * times)?
        } else {
            limit * times
        };
        let clipped = !self.inverse && size > self.most;
        let size = if clipped { self.most } else { size };
        let times = if self.inverse { times } else { size / limit };
        let hidden = self.at(size);
        let numbers = self.along.iter().map(|(name, _)| (name.clone(), hidden.get(name, 0.0)));
        let truth =
            Truth { cause: self.cause.clone(), size: numbers.collect(), limit, times, clipped, rival: None };
        Some((hidden, truth))
    }
}

/// Sizes between which those without proportion are sought: seconds per radian of the slowest and fastest rate.
const SIZE_SEARCH_RANGE: [f64; 2] = [0.05, 20.0];

/// The size, by bisection of its logarithm, at which a rising `chi_square` reaches `goal`.
fn seek(chi_square: impl Fn(f64) -> f64, goal: f64) -> Option<f64> {
    let [mut low, mut high] = SIZE_SEARCH_RANGE.map(f64::ln);
    if chi_square(high.exp()) < goal {
        return None;
    }
    for _ in 0..16 {
        let middle = 0.5 * (low + high);
        if chi_square(middle.exp()) < goal {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(high.exp())
}
