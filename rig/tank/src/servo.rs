//! The simulated hobby servo of the tank.

use super::causes::Linkage;
use super::config::TankServo;

/// The state of one servo: the angle of its output while it has a pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Servo {
    /// Its angles \[rad\]; `None` without a pulse, when it is limp.
    powered: Option<Powered>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Powered {
    /// Angle of the gear before the backlash.
    angle_rad: f64,
    target_rad: f64,
    /// Angle of the output, behind the backlash.
    output_rad: f64,
}

impl Servo {
    pub(super) const LIMP: Self = Self { powered: None };

    /// The angle it holds its link at \[rad\]; none while limp.
    pub(super) fn angle_rad(self) -> Option<f64> {
        self.powered.map(|powered| powered.output_rad)
    }

    /// Takes up its commanded angle \[rad\], or that there is none, at a period's start. A servo that gets its first pulse starts at the
    /// link's angle.
    pub(super) fn latch(&mut self, linkage: &Linkage, command_rad: Option<f64>, link_rad: f64) {
        self.powered = command_rad.map(|command_rad| {
            let target_rad = command_rad * linkage.gain;
            let found = Powered { angle_rad: link_rad, target_rad, output_rad: link_rad };
            Powered { target_rad, ..self.powered.unwrap_or(found) }
        });
    }

    /// Turns for `dt_s`: first order towards the target, no faster than the rate limit; then through the play.
    pub(super) fn turn(&mut self, servo: &TankServo, linkage: &Linkage, dt_s: f64) {
        if let Some(powered) = &mut self.powered {
            let gap = powered.target_rad - powered.angle_rad;
            let lag_s = servo.lag_s.get() + linkage.lag_s;
            let wanted = if lag_s > 0.0 { gap * -(-dt_s / lag_s).exp_m1() } else { gap };
            let most = servo.rate_limit_rad_per_s.get().min(linkage.rate_limit) * dt_s;
            powered.angle_rad += wanted.clamp(-most, most);
            let play = [powered.angle_rad - linkage.play, powered.angle_rad + linkage.play];
            powered.output_rad = powered.output_rad.clamp(play[0], play[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn config(text: &str) -> TankServo {
        let text = format!("actuator = \"servo\"\nus_per_rad = 500.0\n{text}");
        ground::strict::parse(&text, std::path::Path::new("tank.toml")).unwrap()
    }

    fn none() -> Linkage {
        Linkage::new(&BTreeMap::new())
    }

    fn turned(config: &TankServo, pulse_us: u16, steps: u32) -> f64 {
        turned_through(config, &none(), pulse_us, steps)
    }

    fn turned_through(config: &TankServo, linkage: &Linkage, pulse_us: u16, steps: u32) -> f64 {
        let mut servo = Servo::LIMP;
        servo.latch(linkage, Some(config.pulse_angle_rad(pulse_us)), 0.0);
        for _ in 0..steps {
            servo.turn(config, linkage, 0.001);
        }
        servo.angle_rad().unwrap()
    }

    #[test]
    fn small_step_follows_an_exponential() {
        let config = config("lag_s = 0.02\nrate_limit_rad_per_s = 1000.0");
        let angle = turned(&config, 1600, 20);
        assert!((angle - 0.2 * (1.0 - (-1.0_f64).exp())).abs() < 1e-12, "{angle}");
    }

    #[test]
    fn large_step_turns_at_the_rate_limit() {
        let config = config("lag_s = 0.0\nrate_limit_rad_per_s = 5.0");
        assert!((turned(&config, 2000, 100) - 0.5).abs() < 1e-12);
        assert!((turned(&config, 1000, 100) + 0.5).abs() < 1e-12);
        assert!((turned(&config, 2000, 1000) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn servo_wakes_up_where_its_link_is_and_goes_limp_without_pulse() {
        let config = config("");
        let mut servo = Servo::LIMP;
        servo.turn(&config, &none(), 0.001);
        assert_eq!(servo.angle_rad(), None);
        servo.latch(&none(), Some(config.pulse_angle_rad(1500)), 0.7);
        assert_eq!(servo.angle_rad(), Some(0.7));
        servo.latch(&none(), None, 0.0);
        assert_eq!(servo.angle_rad(), None);
    }

    #[test]
    fn hidden_causes_stretch_slow_and_loosen_the_turn() {
        let config = config("lag_s = 0.0\nrate_limit_rad_per_s = 1000.0");
        let linked = |change: fn(&mut Linkage), steps| {
            let mut linkage = none();
            change(&mut linkage);
            turned_through(&config, &linkage, 1600, steps)
        };
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(linked(|linkage| linkage.gain = 1.1, 1), 0.22));
        assert!(close(linked(|linkage| linkage.rate_limit = 2.0, 50), 0.1));
        assert!(close(linked(|linkage| linkage.lag_s = 0.02, 20), 0.2 * (1.0 - (-1.0_f64).exp())));
        assert!(close(linked(|linkage| linkage.play = 0.05, 1), 0.15));
    }
}
