//! The daemon: jobs of one or several rigs, each from its queue or its schedule, one motion at a time on each rig.
//!
//! - `rig`: one rig's queue, schedule and running jobs;
//! - `slots`: when the schedule wants a run;
//! - `stop`: from a request to stop to whoever moves a rig;
//! - `child`: a job as a process of its own;
//! - `alerts`, `webhook`: whom it tells that somebody should look;
//! - `state`, `api`: what the rigs do, and all of it over HTTP.
//!
//! What a job is and how it went stands in [`store`]; whoever can open that may add jobs and cancel them, the daemon sees it.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

mod alerts;
mod api;
mod child;
mod rig;
pub mod service;
mod slots;
mod state;
mod stop;
pub mod web;
mod webhook;

use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use serde_json::json;

use crate::service::Service;
use api::Api;
use api::token::{self, Token};
use app::{Failure, Interrupt, Watcher};
use ground::clock::{MonotonicNs, Now};
use ground::urgency::give_way_to_the_kernel;
use rig::{May, Rig};
pub use slots::next_slot;
use tokio::net::TcpListener;

/// Queues, jobs and clock are looked at so often: a stop that is asked for is on its way within this time.
const TICK: Duration = Duration::from_millis(20);

/// A daemon: its rigs, its server and its loop.
pub struct Daemon {
    rigs: Vec<Rig>,
    beat: Arc<Beat>,
    api: Option<(TcpListener, Api)>,
}

/// When the loop that looks after the rigs came by last: what is told of them is no older.
#[derive(Debug, Default)]
struct Beat(AtomicU64);

impl Beat {
    fn now(&self) {
        self.0.store(MonotonicNs::now().0, Ordering::Relaxed);
    }

    /// How long ago that was \[s\].
    fn age_s(&self) -> f64 {
        MonotonicNs::now().seconds_since(MonotonicNs(self.0.load(Ordering::Relaxed)))
    }
}

/// What a daemon is asked to do.
#[derive(Debug)]
pub struct Options<'a> {
    /// A config for each rig.
    pub configs: &'a [PathBuf],
    /// The folder of run folders; of several rigs, each has a folder in it, called as its config.
    pub runs_dir: &'a Path,
    /// Worker threads of each job.
    pub threads: usize,
    /// Where it is served over HTTP; none: nowhere.
    pub listen: Option<SocketAddr>,
    /// Names by which the server is asked, beside those of the loopback.
    pub hosts: &'a [String],
}

impl Daemon {
    /// Opens all rigs.
    ///
    /// # Errors
    /// [`Failure::Input`] for a config or schedule that cannot be used, two configs of one name, or a folder that another daemon has.
    pub async fn open(options: &Options<'_>, watcher: &mut dyn Watcher) -> Result<Self, Failure> {
        give_way_to_the_kernel();
        let mut names: Vec<&std::ffi::OsStr> =
            options.configs.iter().filter_map(|path| path.file_stem()).collect();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Failure::Input(anyhow!(
                "two configs are called {}: a rig's runs are in a folder of that name; rename one",
                pair[0].display()
            )));
        }
        let folder = |config: &Path| match options.configs {
            [_] => options.runs_dir.to_owned(),
            _ => options.runs_dir.join(config.file_stem().unwrap_or_default()),
        };
        let open = |config: &PathBuf| Rig::open(config, &folder(config), options.threads, watcher);
        let rigs: Vec<Rig> = options.configs.iter().map(open).collect::<Result<_, _>>()?;
        let beat = Arc::new(Beat::default());
        let api = match options.listen {
            Some(address) => Some(api(&rigs, address, &beat, options, watcher).await?),
            None => None,
        };
        Ok(Self { rigs, beat, api })
    }

    /// Serves until a signal comes, or until `max_runs` motions have ended and what follows from them is computed. Gives how many
    /// motions there were.
    ///
    /// # Errors
    /// [`Failure::Internal`] where the journals cannot be written at the end.
    pub async fn serve(
        mut self,
        max_runs: u64,
        interrupt: &Interrupt,
        watcher: &mut dyn Watcher,
    ) -> Result<u64, Failure> {
        self.rigs.iter().for_each(|rig| rig.say_next(Now::read(), watcher));
        let server = self.api.take().map(|(listener, api)| tokio::spawn(api.serve(listener)));
        let mut ticks = tokio::time::interval(TICK);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let service = Service::from_env();
        service.ready();
        let mut said = String::new();
        loop {
            tokio::select! {
                biased;
                () = interrupt.raised(), if !interrupt.is_raised() => {}
                _ = ticks.tick() => {}
            }
            service.alive();
            let ending = interrupt.is_raised();
            let says = if ending { "ending".into() } else { self.says() };
            if says != said {
                if ending {
                    service.stopping();
                }
                service.status(&says);
                said = says;
            }
            let motions = self.motions();
            let enough = max_runs != 0 && motions >= max_runs;
            for place in 0..self.rigs.len() {
                let computes = self.rigs.iter().any(Rig::computes);
                let may = May { move_: !ending && !enough, compute: !ending && !computes, end_all: ending };
                self.rigs[place].tick(Now::read(), may, watcher);
            }
            self.beat.now();
            let over = match (ending, enough) {
                (true, _) => self.rigs.iter().all(Rig::has_ended),
                (false, true) => self.rigs.iter().all(Rig::is_idle),
                _ => false,
            };
            if over {
                break;
            }
        }
        if let Some(server) = server {
            server.abort();
        }
        for rig in &self.rigs {
            rig.say_end()?;
        }
        Ok(self.motions())
    }

    /// What the rigs do, for who asks the service manager.
    fn says(&self) -> String {
        let each: Vec<String> = self.rigs.iter().map(Rig::says).collect();
        each.join("; ")
    }

    fn motions(&self) -> u64 {
        self.rigs.iter().map(Rig::motions_ended).sum()
    }
}

/// Listens at `address` for questions about `rigs`; tells where, and where the token is.
async fn api(
    rigs: &[Rig],
    address: SocketAddr,
    beat: &Arc<Beat>,
    options: &Options<'_>,
    watcher: &mut dyn Watcher,
) -> Result<(TcpListener, Api), Failure> {
    let listen = TcpListener::bind(address).await.and_then(|listener| Ok((listener.local_addr()?, listener)));
    let (address, listener) = listen
        .with_context(|| {
            format!("serving at {address}; choose another --listen, `127.0.0.1:0` for any that is free")
        })
        .map_err(Failure::Input)?;
    let token = Token::of(options.runs_dir, |text| watcher.tell(text)).map_err(Failure::input)?;
    let kept = options.runs_dir.join(token::FILE);
    watcher.tell(&format!("rig: serving at http://{address}/, with the token in {}", kept.display()));
    // what is told elsewhere than at a terminal is kept, in journals and logs that others read
    if std::io::stderr().is_terminal() {
        watcher.tell(&format!("rig: the page with it: http://{address}/#token={}", token.text()));
    }
    for rig in rigs {
        rig.write("serving", json!({ "address": address.to_string() }))?;
    }
    let served = rigs.iter().map(|rig| rig.served(Arc::clone(beat))).collect::<Result<_, _>>()?;
    Ok((listener, Api::new(served, token, address, options.hosts.to_vec())))
}
