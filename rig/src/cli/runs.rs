//! `rig runs`: what is in a runs folder.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use serde_json::Value;

use super::{Failure, Outcome};
use app::{base, recover};
use ground::claim::{Claim, has_open};
use record::folder::{self, RunFolder, file};
use record::run_id::RunId;
use record::verify::{State, verify};
use record::{RecordError, journal};
use store::Store;
use store::runs::Summary;

/// `rig runs`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Where runs are kept.
    #[arg(long, global = true, default_value = "runs", value_name = "DIR")]
    pub runs_dir: PathBuf,
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What to do with the runs.
#[derive(clap::Subcommand, Debug)]
pub enum Action {
    /// List all runs, the newest last.
    Ls {
        /// The runs folder; left out: --runs-dir.
        folder: Option<PathBuf>,
    },
    /// Make the index of all runs again, from their folders.
    Index {
        /// The runs folder; left out: --runs-dir.
        folder: Option<PathBuf>,
    },
    /// Show one run: how it went, its journal and its results.
    Show {
        /// The run's folder, or its id in the runs folder.
        run: String,
    },
    /// Say whether run folders are what was written: compare all files with their checksums.
    Verify {
        /// The runs' folders, or their ids in the runs folder; left out: all of it.
        runs: Vec<String>,
    },
    /// Complete runs that ended without a word, by a kill or a power cut: the next run does so by itself.
    Recover {
        /// The runs' folders, or their ids in the runs folder; left out: all of it.
        runs: Vec<String>,
    },
}

/// Lists runs or shows one.
///
/// # Errors
/// [`Failure::Input`] when there is no such folder or run.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    match &args.action {
        Action::Ls { folder } => {
            let folder = folder.as_ref().unwrap_or(&args.runs_dir);
            let mut store = existing(folder)?;
            store.refresh(false).map_err(Failure::input)?;
            Ok(Outcome {
                text: table(&store.runs(usize::MAX).map_err(Failure::input)?),
                ..Outcome::default()
            })
        }
        Action::Index { folder } => {
            let folder = folder.as_ref().unwrap_or(&args.runs_dir);
            let refreshed = existing(folder)?.refresh(true).map_err(Failure::input)?;
            let text = format!("{} runs indexed, {} gone\n", refreshed.runs, refreshed.gone);
            Ok(Outcome { text, ..Outcome::default() })
        }
        Action::Show { run } => {
            let folder = RunFolder::open(&find(&args.runs_dir, run)).map_err(Failure::input)?;
            let text = describe(&folder).map_err(Failure::input)?;
            Ok(Outcome { text, run: Some(folder.path().into()), ..Outcome::default() })
        }
        Action::Verify { runs } => verified(&chosen(&args.runs_dir, runs)?),
        Action::Recover { runs } => recovered(&chosen(&args.runs_dir, runs)?),
    }
}

/// The folders of the runs asked for; of all where none is.
fn chosen(runs_dir: &Path, runs: &[String]) -> Result<Vec<PathBuf>, Failure> {
    if runs.is_empty() {
        let listed = folder::list(runs_dir).map_err(Failure::input)?;
        return Ok(listed.into_iter().map(|run| runs_dir.join(run.id.as_str())).collect());
    }
    let missing = |path: &&PathBuf| !path.is_dir();
    let paths: Vec<PathBuf> = runs.iter().map(|run| find(runs_dir, run)).collect();
    match paths.iter().find(missing) {
        Some(path) => Err(Failure::Input(anyhow!(
            "there is no run folder {}; `rig runs ls` lists them",
            path.display()
        ))),
        None => Ok(paths),
    }
}

fn name(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy()
}

