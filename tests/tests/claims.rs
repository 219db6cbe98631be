//! `docs/claims.md`: no claim without a command that can be typed, a figure, a date, and the words of its page.

use system_tests::book::checks::{refused_arguments, wrong_for_cargo};
use system_tests::repository;

/// A row of the ledger.
#[derive(Debug, PartialEq)]
struct Claim<'a> {
    claim: &'a str,
    page: &'a str,
    words: &'a str,
    figure: &'a str,
    command: &'a str,
    date: &'a str,
}

/// The rows of the first table of `ledger`.
fn claims(ledger: &str) -> Result<Vec<Claim<'_>>, String> {
    let rows = ledger.lines().skip_while(|line| !line.starts_with("| ---")).skip(1);
    rows.take_while(|line| line.starts_with('|'))
        .map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
            let [claim, page, words, figure, command, date] = cells[..] else {
                return Err(format!("six columns are wanted: {line}"));
            };
            let page = page.rsplit_once('(').map_or("", |(_, page)| page.trim_end_matches(')'));
            Ok(Claim { claim, page, words, figure, command: command.trim_matches('`'), date })
        })
        .collect()
}

/// Words of a page without its marks: a table's columns and line breaks count as spaces.
fn plain(text: &str) -> String {
    text.replace(['|', '/'], " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What is wrong with a claim.
fn wrong(claim: &Claim<'_>) -> Option<String> {
    let words: Vec<String> = claim.command.split_whitespace().map(str::to_owned).collect();
    let typed = match words.split_first() {
        None => Some("it has no command".into()),
        Some((program, arguments)) => match program.as_str() {
            "cargo" => wrong_for_cargo(arguments),
            "rig" => refused_arguments(arguments),
            script => (!repository().join(script).exists()).then(|| format!("there is no {script}")),
        },
    };
    let date_digits = claim.date.split('-').map(str::len).collect::<Vec<_>>();
    let page = std::fs::read_to_string(repository().join("docs").join(claim.page));
    typed
        .or_else(|| claim.figure.is_empty().then(|| "it has no figure".into()))
        .or_else(|| (date_digits != [4, 2, 2]).then(|| format!("`{}` is no date", claim.date)))
        .or_else(|| match page {
            Err(error) => Some(format!("page {}: {error}", claim.page)),
            Ok(page) if claim.words.is_empty() || !plain(&page).contains(&plain(claim.words)) => {
                Some(format!("{} does not say `{}`", claim.page, claim.words))
            }
            Ok(_) => None,
        })
}

#[test]
fn every_claim_has_a_command_a_figure_a_date_and_the_words_of_its_page() {
    let ledger = std::fs::read_to_string(repository().join("docs/claims.md")).expect("the ledger");
    let claims = claims(&ledger).expect("a table");
    assert!(claims.len() >= 15, "{}", claims.len());
    let wrongs: Vec<String> =
        claims.iter().filter_map(|claim| Some(format!("{}: {}", claim.claim, wrong(claim)?))).collect();
    assert!(wrongs.is_empty(), "{}", wrongs.join("\n"));
}

#[test]
fn claims_that_lack_something_are_refused() {
    let good = "| --- |\n| a | [`speed.md`](speed.md) | How fast a rollout is | 3 | `cargo test -p sim --test all` | 2026-11-22 |\n";
    let of = |ledger: &str| claims(ledger).map(|claims| claims.iter().find_map(wrong));
    assert_eq!(of(good), Ok(None));
    for (from, to, why) in [
        ("`cargo test -p sim --test all`", "", "no command"),
        ("--test all", "--test none", "no test none"),
        (" 3 ", "  ", "no figure"),
        ("2026-11-22", "lately", "no date"),
        ("How fast a rollout is", "How slow", "does not say"),
        ("speed.md", "sped.md", "page sped.md"),
    ] {
        let said = of(&good.replace(from, to)).expect("six columns").expect("refused");
        assert!(said.contains(why), "{said}");
    }
    assert!(of("| --- |\n| a | b |\n").is_err());
}
