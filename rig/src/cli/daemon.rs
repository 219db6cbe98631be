//! `rig daemon`.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::progress::Bar;
use super::{Failure, Outcome};
use app::{interruptible, threads};
use daemon::{Daemon, Options};

/// Arguments of `rig daemon`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A rig config; several for several rigs, each of which moves independently of the others
    #[arg(required = true, value_name = "CONFIG")]
    pub configs: Vec<PathBuf>,
    /// Folder of run folders, of the queue and of the daemon's own journal; with several rigs each has a folder in it, called as
    /// its config
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Serve at this address over HTTP, for example 127.0.0.1:8071; only programs on this machine can reach 127.0.0.1. Off the
    /// loopback the token in `.token` of the runs folder is wanted for everything
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Option<SocketAddr>,
    /// A name by which the server is asked, where not 127.0.0.1 or localhost; may be given again
    #[arg(long = "host", value_name = "NAME", requires = "listen")]
    pub hosts: Vec<String>,
    /// End after so many runs; 0 for never
    #[arg(long, default_value_t = 0)]
    pub max_runs: u64,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Serves until a signal comes, or until `--max-runs` runs have ended.
///
/// # Errors
/// As [`Daemon::open`] and [`Daemon::serve`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let options = Options {
        configs: &args.configs,
        runs_dir: &args.runs_dir,
        threads: threads(args.threads),
        listen: args.listen,
        hosts: &args.hosts,
    };
    let runs = interruptible(async |interrupt| {
        let mut bar = Bar::new(interrupt.flag());
        Daemon::open(&options, &mut bar).await?.serve(args.max_runs, interrupt, &mut bar).await
    })?;
    Ok(Outcome { out: Some(args.runs_dir.clone()), text: format!("{runs} runs"), ..Outcome::default() })
}
