//! `rig study`: the collected result is the same to the byte, whoever did the tasks and whatever happened to them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use system_tests::python::python;
use system_tests::study::{Engine, Recordings};
use system_tests::{json, printed, rig, run_rig, wait_until};

/// Everything that `rig study collect` writes.
const COLLECTED: [&str; 4] = ["table.csv", "table.parquet", "findings.json", "report.html"];

/// A study of recordings in a folder of its own.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new(recordings: Recordings, study: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        recordings.write(folder.path());
        std::fs::write(folder.path().join("damping.toml"), study).expect("written");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `rig study damping.toml --out OUT` with more words.
    fn command(&self, out: &str, words: &[&str]) -> Command {
        let mut command = rig(["study"]);
        command.arg(self.path("damping.toml")).arg("--out").arg(self.path(out)).args(words);
        command
    }

    fn done(&self, out: &str, words: &[&str]) -> String {
        succeeded(self.command(out, words))
    }

    fn assert_same(&self, one: &str, other: &str) {
        for name in COLLECTED {
            let read = |out: &str| std::fs::read(self.path(out).join(name)).expect("collected");
            assert!(read(one) == read(other), "{name} of {one} and {other} differ");
        }
    }

    fn results(&self, out: &str) -> usize {
        let results = std::fs::read_dir(self.path(out).join("results")).into_iter().flatten().flatten();
        results.filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b".")).count()
    }
}

fn succeeded(mut command: Command) -> String {
    let output = command.output().expect("rig starts");
    assert!(output.status.success(), "{command:?}\n{}", printed(&output));
    printed(&output)
}

/// Processes that do a task of the study in `out`, by their command lines.
fn at_work(out: &Path) -> Vec<i32> {
    let tasks = out.join("tasks").display().to_string();
    let numbered = |entry: std::fs::DirEntry| entry.file_name().to_str()?.parse::<i32>().ok();
    let processes = std::fs::read_dir("/proc").expect("/proc").flatten().filter_map(numbered);
    let does_task = |pid: &i32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let words: Vec<&[u8]> = line.split(|&byte| byte == 0).collect();
        words.get(1) == Some(&&b"task"[..])
            && words.get(2).is_some_and(|word| word.starts_with(tasks.as_bytes()))
    };
    processes.filter(does_task).collect()
}

fn kill(pid: i32) {
    if let Some(pid) = rustix::process::Pid::from_raw(pid) {
        // it may have ended by itself
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
    }
}

const BOOTSTRAP: &str = "[[experiment]]\npaths = [\"e*/experiment.toml\"]\n[[variation]]\nname = \"as it is\"\n[[variation]]\n\
    name = \"blocks\"\nresample = { by = \"block\", count = 10 }\n";

#[test]
fn one_worker_or_four_killed_and_resumed_collect_the_same_bytes() {
    let bench = Bench::new(Recordings::default(), BOOTSTRAP);
    let said = bench.done("one", &["--workers", "1"]);
    assert!(said.contains("48 of 48 tasks, 4 experiments"), "{said}");
    bench.done("four", &["--workers", "4"]);
    bench.assert_same("one", "four");

    // tasks are killed while they are at it, and then whoever watches over them
    let mut watched = bench.command("killed", &["--workers", "2"]).spawn().expect("rig starts");
    for results in 1..4 {
        wait_until("a task at work", 120.0, || !at_work(&bench.path("killed")).is_empty());
        at_work(&bench.path("killed")).into_iter().take(1).for_each(kill);
        wait_until("a result", 120.0, || bench.results("killed") >= results);
    }
    kill(i32::try_from(watched.id()).expect("a number"));
    let _ = watched.wait();
    let cancel = run_rig(["study".as_ref(), "cancel".as_ref(), bench.path("killed").as_os_str()]);
    assert!(cancel.status.success(), "{}", printed(&cancel));
    let folder = bench.path("killed");
    let status = || printed(&run_rig(["study".as_ref(), "status".as_ref(), folder.as_os_str()]));
    wait_until("the end of all work", 30.0, || !status().contains("under way"));
    let stopped = status();
    assert!(stopped.contains("no engine has anything of it: rig study resume"), "{stopped}");
    let mut resume = rig(["study", "resume", "--again"]);
    resume.arg(&folder);
    succeeded(resume);
    bench.assert_same("one", "killed");

    // done once, nothing is done again
    let before = json(&folder.join("study.json"))["jobs"].as_array().expect("jobs").len();
    bench.done("killed", &[]);
    assert_eq!(json(&folder.join("study.json"))["jobs"].as_array().expect("jobs").len(), before);
}

