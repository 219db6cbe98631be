//! A model of how a servo follows its command; it is fitted to the film.

/// Parameters of the servo model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Law {
    /// Time constant \[s\], above 0.
    pub(super) lag_s: f64,
    /// Fastest turn \[rad/s\].
    pub(super) rate: f64,
    /// Delay from the command to the picture, in addition to the lag \[s\].
    pub(super) delay_s: f64,
    /// Refresh period \[s\], and the share of it after time 0 at which the servo first reads its command; none: it reads it continuously.
    pub(super) refresh: Option<[f64; 2]>,
    /// Half of the zone in which nothing moves: of its own dead band, and of the play behind it \[rad\].
    pub(super) half_zone: [f64; 2],
}

/// A servo that reads its command continuously is simulated with this refresh period \[s\] (chosen).
const CONTINUOUS_REFRESH_PERIOD_S: f64 = 1e-3;

impl Law {
    /// Its angle \[rad\] at each of the rising `time_s` for `command`, the commanded angle at a time; at rest before.
    pub(super) fn follow(&self, command: impl Fn(f64) -> f64, time_s: &[f64]) -> Vec<f64> {
        let [period_s, phase] = self.refresh.unwrap_or([CONTINUOUS_REFRESH_PERIOD_S, 0.0]);
        let read_s = |number: f64| (number + phase) * period_s;
        // a command that is read continuously is taken in the middle between two reads
        let ahead_s = if self.refresh.is_none() { 0.5 * period_s } else { 0.0 };
        let Some(&first) = time_s.first() else { return Vec::new() };
        let mut number = ((first - self.delay_s) / period_s - phase).floor() - 1.0;
        let mut goal = command(read_s(number) + ahead_s);
        let (mut at, mut now_s) = (goal, read_s(number));
        let [dead, play] = self.half_zone;
        let mut output = at;
        let mut angles = Vec::with_capacity(time_s.len());
        for &asked_s in time_s {
            let until_s = asked_s - self.delay_s;
            while read_s(number + 1.0) <= until_s {
                at = self.turned(at, goal, read_s(number + 1.0) - now_s);
                // between two reads it turns one way only
                output = output.clamp(at - play, at + play);
                number += 1.0;
                now_s = read_s(number);
                let commanded = command(now_s + ahead_s);
                goal = goal.clamp(commanded - dead, commanded + dead);
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
