//! Ten thousand bad days on virtual time: stops, releases, kills, restarts, slots, jobs, clocks that are set and a database that somebody
//! holds, in any order. The daemon's own code decides, over its own queue and files; the board is the firmware's own state machine; a
//! job's process is played. No pin moves after a stop before a release.

mod full_disk;

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use firmware_protocol::board::{Board, BoardConfig, Hardware};
use firmware_protocol::command::Command;
use firmware_protocol::event::Fault;
use firmware_protocol::units::{Channel, DurationUs, Name, PulseWidthUs, Sequence, Ticks};
use jiff::{SignedDuration, Timestamp};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use rustix::process::Pid;

use super::{Permissions, Rig};
use crate::child::{Jobs, Running};
use analysis::Progress;
use app::{Failure, HELD, Watcher};
use config::RigConfig;
use ground::clock::{MonotonicNs, Now};
use ground::hold::{Hold, Latch};
use record::run_id::RunId;
use servo::motion::{Motion, Reporter, standing};
use store::Store;
use store::fixtures;
use store::job::{Job, JobId, JobResult, Lane, NewJob, State, Work};

/// A job's process looks at the latch so often, and the world goes on in such steps \[ms\].
const STEP_MS: i64 = 10;
/// The daemon looks every so many steps.
const STEPS_PER_TICK: i64 = 3;
/// From a stop until no pin moves any more \[ms\], where whoever moves it lives.
const MOST_MS: i64 = 100;
/// The board's patience with a host that was killed \[ms\].
const DEAD_MAN_MS: i64 = 250;
const CASES: u32 = 10_000;
const THREADS: u32 = 2;

#[derive(Debug, Clone)]
enum Act {
    /// Somebody adds a run, or a campaign of two.
    Queue {
        motions: u8,
    },
    /// By the page: with the signal, or with a signal that is lost.
    Stop {
        signal: bool,
    },
    /// By `rig estop`, which needs no daemon.
    EStop,
    Release,
    CancelAll,
    KillDaemon,
    StartDaemon,
    KillJob,
    /// The clock on the wall is set by so many seconds.
    SetClock(i64),
    /// Another process holds the database, or lets go of it.
    Lock(bool),
}

fn acts() -> impl Strategy<Value = Vec<(u16, Act)>> {
    let act = prop_oneof![
        4 => (1..3_u8).prop_map(|motions| Act::Queue { motions }),
        3 => any::<bool>().prop_map(|signal| Act::Stop { signal }),
        2 => Just(Act::EStop),
        3 => Just(Act::Release),
        1 => Just(Act::CancelAll),
        2 => Just(Act::KillDaemon),
        3 => Just(Act::StartDaemon),
        1 => Just(Act::KillJob),
        1 => prop_oneof![Just(3600), Just(-3600), Just(365 * 86_400), Just(-365 * 86_400)].prop_map(Act::SetClock),
        2 => any::<bool>().prop_map(Act::Lock),
    ];
    let pause_ms = prop_oneof![Just(0_u16), Just(20), Just(60), Just(150), Just(300)];
    proptest::collection::vec((pause_ms, act), 4..10)
}

/// The board and its pins.
struct Pins {
    at_ms: i64,
    /// When a pulse was last given or changed \[ms\].
    moved_ms: Option<i64>,
}

impl Hardware for Pins {
    fn pulse(&mut self, _: Channel, pulse: Option<PulseWidthUs>, _: Ticks) {
        if pulse.is_some() {
            self.moved_ms = Some(self.at_ms);
        }
    }

    fn send(&mut self, _: &[u8]) {}
}

/// Where a job's process is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Not yet at the board.
    Starts(i64),
    /// The servo has power.
    Moves(i64),
    /// Stopped by itself; soon it says whether anybody else did.
    Stopped(i64),
    Computes(i64),
    Over,
}