#[test]
fn a_coefficient_that_drifts_is_told_from_one_that_does_not_and_tables_are_whole() {
    let study = "[[experiment]]\npaths = [\"e0/experiment.toml\", \"e1/experiment.toml\", \"e2/experiment.toml\"]\ntank = \"small\"\n\
        temperature_c = 20.0\n[[experiment]]\npaths = [\"e3/*.toml\", \"e4/*.toml\", \"e5/*.toml\"]\ntank = \"large\"\ntemperature_c = 24.0\n\
        [[variation]]\nname = \"as it is\"\n[[variation]]\nname = \"other seed\"\nseeds = [2]\n";
    let bench =
        Bench::new(Recordings { count: 6, drift: 0.4, duration_s: 2.0, ..Recordings::default() }, study);
    bench.done("out", &[]);
    let out = bench.path("out");
    let found = json(&out.join("findings.json"));
    let says = |name: &str| {
        let all = found["common"].as_array().expect("numbers");
        let one = all.iter().find(|one| one["name"] == name && one["variation"] == "as it is");
        one.expect("a number")["says"].as_str().expect("a word").to_owned()
    };
    assert_eq!((says("q2/damping").as_str(), says("q3/damping").as_str()), ("differs", "same"), "{found}");
    let trends = found["trends"].as_array().expect("trends");
    assert!(
        trends.iter().any(|trend| trend["follows"] == "tank" && trend["name"] == "q2/damping"),
        "{found}"
    );
    assert!(trends.iter().all(|trend| trend["name"] != "q3/damping"), "{found}");
    let pair = &found["disagreements"][0];
    assert_eq!(pair["name"], "q2/damping", "{pair}");
    assert!(found["to_settle"][0]["commands"][0].as_str().expect("a command").starts_with("rig "), "{found}");
    assert!(
        found["shifts"].as_array().expect("shifts").is_empty(),
        "a seed changes no least squares: {found}"
    );
    let page = std::fs::read_to_string(out.join("report.html")).expect("the page");
    assert!(page.contains("differs") && page.contains("<svg") && !page.contains("src="), "a page of its own");

    let mut table = csv::Reader::from_path(out.join("table.csv")).expect("the table");
    let columns = table.headers().expect("columns").len();
    let rows = table.records().filter(Result::is_ok).count();
    assert_eq!(columns, 23);
    let Some(python) = python("the table in Arrow", &["pyarrow", "pandas"]) else { return };
    let script = "import sys, pandas as p, pyarrow.parquet as q\n\
        a = q.read_table(sys.argv[1] + '/table.parquet').to_pandas(); b = p.read_csv(sys.argv[1] + '/table.csv')\n\
        assert list(a.columns) == list(b.columns) and len(a) == len(b) == int(sys.argv[2]), (len(a), len(b))\n\
        for name in a.columns:\n    assert a[name].isna().equals(b[name].isna()), name\n    \
        assert (a[name].dropna().astype(str) == b[name].dropna().astype(a[name].dropna().dtype).astype(str)).all(), name\n";
    let read = Command::new(python).args(["-c", script]).arg(&out).arg(rows.to_string()).output();
    let read = read.expect("Python starts");
    assert!(read.status.success(), "{}", printed(&read));
}