fn verified(runs: &[PathBuf]) -> Result<Outcome, Failure> {
    let mut text = format!("{:<23}  {:<10}  what was found\n", "run", "state");
    let (mut worst, mut damaged) = (State::Sound, 0);
    for path in runs {
        let is_open = Claim::holder(&recover::lock(base(path)))
            // where nobody may look, it is taken for open
            .is_some_and(|pid| has_open(pid, &path.join(file::JOURNAL)) != Some(false));
        if is_open && !path.join(file::STOP).exists() {
            let _ = writeln!(text, "{:<23}  {:<10}  is being filmed", name(path), "running");
            continue;
        }
        let found = verify(path);
        worst = worst.max(found.state);
        damaged += usize::from(found.state == State::Damaged);
        let _ = writeln!(text, "{:<23}  {:<10}  {}", name(path), found.state, found.findings.join("; "));
    }
    if damaged > 0 {
        return Err(Failure::Data(anyhow!(
            "{damaged} of {} runs are damaged\n{}",
            runs.len(),
            text.trim_end()
        )));
    }
    Ok(Outcome { text, verdict: Some(worst.to_string()), ..Outcome::default() })
}

fn recovered(runs: &[PathBuf]) -> Result<Outcome, Failure> {
    let (mut text, mut failed) = (String::new(), None);
    for path in runs {
        let claim = recover::claim(base(path))?;
        match recover::recover(path, &claim) {
            Ok(Some(outcome)) => {
                let _ = writeln!(text, "{} {outcome}", name(path));
            }
            Ok(None) => {}
            Err(failure) => {
                let _ = writeln!(text, "{} cannot be recovered: {:#}", name(path), failure.error());
                failed.get_or_insert(failure);
            }
        }
    }
    match failed {
        Some(failure) => Err(Failure::of(failure.status(), anyhow!("{}", text.trim_end()))),
        None if text.is_empty() => Ok(Outcome { text: "no run needs it\n".into(), ..Outcome::default() }),
        None => Ok(Outcome { text, ..Outcome::default() }),
    }
}

/// The store of a runs folder that is there: looking makes no folders.
fn existing(folder: &Path) -> Result<Store, Failure> {
    std::fs::read_dir(folder)
        .with_context(|| format!("reading runs folder {}", folder.display()))
        .map_err(Failure::Input)?;
    Store::open_or_memory(folder).map_err(Failure::input)
}

fn find(runs_dir: &Path, run: &str) -> PathBuf {
    match RunId::try_from(run.to_owned()) {
        Ok(id) => runs_dir.join(id.as_str()),
        Err(_) => run.into(),
    }
}

fn table(runs: &[Summary]) -> String {
    if runs.is_empty() {
        return "no runs yet\n".into();
    }
    let mut text = format!(
        "{:<23}  {:<10}  {:>10}  {:>7}  {:>5}  what came out\n",
        "run", "status", "duration", "images", "lost"
    );
    for run in runs {
        let _ = match &run.reason {
            Some(error) if run.status == "unreadable" => writeln!(text, "{}  unreadable: {error}", run.id),
            _ => writeln!(
                text,
                "{}  {:<10}  {:>10}  {:>7}  {:>5}  {}{}",
                run.id,
                run.status,
                run.duration_s.map_or("-".into(), |s| format!("{s:.1} s")),
                run.images.map_or("-".into(), |count| count.to_string()),
                run.losses.map_or("-".into(), |losses| (losses.lost + losses.unread).to_string()),
                run.headline.as_ref().map_or("-", |headline| &headline.line),
                run.note().map_or_else(String::new, |note| format!("  {note}")),
            ),
        };
    }
    text
}

