//! `rig study`: many experiments times variations, on this machine or on a cluster's engine.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use report::{Sameness, StudyFindings};
use study::collect::collect;
use study::conduct;
use study::engine::{Engine, by_name};
use study::folder::{REPORT, Standing, Study, StudyFolder, TABLE};

use super::progress::Bar;
use super::{Failure, Outcome};
use app::{interruptible, threads};

/// Arguments of `rig study`.
#[derive(clap::Args, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    /// STUDY.toml: experiments and variations
    #[arg(value_name = "STUDY", required = true)]
    pub study: Option<PathBuf>,
    /// The study's folder; where it was begun there, what is left is done [default: STUDY without .toml, in its folder]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// How it is handed over.
    #[command(flatten)]
    pub hand_over: HandOver,
    /// Only look, or end.
    #[command(subcommand)]
    pub action: Option<Action>,
}

/// Which engine does the tasks, and whether somebody waits.
#[derive(clap::Args, Debug, Clone)]
pub struct HandOver {
    /// local, slurm or hyperqueue
    #[arg(long, default_value = "local", value_name = "ENGINE")]
    pub on: String,
    /// With `--on local`, tasks at once [default: all cores, by the threads of a task]
    #[arg(long, value_name = "N")]
    pub workers: Option<NonZeroUsize>,
    /// Do not wait for the results
    #[arg(long)]
    pub detach: bool,
}

/// What else is done with a study.
#[derive(clap::Subcommand, Debug)]
pub enum Action {
    /// Say how far it is
    Status {
        /// The study's folder
        folder: PathBuf,
    },
    /// Hand over what is left: after a cancel, a lost server, a power cut
    Resume {
        /// The study's folder
        folder: PathBuf,
        /// How it is handed over.
        #[command(flatten)]
        hand_over: HandOver,
        /// Also what is set aside
        #[arg(long)]
        again: bool,
    },
    /// End what is waiting or under way; results stay
    Cancel {
        /// The study's folder
        folder: PathBuf,
    },
    /// Put all results there are into one table and a page
    Collect {
        /// The study's folder
        folder: PathBuf,
    },
}

/// Carries it out.
///
/// # Errors
/// [`Failure::Input`] where the study or an engine is not as it should be, [`Failure::Interrupted`] after a signal.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    match (&args.action, &args.study) {
        (None, Some(file)) => {
            let out = args.out.clone().unwrap_or_else(|| file.with_extension(""));
            if out == *file {
                return Err(Failure::Input(anyhow!(
                    "{} has no ending, so its folder must be named: --out DIR",
                    file.display()
                )));
            }
            let engine = by_name(&args.hand_over.on)?;
            let (folder, study) = conduct::plan(file, &out)?;
            hand_over(&folder, study, engine, &args.hand_over)
        }
        (Some(Action::Resume { folder, hand_over: how, again }), _) => {
            let engine = by_name(&how.on)?;
            let (folder, study) = conduct::open(folder)?;
            if *again {
                folder.try_again();
            }
            conduct::forget_tries(&folder, &study);
            hand_over(&folder, study, engine, how)
        }
        (Some(Action::Status { folder }), _) => {
            let (folder, study) = conduct::open(folder)?;
            Ok(status(&folder, &study))
        }
        (Some(Action::Cancel { folder }), _) => {
            let (folder, study) = conduct::open(folder)?;
            let count = conduct::cancel(&folder, &study)?;
            let text = format!("{count} jobs cancelled\n{}", said(folder.standing(&study)));
            Ok(Outcome { text, out: Some(folder.path().into()), ..Outcome::default() })
        }
        (Some(Action::Collect { folder }), _) => {
            let (folder, study) = conduct::open(folder)?;
            collected(&folder, &study)
        }
        (None, None) => Err(Failure::Input(anyhow!("a STUDY.toml is wanted"))),
    }
}

