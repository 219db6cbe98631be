//! Faults of the disk, brought about between a program and its files by `tests/shim/storage.c`: kills, a full disk, a slow one, one
//! that cannot be written, and a note of all that was written, of which [`power`] makes what a power cut would have left.

pub mod power;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::repository;

/// The shim, built once a process beside the tests' programs.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let test = std::env::current_exe().expect("a test knows its own path");
        let built = test.with_file_name(format!("storage-shim-{}.so", std::process::id()));
        let mut compiler = Command::new("cc");
        compiler
            .args(["-std=gnu11", "-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", "-o"])
            .arg(&built);
        compiler.arg(repository().join("tests/shim/storage.c")).args(["-ldl", "-lpthread"]);
        assert!(compiler.status().expect("cc, which builds SQLite too").success(), "the shim does not build");
        let library = test.with_file_name("storage-shim.so");
        std::fs::rename(built, &library).expect("renamed");
        library
    })
}

/// When, in an event, a process is killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Nothing of it has happened.
    Before,
    /// Half of the bytes are written.
    During,
    /// It has happened; the program has not heard of it.
    After,
}

impl Phase {
    fn name(self) -> &'static str {
        match self {
            Self::Before => "before",
            Self::During => "during",
            Self::After => "after",
        }
    }
}

/// What is done to a program's files.
#[derive(Debug, Clone, Copy)]
pub enum Order {
    /// They are counted.
    Count,
    /// What is written is noted too.
    Note,
    /// The process is killed at the event of this number.
    Kill(u64, Phase),
    /// Nothing more fits from the event of this number on.
    Full(u64),
    /// Nothing can be changed.
    ReadOnly,
    /// Each write and each sync takes so much longer \[ms\].
    Slow(u64),
}

/// A change of a file, as the shim saw it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// Its number, from 1.
    pub number: u64,
    /// `create`, `write`, `sync`, `sync-folder`, `rename`, `remove`, `set-length` or `make-folder`.
    pub kind: String,
    /// `done`, `killed-before`, `killed-during`, `killed-after`, `full` or `read-only`.
    pub done: String,
    /// Where in the file.
    pub offset: u64,
    /// How many bytes.
    pub length: u64,
    /// Of which file, below the folder.
    pub path: PathBuf,
    /// What it is called from now on.
    pub path2: PathBuf,
    /// What was written, where it was noted.
    pub data: Vec<u8>,
}

impl Event {
    /// What kind of event on which of the program's files: runs and jobs are all alike.
    pub fn class(&self) -> String {
        let parts = self.path.iter().map(|part| {
            let part = part.to_string_lossy();
            // the name of a file that is not whole yet has six letters that are there once only
            if let Some(to) = part.strip_prefix(".part-").and_then(|rest| rest.get(7..)) {
                return format!(".part-{to}");
            }
            let id = part.strip_prefix(".new-").unwrap_or(&part);
            if id.len() == 23 && id.as_bytes()[8] == b'T' {
                part.replace(id, "RUN")
            } else {
                part.into_owned()
            }
        });
        format!("{} {}", self.kind, parts.collect::<Vec<_>>().join("/"))
    }

    /// The phases in which it can be killed.
    pub fn phases(&self) -> &'static [Phase] {
        if self.kind == "write" && self.length > 1 {
            &[Phase::Before, Phase::During, Phase::After]
        } else {
            &[Phase::Before, Phase::After]
        }
    }
}

/// The shim in front of the files below one folder.
#[derive(Debug)]
pub struct Shim {
    below: PathBuf,
    control: tempfile::TempDir,
    notes: bool,
}

impl Shim {
    /// In front of the files below `folder`, which need not be there.
    pub fn before(folder: &Path) -> Self {
        Self { below: folder.into(), control: tempfile::tempdir().expect("a folder"), notes: false }
    }

    /// `command` with the shim, and the processes that it starts; counting begins anew.
    pub fn with(&mut self, command: Command, order: Order) -> Command {
        for name in ["count", "log"] {
            let _ = std::fs::remove_file(self.control.path().join(name));
        }
        self.and(command, order)
    }

