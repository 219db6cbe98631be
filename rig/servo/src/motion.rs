//! What the servos of a rig are doing, judged by the board's events and by how long none came. The process that has the board writes it
//! ten times a second into `state.json` in the runs folder; every other program reads it there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;
use ground::in_place;

/// Name of the state file in the runs folder.
pub const STATE_FILE: &str = "state.json";
/// The motion is unknown when no event came from a board with power for this long \[s\], chosen: a little over two ping periods of a
/// bus.
const BOARD_SILENCE_LIMIT_S: f64 = 1.2;
/// A servo counts as moving for this long after its pulse or position changed \[s\], chosen.
const MOTION_HOLDOVER_S: f64 = 0.3;
/// Measured positions of a servo at rest differ by up to this much \[counts\], chosen.
const POSITION_JITTER_COUNTS: i32 = 3;
/// A report older than this says nothing about the present \[s\], chosen.
const REPORT_MAX_AGE_S: f64 = 1.0;

/// What the servos are doing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Nothing has power, or all was stopped.
    #[default]
    AtRest,
    /// A motion begins soon; nothing has power yet.
    Announced,
    /// Something has power: it may move at any instant.
    Armed,
    /// Something moves.
    Moving,
    /// No events come from the board.
    Unknown,
}

/// What the servos are doing, as other programs show it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, ToSchema)]
pub struct Standing {
    /// The motion.
    pub motion: Motion,
    /// Since when, UTC; with an unknown motion: when it was known last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub since: Option<String>,
    /// Time until an announced motion begins \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moves_in_s: Option<f64>,
    /// The process that has the board.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pid: Option<u32>,
}

impl Standing {
    /// Whether a hand in the tank might be hurt now.
    pub fn may_move(&self) -> bool {
        self.motion != Motion::AtRest
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let since = self.since.as_deref().map_or(String::new(), |since| format!(" since {since}"));
        match (self.motion, self.moves_in_s) {
            (Motion::AtRest, _) => write!(f, "at rest{since}"),
            (Motion::Announced, Some(in_s)) => write!(f, "move in {in_s:.0} s"),
            (Motion::Announced, None) => write!(f, "move soon"),
            (Motion::Armed, _) => write!(f, "have power{since}: they may move at any instant"),
            (Motion::Moving, _) => write!(f, "move{since}"),
            (Motion::Unknown, _) => write!(f, "unknown{since}: they may move"),
        }
    }
}

/// The content of the state file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Report {
    motion: Motion,
    since_ns: MonotonicNs,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    moves_at_ns: Option<MonotonicNs>,
    at_ns: MonotonicNs,
    /// Boot id of this computer, on whose clock these instants are.
    boot: String,
    pid: u32,
}

/// Writes what the servos of a rig do, where there is a runs folder to write it in.
#[derive(Debug, Clone, Default)]
pub struct Reporter {
    path: Option<PathBuf>,
}

impl Reporter {
    /// A reporter into the folder `runs_dir`.
    pub fn of(runs_dir: Option<&Path>) -> Self {
        let path = runs_dir.filter(|folder| folder.is_dir()).map(|folder| folder.join(STATE_FILE));
        Self { path }
    }

    /// Writes what the servos do and since when; an announced motion begins at `moves_at`. A report that cannot be written is dropped:
    /// readers see that the last one is old.
    pub fn report(&self, motion: Motion, since: MonotonicNs, moves_at: Option<MonotonicNs>) {
        let Some(path) = &self.path else { return };
        let report = Report {
            motion,
            since_ns: since,
            moves_at_ns: moves_at,
            at_ns: MonotonicNs::now(),
            boot: boot().into(),
            pid: std::process::id(),
        };
        let written = in_place::make(path, &report, 0o664).and_then(|()| in_place::write(path, &report));
        if let Err(error) = written {
            tracing::debug!("writing {}: {error}", path.display());
        }
    }
}

/// The boot id of this computer.
fn boot() -> &'static str {
    static BOOT: OnceLock<String> = OnceLock::new();
    BOOT.get_or_init(|| {
        let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id");
        id.unwrap_or_default().trim().into()
    })
}

/// What the servos of the rig whose runs are in `runs_dir` are doing. What is not known for certain is unknown: a file that cannot be
/// read, a report that is old and did not say that all is at rest.
pub fn standing(runs_dir: &Path) -> Standing {
    judged(in_place::read(&runs_dir.join(STATE_FILE)), boot(), MonotonicNs::now(), Timestamp::now())
}

