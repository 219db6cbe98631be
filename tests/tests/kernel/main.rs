//! `rig` on cameras and serial ports that a kernel's own drivers provide, pulled and plugged in the middle of runs.
//!
//! All of it runs in the guest that `scripts/kernel-test` boots, as root and one test at a time: vivid is a camera with faults on
//! demand, v4l2loopback one that shows the mock rig's tank, and a CDC-ACM gadget on dummy_hcd the serial port, with `rig mock-board` behind
//! it, whose pulses move the tank. The Uno's firmware is behind it in the emulator of its chip where nothing else is to be done: the guest's
//! processor, emulated itself, is too slow for a board that answers within the 3 ms that a run's clock wants.

mod bench;
mod experiment;
mod feeder;
mod gadget;
mod unplugged;
mod vivid;
