//! Extraction and import of films, real ones among them.

#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a test stops where it cannot go on, makes its files and shows its figures"
)]

mod extract;
mod import;
mod sam2;
mod vision;
mod worm;