    /// The same; counting goes on.
    pub fn and(&mut self, mut command: Command, order: Order) -> Command {
        self.notes = matches!(order, Order::Note);
        command.env("LD_PRELOAD", library());
        command.env("STORAGE_BELOW", &self.below).env("STORAGE_CONTROL", self.control.path());
        match order {
            Order::Count => &mut command,
            Order::Note => command.env("STORAGE_DATA", "1"),
            Order::Kill(number, phase) => command.env("STORAGE_KILL", format!("{number}:{}", phase.name())),
            Order::Full(number) => command.env("STORAGE_FULL", number.to_string()),
            Order::ReadOnly => command.env("STORAGE_READ_ONLY", "1"),
            Order::Slow(ms) => command.env("STORAGE_SLOW_MS", ms.to_string()),
        };
        command
    }

    /// Fills the disk, or makes room again, while the program runs.
    pub fn fill(&self, is_full: bool) {
        let path = self.control.path().join("full");
        let done = if is_full { std::fs::write(path, "") } else { std::fs::remove_file(path) };
        done.expect("the control folder");
    }

    /// What has happened since the program with the shim began.
    pub fn events(&self) -> Vec<Event> {
        let log = std::fs::read(self.control.path().join("log")).unwrap_or_default();
        let (mut events, mut rest) = (Vec::new(), &log[..]);
        while let Some(end) = rest.iter().position(|&byte| byte == b'\n') {
            let line = String::from_utf8_lossy(&rest[..end]).into_owned();
            let cells: Vec<&str> = line.split('\t').collect();
            let [number, kind, done, _process, offset, length, path, path2] = cells[..] else {
                panic!("not a line of the log: {line}")
            };
            let below = |path: &str| {
                Path::new(path).strip_prefix(&self.below).map_or_else(|_| PathBuf::new(), Path::to_owned)
            };
            let length: u64 = length.parse().expect("a length");
            rest = &rest[end + 1..];
            let data =
                if self.notes && kind == "write" { rest[..length as usize].to_vec() } else { Vec::new() };
            rest = &rest[data.len()..];
            events.push(Event {
                number: number.parse().expect("a number"),
                kind: kind.into(),
                done: done.into(),
                offset: offset.parse().expect("an offset"),
                length,
                path: below(path),
                path2: below(path2),
                data,
            });
        }
        // two threads may note in another order than they were counted
        events.sort_by_key(|event| event.number);
        events
    }
}

/// Which kills a sweep has brought about.
#[derive(Debug, Default)]
pub struct Kills {
    before: usize,
    during: usize,
    after: usize,
    classes: BTreeSet<String>,
}

impl Kills {
    /// Counts the kill that `events` end with; whether there was one.
    pub fn count(&mut self, events: &[Event]) -> bool {
        let Some(event) = events.iter().find(|event| event.done.starts_with("killed-")) else { return false };
        match event.done.as_str() {
            "killed-before" => self.before += 1,
            "killed-during" => self.during += 1,
            _ => self.after += 1,
        }
        self.classes.insert(event.class());
        true
    }

    /// How many landed before, during and after an event.
    pub fn counts(&self) -> [usize; 3] {
        [self.before, self.during, self.after]
    }

    /// On how many kinds of events.
    pub fn classes(&self) -> usize {
        self.classes.len()
    }
}

/// All of a sweep is wanted, not a sample that fits into a test: `RIG_STORAGE_SWEEP=all`.
pub fn sweeps_all() -> bool {
    std::env::var_os("RIG_STORAGE_SWEEP").is_some_and(|value| value == "all")
}

/// The kills of a sweep: all of `events` in each phase; or `most` of them, first one on each kind of event, in one phase after the
/// other.
pub fn kills(events: &[Event], most: usize) -> Vec<(u64, Phase)> {
    let all = events.iter().flat_map(|event| event.phases().iter().map(move |&phase| (event.number, phase)));
    if sweeps_all() {
        return all.collect();
    }
    let mut seen = BTreeSet::new();
    let kinds: Vec<&Event> = events.iter().filter(|event| seen.insert(event.class())).collect();
    let first = |place: usize| place * kinds.len() / most.min(kinds.len());
    let mut chosen: Vec<(u64, Phase)> = Vec::new();
    for round in 0..3 {
        for place in 0..most.min(kinds.len()) {
            let event = kinds[first(place)];
            let phases = event.phases();
            // a write's middle, which only it has, comes first
            let phase = phases[if phases.len() == 3 { (1 + round) % 3 } else { (place + round) % 2 }];
            if !chosen.contains(&(event.number, phase)) {
                chosen.push((event.number, phase));
            }
        }
    }
    chosen.truncate(most);
    chosen.sort_unstable();
    chosen
}
