//! A night of faults on a mock rig with its daemon, by one seed: whose memory, files and threads stay as many as they were, and who at the
//! end does a run as if nothing had been.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;

use crate::daemon::{Bench, Served};
use crate::http::Events;
use crate::outside::Outside;
use crate::set;
use crate::storage::{Order, Shim};

type Fault = (&'static str, fn(&mut Rig));

/// What happens in a night.
const FAULTS: [Fault; 6] = [
    ("board unplugged", Rig::unplug),
    ("camera stalled", Rig::stall),
    ("disk full", Rig::fill),
    ("job killed", Rig::kill),
    ("stopped and released", Rig::stop),
    ("watched by twenty", Rig::watch),
];
/// A fault lasts so long; between two of them the rig has up to so long for itself. Chosen.
const FAULT_TIME: Duration = Duration::from_secs(3);
const LONGEST_PEACE_S: f64 = 12.0;
const SAMPLE_INTERVAL: Duration = Duration::from_millis(500);
/// What the last run may take, all that waits for it and a busy machine included (chosen).
const LONGEST_LAST_RUN: Duration = Duration::from_secs(120);
/// Jobs that wait at a time at least.
const LEAST_WAITING_JOBS: usize = 2;
/// Growth of the least memory from a night's second quarter to its last one that is none \[KiB\]: what a list of jobs that becomes longer, and a
/// heap that is used in another order, come to. Chosen.
const MEMORY_GROWTH_LIMIT_KIB: i64 = 4096;
/// The same for files and threads: a request or a job that is just being dealt with.
const COUNT_GROWTH_LIMIT: i64 = 2;

/// A night.
#[derive(Debug, Clone, Copy)]
pub struct Night {
    /// Which one.
    pub seed: u64,
    /// Its length.
    pub length: Duration,
}

/// What the daemon holds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Held {
    /// Since the night began \[s\].
    pub at_s: f64,
    /// Resident memory \[KiB\].
    pub memory_kib: i64,
    /// Open files and connections.
    pub files: i64,
    /// Threads.
    pub threads: i64,
}

/// How a night went.
#[derive(Debug, Clone, Serialize)]
pub struct Endured {
    /// What the daemon held, twice a second.
    pub held: Vec<Held>,
    /// How often each fault came.
    pub faults: BTreeMap<&'static str, usize>,
    /// How many jobs ended in which state.
    pub jobs: BTreeMap<String, usize>,
}

struct Rig {
    outside: Outside,
    served: Served,
    shim: Shim,
    began: Instant,
    held: Vec<Held>,
}

