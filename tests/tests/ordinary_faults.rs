//! Ordinary faults that `rig diagnose` must name with the link or hinge they sit in: a slice of the set that
//! `examples/ordinary_faults.rs` goes through.

use rayon::prelude::*;
use system_tests::ordinary::faults::Kind;
use system_tests::ordinary::judge::{Judged, Nearness, diagnose, table};

/// A mechanism, and what is wrong with it.
const SLICE: [(Kind, u64); 12] = [
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
    (Kind::ShiftingCurrent, 5000),
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
    let share = |wanted: Nearness| {
        judged.iter().filter(|one| one.nearness() == wanted).count() as f64 / judged.len() as f64
    };
    let right = share(Nearness::Right);
    assert!(right >= 0.85, "right with the element: {:.0} %", 100.0 * right);
    assert_eq!(share(Nearness::Wrong), 0.0, "named, and wrong");
    assert_eq!(share(Nearness::Failed), 0.0, "no answer");
}
