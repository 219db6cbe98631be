//! `rig` on cameras and serial ports that a kernel's own drivers provide, pulled and plugged in the middle of runs.
//!
//! All of it runs in the guest that `scripts/kernel-test` boots, as root and one test at a time: vivid is a camera with faults on
//! demand, v4l2loopback one that shows the mock rig's tank, and a CDC-ACM gadget on dummy_hcd the serial port. Behind it, and moving the
//! tank by what it does at its pins, is the Uno's firmware in the emulator of its chip where a whole experiment or an unplugged board is
//! looked at, else `rig mock-board`. The guest's processor, emulated itself, has just enough time for the chip: hence chip and line come
//! first there, as hardware of their own would, and answers to a ping take 4.3 ms, 2.4 of them on the wire.

mod bench;
mod experiment;
mod feeder;
mod gadget;
mod unplugged;
mod vivid;