fn held(process: u32, at_s: f64) -> Held {
    let folder = format!("/proc/{process}");
    let status = std::fs::read_to_string(format!("{folder}/status")).expect("the daemon lives");
    let number = |name: &str| -> i64 {
        let line = status.lines().find_map(|line| line.strip_prefix(name)).expect("Linux says it");
        line.trim().trim_end_matches(" kB").parse().expect("a number")
    };
    let files = std::fs::read_dir(format!("{folder}/fd")).expect("its files").count() as i64;
    Held { at_s, memory_kib: number("VmRSS:"), files, threads: number("Threads:") }
}

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let outside = Outside::new("chain-driven-pose-1.toml", folder.path());
        let bench = Bench::of(folder, outside.config.clone(), outside.runs.clone());
        // a machine that is busy with anything loses no image of so few
        bench.change(|config| set(config, "camera", "fps", 25.0));
        let mut shim = Shim::before(&outside.runs);
        let served = Served::changed(bench, "127.0.0.1:0", |daemon| shim.with(daemon, Order::Count));
        Self { outside, served, shim, began: Instant::now(), held: Vec::new() }
    }

    fn pass(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.held.push(held(self.served.process(), self.began.elapsed().as_secs_f64()));
            std::thread::sleep(SAMPLE_INTERVAL.min(until.saturating_duration_since(Instant::now())));
        }
    }

    fn unplug(&mut self) {
        self.outside.board.signal(Signal::KILL);
        self.pass(FAULT_TIME);
        self.outside.plug_in();
    }

    fn stall(&mut self) {
        self.outside.camera.signal(Signal::STOP);
        self.pass(FAULT_TIME);
        self.outside.camera.signal(Signal::CONT);
    }

    fn fill(&mut self) {
        self.shim.fill(true);
        self.pass(FAULT_TIME);
        self.shim.fill(false);
    }

    /// Kills a job's process; one whose number somebody else has by now is left alone.
    fn kill(&mut self) {
        let journal = self.served.bench.journal();
        let began = journal.lines().rfind(|line| line.contains("\"job-began\""));
        let Some(began) = began.and_then(|line| serde_json::from_str::<serde_json::Value>(line).ok()) else {
            return;
        };
        let Some(process) = began["pid"].as_i64().and_then(|number| Pid::from_raw(number as i32)) else {
            return;
        };
        let command = format!("/proc/{}/cmdline", process.as_raw_nonzero());
        let runs = self.served.bench.runs.as_os_str().as_encoded_bytes();
        let is_job = std::fs::read(Path::new(&command))
            .is_ok_and(|words| words.windows(runs.len()).any(|word| word == runs));
        if is_job {
            let _ = kill_process(process, Signal::KILL);
        }
    }

    fn stop(&mut self) {
        let stopped = self.served.post("/api/v1/rigs/rig/stop", r#"{"by":"a test","why":"the night"}"#);
        assert_eq!(stopped.status, 200, "{}", stopped.body);
        self.pass(FAULT_TIME);
    }

    fn watch(&mut self) {
        let paths = ["/api/v1/events", "/api/v1/rigs/rig/live?lane=motion"];
        let watching: Vec<_> =
            paths.iter().cycle().take(20).map(|path| Events::listen(self.served.address, path)).collect();
        self.pass(FAULT_TIME);
        drop(watching);
    }

    /// Says that a person has seen to it; a board that is not back yet is seen to later.
    fn release(&self) {
        let released = self.served.post("/api/v1/rigs/rig/release", r#"{"by":"a test"}"#);
        assert!([200, 409].contains(&released.status), "{}: {}", released.status, released.body);
    }

    fn jobs(&self) -> BTreeMap<String, usize> {
        let mut states = BTreeMap::new();
        let jobs = self.served.get("/api/v1/rigs/rig/jobs?most=100000").json();
        for job in jobs.as_array().expect("jobs") {
            *states.entry(job["state"].as_str().expect("a state").to_owned()).or_default() += 1;
        }
        states
    }

    fn add_run(&self, film_only: bool) -> i64 {
        let body = format!(r#"{{"work":{{"kind":"run","film_only":{film_only}}}}}"#);
        let added = self.served.post("/api/v1/rigs/rig/jobs", &body);
        assert_eq!(added.status, 201, "{}", added.body);
        added.json()["job"].as_i64().expect("its number")
    }

    /// A run that is done, once everything is there again.
    fn ends_well(&mut self) {
        let cancelled = self.served.post("/api/v1/rigs/rig/jobs/cancel", "{}");
        assert_eq!(cancelled.status, 200, "{}", cancelled.body);
        // one that runs may be at a diagnosis, which takes its minute
        for job in self.served.get("/api/v1/rigs/rig/jobs?most=100000").json().as_array().expect("jobs") {
            if job["state"] == "running" {
                let cancel = format!("/api/v1/rigs/rig/jobs/{}/cancel", job["id"]);
                let cancelled = self.served.post(&cancel, "{}");
                assert!([200, 409].contains(&cancelled.status), "{}", cancelled.body);
            }
        }
        let last = self.add_run(true);
        let began = Instant::now();
        loop {
            self.release();
            std::thread::sleep(SAMPLE_INTERVAL);
            let job = self.served.get(&format!("/api/v1/rigs/rig/jobs/{last}")).json();
            let state = job["state"].as_str().expect("a state");
            assert!(["queued", "running", "done"].contains(&state), "{job}");
            if state == "done" {
                return;
            }
            if began.elapsed() > LONGEST_LAST_RUN {
                let rig = self.served.get("/api/v1/rigs/rig").body;
                panic!("the last run is not done: {job}\n{rig}\n{}", self.served.bench.journal());
            }
        }
    }
}

impl Night {
    /// Lets a rig have this night.
    ///
    /// # Panics
    /// Where the daemon dies, does not answer or fails a request, or the last run is not done.
    pub fn endure(&self) -> Endured {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut rig = Rig::new();
        let mut faults = BTreeMap::new();
        while rig.began.elapsed() < self.length {
            while rig.jobs().get("queued").is_none_or(|&waiting| waiting < LEAST_WAITING_JOBS) {
                rig.add_run(random.random_bool(0.7));
            }
            rig.pass(ground::strict::duration(random.random_range(0.0..LONGEST_PEACE_S)));
            let (name, happens) = FAULTS[random.random_range(0..FAULTS.len())];
            happens(&mut rig);
            rig.release();
            *faults.entry(name).or_default() += 1;
        }
        rig.ends_well();
        Endured { jobs: rig.jobs(), held: rig.held, faults }
    }
}

impl Endured {
    /// The least of memory \[KiB\], files and threads in the night's quarters from `from` to `to`: what is held for good.
    pub fn least(&self, from: f64, to: f64) -> [i64; 3] {
        let end_s = self.held.last().map_or(0.0, |held| held.at_s);
        let within = |held: &&Held| (from..=to).contains(&(held.at_s * 4.0 / end_s));
        let of = |what: fn(&Held) -> i64| self.held.iter().filter(within).map(what).min().unwrap_or(0);
        [of(|held| held.memory_kib), of(|held| held.files), of(|held| held.threads)]
    }

    /// What has grown from the second quarter to the last, and by how much.
    pub fn grown(&self) -> Vec<String> {
        let (before, after) = (self.least(1.0, 2.0), self.least(3.0, 4.0));
        let kinds = [
            ("KiB of memory", MEMORY_GROWTH_LIMIT_KIB),
            ("open files", COUNT_GROWTH_LIMIT),
            ("threads", COUNT_GROWTH_LIMIT),
        ];
        let each = kinds.into_iter().zip(before.into_iter().zip(after));
        each.filter(|((_, limit), (before, after))| after - before > *limit)
            .map(|((what, limit), (before, after))| {
                format!("{before} {what} became {after}, {limit} more are allowed")
            })
            .collect()
    }
}