fn describe(run: &RunFolder) -> Result<String, RecordError> {
    let start = run.start();
    let summary = Summary::of(&start.id, run.path());
    let mut text = String::new();
    let mut line = |name: &str, value: &dyn std::fmt::Display| {
        let _ = writeln!(text, "{name:<10} {value}");
    };
    line("run", &start.id);
    line("status", &summary.status);
    if let Some(reason) = &summary.reason {
        line("reason", reason);
    }
    if let Some(degraded) = &summary.degraded {
        line("degraded", degraded);
    }
    line("began", &start.clock.utc);
    if let Some(duration_s) = summary.duration_s {
        line("duration", &format_args!("{duration_s:.3} s"));
    }
    line("kind", &format!("{:?}", start.kind).to_lowercase());
    if let Some(board) = &start.board {
        line("board", &format_args!("{}, boot id {:08x}", board.name, board.boot_id));
    }
    if let Some(camera) = &start.camera {
        let size = format_args!("{}x{} px", camera.width_px, camera.height_px);
        line("camera", &format_args!("{}, {size}, {} images a second", camera.name, camera.fps));
    }
    if let Some(images) = summary.images {
        line("images", &images);
    }
    if let Some(stop) = run.stop() {
        line("lost", &format_args!("{} images, {} messages", stop.images_lost, stop.messages_dropped));
        let doubtful = [stop.images_damaged, stop.images_repeated, stop.images_stale];
        if doubtful != [0; 3] {
            let [damaged, repeated, stale] = doubtful;
            line(
                "doubtful",
                &format_args!(
                    "{damaged} images damaged, {repeated} equal to the one before, {stale} stamped no later"
                ),
            );
        }
    }
    if let Some(headline) = &summary.headline {
        line("came out", &headline.line);
    }
    line("folder", &run.path().display());

    let path = run.file(file::JOURNAL);
    if path.exists() {
        text.push_str("journal\n");
        for entry in journal::read(&path)? {
            let details = if entry.details.is_empty() {
                String::new()
            } else {
                format!("  {}", Value::Object(entry.details))
            };
            let _ = writeln!(text, "  {:>9.3} s  {}{details}", entry.at_s, entry.event);
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::fixtures;
    use record::start_stop::Stop;
    use servo::StopOutcome;

    fn create(runs_dir: &Path, id: &str) -> RunFolder {
        let start = fixtures::start(id);
        RunFolder::create(runs_dir, start).unwrap()
    }

    fn show(runs_dir: &Path, action: Action) -> String {
        run(&Args { runs_dir: runs_dir.into(), action }).unwrap().text
    }

    #[test]
    fn finished_and_cut_short_runs_are_listed_with_what_is_known() {
        let dir = tempfile::tempdir().unwrap();
        let mut finished = create(dir.path(), "20261120T101503Z-ab12cd");
        let fit = ident::fit::Fit { error_m: Some(0.0015), noise_m: 1e-3, ..Default::default() };
        finished.write(file::FIT, fit.to_json().unwrap().as_bytes()).unwrap();
        finished
            .finish(
                Stop {
                    images: 350,
                    images_lost: 2,
                    images_damaged: 3,
                    servo: StopOutcome::Acknowledged,
                    ..fixtures::stop()
                },
                None,
            )
            .unwrap();
        let cut_short = create(dir.path(), "20261120T111503Z-ab12cd");
        cut_short.journal().unwrap().write("armed", serde_json::json!({"boot_id": 7})).unwrap();

        let text = show(dir.path(), Action::Ls { folder: None });
        let lines: Vec<_> = text.lines().collect();
        let said = "The simulation follows the keypoints to their noise: off by 1.50 mm, 1.5 times the noise of 1.00 mm; 5 of 352 \
                    images are missing: 2 lost before they were recorded, 3 damaged.";
        let first = format!(
            "20261120T101503Z-ab12cd  success          3.5 s      350      2  {said}  degraded: 5 of 352"
        );
        assert!(lines[1].starts_with(&first), "{text}");
        assert!(lines[2].contains("incomplete") && lines[2].ends_with('-'), "{text}");

        let text = show(dir.path(), Action::Show { run: "20261120T101503Z-ab12cd".into() });
        assert!(
            text.contains(&format!("came out   {said}")) && text.contains("lost       2 images"),
            "{text}"
        );
        let by_path = cut_short.path().to_str().unwrap().to_owned();
        let text = show(dir.path(), Action::Show { run: by_path });
        assert!(text.contains("incomplete") && text.contains("armed  {\"boot_id\":7}"), "{text}");
    }

    #[test]
    fn missing_run_is_an_input_error() {
        let dir = tempfile::tempdir().unwrap();
        let args = Args {
            runs_dir: dir.path().into(),
            action: Action::Show { run: "20261120T101503Z-ab12cd".into() },
        };
        assert_eq!(run(&args).unwrap_err().exit_code(), 2);
    }
}
