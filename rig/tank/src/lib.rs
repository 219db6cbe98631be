//! The simulated tank behind mock board and mock camera: the board's pulses move it, the camera looks at it.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod causes;
pub mod config;
mod error;
mod motion;
pub mod render;
pub mod scene;
mod servo;
mod sync_led;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ::servo::PulseSink;
pub use config::TankConfig;
pub use error::TankError;
use ground::clock::MonotonicNs;
use motion::{Event, Motion};
use sync_led::SyncLed;

/// How long a picture waits for the pulses of a board that a busy machine holds up \[s\], chosen.
const PULSE_WAIT_LIMIT_S: f64 = 1.0;
/// Time between two looks for these pulses, chosen.
const PULSE_WAIT_STEP: Duration = Duration::from_millis(1);
/// Value of `complete_ns` in a tank that no board in this process moves.
const NO_BOARD_NS: u64 = u64::MAX;

/// The live tank, shared by mock board and mock camera: clones are the same tank.
///
/// Its mechanism moves on CLOCK_MONOTONIC; the motion is computed when its position is asked for. The same pulses give the same motion.
#[derive(Debug, Clone)]
pub struct Tank {
    shared: Arc<Mutex<Shared>>,
    config: Arc<TankConfig>,
    model: Arc<sim::Model>,
    /// Events since the motion was last computed. These and the LED have locks of their own, so that the board, which reports them, never
    /// waits for a simulation.
    pending_events: Arc<Mutex<Vec<(MonotonicNs, Event)>>>,
    sync_led: Arc<Mutex<SyncLed>>,
    /// Until when the board's pulses are known.
    complete_ns: Arc<AtomicU64>,
}

#[derive(Debug)]
struct Shared {
    motion: Motion,
    run_origin: Option<MonotonicNs>,
}

impl Tank {
    /// Fills a tank as `config` says, from now on; a relative model path starts at `folder`.
    ///
    /// # Errors
    /// [`TankError`] naming the file or option at fault.
    pub fn new(config: &TankConfig, folder: &Path) -> Result<Self, TankError> {
        let path = folder.join(&config.model);
        let mut model = sim::Model::read_mjcf(&path)
            .map_err(|source| TankError::Model { path, source: source.into() })?;
        causes::add_to_model(&mut model, &config.causes)?;
        let motion = Motion::new(model.clone(), config, MonotonicNs::now())?;
        Ok(Self {
            shared: Arc::new(Mutex::new(Shared { motion, run_origin: None })),
            config: Arc::new(config.clone()),
            model: Arc::new(model),
            pending_events: Arc::default(),
            sync_led: Arc::default(),
            complete_ns: Arc::new(AtomicU64::new(NO_BOARD_NS)),
        })
    }

    /// The tank that the folder `folder` describes in its `tank.toml`.
    ///
    /// # Errors
    /// [`TankError`].
    pub fn read(folder: &Path) -> Result<Self, TankError> {
        Self::new(&ground::strict::read(&folder.join("tank.toml"))?, folder)
    }

    /// The tank's configuration.
    pub fn config(&self) -> &TankConfig {
        &self.config
    }

    /// The mechanism in it.
    pub fn model(&self) -> &sim::Model {
        &self.model
    }

    /// A run begins at `origin`: faults of the mock camera are timed from there.
    pub fn begin_run(&self, origin: MonotonicNs) {
        self.lock().run_origin = Some(origin);
    }

    /// When the run began, if one did.
    pub fn run_origin(&self) -> Option<MonotonicNs> {
        self.lock().run_origin
    }

    /// Asks, at `at`, for the mechanism to be let go, which happens `[tank.release] after_s` later.
    pub fn ask_release(&self, at: MonotonicNs) {
        let at = at.plus_seconds(self.config.release.after_s.get());
        self.add_event(at, Event::LetGo);
    }

    /// Coordinates of the mechanism at `at`, as in its model's `qpos`.
    ///
    /// # Errors
    /// [`TankError::Simulation`] when the simulation diverges.
    pub fn qpos(&self, at: MonotonicNs) -> Result<Vec<f64>, TankError> {
        let mut shared = self.lock();
        let events = std::mem::take(&mut *self.pending_events());
        for (at, event) in events {
            shared.motion.add_event(at, event);
        }
        shared.motion.qpos(at)
    }

    /// For what share of the time from `from` to `until` the board's sync LED was lit.
    pub fn lit_share(&self, from: MonotonicNs, until: MonotonicNs) -> f64 {
        self.led().lit_share(from, until)
    }

    /// Waits, for a limited time, until all pulses before `at` are known. Otherwise a picture taken while the board's thread is held up
    /// would show a servo that stands still.
    pub fn await_pulses(&self, at: MonotonicNs) {
        let deadline = MonotonicNs::now().plus_seconds(PULSE_WAIT_LIMIT_S);
        while self.complete_ns.load(Ordering::Acquire) < at.0 && MonotonicNs::now() < deadline {
            std::thread::sleep(PULSE_WAIT_STEP);
        }
    }

    fn add_event(&self, at: MonotonicNs, event: Event) {
        self.pending_events().push((at, event));
    }

    fn pending_events(&self) -> MutexGuard<'_, Vec<(MonotonicNs, Event)>> {
        self.pending_events.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn led(&self) -> MutexGuard<'_, SyncLed> {
        self.sync_led.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PulseSink for Tank {
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs) {
        self.add_event(at, Event::Pulse { channel, pulse_us });
    }

    fn sync_led(&mut self, lit: bool, at: MonotonicNs) {
        self.led().turn(lit, at);
    }

    fn position(&mut self, channel: u8, position_counts: Option<f64>, at: MonotonicNs) {
        self.add_event(at, Event::Position { channel, counts: position_counts });
    }

    fn complete(&mut self, until: MonotonicNs) {
        self.complete_ns.store(until.0, Ordering::Release);
    }
}