fn judged(
    report: std::io::Result<Option<Report>>,
    boot: &str,
    now: MonotonicNs,
    clock: Timestamp,
) -> Standing {
    let report = match report {
        Ok(Some(report)) => report,
        Ok(None) => return Standing::default(),
        Err(_) => return Standing { motion: Motion::Unknown, ..Standing::default() },
    };
    let same_boot = report.boot == boot;
    let is_fresh = same_boot && now.seconds_since(report.at_ns) <= REPORT_MAX_AGE_S;
    let at = |then: MonotonicNs| {
        let ago = SignedDuration::from_millis((now.seconds_since(then) * 1e3) as i64);
        let at = clock.checked_sub(ago).ok().filter(|_| same_boot);
        at.map(|at| at.strftime("%Y-%m-%dT%H:%M:%SZ").to_string())
    };
    match report.motion {
        Motion::AtRest => Standing { since: at(report.since_ns), ..Standing::default() },
        _ if !is_fresh => {
            Standing { motion: Motion::Unknown, since: at(report.at_ns), ..Standing::default() }
        }
        motion => Standing {
            motion,
            since: at(report.since_ns),
            moves_in_s: report.moves_at_ns.map(|begins| begins.seconds_since(now).max(0.0)),
            pid: Some(report.pid),
        },
    }
}

/// Judges the motion of a board's servos by its events. No clock of its own: instants are handed in.
#[derive(Debug)]
pub struct MotionTracker {
    last_event: MonotonicNs,
    pulses: BTreeMap<u8, Option<u16>>,
    positions: BTreeMap<u8, i32>,
    changed: Option<MonotonicNs>,
    /// A motion was ordered: the servos have power, and move until then.
    ordered: Option<MonotonicNs>,
    plays: bool,
    stopped: Option<StopOutcome>,
    /// The motion that was returned last, and since when.
    reported: (Motion, MonotonicNs),
}

impl MotionTracker {
    /// A tracker of a board that was opened at `now`: nothing has power.
    pub fn new(now: MonotonicNs) -> Self {
        Self {
            last_event: now,
            pulses: BTreeMap::new(),
            positions: BTreeMap::new(),
            changed: None,
            ordered: None,
            plays: false,
            stopped: None,
            reported: (Motion::AtRest, now),
        }
    }

    /// Takes in an event that came from the board at `now`.
    pub fn observe(&mut self, event: &ServoEvent, now: MonotonicNs) {
        match event {
            ServoEvent::Note { .. } => return,
            ServoEvent::Ping { .. } => {}
            ServoEvent::Started { .. } => self.plays = true,
            ServoEvent::Finished { .. } => self.plays = false,
            &ServoEvent::Pulse { channel, pulse_us, .. } => {
                let before = self.pulses.insert(channel, pulse_us);
                if pulse_us.is_some() && before != Some(pulse_us) {
                    self.changed = Some(now);
                }
            }
            &ServoEvent::Position { channel, count, .. } => {
                let last_count = self.positions.entry(channel).or_insert(count);
                if last_count.abs_diff(count) > POSITION_JITTER_COUNTS.unsigned_abs() {
                    *last_count = count;
                    self.changed = Some(now);
                }
            }
        }
        self.last_event = now;
    }

    /// A motion was ordered: the board has power from now on, and moves until `until`.
    pub fn order(&mut self, until: MonotonicNs) {
        self.ordered = Some(until);
    }

    /// The board failed: nothing more is known of it.
    pub fn mark_lost(&mut self) {
        self.last_event = MonotonicNs(0);
    }

    /// The safe stop ended with `outcome`.
    pub fn stop(&mut self, outcome: StopOutcome) {
        self.stopped = Some(outcome);
    }

