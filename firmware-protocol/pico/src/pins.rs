//! Which pin does what.

use embedded_hal::digital::{OutputPin, PinState};
use embedded_hal::pwm::SetDutyCycle;
use firmware_protocol::units::Channel;
use rp2040_hal as hal;

use hal::gpio::{FunctionNull, FunctionSioOutput, Pin, PullDown, bank0};
use hal::pwm::{FreeRunning, Pwm1, Pwm2, Pwm3, Pwm4, Slice, Slices};

/// 125 MHz to a count each microsecond.
const DIVIDER: u8 = 125;
/// Counts of a frame, less one: 20 ms.
const TOP: u16 = 19_999;

type Output<Id> = Pin<Id, FunctionSioOutput, PullDown>;

/// Servo channels 0 to 7 are GP2 to GP9, two on each slice.
pub struct Pins {
    first: Slice<Pwm1, FreeRunning>,
    second: Slice<Pwm2, FreeRunning>,
    third: Slice<Pwm3, FreeRunning>,
    fourth: Slice<Pwm4, FreeRunning>,
    hold: Output<bank0::Gpio10>,
    lamp: Output<bank0::Gpio11>,
    sync_led: Output<bank0::Gpio15>,
    sync_led_on_board: Output<bank0::Gpio25>,
}

fn low<Id: hal::gpio::PinId + hal::gpio::ValidFunction<FunctionSioOutput>>(
    pin: Pin<Id, FunctionNull, PullDown>,
) -> Output<Id> {
    pin.into_push_pull_output_in_state(hal::gpio::PinState::Low)
}

macro_rules! begin {
    ($pwm:ident . $slice:ident, $a:expr, $b:expr) => {
        $pwm.$slice.default_config();
        $pwm.$slice.set_div_int(DIVIDER);
        $pwm.$slice.set_top(TOP);
        let _ = $pwm.$slice.channel_a.set_duty_cycle(0);
        let _ = $pwm.$slice.channel_b.set_duty_cycle(0);
        $pwm.$slice.channel_a.output_to($a);
        $pwm.$slice.channel_b.output_to($b);
    };
}

impl Pins {
    /// Every pin low, no pulses, frames running.
    pub fn new(gpio: hal::gpio::Pins, mut pwm: Slices) -> Self {
        begin!(pwm.pwm1, gpio.gpio2, gpio.gpio3);
        begin!(pwm.pwm2, gpio.gpio4, gpio.gpio5);
        begin!(pwm.pwm3, gpio.gpio6, gpio.gpio7);
        begin!(pwm.pwm4, gpio.gpio8, gpio.gpio9);
        pwm.enable_simultaneous(0b0001_1110);
        Self {
            first: pwm.pwm1,
            second: pwm.pwm2,
            third: pwm.pwm3,
            fourth: pwm.pwm4,
            hold: low(gpio.gpio10),
            lamp: low(gpio.gpio11),
            sync_led: low(gpio.gpio15),
            sync_led_on_board: low(gpio.gpio25),
        }
    }

    /// From the next frame on; 0: no pulse. One longer than a frame is a frame's.
    pub fn set_servo(&mut self, channel: Channel, pulse_us: u16) {
        let pulse = pulse_us.min(TOP);
        // A duty up to the top is never refused.
        let _ = match channel.0 {
            0 => self.first.channel_a.set_duty_cycle(pulse),
            1 => self.first.channel_b.set_duty_cycle(pulse),
            2 => self.second.channel_a.set_duty_cycle(pulse),
            3 => self.second.channel_b.set_duty_cycle(pulse),
            4 => self.third.channel_a.set_duty_cycle(pulse),
            5 => self.third.channel_b.set_duty_cycle(pulse),
            6 => self.fourth.channel_a.set_duty_cycle(pulse),
            7 => self.fourth.channel_b.set_duty_cycle(pulse),
            _ => Ok(()),
        };
    }

    /// Magnet, lamp, sync LED.
    pub fn set_levels(&mut self, hold: PinState, lamp: PinState, sync_led: PinState) {
        let Ok(()) = self.hold.set_state(hold);
        let Ok(()) = self.lamp.set_state(lamp);
        let Ok(()) = self.sync_led.set_state(sync_led);
        let Ok(()) = self.sync_led_on_board.set_state(sync_led);
    }
}
