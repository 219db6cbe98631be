//! From the command to the first link: a dense table of what the drive is commanded, with the causes between.

use super::terms::Hidden;

/// A servo table: times \[s\] and commanded angles \[rad\], straight between rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Servo {
    /// Row times.
    pub time_s: Vec<f64>,
    /// Commanded angles.
    pub angle_rad: Vec<f64>,
}

impl Servo {
    /// The command at `time_s`.
    pub fn at(&self, time_s: f64) -> f64 {
        let next = self.time_s.partition_point(|&t| t <= time_s);
        if next == 0 || next == self.time_s.len() {
            return self.angle_rad[next.saturating_sub(1).min(self.angle_rad.len() - 1)];
        }
        let (a, b) = (self.time_s[next - 1], self.time_s[next]);
        let share = (time_s - a) / (b - a);
        self.angle_rad[next - 1] * (1.0 - share) + self.angle_rad[next] * share
    }
}

/// Step of the servo's path \[s\].
const PATH_STEP_S: f64 = 5e-5;

/// What a servo's motor makes of the horn's speed, either way \[rad/s2\]: it covers three degrees in 8 ms.
const MOTOR_RAD_PER_S2: f64 = 3000.0;

/// A horn that goes where it is commanded as fast as its motor can, and stops there.
struct Jerk {
    angle: f64,
    rate: f64,
}

impl Jerk {
    /// Where it is an instant later.
    fn towards(&mut self, aim: f64) -> f64 {
        let left = aim - self.angle;
        let change = MOTOR_RAD_PER_S2 * PATH_STEP_S;
        // the speed from which it can still stop in time
        let wanted = left.signum() * ((2.0 * MOTOR_RAD_PER_S2 * left.abs()).sqrt() - 0.5 * change).max(0.0);
        self.rate += (wanted - self.rate).clamp(-change, change);
        if left.abs() < change * PATH_STEP_S && self.rate.abs() <= 2.0 * change {
            (self.angle, self.rate) = (aim, 0.0);
        }
        self.angle += self.rate * PATH_STEP_S;
        self.angle
    }
}

/// What the drive gets, evenly sampled from time 0 on.
#[derive(Debug, Clone)]
pub struct Path {
    value: Vec<f64>,
}

impl Path {
    /// `servo` from time 0 to `end_s`, looked at every so often by a servo that jerks to what it sees, through gain, a reach that sags,
    /// rate limit, lag, backlash, delay and the horn's zero.
    pub fn new(servo: &Servo, hidden: &Hidden, end_s: f64) -> Self {
        let gain = 1.0 + hidden.get("servo_gain/scale", 0.0);
        let limited = hidden.get("servo_rate_limit/share", 0.0) > 0.5;
        let rate = if limited { hidden.get("servo_rate_limit/rate", 6.0) } else { f64::INFINITY };
        let lag = hidden.get("servo_lag/time", 0.0);
        let play = hidden.get("backlash/half_width", 0.0);
        let delay = hidden.get("servo_delay/delay", 0.0);
        let keep = if lag > 0.0 { (-PATH_STEP_S / lag).exp() } else { 0.0 };
        // the exact answer to an input that rises evenly over one instant
        let lead = if lag > 0.0 { 1.0 - (1.0 - keep) * lag / PATH_STEP_S } else { 1.0 };
        let zero = hidden.get("joint_zero/q1", 0.0);
        let sag = hidden.get("servo_sag/rate", 0.0);
        let every = hidden.get("servo_refresh/period", 0.0);
        let commanded = |k: usize| {
            let now = k as f64 * PATH_STEP_S;
            // to the instant, whatever rounding says of a whole number of periods
            let looked = if every > 0.0 { ((now / every + 1e-6).floor() * every).min(now) } else { now };
            gain * (1.0 - sag * now) * servo.at(looked)
        };
        let (mut turned, mut before) = (commanded(0), commanded(0));
        let (mut lagged, mut played) = (turned, turned);
        let mut jerked = Jerk { angle: turned, rate: 0.0 };
        let count = (end_s / PATH_STEP_S).ceil() as usize + 2;
        let mut value: Vec<f64> = (0..count)
            .map(|k| {
                let commanded = if every > 0.0 { jerked.towards(commanded(k)) } else { commanded(k) };
                turned += (commanded - turned).clamp(-rate * PATH_STEP_S, rate * PATH_STEP_S);
                lagged = keep * lagged + (1.0 - keep - lead) * before + lead * turned;
                before = turned;
                played = played.clamp(lagged - play, lagged + play);
                played + zero
            })
            .collect();
        if delay > 0.0 {
            let prompt = Self { value };
            value = (0..count).map(|k| prompt.at(k as f64 * PATH_STEP_S - delay)).collect();
        }
        Self { value }
    }

    /// What the drive gets at `time_s`.
    pub fn at(&self, time_s: f64) -> f64 {
        let place = (time_s / PATH_STEP_S).clamp(0.0, (self.value.len() - 1) as f64);
        let before = place.floor() as usize;
        let after = (before + 1).min(self.value.len() - 1);
        self.value[before] + (place - before as f64) * (self.value[after] - self.value[before])
    }
}

/// A drive that follows exactly, on a cubic spline that rounds corners over two knots.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    knots: Vec<f64>,
    start_s: f64,
    spacing_s: f64,
}

impl Followed {
    pub(super) fn new(path: &Path, start_s: f64, end_s: f64, spacing_s: f64) -> Self {
        let count = ((end_s - start_s) / spacing_s).ceil() as usize + 4;
        let knots = (0..count).map(|k| path.at(start_s + (k as f64 - 1.0) * spacing_s)).collect();
        Self { knots, start_s, spacing_s }
    }

    /// Angle, rate and acceleration at `time_s`.
    pub(super) fn at(&self, time_s: f64) -> [f64; 3] {
        let place = ((time_s - self.start_s) / self.spacing_s).max(0.0);
        let first = (place.floor() as usize).min(self.knots.len() - 4);
        let (s, h) = (place - first as f64, self.spacing_s);
        let k: [f64; 4] = std::array::from_fn(|i| self.knots[first + i]);
        let r = 1.0 - s;
        let angle = (k[0] * r * r * r
            + k[1] * (3.0 * s * s * s - 6.0 * s * s + 4.0)
            + k[2] * (3.0 * r * r * r - 6.0 * r * r + 4.0)
            + k[3] * s * s * s)
            / 6.0;
        let slope = |i: usize| (k[i + 1] - k[i]) / h;
        let rate = 0.5 * (slope(0) * r * r + slope(1) * (1.0 + 2.0 * s * r) + slope(2) * s * s);
        let bend = |i: usize| (slope(i + 1) - slope(i)) / h;
        [angle, rate, bend(0) * r + bend(1) * s]
    }
}
