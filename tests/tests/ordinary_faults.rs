//! Ordinary faults that `rig diagnose` must name with the link or hinge they sit in: a slice of the set that
//! `examples/ordinary_faults.rs` goes through.

use rayon::prelude::*;
use system_tests::ordinary::faults::Kind;
use system_tests::ordinary::judge::{Judged, Nearness, diagnose, table};

/// A mechanism, and what is wrong with it.
const SLICE: [(Kind, u64); 11] = [
    (Kind::Nothing, 5000),
    (Kind::OwnHinge, 5000),
    (Kind::Bubble, 5000),
    (Kind::HeavyLink, 5000),
    (Kind::RubbingHinge, 5000),
    (Kind::SprungHinge, 5000),
    (Kind::LongLink, 5001),
    (Kind::AskewHorn, 5001),
    (Kind::Inertia, 5000),
    (Kind::Sagging, 5000),
    (Kind::Air, 5000),
];

#[test]
fn ordinary_faults_are_named_with_their_element() {
    let folder = tempfile::tempdir().expect("a folder");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    let judged: Vec<Judged> = pool.install(|| {
        SLICE.par_iter().with_max_len(1).map(|&(kind, seed)| diagnose(kind, seed, folder.path())).collect()
    });
    for one in &judged {
        eprintln!("{}", one.line());
    }
    eprintln!("{}", table(&judged));
    let missed: Vec<String> =
        judged.iter().filter(|one| one.nearness() != Nearness::Right).map(Judged::line).collect();
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}
