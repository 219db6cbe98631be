//! A rig of one's own: what somebody answers about a chain of rigid links, its board and its camera, made into a model and a config.
//!
//! - `answers`: what can be answered; `chain`: the rig that these answers make, defaults filled in and contradictions refused;
//! - `mjcf`: the chain as a model; `config`: the rig's config, and for a mock rig its tank.
//!
//! Nothing here asks, and nothing here writes files: the command line does.

mod answers;
mod chain;
mod config;
mod mjcf;

pub use answers::{Answers, Shape, YOUR_BOARD, YOUR_CAMERA};
pub use chain::{Chain, Drive, Link, Picture, Refusal, Scale};

/// One file to write into the rig's folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Its name.
    pub name: &'static str,
    /// Its text.
    pub text: String,
}

/// Name of the config.
pub const CONFIG: &str = "rig.toml";
/// Name of the model that a fit starts from.
pub const MODEL: &str = "model.xml";
/// Name of the mock rig's tank.
pub const TANK: &str = "tank.toml";
/// Name of the model of what that tank really is.
pub const TRUTH: &str = "tank.xml";

/// The files of the rig `name`.
pub fn files(name: &str, chain: &Chain) -> Vec<File> {
    let mut files = vec![
        File { name: CONFIG, text: config::rig(name, chain) },
        File { name: MODEL, text: mjcf::model(name, chain, mjcf::Which::Start) },
    ];
    if chain.drive == Drive::Mock {
        files.push(File { name: TANK, text: config::tank(chain) });
        files.push(File { name: TRUTH, text: mjcf::model(name, chain, mjcf::Which::Truth) });
    }
    files
}

/// A number for people: six digits, without those that only rounding made.
fn tidy(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    format!("{rounded:?}")
}

#[cfg(test)]
mod tests;