#[test]
fn poisoned_tasks_are_set_aside_with_their_reason_and_the_others_go_on() {
    let study = "[[experiment]]\npaths = [\"e*/experiment.toml\"]\n[task]\ntries = 2\n";
    let bench = Bench::new(Recordings::default(), study);
    let out = bench.path("out");
    bench.done("planned", &["--workers", "1"]);
    // another recording than was planned: refused by whoever is to fit it
    let mut plan = bench.command("out", &["--detach", "--workers", "1"]);
    let file = bench.path("e1/run-0.csv");
    let whole = std::fs::read_to_string(&file).expect("a recording");
    std::fs::write(&file, "time_s,P1_x_m\n0,0\n1,0\n").expect("written");
    let output = plan.output().expect("rig starts");
    assert!(output.status.success(), "a recording is for its task to refuse: {}", printed(&output));
    let status = || printed(&run_rig(["study".as_ref(), "status".as_ref(), out.as_os_str()]));
    wait_until("three results", 120.0, || status().contains("3 of 4 tasks done, 1 set aside, 0 left"));
    assert!(status().contains("set aside") && status().contains("logs/"), "{}", status());
    std::fs::write(&file, &whole).expect("written");

    // one that dies each time it is begun is set aside too, after so many tries
    let ids = json(&bench.path("planned").join("study.json"))["tasks"].clone();
    let id = ids[0].as_str().expect("a name");
    let folder = bench.path("planned");
    std::fs::remove_file(folder.join(format!("results/{id}.json"))).expect("a result");
    std::fs::remove_file(folder.join(format!("tries/{id}.jsonl"))).expect("its tries");
    let task = folder.join(format!("tasks/{id}.json"));
    let begun = "{\"at_utc\":\"2026-11-20T10:15:03Z\",\"host\":\"n1\",\"pid\":1}\n";
    std::fs::write(folder.join(format!("tries/{id}.jsonl")), begun.repeat(2)).expect("written");
    let output = run_rig(["task".as_ref(), task.as_os_str()]);
    assert_eq!(output.status.code(), Some(4), "{}", printed(&output));
    let why = std::fs::read_to_string(folder.join(format!("set-aside/{id}.txt"))).expect("the reason");
    assert!(why.contains("begun 2 times and never ended"), "{why}");
    let mut again = rig(["study", "resume", "--again"]);
    again.arg(&folder);
    assert!(succeeded(again).contains("4 of 4 tasks"));
}

#[test]
fn mistakes_in_a_study_are_said_before_any_task() {
    let bench = Bench::new(Recordings { count: 1, ..Recordings::default() }, BOOTSTRAP);
    let refused = |study: &str| {
        std::fs::write(bench.path("damping.toml"), study).expect("written");
        let output = bench.command("out", &[]).output().expect("rig starts");
        assert_eq!(output.status.code(), Some(2), "{}", printed(&output));
        assert!(!bench.path("out/study.json").exists());
        printed(&output)
    };
    let paths = "[[experiment]]\npaths = [\"e0/experiment.toml\"]\n";
    assert!(refused("[[experiment]]\npaths = [\"runs/*\"]\n").contains("nothing is called `runs/*`"));
    assert!(
        refused(&format!("{paths}[[variation]]\nname = \"a\"\nseed = [1]\n"))
            .contains("did you mean `seeds`?")
    );
    let parameter =
        refused(&format!("{paths}[[variation]]\nname = \"a\"\nfit = {{ parameters = [\"q2/dampin\"] }}\n"));
    assert!(parameter.contains("[[variation]] `a`") && parameter.contains("q2/dampin"), "{parameter}");
    let twice = refused(&format!("{paths}[[variation]]\nname = \"a\"\n[[variation]]\nname = \"a\"\n"));
    assert!(twice.contains("could not be told apart"), "{twice}");
    let output = bench.command("out", &["--on", "slrum"]).output().expect("rig starts");
    assert!(printed(&output).contains("did you mean `slurm`?"), "{}", printed(&output));
    let run_in = run_rig(["study".as_ref(), "status".as_ref(), bench.path("e0").as_os_str()]);
    assert!(printed(&run_in).contains("is no study's folder"), "{}", printed(&run_in));
}

