//! One experiment from still water to a recorded run: the state machine, the device threads it talks to, and the
//! one safe stop that every way out passes.

pub mod config;
pub mod machine;
pub mod stillness;
