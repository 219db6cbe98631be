//! The page that lists the causes.

use super::*;
use crate::causes::{AliasWhen, CauseValues, Per};

/// The list of docs/causes.md.
fn listed() -> String {
    let mut page = String::new();
    for cause in Cause::ALL {
        let info = cause.info();
        page += &format!("### `{}`\n\n{}. {}.\n\n", info.name, capital(info.sentence), info.formula);
        page += &format!("Source: {}.\n\nTo check: {}.\n\n", info.source, info.check);
        page += "| parameter | unit | bounds | neutral | part | meaning |\n| --- | --- | --- | --- | --- | --- |\n";
        for parameter in info.parameters {
            let own = match parameter.per {
                Per::Model => parameter.name.to_owned(),
                Per::Held => "<joint>".to_owned(),
                per => format!("<{}>", format!("{per:?}").to_lowercase()),
            };
            let part = match parameter.role {
                Role::Size if parameter.per_run => "size, each run its own",
                Role::Size => "size",
                Role::Switch => "switch",
                Role::Hidden(_) => "hidden, tried on a grid",
                Role::Choice(_) => "choice",
                Role::Detail => "detail",
            };
            let idle = parameter
                .idle_where
                .map_or(String::new(), |(choice, value)| format!("; idle where `{choice}` is {value}"));
            let differs = if parameter.may_differ { "; may differ from run to run" } else { "" };
            let [low, high] = parameter.bounds;
            page += &format!(
                "| `{}/{own}` | {} | {low}..{high} | {} | {part} | {}{idle}{differs} |\n",
                info.name, parameter.unit, parameter.neutral, parameter.meaning
            );
        }
        for alias in info.aliases {
            let when = match alias.when {
                AliasWhen::UnlessWeighed => "unless both weights carry a prior",
                AliasWhen::NoReleaseStated => "where no drop states its release and no encoder reads a hinge",
            };
            page += &format!("\nNo video tells it from `{}` {when}.\n", alias.name);
        }
        let held = match info.mjcf {
            Some(mjcf) if (mjcf.exact)(&CauseValues::neutral(*cause, &chain("active"))) => {
                format!("MJCF holds it: {}.", mjcf.how)
            }
            Some(mjcf) => format!("MJCF holds it in a slightly other form: {}.", mjcf.how),
            None => "MJCF cannot hold it.".into(),
        };
        page += &format!("\n{held}\n\n");
    }
    page
}

fn capital(sentence: &str) -> String {
    let (first, rest) = sentence.split_at(1);
    first.to_uppercase() + rest
}

#[test]
fn the_page_of_causes_lists_what_the_causes_say() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/causes.md")).unwrap();
    let (_, list) = page.split_once("## The causes\n\n").unwrap();
    let ours = listed();
    // the page is made by copying this
    assert!(list.trim() == ours.trim(), "{ours}");
}
