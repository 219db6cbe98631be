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
use rig::{Permissions, Rig};
pub use slots::next_slot;
use tokio::net::TcpListener;

/// Period of the daemon's loop; the delay of a stop that another process asks for. Chosen.
const LOOP_PERIOD: Duration = Duration::from_millis(20);

/// A daemon: its rigs, its server and its loop.
pub struct Daemon {
    rigs: Vec<Rig>,
    heartbeat: Arc<Heartbeat>,
    api: Option<(TcpListener, Api)>,
}

/// Time of the last pass of the daemon's loop: the age of the published states.
#[derive(Debug, Default)]
struct Heartbeat(AtomicU64);

impl Heartbeat {
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
    /// Address of the HTTP server; none: no server.
    pub listen: Option<SocketAddr>,
    /// Host names of the server in addition to those of the loopback.
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
        let heartbeat = Arc::new(Heartbeat::default());
        let api = match options.listen {
            Some(address) => Some(api(&rigs, address, &heartbeat, options, watcher).await?),
            None => None,
        };
        Ok(Self { rigs, heartbeat, api })
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
        self.rigs.iter().for_each(|rig| rig.report_next_run(Now::read(), watcher));
        let server = self.api.take().map(|(listener, api)| tokio::spawn(api.serve(listener)));
        let mut ticks = tokio::time::interval(LOOP_PERIOD);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let service = Service::from_env();
        service.ready();
        let mut reported = String::new();
        loop {
            tokio::select! {
                biased;
                () = interrupt.raised(), if !interrupt.is_raised() => {}
                _ = ticks.tick() => {}
            }
            service.alive();
            let ending = interrupt.is_raised();
            let status = if ending { "ending".into() } else { self.status_line() };
            if status != reported {
                if ending {
                    service.stopping();
                }
                service.status(&status);
                reported = status;
            }
            let motions = self.motions();
            let enough = max_runs != 0 && motions >= max_runs;
            for place in 0..self.rigs.len() {
                let computes = self.rigs.iter().any(Rig::computes);
                let may =
                    Permissions { move_: !ending && !enough, compute: !ending && !computes, end_all: ending };
                self.rigs[place].tick(Now::read(), may, watcher);
            }
            self.heartbeat.now();
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
            rig.log_end()?;
        }
        Ok(self.motions())
    }

    /// Who answers its requests, in the place of its server; none without one. For programs that ask within their own process.
    pub fn take_router(&mut self) -> Option<axum::Router> {
        self.api.take().map(|(_, api)| api.router())
    }

    /// The state of all rigs, for the service manager.
    fn status_line(&self) -> String {
        let each: Vec<String> = self.rigs.iter().map(Rig::status_line).collect();
        each.join("; ")
    }

    fn motions(&self) -> u64 {
        self.rigs.iter().map(Rig::motions_ended).sum()
    }
}

/// Opens the API of `rigs` at `address`, and reports the address and where the token is.
async fn api(
    rigs: &[Rig],
    address: SocketAddr,
    heartbeat: &Arc<Heartbeat>,
    options: &Options<'_>,
    watcher: &mut dyn Watcher,
) -> Result<(TcpListener, Api), Failure> {
    let listen = TcpListener::bind(address).await.and_then(|listener| Ok((listener.local_addr()?, listener)));
    let (address, listener) = listen
        .with_context(|| {
            format!("serving at {address}; choose another --listen, `127.0.0.1:0` for any that is free")
        })
        .map_err(Failure::Input)?;
    let token = Token::of(options.runs_dir, |text| watcher.alert(text)).map_err(Failure::input)?;
    let token_path = options.runs_dir.join(token::FILE);
    watcher.alert(&format!("rig: serving at http://{address}/, with the token in {}", token_path.display()));
    // the token itself only on a terminal: other output ends in logs that others may read
    if std::io::stderr().is_terminal() {
        watcher.alert(&format!("rig: the page with it: http://{address}/#token={}", token.text()));
    }
    for rig in rigs {
        rig.write("serving", json!({ "address": address.to_string() }))?;
    }
    let served = rigs.iter().map(|rig| rig.served(Arc::clone(heartbeat))).collect::<Result<_, _>>()?;
    Ok((listener, Api::new(served, token, address, options.hosts.to_vec())))
}
