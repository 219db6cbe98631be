//! Ordinary faults, each kind on several mechanisms, through `rig diagnose`:
//! `cargo run -p system-tests --example ordinary_faults -- OUT [--first 5000] [--mechanisms 10] [--only TEXT] [--threads 2] [--keep]`
//!
//! Every finished case is a line of `OUT/judged.jsonl`; started again, it goes on where it stopped. `--only` takes the kinds whose
//! words contain a text. Build the program first: `cargo build -p rig`.

use std::io::Write as _;
use std::path::PathBuf;

use rayon::prelude::*;
use system_tests::journal::Journal;
use system_tests::ordinary::faults::Kind;
use system_tests::ordinary::judge::{Judged, diagnose, number, table};

struct Options {
    out: PathBuf,
    first: u64,
    mechanisms: u64,
    only: Vec<String>,
    threads: usize,
    keep: bool,
}

impl Options {
    fn read() -> Result<Self, Box<dyn std::error::Error>> {
        let mut options = Self {
            out: PathBuf::new(),
            first: 5000,
            mechanisms: 10,
            only: Vec::new(),
            threads: 2,
            keep: false,
        };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} wants a value"));
            match word.as_str() {
                "--first" => options.first = value()?.parse()?,
                "--mechanisms" => options.mechanisms = value()?.parse()?,
                "--only" => options.only.push(value()?),
                "--threads" => options.threads = value()?.parse()?,
                "--keep" => options.keep = true,
                _ if options.out.as_os_str().is_empty() && !word.starts_with('-') => {
                    options.out = word.into()
                }
                _ => return Err(format!("unknown argument `{word}`").into()),
            }
        }
        if options.out.as_os_str().is_empty() {
            return Err("name a folder for the outcomes".into());
        }
        Ok(options)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let options = Options::read()?;
    std::fs::create_dir_all(&options.out)?;
    let (journal, mut list) = Journal::<Judged>::open(&options.out.join("judged.jsonl"))?;
    let seeds = options.first..options.first + options.mechanisms;
    let is_wanted = |kind: &Kind| {
        options.only.is_empty() || options.only.iter().any(|text| kind.words().contains(text.as_str()))
    };
    let all = seeds.flat_map(|seed| Kind::ALL.into_iter().map(move |kind| (kind, seed)));
    let open: Vec<(Kind, u64)> = all
        .filter(|(kind, seed)| {
            let id = format!("case-{:06}", number(*kind, *seed));
            is_wanted(kind) && list.iter().all(|judged| judged.outcome.id != id)
        })
        .collect();
    eprintln!("{} cases to do, {} done before", open.len(), list.len());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    pool.install(|| {
        open.into_par_iter().with_max_len(1).for_each(|(kind, seed)| {
            let judged = diagnose(kind, seed, &options.out);
            if !options.keep {
                let _ = std::fs::remove_dir_all(options.out.join(&judged.outcome.id));
            }
            eprintln!("{}", judged.line());
            journal.add(judged);
        });
    });
    list.extend(journal.added());
    let table = table(&list);
    std::fs::write(options.out.join("table.md"), &table)?;
    std::io::stdout().write_all(table.as_bytes())?;
    Ok(())
}
