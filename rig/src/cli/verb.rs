//! The whole command line: options of all verbs, and the verbs.

use clap::{Parser, Subcommand};

use super::{
    Failure, Outcome, calibrate, campaign, daemon, design, diagnose, doctor, estop, experiment, export,
    extract, firmware, fit, import, job, jobs, jog, list, mock_board, mock_camera, new, packaging, preview,
    recalibrate, replay, run, runs, simulate, status, study, task,
};

/// Runs tank experiments: drives, films, extracts, fits, reports, replays.
#[derive(Parser, Debug)]
#[command(name = "rig", version, max_term_width = 110, help_template = super::help::template())]
pub struct Cli {
    /// Standard output is exactly one JSON object: status, out, run, verdict, warnings, error
    #[arg(long, global = true)]
    pub json: bool,
    /// Exit code 4 where there is a warning: images that are missing, things that could not be done
    #[arg(long, global = true)]
    pub strict: bool,
    /// More to read on standard error; twice for every detail
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// What to do
    #[command(subcommand)]
    pub verb: Verb,
}

/// What `rig` can do.
#[derive(Subcommand, Debug)]
pub enum Verb {
    /// Write a rig of your own: config and model, out of a few answers
    New(new::Args),
    /// Run the whole experiment: arm, drive or wait for the release, film, extract, fit, report
    Run(run::Args),
    /// Redo a recorded run, from any stage, into another folder
    Replay(replay::Args),
    /// Measure what a rig needs once: pixels to metres
    Calibrate(calibrate::Args),
    /// Images to keypoint trajectories
    Extract(extract::Args),
    /// Put run folders together into an experiment.toml
    Experiment(experiment::Args),
    /// Fit a model's parameters to an experiment
    Fit(fit::Args),
    /// Say what the simulation of an experiment gets wrong, and why
    Diagnose(diagnose::Args),
    /// Say which runs would tell more, and write their configs
    Design(design::Args),
    /// Run, fit, diagnose, design and run again, until what was asked is known
    Campaign(campaign::Args),
    /// Many experiments times variations, on this machine or a cluster, and what they say together
    Study(study::Args),
    /// Do one task of a study
    Task(task::Args),
    /// Move a model through time
    Simulate(simulate::Args),
    /// Bring the last good fit up to date with a run
    Recalibrate(recalibrate::Args),
    /// Do the jobs of one or several rigs, and run their experiments on schedule
    Daemon(daemon::Args),
    /// Look at the queue of jobs, add to it, cancel
    Jobs(jobs::Args),
    /// Show what the camera sees, with focus, light and flicker, on a page of this machine
    Preview(preview::Args),
    /// Check everything a run needs, and say what to do about the rest
    Doctor(doctor::Args),
    /// List serial ports and cameras, and why one cannot be used
    List(list::Args),
    /// Say who holds the rig, how the board is and how the last run went
    Status(status::Args),
    /// Move one servo by hand, slowly
    Jog(jog::Args),
    /// Write firmware to a servo board
    Firmware(firmware::Args),
    /// Stop the servo now, also from beside a running rig
    Estop(estop::Args),
    /// Let a rig move again that was stopped, in your name
    Release(estop::ReleaseArgs),
    /// A servo board behind a pseudo-terminal, as a process of its own
    MockBoard(mock_board::Args),
    /// A camera on the simulated tank, as a process of its own
    MockCamera(mock_camera::Args),
    /// Look at recorded runs
    Runs(runs::Args),
    /// Hand results to other programs
    Export(export::Args),
    /// Take over keypoints that other programs found
    Import(import::Args),
    /// Do what a daemon has ordered
    #[command(hide = true)]
    Job(job::Args),
    /// Write completions and man pages
    #[command(hide = true)]
    Packaging(packaging::Args),
}

impl Verb {
    /// Carries it out.
    ///
    /// # Errors
    /// As the verb's own `run`.
    pub fn carry_out(&self) -> Result<Outcome, Failure> {
        match self {
            Self::New(args) => new::run(args),
            Self::Run(args) => run::run(args),
            Self::Replay(args) => replay::run(args),
            Self::Calibrate(args) => calibrate::run(args),
            Self::Extract(args) => extract::run(args),
            Self::Experiment(args) => experiment::run(args),
            Self::Fit(args) => fit::run(args),
            Self::Diagnose(args) => diagnose::run(args),
            Self::Design(args) => design::run(args),
            Self::Campaign(args) => campaign::run(args),
            Self::Study(args) => study::run(args),
            Self::Task(args) => task::run(args),
            Self::Simulate(args) => simulate::run(args),
            Self::Recalibrate(args) => recalibrate::run(args),
            Self::Daemon(args) => daemon::run(args),
            Self::Jobs(args) => jobs::run(args),
            Self::Preview(args) => preview::run(args),
            Self::Doctor(args) => doctor::run(args),
            Self::List(args) => list::run(args),
            Self::Status(args) => status::run(args),
            Self::Jog(args) => jog::run(args),
            Self::Firmware(args) => firmware::run(args),
            Self::Estop(args) => estop::run(args),
            Self::Release(args) => estop::release(args),
            Self::MockBoard(args) => mock_board::run(args),
            Self::MockCamera(args) => mock_camera::run(args),
            Self::Runs(args) => runs::run(args),
            Self::Export(args) => export::run(args),
            Self::Import(args) => import::run(args),
            Self::Job(args) => job::run(args),
            Self::Packaging(args) => packaging::run(args),
        }
    }
}
