//! Everything that reads bytes from outside, met with bytes that nobody meant.
//!
//! A target takes any bytes and panics where what it promises does not hold. `cargo test -p fuzz` gives each the files in
//! `corpus/NAME` and some thousand changes of them; `scripts/fuzz NAME` lets libFuzzer look for more, as long as one likes. A new target is
//! a function, a line in [`TARGETS`] and a folder with a file or two.

mod documents;
mod files;
mod line;
mod requests;
mod tables;
mod uno;

/// Something that reads bytes.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, also of its folder in `corpus`.
    pub name: &'static str,
    /// How many changed files a test run gives it: about two seconds of them.
    pub slice: u32,
    /// Reads the bytes: whether it took them for what it reads.
    ///
    /// # Panics
    /// Where what it promises does not hold.
    pub meets: fn(&[u8]) -> bool,
}

/// All there are.
pub const TARGETS: &[Target] = &[
    Target { name: "wire", slice: 20_000, meets: line::wire },
    Target { name: "bus", slice: 100_000, meets: line::bus },
    Target { name: "uno", slice: 40, meets: uno::uno },
    Target { name: "http", slice: 4_000, meets: requests::http },
    Target { name: "image_message", slice: 300_000, meets: files::image_message },
    Target { name: "picture", slice: 3_000, meets: files::picture },
    Target { name: "recording", slice: 200, meets: files::recording },
    Target { name: "journal", slice: 500, meets: files::journal },
    Target { name: "mjcf", slice: 5_000, meets: documents::mjcf },
    Target { name: "mjcf_include", slice: 1_000, meets: documents::mjcf_include },
    Target { name: "config", slice: 2_000, meets: documents::config },
    Target { name: "expression", slice: 2_000, meets: documents::expression },
    Target { name: "experiment", slice: 300, meets: documents::experiment },
    Target { name: "trajectory", slice: 5_000, meets: tables::trajectory },
    Target { name: "servo_table", slice: 5_000, meets: tables::servo },
    Target { name: "dlc", slice: 5_000, meets: tables::dlc },
    Target { name: "sleap", slice: 5_000, meets: tables::sleap },
    Target { name: "wcon", slice: 20_000, meets: tables::wcon },
];

/// The target that is called `name`.
pub fn target(name: &str) -> Option<Target> {
    TARGETS.iter().find(|target| target.name == name).copied()
}

/// All names, for messages.
pub fn names() -> String {
    TARGETS.iter().map(|target| target.name).collect::<Vec<_>>().join(", ")
}

/// Text as most readers of files take it.
fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    String::from_utf8_lossy(bytes)
}
