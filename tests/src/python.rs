//! Other people's code in Python, which some tests hold ours against.

use std::path::PathBuf;
use std::process::Command;

/// What `scripts/python-tools` installs.
const TOOLS: &str = include_str!("../python-tools.txt");

/// The Python that `RIG_PYTHON` names, where it has all these modules; else `None`, with a printed line that says what is skipped, unless
/// `RIG_PYTHON_TESTS` says that nothing may be of what `scripts/python-tools` installs.
pub fn python(skipped: &str, modules: &[&str]) -> Option<PathBuf> {
    let python = std::env::var_os("RIG_PYTHON").map(PathBuf::from);
    let import = format!("import {}", modules.join(", "));
    let has = |python: &PathBuf| {
        Command::new(python).args(["-c", &import]).output().is_ok_and(|output| output.status.success())
    };
    let found = python.filter(has);
    if found.is_none() {
        let why = format!("RIG_PYTHON names no Python with {}", modules.join(", "));
        let is_tool = |module: &&str| TOOLS.contains(&module.replace('_', "-"));
        let may_skip = std::env::var_os("RIG_PYTHON_TESTS").is_none() || !modules.iter().all(is_tool);
        assert!(may_skip, "{skipped}: {why}");
        eprintln!("skipped: {skipped} ({why}; `scripts/python-tools` makes one, with `--package` ours too)");
    }
    found
}