/// A job's process.
struct Process {
    id: JobId,
    lane: Lane,
    phase: Phase,
    motions: u8,
    moved: bool,
    asked: bool,
    said: Option<(State, JobResult)>,
}

/// All that is not the daemon.
struct World {
    runs_dir: PathBuf,
    latch: Latch,
    config: RigConfig,
    board: Board<8>,
    pins: Pins,
    processes: Vec<Process>,
    now_ms: i64,
    sequence: u16,
}

impl World {
    fn tick(&self) -> Ticks {
        Ticks((self.now_ms * 1000) as u32)
    }

    fn tell_board(&mut self, command: &Command) {
        self.sequence = self.sequence.wrapping_add(1);
        let line = command.encode(Sequence(self.sequence)).encode();
        let tick = self.tick();
        self.board.receive(&line, tick, &mut self.pins);
    }

    fn report(&self, motion: Motion) {
        Reporter::of(Some(&self.runs_dir)).report(motion, MonotonicNs::now(), None);
    }

    /// As a board is opened: what somebody has stopped stays so.
    fn open_board(&mut self) -> bool {
        if self.latch.held().is_some() {
            return false;
        }
        self.tell_board(&Command::Hello);
        match self.board.fault() {
            Fault::None => {}
            fault @ (Fault::DeadMan | Fault::HostRestarted) => self.tell_board(&Command::Acknowledge(fault)),
            _ => {
                self.latch.hold(&Hold::now("the servo board", "its emergency stop")).unwrap();
                return false;
            }
        }
        let channel = self.config.servo.as_ref().unwrap().channels[0].to_wire().unwrap();
        self.tell_board(&Command::Configure(channel));
        true
    }

    fn power(&mut self) {
        for (pulse, ms) in [(1200, 0), (1800, 2000)] {
            let duration = DurationUs(ms * 1000);
            self.tell_board(&Command::Jog { channel: Channel(0), pulse: PulseWidthUs(pulse), duration });
        }
        self.report(Motion::Moving);
    }

    fn step_process(&mut self, place: usize) {
        let (phase, asked) = (self.processes[place].phase, self.processes[place].asked);
        let now = self.now_ms;
        let result = |status: &str| JobResult { status: Some(status.into()), ..JobResult::default() };
        let over = |state, status| (Phase::Over, Some((state, result(status))));
        let (next, said) = match phase {
            Phase::Starts(_) if asked => over(State::Cancelled, "interrupted"),
            Phase::Starts(until) if now >= until => {
                if self.processes[place].lane == Lane::Analysis {
                    (Phase::Computes(now + 50), None)
                } else if self.open_board() {
                    self.power();
                    self.processes[place].moved = true;
                    (Phase::Moves(now + 300), None)
                } else if self.processes[place].moved {
                    over(State::Failed, HELD)
                } else {
                    over(State::Queued, HELD)
                }
            }
            Phase::Moves(until) if asked || now >= until || self.latch.held().is_some() => {
                self.tell_board(&Command::EStop);
                self.report(Motion::AtRest);
                (Phase::Stopped(now + 100), None)
            }
            Phase::Stopped(until) if now >= until => {
                if self.latch.held().is_none() {
                    self.tell_board(&Command::Acknowledge(Fault::EStop));
                }
                self.tell_board(&Command::Goodbye);
                self.processes[place].motions -= 1;
                if asked {
                    over(State::Cancelled, "interrupted")
                } else if self.processes[place].motions > 0 {
                    (Phase::Starts(now + 50), None)
                } else {
                    (Phase::Computes(now + 100), None)
                }
            }
            Phase::Moves(_) | Phase::Stopped(_) => {
                self.tell_board(&Command::Ping);
                (phase, None)
            }
            Phase::Computes(_) if asked => over(State::Cancelled, "interrupted"),
            Phase::Computes(until) if now >= until => over(State::Done, "done"),
            Phase::Starts(_) | Phase::Computes(_) | Phase::Over => (phase, None),
        };
        self.processes[place].phase = next;
        if said.is_some() {
            self.processes[place].said = said;
        }
    }