fn hand_over(
    folder: &StudyFolder,
    mut study: Study,
    engine: &dyn Engine,
    how: &HandOver,
) -> Result<Outcome, Failure> {
    let at_once = (threads(None) / study.threads).max(1);
    let workers = how.workers.or(NonZeroUsize::new(at_once)).unwrap_or(NonZeroUsize::MIN);
    let count = conduct::submit(folder, &mut study, engine, workers)?;
    if how.detach && count > 0 {
        let text = format!(
            "{count} tasks handed to {}\nrig study status {}\n",
            engine.name(),
            folder.path().display()
        );
        return Ok(Outcome { text, out: Some(folder.path().into()), ..Outcome::default() });
    }
    let standing = interruptible(async |interrupt| {
        let standing =
            conduct::watch(folder, &study, &mut Bar::new(interrupt.flag()), &|| interrupt.is_raised());
        if !interrupt.is_raised() {
            return Ok(standing);
        }
        let is_here = engine.name() == "local";
        if is_here {
            conduct::cancel(folder, &study)?;
        }
        let path = folder.path().display();
        Err(Failure::Interrupted(anyhow!(match is_here {
            true => format!(
                "interrupted with {} of {} tasks done; `rig study resume {path}` goes on",
                standing.done, standing.all
            ),
            false => format!(
                "{} goes on without you; `rig study status {path}`, `rig study cancel {path}`",
                engine.name()
            ),
        })))
    })?;
    if standing.left() > 0 {
        return Err(Failure::Data(anyhow!(
            "{} of {} tasks have no result, and {} has nothing of them any more; logs/ in {} says why, `rig study resume {2}` hands them over again",
            standing.left(),
            standing.all,
            engine.name(),
            folder.path().display()
        )));
    }
    collected(folder, &study)
}

fn said(standing: Standing) -> String {
    let Standing { all, done, set_aside } = standing;
    format!("{done} of {all} tasks done, {set_aside} set aside, {} left\n", standing.left())
}

fn status(folder: &StudyFolder, study: &Study) -> Outcome {
    let standing = folder.standing(study);
    let (at_work, trouble) = conduct::look(folder, study);
    let mut text = said(standing);
    if at_work.is_over() && standing.left() > 0 && trouble.is_empty() {
        let _ = writeln!(text, "no engine has anything of it: rig study resume {}", folder.path().display());
    } else if !at_work.is_over() {
        let _ = writeln!(text, "under way: {} running, {} waiting", at_work.running, at_work.waiting);
    }
    let (wall_s, cpu_s, peak_mib) = conduct::took(folder, study);
    let _ =
        writeln!(text, "so far {wall_s:.0} s, {cpu_s:.0} s of processors, at most {peak_mib:.0} MiB a task");
    for id in &study.tasks {
        if let Some(why) = folder.set_aside(id) {
            let _ = writeln!(text, "set aside {id}: {why}; {}", folder.log(id).display());
        }
    }
    let verdict = if standing.left() == 0 {
        "done"
    } else if at_work.is_over() {
        "stopped"
    } else {
        "running"
    };
    Outcome {
        text,
        warnings: trouble,
        out: Some(folder.path().into()),
        verdict: Some(verdict.into()),
        ..Outcome::default()
    }
}

fn collected(folder: &StudyFolder, study: &Study) -> Result<Outcome, Failure> {
    let found = collect(folder, study)?;
    let mut warnings = found.warnings.clone();
    let missing = found.size.tasks - found.size.done;
    if missing > 0 {
        warnings.push(format!(
            "{missing} of {} tasks have no result, {} of them set aside",
            found.size.tasks,
            found.set_aside.len()
        ));
    }
    Ok(Outcome {
        text: summary(&found, folder.path()),
        warnings,
        out: Some(folder.path().into()),
        ..Outcome::default()
    })
}

fn summary(found: &StudyFindings, folder: &Path) -> String {
    let size = found.size;
    let mut text = format!("{} of {} tasks, {} experiments\n", size.done, size.tasks, size.experiments);
    let named = |says: Sameness| -> Vec<&str> {
        found.common.iter().filter(|it| it.says == says).map(|it| it.name.as_str()).collect()
    };
    for (words, says) in [("the same in all", Sameness::Same), ("differs", Sameness::Differs)] {
        let names = named(says);
        if !names.is_empty() {
            let _ = writeln!(text, "{words}: {}", names.join(", "));
        }
    }
    for trend in &found.trends {
        let _ = writeln!(text, "{} follows {}, p {:.1e}", trend.name, trend.follows, trend.p);
    }
    for step in &found.to_settle {
        let _ = writeln!(text, "{}", step.question);
        step.commands.iter().for_each(|command| text += &format!("  {command}\n"));
    }
    for name in [TABLE, REPORT] {
        let _ = writeln!(text, "{}", folder.join(name).display());
    }
    text
}
