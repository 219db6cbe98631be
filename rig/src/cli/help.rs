//! `rig --help`: the verbs by what one is doing.

use std::fmt::Write as _;

use clap::builder::StyledStr;
use clap::{Command, Subcommand as _};

use super::verb::Verb;

/// What one is doing, and the verbs that do it. Each verb that is shown stands in one of them.
const GROUPS: [(&str, &[&str]); 5] = [
    (
        "Set up a rig",
        &["new", "list", "doctor", "preview", "calibrate", "jog", "firmware", "mock-board", "mock-camera"],
    ),
    ("Run it", &["run", "status", "estop", "release"]),
    ("Look at what was recorded", &["runs", "extract", "replay", "export", "import"]),
    ("Understand it", &["experiment", "fit", "diagnose", "design", "simulate", "recalibrate", "study"]),
    ("Automate it", &["campaign", "daemon", "jobs", "task"]),
];

/// What stands between the usage and the options, as clap's template wants it.
pub(super) fn template() -> StyledStr {
    let verbs = Verb::augment_subcommands(Command::new("rig"));
    let width = GROUPS.iter().flat_map(|(_, names)| *names).map(|name| name.len()).max().unwrap_or_default();
    let styles = verbs.get_styles();
    let (header, literal) = (*styles.get_header(), *styles.get_literal());
    let mut text = String::from("{about}\n\n{usage-heading} {usage}\n");
    for (doing, names) in GROUPS {
        let _ = writeln!(text, "\n{header}{doing}:{header:#}");
        for name in names {
            let about = verbs.find_subcommand(name).and_then(Command::get_about);
            let about = about.map_or_else(String::new, ToString::to_string);
            let _ = writeln!(text, "  {literal}{name:<width$}{literal:#}  {about}");
        }
    }
    let _ = write!(
        text,
        "\n{header}Options:{header:#}\n{{options}}\n\n`rig help VERB` says more of each; the first minutes: \
         rig new DIR, rig doctor DIR/rig.toml, rig run DIR/rig.toml"
    );
    text.into()
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::super::Cli;
    use super::*;

    #[test]
    fn every_verb_that_is_shown_stands_in_one_group() {
        let command = Cli::command();
        let mut shown: Vec<&str> =
            command.get_subcommands().filter(|verb| !verb.is_hide_set()).map(Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        shown.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(shown, grouped);
        let help = Cli::command().render_help().to_string();
        for (name, about) in [("fit", "Fit a model's parameters"), ("estop", "Stop the servo now")] {
            let line = help.lines().find(|line| line.trim_start().starts_with(name));
            assert!(line.is_some_and(|line| line.contains(about)), "{help}");
        }
        assert!(help.contains("--json") && help.contains("Set up a rig:"), "{help}");
    }
}