    /// The motion at `now`, and since when.
    pub fn motion(&mut self, now: MonotonicNs) -> (Motion, MonotonicNs) {
        let has_power = self.ordered.is_some() || self.pulses.values().any(Option::is_some);
        let changes = self.changed.is_some_and(|at| now.seconds_since(at) <= MOTION_HOLDOVER_S);
        let is_silent = now.seconds_since(self.last_event) > BOARD_SILENCE_LIMIT_S;
        let motion = match self.stopped {
            Some(StopOutcome::Acknowledged | StopOutcome::NotNeeded) => Motion::AtRest,
            Some(StopOutcome::LeftToDeadMan) => Motion::Unknown,
            None if is_silent && has_power => Motion::Unknown,
            None if self.plays || changes || self.ordered.is_some_and(|until| now < until) => Motion::Moving,
            None if has_power => Motion::Armed,
            None => Motion::AtRest,
        };
        if motion != self.reported.0 {
            self.reported = (motion, now);
        }
        self.reported
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> MonotonicNs {
        MonotonicNs(1_000_000_000_000).plus_seconds(seconds)
    }

    fn pulse(pulse_us: Option<u16>) -> ServoEvent {
        ServoEvent::Pulse { channel: 0, board_tick_us: 0, pulse_us }
    }

    #[test]
    fn events_of_a_board_are_rest_power_motion_and_rest_again() {
        let mut tracker = MotionTracker::new(at(0.0));
        let mut motion_after = |event: Option<ServoEvent>, s: f64| {
            event.iter().for_each(|event| tracker.observe(event, at(s)));
            tracker.motion(at(s)).0
        };
        assert_eq!(motion_after(Some(pulse(None)), 0.1), Motion::AtRest);
        assert_eq!(motion_after(Some(pulse(Some(1500))), 0.2), Motion::Moving, "it goes there");
        assert_eq!(motion_after(Some(pulse(Some(1500))), 0.6), Motion::Armed);
        assert_eq!(motion_after(Some(ServoEvent::Started { board_tick_us: 0 }), 0.7), Motion::Moving);
        assert_eq!(motion_after(Some(pulse(Some(1500))), 1.5), Motion::Moving, "the profile may pause");
        assert_eq!(motion_after(Some(ServoEvent::Finished { board_tick_us: 0 }), 1.6), Motion::Armed);
        assert_eq!(motion_after(None, 3.0), Motion::Unknown, "the line is silent");
        assert_eq!(motion_after(Some(pulse(Some(1500))), 3.1), Motion::Armed);
        tracker.stop(StopOutcome::Acknowledged);
        assert_eq!(tracker.motion(at(9.0)).0, Motion::AtRest);
    }

    #[test]
    fn stop_without_an_answer_and_a_lost_board_leave_the_motion_unknown() {
        let mut tracker = MotionTracker::new(at(0.0));
        tracker.order(at(2.0));
        assert_eq!(tracker.motion(at(1.0)), (Motion::Moving, at(1.0)));
        tracker.mark_lost();
        assert_eq!(tracker.motion(at(1.1)).0, Motion::Unknown);
        tracker.stop(StopOutcome::LeftToDeadMan);
        assert_eq!(tracker.motion(at(9.0)), (Motion::Unknown, at(1.1)));
    }

    #[test]
    fn old_report_is_unknown_unless_it_said_that_all_is_at_rest() {
        let report = |motion, s| Report {
            motion,
            since_ns: at(s - 5.0),
            moves_at_ns: None,
            at_ns: at(s),
            boot: "this".into(),
            pid: 7,
        };
        let clock: Timestamp = "2026-11-27T12:00:00Z".parse().unwrap();
        let judge = |report: Report| judged(Ok(Some(report)), "this", at(10.0), clock);
        let fresh = judge(report(Motion::Moving, 9.9));
        assert_eq!((fresh.motion, fresh.pid), (Motion::Moving, Some(7)));
        assert_eq!(fresh.since.as_deref(), Some("2026-11-27T11:59:54Z"));
        let old = judge(report(Motion::Armed, 7.0));
        assert_eq!((old.motion, old.since.as_deref()), (Motion::Unknown, Some("2026-11-27T11:59:57Z")));
        assert_eq!(judge(report(Motion::AtRest, 1.0)).motion, Motion::AtRest);
        let rebooted = Report { boot: "another".into(), ..report(Motion::Moving, 9.9) };
        assert_eq!(judge(rebooted), Standing { motion: Motion::Unknown, ..Standing::default() });
        assert_eq!(judged(Ok(None), "this", at(0.0), clock).motion, Motion::AtRest);
        let unreadable = Err(std::io::ErrorKind::InvalidData.into());
        assert_eq!(judged(unreadable, "this", at(0.0), clock).motion, Motion::Unknown);
    }

    #[test]
    fn report_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(standing(folder.path()).motion, Motion::AtRest);
        let reporter = Reporter::of(Some(folder.path()));
        let now = MonotonicNs::now();
        reporter.report(Motion::Announced, now, Some(now.plus_seconds(10.0)));
        let read = standing(folder.path());
        assert_eq!((read.motion, read.pid), (Motion::Announced, Some(std::process::id())));
        assert!((8.0..=10.0).contains(&read.moves_in_s.unwrap()), "{read:?}");
    }
}
