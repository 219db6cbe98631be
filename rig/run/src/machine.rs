//! The run as a state machine: events go in, actions come out. No clocks, threads or devices here,
//! so every path to the safe stop is tested in virtual time.

use serde::{Deserialize, Serialize};

use config::MotionKind;
use ground::clock::MonotonicNs;

/// How a run ended, as `stop.json` says it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", content = "reason", rename_all = "lowercase")]
pub enum Ending {
    /// Everything asked for was filmed.
    Success,
    /// A person ended it.
    Abort(String),
    /// A device failed.
    Fail(String),
}

/// What a run waits for and for how long.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Driven by the servo, or let go by hand.
    pub kind: MotionKind,
    /// How long the servo takes to the start of its profile \[s\]; stillness before that does not count.
    pub approach_s: f64,
    /// Stillness wanted before motion \[s\].
    pub settle_s: f64,
    /// How long filming goes on after the profile's end or the release \[s\].
    pub film_s: f64,
    /// Length of the profile \[s\]; 0 for a drop.
    pub profile_s: f64,
    /// How far ahead of now the board is armed \[s\].
    pub lead_s: f64,
    /// Longest wait for the release, and for stillness \[s\].
    pub release_timeout_s: f64,
    /// Share of changed pixels below which the picture is still.
    pub still_share: f64,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Time passes.
    Tick,
    /// An image came.
    Image {
        /// Whether its bytes equal those of the image before.
        identical: bool,
    },
    /// Share of the pixels that changed within about 0.1 s.
    Changed(f64),
    /// The board began the profile.
    Started,
    /// The board reached the profile's end.
    Finished,
    /// Camera, board or recording failed.
    Fault(String),
    /// Ctrl-C, SIGTERM or a hold, in words.
    Interrupted(String),
}

/// Something to do.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Upload the profile and arm it for this instant.
    Arm(MonotonicNs),
    /// Ask the person at the tank to let go.
    AskForRelease,
    /// Write this entry into the journal.
    Journal(&'static str),
    /// Stop the servo, then everything else.
    Stop(Ending),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Waiting for the picture to be still, since the given instant.
    Settling { still_since: Option<MonotonicNs> },
    /// The board waits for its start tick.
    Armed { start: MonotonicNs },
    /// The profile plays.
    Playing { since: MonotonicNs },
    /// Waiting for the mechanism to be let go.
    AwaitingRelease,
    /// Filming what follows the profile or the release.
    Filming { until: MonotonicNs },
    /// Over; nothing changes any more.
    Stopped,
}

/// More identical images in a row than this, while a profile plays, mean a frozen camera; chosen.
const MAX_IDENTICAL_IMAGES: u32 = 5;
/// How much later than planned the board may report start and end of the profile before that is a fault \[s\], chosen.
const BOARD_REPORT_DELAY_LIMIT_S: f64 = 1.0;

/// The states of a run, from still water to the safe stop.
#[derive(Debug)]
pub struct Machine {
    plan: Plan,
    phase: Phase,
    began: MonotonicNs,
    /// When motion began.
    moves_since: Option<MonotonicNs>,
    identical: u32,
    last_change: f64,
}

impl Plan {
    /// How long motion is filmed \[s\].
    pub fn motion_s(&self) -> f64 {
        self.profile_s + self.film_s
    }
}

impl Machine {
    /// A run that begins to wait for stillness at `now`.
    pub fn new(plan: Plan, now: MonotonicNs) -> Self {
        Self {
            plan,
            phase: Phase::Settling { still_since: None },
            began: now,
            moves_since: None,
            identical: 0,
            last_change: 1.0,
        }
    }

    /// Time since the motion began \[s\]; `None` before it.
    pub fn moves_for_s(&self, now: MonotonicNs) -> Option<f64> {
        self.moves_since.map(|since| now.seconds_since(since)).filter(|moves_s| *moves_s >= 0.0)
    }

