//! The servo of a config that cannot be read whole: a stop is not refused for a word that is wrong elsewhere.

use std::path::Path;

use toml::Table;

use servo::ServoConfig;

/// What says where the servo is, and how it is spoken to.
const KEYS: [&str; 3] = ["kind", "port", "baud"];

/// The servo board that the config at `path` names, as far as anything can be made of it: its `[servo]` tables by themselves, or else
/// the lines of `[servo]` that say where it is. None where nothing of it can be read.
pub fn servo(path: &Path) -> Option<ServoConfig> {
    let bytes = std::fs::read(path).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let (own, tables) = tables(&text);
    config(&format!("{own}{tables}")).or_else(|| config(&own)).or_else(|| {
        let is_line = |line: &&str| {
            let said = line.parse::<Table>();
            said.is_ok_and(|said| said.keys().all(|key| KEYS.contains(&key.as_str())))
        };
        config(&own.lines().filter(is_line).collect::<Vec<_>>().join("\n"))
    })
}

fn config(own: &str) -> Option<ServoConfig> {
    toml::from_str(own).ok()
}

/// The lines of the table `[servo]`, and those of the tables within it as they are seen from there.
fn tables(text: &str) -> (String, String) {
    let (mut own, mut within) = (String::new(), String::new());
    let mut into = None;
    for line in text.lines() {
        let header = line.trim_start();
        if header.starts_with('[') {
            let name = header.trim_start_matches('[').trim_start();
            into = match name.strip_prefix("servo").map(str::trim_start) {
                Some(rest) if rest.starts_with(']') => Some(&mut own),
                Some(rest) if rest.starts_with('.') => {
                    within.push_str(&line.replacen("servo", "", 1).replacen('.', "", 1));
                    within.push('\n');
                    Some(&mut within)
                }
                _ => None,
            };
        } else if let Some(into) = &mut into {
            into.push_str(line);
            into.push('\n');
        }
    }
    (own, within)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Option<ServoConfig> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, text).unwrap();
        servo(&path)
    }

    #[test]
    fn servo_is_found_in_a_config_that_is_wrong_elsewhere_within_it_or_no_toml_at_all() {
        let servo = "[servo]\nkind = \"serial\"\nport = \"/dev/ttyACM0\"\n";
        let channel = "[[servo.channel]]\nid = 0\nname = \"pin 9\"\n";
        for text in [
            format!("[run]\nname = \"x\nnot toml at all {{\n{servo}[camera]\nfps = =\n"),
            format!("{servo}dead_man_ms = \"soon\"\n{channel}"),
            format!("{servo}colour = \"red\"\nbaud = 9600\n{channel}no toml\n[profile]\nport = \"no\""),
        ] {
            let found = of(&text).unwrap_or_else(|| panic!("none in {text}"));
            assert_eq!(found.outside_port(), Some("/dev/ttyACM0"), "{text}");
        }
        assert!(of("[camera]\nport = \"/dev/ttyACM0\"").is_none());
        assert!(of("\u{0}[servo]").is_none());
    }
}