    fn step(&mut self) {
        self.now_ms += STEP_MS;
        self.pins.at_ms = self.now_ms;
        let tick = self.tick();
        self.board.advance(tick, &mut self.pins);
        (0..self.processes.len()).for_each(|place| self.step_process(place));
    }

    fn process(&mut self, id: JobId) -> Option<&mut Process> {
        self.processes.iter_mut().find(|process| process.id == id)
    }

    fn moves(&self) -> bool {
        self.processes.iter().any(|process| matches!(process.phase, Phase::Moves(_) | Phase::Stopped(_)))
    }
}

struct Played(Rc<RefCell<World>>);

struct PlayedJob(Rc<RefCell<World>>, JobId);

impl Jobs for Played {
    fn start(&mut self, job: &Job, _: JobId) -> Result<Box<dyn Running>, Failure> {
        let mut world = self.0.borrow_mut();
        let motions = if matches!(job.work, Work::Campaign { .. }) { 2 } else { 1 };
        let phase = Phase::Starts(world.now_ms + 30);
        let (id, lane) = (job.id, job.work.lane());
        world.processes.push(Process { id, lane, phase, motions, moved: false, asked: false, said: None });
        Ok(Box::new(PlayedJob(Rc::clone(&self.0), id)))
    }

    fn adopt(&mut self, job: &Job) -> Option<Box<dyn Running>> {
        let lives = self.0.borrow_mut().process(job.id).is_some();
        lives.then(|| Box::new(PlayedJob(Rc::clone(&self.0), job.id)) as Box<dyn Running>)
    }

    fn clear_up(&mut self) {
        let mut world = self.0.borrow_mut();
        let tick = world.tick();
        let world = &mut *world;
        world.board.advance(tick, &mut world.pins);
        if world.board.fault() != Fault::None && !world.moves() {
            world.report(Motion::AtRest);
        }
    }

    fn is_clearing_up(&self) -> bool {
        false
    }

    fn take_recovered_runs(&mut self) -> Vec<(RunId, String)> {
        Vec::new()
    }
}

impl Running for PlayedJob {
    fn id(&self) -> JobId {
        self.1
    }

    fn pid(&self) -> Pid {
        // nobody's: what is signalled here is signalled by hand
        Pid::from_raw(i32::MAX).unwrap()
    }

    fn end(&mut self) {
        if let Some(process) = self.0.borrow_mut().process(self.1) {
            process.asked = true;
        }
    }

    fn ended(&mut self) -> Result<Option<(State, JobResult)>, Failure> {
        Ok(match self.0.borrow_mut().process(self.1) {
            None => Some((State::Lost, JobResult::default())),
            Some(process) => process.said.clone(),
        })
    }
}

struct Nobody;

impl Watcher for Nobody {
    fn status(&mut self, _: String) {}
    fn event(&mut self, _: &str) {}
    fn alert(&mut self, _: &str) {}
    fn clear(&mut self) {}
}

impl ident::fit::Observer for Nobody {
    fn progress(&mut self, _: &ident::fit::Progress<'_>) -> ident::fit::Flow {
        ident::fit::Flow::Continue
    }
}

impl ident::diagnose::Observer for Nobody {
    fn stage(&mut self, _: &str) -> bool {
        true
    }
}

impl Progress for Nobody {
    fn begin(&mut self, _: &str, _: Option<u64>) {}
    fn step(&mut self, _: u64) {}
}

/// A day.
struct Day {
    world: Rc<RefCell<World>>,
    rig: Option<Rig>,
    config: (PathBuf, RigConfig),
    wall: Timestamp,
    set_by: SignedDuration,
    /// A person's own connection to the queue, and whoever holds the database.
    person: Store,
    locked: bool,
    /// When the rig was stopped, until it is released \[ms\].
    stopped_ms: Option<i64>,
    /// Until when a board that was left by a killed process may move \[ms\].
    left_ms: i64,
    steps: i64,
}

