//! The whole set of hidden-effect cases, through `rig diagnose`:
//! `cargo run -p system-tests --example hidden_causes -- OUT [--seeds 10] [--times N] [--only TEXT] [--every N] [--threads 2] [--keep]
//! [--images-every 1] [--misread 0] [--pictures] [--arm]`
//!
//! Every finished case is a line of `OUT/outcomes.jsonl`; started again, it goes on where it stopped. The tables stand in
//! `OUT/tables.md` and on standard output. `--only` takes the cases whose names contain a text, `--every` each n-th of them.
//! `--times` hides
//! causes at so many times their limits instead of the usual sizes. `--threads` says how many are under way at once; each has its share of the cores. `--keep` leaves the cases' files, `--make` only
//! writes them. `--images-every` keeps each so many-th of 100 images a second, `--misread` puts a share of the keypoints 20 mm off.
//! `--pictures` draws every image and reads it as `rig extract --self-check` does, instead of putting noise on keypoints; limits are still those
//! of 0.4 mm of noise. `--arm` hides causes in soft arms instead of three rigid links; `--limit-s` says how long a diagnosis may take. Build the program first: `cargo build -p rig`.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use system_tests::hidden::arm::ARM;
use system_tests::hidden::bench::Mechanism;
use system_tests::hidden::cases::{self, Case, SIZES};
use system_tests::hidden::diagnose::{Outcome, diagnose};
use system_tests::hidden::limit::Benches;
use system_tests::hidden::score::tables;
use system_tests::hidden::three_links::THREE_LINKS;
use system_tests::hidden::write::{Film, write};
use system_tests::journal::Journal;

/// What the command line asks for.
struct Options {
    out: PathBuf,
    seeds: u64,
    times: Vec<f64>,
    only: Vec<String>,
    every: usize,
    threads: usize,
    keep: bool,
    make: bool,
    film: Film,
    arm: bool,
}

impl Options {
    fn read() -> Result<Self, Box<dyn std::error::Error>> {
        let mut options = Self {
            out: PathBuf::new(),
            seeds: 10,
            times: Vec::new(),
            only: Vec::new(),
            every: 1,
            threads: 2,
            keep: false,
            make: false,
            film: Film::default(),
            arm: false,
        };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} wants a value"));
            match word.as_str() {
                "--seeds" => options.seeds = value()?.parse()?,
                "--times" => options.times.push(value()?.parse()?),
                "--only" => options.only.push(value()?),
                "--every" => options.every = value()?.parse::<usize>()?.max(1),
                "--threads" => options.threads = value()?.parse()?,
                "--images-every" => options.film.every = value()?.parse::<usize>()?.max(1),
                "--misread" => options.film.misread = value()?.parse()?,
                "--pictures" => options.film.pictures = true,
                "--limit-s" => options.film.limit_s = Some(value()?.parse()?),
                "--arm" => options.arm = true,
                "--keep" => options.keep = true,
                "--make" => options.make = true,
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

    fn sizes(&self) -> &[f64] {
        if self.times.is_empty() { &SIZES } else { &self.times }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let options = Options::read()?;
    std::fs::create_dir_all(&options.out)?;
    match options.arm {
        true => go_through(&options, &ARM),
        false => go_through(&options, &THREE_LINKS),
    }
}

fn go_through<const N: usize>(
    options: &Options,
    mechanism: &'static Mechanism<N>,
) -> Result<(), Box<dyn std::error::Error>> {
    let (journal, mut outcomes) = Journal::<Outcome>::open(&options.out.join("outcomes.jsonl"))?;
    let wanted =
        |case: &Case| options.only.is_empty() || options.only.iter().any(|text| case.id.contains(text));
    let all = cases::all(mechanism.causes, options.seeds, options.sizes());
    let list = all.into_iter().filter(wanted).step_by(options.every);
    let mut list: Vec<Case> =
        list.filter(|case| options.make || outcomes.iter().all(|outcome| outcome.id != case.id)).collect();
    // neighbours in the list share the mechanism that their limits come from
    list.sort_by_key(|case| case.seed);
    eprintln!("{} cases to do, {} done before", list.len(), outcomes.len());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    let seeds: Vec<&[Case]> = list.chunk_by(|a, b| a.seed == b.seed).collect();
    pool.install(|| {
        seeds.into_par_iter().with_max_len(1).for_each(|cases| {
            let mut benches = Benches::of(mechanism);
            for case in cases {
                let folder = options.out.join("cases").join(&case.id);
                if options.make {
                    make(case, &mut benches, options.film, &folder);
                    continue;
                }
                let Some(outcome) = diagnose(case, &mut benches, options.film, &folder) else {
                    eprintln!("{}: these runs never show it", case.id);
                    continue;
                };
                if !options.keep {
                    let _ = std::fs::remove_dir_all(&folder);
                }
                let names: Vec<&str> = outcome.causes.iter().map(|cause| cause.name.as_str()).collect();
                eprintln!(
                    "{}: {} {} ({:.1} s) -> {:?}",
                    outcome.id,
                    outcome.verdict,
                    names.join("+"),
                    outcome.wall_s,
                    outcome.judgement()
                );
                journal.add(outcome);
            }
        });
    });
    outcomes.extend(journal.added());
    let tables = tables(&outcomes);
    std::fs::write(options.out.join("tables.md"), &tables)?;
    std::io::stdout().write_all(tables.as_bytes())?;
    Ok(())
}

fn make<const N: usize>(case: &Case, benches: &mut Benches<N>, film: Film, folder: &Path) {
    std::fs::create_dir_all(folder).expect("a folder for the case");
    match case.make(benches) {
        Some(made) => {
            write(case, &made, film, folder).expect("the case's files");
            eprintln!("{}: {:?}", case.id, made.truth);
        }
        None => eprintln!("{}: these runs never show it", case.id),
    }
}
