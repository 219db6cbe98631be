//! Servo board on a Raspberry Pi Pico (RP2040): the crate's own board on this chip's timer, PWM and USB.
//!
//! The tick is the chip's 1 µs timer. Each pair of servos is a PWM slice that counts microseconds to 20 ms; its compare
//! values are taken over when it wraps, so that an update cannot cut a pulse short. Pins: `README.md`.

#![no_std]
#![no_main]

mod pins;
mod queue;

use embedded_hal::digital::PinState;
use firmware_protocol::board::{Board, BoardConfig, Hardware};
use firmware_protocol::channel::ChannelKind;
use firmware_protocol::event::Fault;
use firmware_protocol::sync_led;
use firmware_protocol::units::{Channel, Name, PulseWidthUs, Ticks};
use rp2040_hal as hal;

use hal::fugit::ExtU32;
use hal::pac;
use pins::Pins;
use queue::Queue;
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{StringDescriptors, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::SerialPort;

/// Second stage of the chip's bootloader, for the Pico's flash.
#[unsafe(link_section = ".boot2")]
#[used]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

const CRYSTAL_HZ: u32 = 12_000_000;
const FIRMWARE: &str = "rig pico 1";
const CHANNELS: u8 = 8;
const SEGMENTS: usize = 1024;
/// For tests and prototypes (pid.codes).
const USB_ID: UsbVidPid = UsbVidPid(0x1209, 0x0001);
const WATCHDOG_MS: u32 = 500;

/// Nothing can be told any more: the watchdog resets the chip, and its pins let go.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    loop {
        cortex_m::asm::nop();
    }
}

/// What the board's state machine moves.
struct Port {
    pins: Pins,
    to_send: Queue,
}

impl Hardware for Port {
    fn pulse(&mut self, channel: Channel, pulse: Option<PulseWidthUs>, _at: Ticks) {
        self.pins.set_servo(channel, pulse.map_or(0, |pulse| pulse.0));
    }

    fn send(&mut self, bytes: &[u8]) {
        self.to_send.put_whole(bytes);
    }
}

/// A number that differs after each start: bits of an oscillator's noise, eight folded into one.
fn boot_id(oscillator: &hal::rosc::RingOscillator<hal::rosc::Enabled>) -> u32 {
    (0..32).fold(0, |id, _| {
        let bit = (0..8).fold(false, |bit, _| {
            // Neighbouring bits are alike when they are read too soon.
            cortex_m::asm::delay(100);
            bit ^ oscillator.get_random_bit()
        });
        id << 1 | u32::from(bit)
    })
}

/// The levels of magnet and lamp: held below the middle of a release's limits, lit from the middle of a lamp's on.
fn levels(board: &Board<SEGMENTS>) -> (PinState, PinState) {
    let (mut hold, mut lamp) = (false, false);
    for channel in (0..CHANNELS).map(Channel) {
        let (Some(config), Some(pulse)) = (board.channel(channel), board.pulse(channel)) else { continue };
        let high = pulse.0 >= config.min_pulse.0 + (config.max_pulse.0 - config.min_pulse.0) / 2;
        match config.kind {
            ChannelKind::Servo => {}
            ChannelKind::Release => hold |= !high,
            ChannelKind::SyncLed => lamp |= high,
        }
    }
    (hold.into(), lamp.into())
}

#[hal::entry]
fn main() -> ! {
    // The only call, and no one else has them.
    let mut chip = pac::Peripherals::take().expect("the peripherals");
    let by_watchdog = chip.WATCHDOG.reason().read().timer().bit_is_set();
    let mut watchdog = hal::Watchdog::new(chip.WATCHDOG);
    let oscillator = hal::rosc::RingOscillator::new(chip.ROSC).initialize();
    let Ok(clocks) = hal::clocks::init_clocks_and_plls(
        CRYSTAL_HZ,
        chip.XOSC,
        chip.CLOCKS,
        chip.PLL_SYS,
        chip.PLL_USB,
        &mut chip.RESETS,
        &mut watchdog,
    ) else {
        panic!("the clocks do not start");
    };
    watchdog.start(WATCHDOG_MS.millis());

    let timer = hal::Timer::new(chip.TIMER, &mut chip.RESETS, &clocks);
    let sio = hal::Sio::new(chip.SIO);
    let gpio = hal::gpio::Pins::new(chip.IO_BANK0, chip.PADS_BANK0, sio.gpio_bank0, &mut chip.RESETS);
    let pwm = hal::pwm::Slices::new(chip.PWM, &mut chip.RESETS);
    let mut port = Port { pins: Pins::new(gpio, pwm), to_send: Queue::new() };

    let usb = UsbBusAllocator::new(hal::usb::UsbBus::new(
        chip.USBCTRL_REGS,
        chip.USBCTRL_DPRAM,
        clocks.usb_clock,
        true,
        &mut chip.RESETS,
    ));
    let mut serial = SerialPort::new(&usb);
    let mut device = UsbDeviceBuilder::new(&usb, USB_ID)
        .strings(&[StringDescriptors::default().product(FIRMWARE)])
        .expect("one language")
        .device_class(usbd_serial::USB_CLASS_CDC)
        .build();

    let config = BoardConfig {
        boot_id: boot_id(&oscillator),
        channels: CHANNELS,
        firmware: Name::new(FIRMWARE).expect("a short name"),
        fault: if by_watchdog { Fault::Watchdog } else { Fault::None },
    };
    let now = || Ticks(timer.get_counter_low());
    let mut board = Board::<SEGMENTS>::new(config, now());
    board.greet(&mut port);
    loop {
        let mut bytes = [0; 64];
        if device.poll(&mut [&mut serial])
            && let Ok(count) = serial.read(&mut bytes)
        {
            board.receive(&bytes[..count], now(), &mut port);
        }
        board.advance(now(), &mut port);
        let (hold, lamp) = levels(&board);
        port.pins.set_levels(hold, lamp, sync_led::lit(now()).into());
        if let Ok(count) = serial.write(port.to_send.next_bytes()) {
            port.to_send.drop_first(count);
        }
        let _ = serial.flush();
        watchdog.feed();
    }
}