impl Day {
    fn now(&self) -> Now {
        let boot = SignedDuration::from_millis(self.world.borrow().now_ms);
        Now { wall: self.wall + boot + self.set_by, boot }
    }

    fn start_daemon(&mut self) {
        let runs_dir = self.world.borrow().runs_dir.clone();
        let Ok(store) = fixtures::open_at_once(&runs_dir) else { return };
        let jobs = Box::new(Played(Rc::clone(&self.world)));
        let (path, config) = self.config.clone();
        let Ok(mut rig) = Rig::new(path, config, runs_dir, store, jobs, self.now()) else { return };
        if rig.take_over(&mut Nobody).is_ok() {
            self.rig = Some(rig);
        }
    }

    fn step(&mut self) -> Result<(), TestCaseError> {
        self.world.borrow_mut().step();
        self.steps += 1;
        let now = self.now();
        if self.steps % STEPS_PER_TICK == 0
            && let Some(rig) = &mut self.rig
        {
            rig.tick(now, Permissions { move_: true, compute: true, end_all: false }, &mut Nobody);
        }
        let world = self.world.borrow();
        if let (Some(stopped), Some(moved)) = (self.stopped_ms, world.pins.moved_ms) {
            let latest = (stopped + MOST_MS).max(self.left_ms);
            prop_assert!(moved <= latest, "a pin moved {} ms after the stop", moved - stopped);
        }
        Ok(())
    }

    fn act(&mut self, act: &Act) {
        let stopped = |day: &mut Self| {
            let now = day.world.borrow().now_ms;
            day.stopped_ms.get_or_insert(now);
        };
        match *act {
            Act::Queue { motions } => {
                let config = self.config.0.clone();
                let work = match motions {
                    1 => Work::Run { config, film_only: true },
                    _ => Work::Campaign { config, goals: Vec::new(), max_runs: 2 },
                };
                // a database that is held takes nothing
                let _ = self.person.add(&NewJob::new(work));
            }
            Act::Stop { signal } => {
                let Some(rig) = &self.rig else { return };
                rig.stop.request(Hold::now("the page", "a hand in the tank"));
                rig.stop.write(std::time::Duration::ZERO).unwrap();
                if signal && standing(&rig.runs_dir).may_move() {
                    self.world.borrow_mut().processes.iter_mut().for_each(|process| process.asked = true);
                }
                stopped(self);
            }
            Act::EStop => {
                let mut world = self.world.borrow_mut();
                world.latch.hold(&Hold::now("rig estop", "a hand in the tank")).unwrap();
                if !world.moves() {
                    world.tell_board(&Command::EStop);
                }
                drop(world);
                stopped(self);
            }
            Act::Release => {
                let mut world = self.world.borrow_mut();
                // whoever still has the port is waited for
                if world.moves() {
                    return;
                }
                world.tell_board(&Command::Hello);
                let fault = world.board.fault();
                world.tell_board(&Command::Acknowledge(fault));
                world.tell_board(&Command::Goodbye);
                world.latch.release("Ada").unwrap();
                world.pins.moved_ms = None;
                drop(world);
                if let Some(rig) = &self.rig {
                    rig.stop.forget();
                }
                self.stopped_ms = None;
            }
            Act::CancelAll => drop(self.person.cancel_waiting("enough")),
            Act::KillDaemon => self.rig = None,
            Act::StartDaemon if self.rig.is_none() => self.start_daemon(),
            Act::StartDaemon => {}
            Act::KillJob => {
                let mut world = self.world.borrow_mut();
                if world.moves() {
                    self.left_ms = world.now_ms + DEAD_MAN_MS + STEP_MS;
                }
                world.processes.clear();
            }
            Act::SetClock(seconds) => self.set_by += SignedDuration::from_secs(seconds),
            Act::Lock(lock) if lock != self.locked => {
                self.locked = lock;
                fixtures::hold(&self.person, lock);
            }
            Act::Lock(_) => {}
        }
    }
}

