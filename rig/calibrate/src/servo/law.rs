//! How a servo turns, in numbers: what quick steps are laid on.

/// A servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Law {
    /// Time constant \[s\], above 0.
    pub(super) lag_s: f64,
    /// Fastest turn \[rad/s\].
    pub(super) rate: f64,
    /// From the command to the picture, beside the lag \[s\].
    pub(super) delay_s: f64,
    /// From one look at the command to the next, and how much of it after time 0 the first one is; none: it looks all the time.
    pub(super) looks: Option<[f64; 2]>,
    /// Half of the zone in which nothing moves: of its own dead band, and of the play behind it \[rad\].
    pub(super) half_zone: [f64; 2],
}

/// A servo that looks all the time looks this often \[s\].
const ALL_THE_TIME_S: f64 = 1e-3;

impl Law {
    /// Where it is at rising `time_s` from what it is told, `told` at a time, having stood before.
    pub(super) fn follow(&self, told: impl Fn(f64) -> f64, time_s: &[f64]) -> Vec<f64> {
        let [period_s, phase] = self.looks.unwrap_or([ALL_THE_TIME_S, 0.0]);
        let look_s = |number: f64| (number + phase) * period_s;
        // what is told all the time changes evenly between two looks
        let seen_s = if self.looks.is_none() { 0.5 * period_s } else { 0.0 };
        let Some(&first) = time_s.first() else { return Vec::new() };
        let mut number = ((first - self.delay_s) / period_s - phase).floor() - 1.0;
        let mut goal = told(look_s(number) + seen_s);
        let (mut at, mut now_s) = (goal, look_s(number));
        let [dead, play] = self.half_zone;
        let mut output = at;
        let mut angles = Vec::with_capacity(time_s.len());
        for &asked_s in time_s {
            let until_s = asked_s - self.delay_s;
            while look_s(number + 1.0) <= until_s {
                at = self.turned(at, goal, look_s(number + 1.0) - now_s);
                // between two looks it turns one way only
                output = output.clamp(at - play, at + play);
                number += 1.0;
                now_s = look_s(number);
                let told = told(now_s + seen_s);
                goal = goal.clamp(told - dead, told + dead);
            }
            let turned = self.turned(at, goal, until_s - now_s);
            angles.push(output.clamp(turned - play, turned + play));
        }
        angles
    }

    /// Where it is after `dt_s` from `at` on its way to `goal`: as fast as it can while that is slower than its lag would have it, then
    /// as its lag has it.
    fn turned(&self, at: f64, goal: f64, dt_s: f64) -> f64 {
        let gap = goal - at;
        let near = self.rate * self.lag_s;
        let racing_s = ((gap.abs() - near) / self.rate).clamp(0.0, dt_s);
        let left = gap.abs() - racing_s * self.rate;
        goal - gap.signum() * left * (-(dt_s - racing_s) / self.lag_s).exp()
    }
}
