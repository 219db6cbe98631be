//! Commands in messages, which can be typed as they stand from any folder of this computer.

use std::path::{Path, PathBuf};

/// `path` from the root on, as one word of a shell.
pub fn word(path: &Path) -> String {
    let whole = std::path::absolute(path).unwrap_or_else(|_| PathBuf::from(path));
    let text = whole.display().to_string();
    let is_plain = |letter: char| letter.is_alphanumeric() || "/._-+:@,=".contains(letter);
    match text.chars().all(is_plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// The command that runs the config at `config`.
pub fn run(config: &Path) -> String {
    format!("rig run {}", word(config))
}

/// The command that plans the next runs after the run in the folder `run`, of the rig at `config`.
pub fn design(run: &Path, config: &Path) -> String {
    format!("rig design {} --config {} --out next", word(run), word(config))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_whole_and_one_word_whatever_they_are_called() {
        assert_eq!(word(Path::new("/tank/rig-1.toml")), "/tank/rig-1.toml");
        assert_eq!(word(Path::new("/my tank/o'clock")), "'/my tank/o'\\''clock'");
        assert!(word(Path::new("rig.toml")).starts_with('/'));
    }
}