/// A day that begins in `runs_dir` with a daemon and nothing to do.
fn begun(runs_dir: &Path, config: &(PathBuf, RigConfig)) -> Day {
    let person = fixtures::open_at_once(runs_dir).unwrap();
    fixtures::forget_all(&person);
    // what other days have written is not read again
    let _ = std::fs::remove_file(runs_dir.join(super::JOURNAL));
    let latch = Latch::of(Some(runs_dir), None);
    latch.make_room().unwrap();
    latch.release("nobody").unwrap();
    Reporter::of(Some(runs_dir)).report(Motion::AtRest, MonotonicNs::now(), None);
    let firmware = Name::new("the test's").unwrap();
    let board = BoardConfig { boot_id: 1, channels: 1, firmware, fault: Fault::None };
    let world = World {
        runs_dir: runs_dir.into(),
        latch,
        config: config.1.clone(),
        board: Board::new(board, Ticks(0)),
        pins: Pins { at_ms: 0, moved_ms: None },
        processes: Vec::new(),
        now_ms: 0,
        sequence: 0,
    };
    let mut day = Day {
        world: Rc::new(RefCell::new(world)),
        rig: None,
        config: config.clone(),
        wall: "2026-11-27T12:00:00Z".parse().unwrap(),
        set_by: SignedDuration::ZERO,
        person,
        locked: false,
        stopped_ms: None,
        left_ms: 0,
        steps: 0,
    };
    day.start_daemon();
    day
}

fn day(runs_dir: &Path, config: &(PathBuf, RigConfig), acts: &[(u16, Act)]) -> Result<u32, TestCaseError> {
    let mut day = begun(runs_dir, config);
    let mut stops_in_motion = 0;
    for (pause_ms, act) in acts {
        for _ in 0..i64::from(*pause_ms) / STEP_MS {
            day.step()?;
        }
        let moved = day.world.borrow().moves();
        let was_free = day.stopped_ms.is_none();
        day.act(act);
        stops_in_motion += u32::from(moved && was_free && day.stopped_ms.is_some());
    }
    // whatever was to come of it has come by then
    for _ in 0..15 {
        day.step()?;
    }
    if day.locked {
        fixtures::hold(&day.person, false);
    }
    Ok(stops_in_motion)
}

/// A run every four seconds, on a board whose servo is driven within this program.
fn config() -> (PathBuf, RigConfig) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-hanging.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let more =
        "[motion]\nfailures_to_hold = 3\n[schedule]\ncron = \"*/4 * * * * *\"\ntime_zone = \"UTC\"\n[water]";
    let config = RigConfig::parse(&text.replace("[water]", more), &path).unwrap();
    (path, config)
}

#[test]
fn no_pin_moves_after_a_stop_before_a_release_on_ten_thousand_bad_days() {
    let config = config();
    let stops: u32 = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..THREADS)
            .map(|thread| {
                let config = &config;
                scope.spawn(move || {
                    let folder = tempfile::tempdir_in(quick_folder()).unwrap();
                    let cases =
                        Config { cases: CASES / THREADS, failure_persistence: None, ..Config::default() };
                    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[thread as u8 + 1; 32]);
                    let stops = std::cell::Cell::new(0);
                    let result = TestRunner::new_with_rng(cases, rng).run(&acts(), |acts| {
                        stops.set(stops.get() + day(folder.path(), config, &acts)?);
                        Ok(())
                    });
                    result.unwrap_or_else(|error| panic!("{error}"));
                    stops.get()
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).sum()
    });
    println!("{stops} stops while a servo moved");
    assert!(stops > CASES / 20, "{stops} stops while a servo moved: these days are too good");
}

/// A folder in memory, where the machine has one: what is forced to the disk then costs nothing.
fn quick_folder() -> PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { memory.into() } else { std::env::temp_dir() }
}