    /// The present phase in a word, for progress.
    pub fn phase(&self) -> &'static str {
        match self.phase {
            Phase::Settling { .. } => "waiting for still water",
            Phase::Armed { .. } => "armed",
            Phase::Playing { .. } => "driving",
            Phase::AwaitingRelease => "waiting for the release",
            Phase::Filming { .. } => "filming",
            Phase::Stopped => "stopped",
        }
    }

    /// Takes in `event` at `now`; returns what to do. After a [`Action::Stop`] nothing more comes.
    pub fn on(&mut self, event: Event, now: MonotonicNs) -> Option<Action> {
        if self.phase == Phase::Stopped {
            return None;
        }
        match event {
            Event::Fault(reason) => return self.stop(Ending::Fail(reason)),
            Event::Interrupted(why) => return self.stop(Ending::Abort(why)),
            Event::Image { identical } => self.identical = if identical { self.identical + 1 } else { 0 },
            Event::Changed(share) => self.last_change = share,
            Event::Started | Event::Finished | Event::Tick => {}
        }
        if self.moving() && self.identical > MAX_IDENTICAL_IMAGES {
            return self.stop(Ending::Fail(format!(
                "camera: {} identical images in a row while the mechanism moves: the picture is frozen",
                self.identical
            )));
        }
        match self.phase {
            Phase::Settling { still_since } => self.settle(still_since, &event, now),
            Phase::Armed { start } if event == Event::Started => {
                self.phase = Phase::Playing { since: start };
                self.moves_since = Some(start);
                Some(Action::Journal("profile-started"))
            }
            Phase::Armed { start } if now > start.plus_seconds(BOARD_REPORT_DELAY_LIMIT_S) => {
                self.stop(Ending::Fail("servo board: armed, but the profile did not start".into()))
            }
            Phase::Playing { .. } if event == Event::Finished => self.film("profile-finished", now),
            Phase::Playing { since }
                if now > since.plus_seconds(self.plan.profile_s + BOARD_REPORT_DELAY_LIMIT_S) =>
            {
                self.stop(Ending::Fail("servo board: the profile's end is overdue".into()))
            }
            Phase::AwaitingRelease => match event {
                Event::Changed(share) if share > self.plan.still_share => self.film("release-seen", now),
                _ if now > self.began.plus_seconds(self.plan.release_timeout_s) => {
                    self.stop(Ending::Abort(format!(
                        "no release seen within {} s ([run] release_timeout_s)",
                        self.plan.release_timeout_s
                    )))
                }
                _ => None,
            },
            Phase::Filming { until } if now >= until => self.stop(Ending::Success),
            _ => None,
        }
    }

    fn settle(
        &mut self,
        still_since: Option<MonotonicNs>,
        event: &Event,
        now: MonotonicNs,
    ) -> Option<Action> {
        if let Event::Changed(share) = event
            && now >= self.began.plus_seconds(self.plan.approach_s)
        {
            let still = *share <= self.plan.still_share;
            self.phase = Phase::Settling { still_since: still.then(|| still_since.unwrap_or(now)) };
        }
        match self.phase {
            Phase::Settling { still_since: Some(since) } if now >= since.plus_seconds(self.plan.settle_s) => {
                self.began = now;
                Some(match self.plan.kind {
                    MotionKind::Driven => {
                        let start = now.plus_seconds(self.plan.lead_s);
                        self.phase = Phase::Armed { start };
                        Action::Arm(start)
                    }
                    MotionKind::Drop => {
                        self.phase = Phase::AwaitingRelease;
                        Action::AskForRelease
                    }
                })
            }
            _ if now > self.began.plus_seconds(self.plan.approach_s + self.plan.release_timeout_s + self.plan.settle_s) => {
                self.stop(Ending::Fail(format!(
                    "the picture never was still for {} s: {:.3} % of it kept changing, {:.3} % are allowed ([run] still_share)",
                    self.plan.settle_s,
                    self.last_change * 100.0,
                    self.plan.still_share * 100.0
                )))
            }
            _ => None,
        }
    }

    fn film(&mut self, entry: &'static str, now: MonotonicNs) -> Option<Action> {
        self.phase = Phase::Filming { until: now.plus_seconds(self.plan.film_s) };
        self.moves_since.get_or_insert(now);
        Some(Action::Journal(entry))
    }

    fn stop(&mut self, ending: Ending) -> Option<Action> {
        self.phase = Phase::Stopped;
        Some(Action::Stop(ending))
    }

    fn moving(&self) -> bool {
        // A drop or the time after a profile may end at rest; only while a profile plays is motion certain.
        matches!(self.phase, Phase::Playing { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(kind: MotionKind) -> Plan {
        Plan {
            kind,
            approach_s: 0.0,
            settle_s: 0.5,
            film_s: 1.0,
            profile_s: 3.0,
            lead_s: 0.3,
            release_timeout_s: 10.0,
            still_share: 1e-3,
        }
    }

    fn at(seconds: f64) -> MonotonicNs {
        MonotonicNs(0).plus_seconds(seconds)
    }

    fn driven_until_playing() -> Machine {
        let mut machine = Machine::new(plan(MotionKind::Driven), at(0.0));
        assert_eq!(machine.on(Event::Changed(0.0), at(0.1)), None);
        assert_eq!(machine.on(Event::Tick, at(0.6)), Some(Action::Arm(at(0.9))));
        assert_eq!(machine.on(Event::Started, at(0.91)), Some(Action::Journal("profile-started")));
        machine
    }

    #[test]
    fn driven_run_settles_arms_plays_films_on_and_succeeds() {
        let mut machine = driven_until_playing();
        assert_eq!(machine.moves_for_s(at(0.8)), None, "armed for 0.9 s");
        assert!((machine.moves_for_s(at(2.9)).unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(machine.on(Event::Finished, at(3.9)), Some(Action::Journal("profile-finished")));
        assert!((machine.moves_for_s(at(3.9)).unwrap() - 3.0).abs() < 1e-9, "still");
        assert_eq!(machine.on(Event::Tick, at(4.8)), None);
        assert_eq!(machine.on(Event::Tick, at(4.9)), Some(Action::Stop(Ending::Success)));
        assert_eq!(machine.on(Event::Fault("late".into()), at(5.0)), None);
    }

    #[test]
    fn stillness_does_not_count_while_the_servo_approaches_its_start() {
        let mut machine = Machine::new(Plan { approach_s: 1.5, ..plan(MotionKind::Driven) }, at(0.0));
        machine.on(Event::Changed(0.0), at(0.1));
        assert_eq!(machine.on(Event::Tick, at(1.4)), None);
        machine.on(Event::Changed(0.0), at(1.6));
        assert_eq!(machine.on(Event::Tick, at(2.0)), None);
        assert_eq!(machine.on(Event::Tick, at(2.1)), Some(Action::Arm(at(2.4))));
    }

    #[test]
    fn motion_restarts_the_wait_for_stillness() {
        let mut machine = Machine::new(plan(MotionKind::Drop), at(0.0));
        machine.on(Event::Changed(0.0), at(0.1));
        machine.on(Event::Changed(0.5), at(0.4));
        machine.on(Event::Changed(0.0), at(0.5));
        assert_eq!(machine.on(Event::Tick, at(0.9)), None);
        assert_eq!(machine.on(Event::Tick, at(1.0)), Some(Action::AskForRelease));
        assert_eq!(machine.on(Event::Changed(0.01), at(3.0)), Some(Action::Journal("release-seen")));
        assert_eq!(machine.on(Event::Tick, at(4.0)), Some(Action::Stop(Ending::Success)));
    }

    #[test]
    fn every_phase_stops_on_a_fault_and_on_an_interrupt() {
        type Start = fn() -> Machine;
        let starts: [Start; 3] = [
            || Machine::new(plan(MotionKind::Driven), at(0.0)),
            driven_until_playing,
            || {
                let mut machine = driven_until_playing();
                machine.on(Event::Finished, at(3.9));
                machine
            },
        ];
        for start in starts {
            let fault = start().on(Event::Fault("gone".into()), at(4.0));
            assert_eq!(fault, Some(Action::Stop(Ending::Fail("gone".into()))));
            let interrupt = start().on(Event::Interrupted("interrupted".into()), at(4.0));
            assert_eq!(interrupt, Some(Action::Stop(Ending::Abort("interrupted".into()))));
        }
    }

    #[test]
    fn frozen_picture_while_driving_is_a_fault() {
        let mut machine = driven_until_playing();
        let mut ended = None;
        for k in 0..=MAX_IDENTICAL_IMAGES {
            assert_eq!(ended, None);
            ended = machine.on(Event::Image { identical: true }, at(1.0 + 0.01 * f64::from(k)));
        }
        assert!(matches!(ended, Some(Action::Stop(Ending::Fail(reason))) if reason.contains("frozen")));
    }

    #[test]
    fn board_that_never_starts_or_never_ends_is_a_fault() {
        let mut machine = driven_until_playing();
        let overdue = machine.on(Event::Tick, at(0.9 + 3.0 + BOARD_REPORT_DELAY_LIMIT_S + 0.1));
        assert!(matches!(overdue, Some(Action::Stop(Ending::Fail(reason))) if reason.contains("overdue")));
        let mut machine = Machine::new(plan(MotionKind::Driven), at(0.0));
        machine.on(Event::Changed(0.0), at(0.1));
        machine.on(Event::Tick, at(0.6));
        let silent = machine.on(Event::Tick, at(2.0));
        assert!(
            matches!(silent, Some(Action::Stop(Ending::Fail(reason))) if reason.contains("did not start"))
        );
    }

    #[test]
    fn patience_with_hand_and_water_ends() {
        let mut machine = Machine::new(plan(MotionKind::Drop), at(0.0));
        machine.on(Event::Changed(0.0), at(0.0));
        assert_eq!(machine.on(Event::Tick, at(0.5)), Some(Action::AskForRelease));
        assert!(matches!(machine.on(Event::Tick, at(11.0)), Some(Action::Stop(Ending::Abort(_)))));
        let mut machine = Machine::new(plan(MotionKind::Driven), at(0.0));
        machine.on(Event::Changed(0.2), at(5.0));
        let restless = machine.on(Event::Tick, at(10.6));
        assert!(matches!(restless, Some(Action::Stop(Ending::Fail(reason))) if reason.contains("20.000 %")));
    }
}
