//! Each target with its corpus and some thousand changes of it, the same ones every time; RIG_FUZZ_SEED=N makes others.

#![expect(clippy::unwrap_used, reason = "a test may")]

use std::path::Path;

use fuzz::{TARGETS, Target};

/// Numbers of a seed (xorshift64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as usize % limit.max(1)
    }
}

fn corpus(target: &Target) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target.name);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Values on which code that counts goes wrong.
const EDGES: [&[u8]; 12] = [
    b"0",
    b"-1",
    b"1e999",
    b"NaN",
    b"18446744073709551616",
    b"\0",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\n",
    b",",
    b"\"",
    b"\xef\xbb\xbf",
];

/// One change of `bytes`: a bit, a piece away, twice, moved or of another file, or a value from [`EDGES`].
fn change(bytes: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    let at = dice.below(bytes.len() + 1);
    let piece = at..(at + 1 + dice.below(24)).min(bytes.len());
    match dice.below(8) {
        0 | 1 if at < bytes.len() => bytes[at] ^= 1 << dice.below(8),
        2 if at < bytes.len() => bytes[at] = dice.below(256) as u8,
        3 => drop(bytes.drain(piece)),
        4 => {
            let twice = bytes[piece].to_vec();
            let to = dice.below(bytes.len() + 1);
            drop(bytes.splice(to..to, twice));
        }
        5 => drop(bytes.splice(piece, EDGES[dice.below(EDGES.len())].iter().copied())),
        6 => {
            let from = dice.below(other.len());
            let to = (from + 1 + dice.below(64)).min(other.len());
            drop(bytes.splice(piece, other[from..to].iter().copied()));
        }
        _ if dice.below(8) == 0 => bytes.truncate(at),
        _ => bytes.insert(at, dice.below(256) as u8),
    }
}

#[test]
fn every_target_stands_its_corpus_and_changes_of_it() {
    let seed = std::env::var("RIG_FUZZ_SEED").map_or(1, |seed| seed.parse().unwrap());
    let mut failed = Vec::new();
    for target in TARGETS {
        let corpus = corpus(target);
        assert!(!corpus.is_empty(), "{}: no file to begin with", target.name);
        let began = std::time::Instant::now();
        let mut dice = Dice(0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(seed));
        let changed = (0..target.slice).map(|_| {
            let mut bytes = corpus[dice.below(corpus.len())].clone();
            let other = &corpus[dice.below(corpus.len())];
            for _ in 0..1 + dice.below(4) {
                change(&mut bytes, other, &mut dice);
            }
            bytes
        });
        let mut taken = 0;
        for bytes in corpus.iter().cloned().chain(changed) {
            match std::panic::catch_unwind(|| (target.meets)(&bytes)) {
                Ok(is_taken) => taken += u32::from(is_taken),
                Err(_) => {
                    let kept = std::env::temp_dir().join(format!("rig-fuzz-{}", target.name));
                    std::fs::write(&kept, &bytes).unwrap();
                    failed.push(format!("{} by {}", target.name, kept.display()));
                    break;
                }
            }
        }
        println!(
            "{}: {taken} of {} taken, {:.1} s",
            target.name,
            target.slice,
            began.elapsed().as_secs_f64()
        );
        // a reader that refuses nearly all is not met at all
        if taken < target.slice / 200 {
            failed.push(format!("{}: only {taken} of {} taken", target.name, target.slice));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("; "));
}
