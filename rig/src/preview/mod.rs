//! What the rig's camera sees, live on a page of this machine: to set up focus, light and the places that a config needs.
//!
//! - `watch`: two threads, one that takes the camera's images and never waits for anybody, one that measures and draws;
//! - `measures`, `flicker`: what a picture, and what a stretch of them, says of focus and light;
//! - `server`: the page's HTTP, on the loopback alone; `edit`: places clicked, written into the config.

mod edit;
pub mod flicker;
pub mod measures;
mod server;
mod watch;

pub use edit::{Places, PlacesError};
pub use server::{PreviewError, Server};
pub use watch::Watch;