#[test]
fn slurm_gives_the_same_bytes_though_a_node_dies_on_the_way() {
    let bench = Bench::new(Recordings { duration_s: 2.0, ..Recordings::default() }, BOOTSTRAP);
    let Some(slurm) = Engine::start("slurm", &bench.path("slurm"), "studies on Slurm") else { return };
    bench.done("local", &[]);
    let mut study = slurm.command(bench.command("out", &["--on", "slurm"])).spawn().expect("rig starts");
    wait_until("a result", 120.0, || bench.results("out") >= 2);
    slurm.kill("n2");
    wait_until("more results", 120.0, || bench.results("out") >= 6);
    // its tasks had gone on; the daemon finds them, or the controller gives them out again
    let _node = slurm.node("n2");
    let status = study.wait().expect("it ends");
    if !status.success() {
        let mut resume = rig(["study", "resume", "--on", "slurm"]);
        resume.arg(bench.path("out"));
        succeeded(slurm.command(resume));
    }
    bench.assert_same("local", "out");
    let collected = bench.path("out/logs/slurm-collect.txt");
    wait_until("the job that collects", 60.0, || {
        std::fs::read_to_string(&collected).is_ok_and(|text| text.contains("48 of 48 tasks"))
    });
    bench.assert_same("local", "out");
}

#[test]
fn slurm_s_jobs_are_cancelled_and_resumed_elsewhere() {
    let bench = Bench::new(Recordings { duration_s: 2.0, ..Recordings::default() }, BOOTSTRAP);
    let Some(slurm) = Engine::start("slurm", &bench.path("slurm"), "cancelling studies on Slurm") else {
        return;
    };
    succeeded(slurm.command(bench.command("out", &["--on", "slurm", "--detach"])));
    let again = slurm.command(bench.command("out", &["--on", "slurm"])).output().expect("rig starts");
    assert!(printed(&again).contains("still under way"), "{}", printed(&again));
    let mut cancel = rig(["study", "cancel"]);
    cancel.arg(bench.path("out"));
    assert!(succeeded(slurm.command(cancel)).contains("1 jobs cancelled"));
    let mut status = rig(["study", "status"]);
    status.arg(bench.path("out"));
    let mut status = slurm.command(status);
    wait_until("no job", 60.0, || printed(&status.output().expect("rig")).contains("no engine has anything"));
    let mut resume = rig(["study", "resume", "--on", "local"]);
    resume.arg(bench.path("out"));
    assert!(succeeded(slurm.command(resume)).contains("48 of 48 tasks"));
}

#[test]
fn hyperqueue_gives_the_same_bytes_though_a_worker_and_the_server_die_on_the_way() {
    let bench = Bench::new(Recordings { duration_s: 2.0, ..Recordings::default() }, BOOTSTRAP);
    let Some(queue) = Engine::start("hyperqueue", &bench.path("hq"), "studies on HyperQueue") else { return };
    bench.done("local", &[]);
    let mut workers = [queue.worker(), queue.worker()];
    let mut study = queue.command(bench.command("out", &["--on", "hyperqueue"])).spawn().expect("rig starts");
    wait_until("a result", 120.0, || bench.results("out") >= 2);
    workers[0].kill().expect("it is there");
    wait_until("more results", 120.0, || bench.results("out") >= 5);
    queue.kill("hq-server");
    std::thread::sleep(Duration::from_secs(1));
    let _server = queue.server();
    let mut last = queue.worker();
    let status = study.wait().expect("it ends");
    if !status.success() {
        let mut resume = rig(["study", "resume", "--on", "hyperqueue"]);
        resume.arg(bench.path("out"));
        succeeded(queue.command(resume));
    }
    bench.assert_same("local", "out");
    for worker in workers.iter_mut().chain([&mut last]) {
        let _ = worker.kill();
        let _ = worker.wait();
    }
}
