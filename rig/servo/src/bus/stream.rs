//! The commanded position of each servo at any instant, and whether the servo follows it. No bus and no clock here: instants are handed in.
//!
//! Servos on a bus cannot be given a profile to play: this computer sends them a position again and again, and each holds the last one
//! until the next. What is sent at an instant is the profile half a period later, so that its mean over the period is that of the profile.

use crate::pulses::{PulseProfile, PulseTrack};
use crate::travel::{COUNTS_PER_RAD, CountTravel};
use crate::{ServoError, ServoEvent};
use ground::clock::MonotonicNs;

/// A servo further from its commanded position than `max_error_rad` for this long is a fault \[s\], chosen.
const FOLLOWING_ERROR_TIMEOUT_S: f64 = 0.1;
/// Least time from arming to the start of a profile \[s\], chosen: for torque on, limits read and a few late answers.
pub(super) const MIN_START_LEAD_S: f64 = 0.05;

/// Straight lines from count to count.
#[derive(Debug, Clone)]
struct Path {
    start: MonotonicNs,
    /// Time from the start \[µs\] and count.
    corners: Vec<(u64, u16)>,
}

impl Path {
    fn count(&self, at: MonotonicNs) -> f64 {
        let us = at.seconds_since(self.start) * 1e6;
        let next = self.corners.partition_point(|&(corner, _)| corner as f64 <= us);
        match (next.checked_sub(1).and_then(|before| self.corners.get(before)), self.corners.get(next)) {
            (Some(&(t0, c0)), Some(&(t1, c1))) => {
                f64::from(c0) + (f64::from(c1) - f64::from(c0)) * (us - t0 as f64) / (t1 - t0) as f64
            }
            (Some(&(_, count)), None) | (None, Some(&(_, count))) => f64::from(count),
            (None, None) => 0.0,
        }
    }

    fn end(&self) -> MonotonicNs {
        self.start.plus_seconds(self.corners.last().map_or(0, |&(us, _)| us) as f64 * 1e-6)
    }
}

/// One servo, its limits and the path that it is to follow.
#[derive(Debug, Clone)]
struct Course {
    id: u8,
    name: String,
    travel: CountTravel,
    /// `None` until a position was commanded.
    path: Option<Path>,
    off_path_since: Option<MonotonicNs>,
}

/// A profile under way: when it starts and ends, and whether its start was reported.
#[derive(Debug, Clone)]
struct Armed {
    start: MonotonicNs,
    end: MonotonicNs,
    started: bool,
}

/// The positions streamed to a bus: computes each at its instant, and judges whether the servo follows.
#[derive(Debug, Clone)]
pub(super) struct Stream {
    courses: Vec<Course>,
    armed: Option<Armed>,
    period_s: f64,
}

fn refused(request: &str, why: String) -> ServoError {
    ServoError::Refused { request: request.into(), why }
}

impl Stream {
    /// A stream without commands yet, for servos given as ID, name and travel.
    pub(super) fn new(servos: impl IntoIterator<Item = (u8, String, CountTravel)>, period_s: f64) -> Self {
        let course = |(id, name, travel)| Course { id, name, travel, path: None, off_path_since: None };
        Self { courses: servos.into_iter().map(course).collect(), armed: None, period_s }
    }

    /// Holds the servo with the ID `id` at `count`, until another command.
    pub(super) fn hold_at(&mut self, id: u8, count: u16, now: MonotonicNs) {
        for course in self.courses.iter_mut().filter(|course| course.id == id) {
            course.path = Some(Path { start: now, corners: vec![(0, count)] });
            course.off_path_since = None;
        }
    }

    /// Drops all paths and the armed profile.
    pub(super) fn clear(&mut self) {
        self.armed = None;
        self.courses.iter_mut().for_each(|course| (course.path, course.off_path_since) = (None, None));
    }

    /// Whether a profile or a move is under way at `now`.
    pub(super) fn moves(&self, now: MonotonicNs) -> bool {
        self.armed.is_some()
            || self.courses.iter().any(|c| c.path.as_ref().is_some_and(|path| path.end() > now))
    }

    /// The position to send to each servo at `now`: ID and \[counts\].
    pub(super) fn goals(&self, now: MonotonicNs) -> Vec<(u8, u16)> {
        let at = now.plus_seconds(self.period_s / 2.0);
        let goal = |course: &Course| {
            let count = course.path.as_ref()?.count(at).round();
            let (min, max) = (course.travel.min_count, course.travel.max_count);
            Some((course.id, (count as u16).clamp(min, max)))
        };
        self.courses.iter().filter_map(goal).collect()
    }

    fn course(&mut self, id: u8, request: &str) -> Result<&mut Course, ServoError> {
        let known = self.courses.iter().map(|course| course.id.to_string()).collect::<Vec<_>>().join(", ");
        let why = format!("no servo with ID {id} in the config; there are {known}");
        self.courses.iter_mut().find(|course| course.id == id).ok_or_else(|| refused(request, why))
    }

    /// Moves a servo from its commanded position to `count` over `duration_s`.
    ///
    /// # Errors
    /// [`ServoError::Refused`] naming the limit; nothing changes then.
    pub(super) fn jog(
        &mut self,
        id: u8,
        count: u16,
        duration_s: f64,
        now: MonotonicNs,
    ) -> Result<(), ServoError> {
        const REQUEST: &str = "jog";
        if self.armed.is_some() {
            return Err(refused(
                REQUEST,
                "a profile is armed or playing; wait for its end or stop it".into(),
            ));
        }
        let course = self.course(id, REQUEST)?;
        if !duration_s.is_finite() || !(0.0..=4294.0).contains(&duration_s) {
            return Err(refused(REQUEST, format!("{duration_s} s is no duration between 0 and 4294 s")));
        }
        let from = course.path.as_ref().map(|path| path.count(now).round() as u16);
        let from =
            from.ok_or_else(|| refused(REQUEST, format!("where servo {id} stands is not known yet")))?;
        let corners = vec![(0, from), ((duration_s * 1e6).round().max(1.0) as u64, count)];
        course.check_limits(&corners, REQUEST)?;
        course.path = Some(Path { start: now, corners });
        course.off_path_since = None;
        Ok(())
    }

    /// Takes up a profile that starts at `start`.
    ///
    /// # Errors
    /// [`ServoError::Refused`] naming the limit; nothing changes then.
    pub(super) fn arm(
        &mut self,
        profile: &PulseProfile,
        start: MonotonicNs,
        now: MonotonicNs,
    ) -> Result<(), ServoError> {
        const REQUEST: &str = "arming";
        if self.armed.is_some() {
            return Err(refused(
                REQUEST,
                "a profile is armed or playing; wait for its end or stop it".into(),
            ));
        }
        let ahead_s = start.seconds_since(now);
        if ahead_s < MIN_START_LEAD_S {
            let (ahead_ms, least_ms) = (ahead_s * 1e3, MIN_START_LEAD_S * 1e3);
            return Err(refused(
                REQUEST,
                format!("its start is {ahead_ms:.0} ms ahead, at least {least_ms:.0} ms wanted; start later"),
            ));
        }
        for PulseTrack { channel, start_pulse, .. } in &profile.tracks {
            let course = self.course(*channel, REQUEST)?;
            let path = course.path.as_ref().filter(|path| path.end() <= now);
            let commanded = path.map(|path| path.count(now).round() as u16);
            if commanded != Some(*start_pulse) {
                let at = commanded.map_or("on its way".into(), |count| format!("commanded to {count}"));
                return Err(refused(
                    REQUEST,
                    format!("servo {channel} is {at}, wanted {start_pulse} counts; jog it there first"),
                ));
            }
        }
        let tracks: Vec<(u8, Vec<_>)> =
            profile.tracks.iter().map(|track| (track.channel, track.corners().collect())).collect();
        for (id, corners) in &tracks {
            self.course(*id, REQUEST)?.check_limits(corners, REQUEST)?;
        }
        for (id, corners) in tracks {
            self.course(id, REQUEST)?.path = Some(Path { start, corners });
        }
        let end = start.plus_seconds(profile.duration_us() as f64 * 1e-6);
        self.armed = Some(Armed { start, end, started: false });
        Ok(())
    }

    /// Advances to `now`; returns what has begun or ended by then.
    pub(super) fn advance(&mut self, now: MonotonicNs) -> Vec<ServoEvent> {
        let mut events = Vec::new();
        if let Some(armed) = &mut self.armed {
            if !armed.started && now >= armed.start {
                armed.started = true;
                events.push(ServoEvent::Started { board_tick_us: armed.start.0 / 1000 });
            }
            if now >= armed.end {
                events.push(ServoEvent::Finished { board_tick_us: armed.end.0 / 1000 });
                self.armed = None;
            }
        }
        events
    }

    /// Takes in that a servo was measured at `count` at about `at`. The fault in words, where it has been too far off its path for too long.
    pub(super) fn following_fault(&mut self, id: u8, count: i32, at: MonotonicNs) -> Option<String> {
        let course = self.courses.iter_mut().find(|course| course.id == id)?;
        let error_rad = (f64::from(count) - course.path.as_ref()?.count(at)).abs() / COUNTS_PER_RAD;
        let limit_rad = course.travel.max_error_rad.get();
        if error_rad <= limit_rad {
            course.off_path_since = None;
            return None;
        }
        let since = *course.off_path_since.get_or_insert(at);
        (at.seconds_since(since) >= FOLLOWING_ERROR_TIMEOUT_S).then(|| {
            format!(
                "servo {id} (`{}`) has been further from its commanded position than max_error_rad = {limit_rad} for {:.0} ms, now \
                 {error_rad:.3} rad: blocked, overloaded, or too slow for this motion",
                course.name,
                at.seconds_since(since) * 1e3
            )
        })
    }

    /// Begins to take each of these servos to its park position, no faster than it may; how long that takes \[s\].
    pub(super) fn park(&mut self, ids: &[u8], now: MonotonicNs) -> f64 {
        let mut longest_s: f64 = 0.0;
        self.armed = None;
        for course in self.courses.iter_mut().filter(|course| ids.contains(&course.id)) {
            let Some(from) = course.path.as_ref().map(|path| path.count(now).round() as u16) else {
                continue;
            };
            let to = course.travel.park_count.unwrap_or(course.travel.zero_count);
            let rate = course.travel.max_rate_rad_per_s.get() * COUNTS_PER_RAD;
            let duration_s = f64::from(from.abs_diff(to)) / rate;
            longest_s = longest_s.max(duration_s);
            let corners = vec![(0, from), ((duration_s * 1e6).ceil().max(1.0) as u64, to)];
            course.path = Some(Path { start: now, corners });
        }
        longest_s
    }
}

impl Course {
    fn check_limits(&self, corners: &[(u64, u16)], request: &str) -> Result<(), ServoError> {
        let range = self.travel.min_count..=self.travel.max_count;
        let outside = corners.iter().skip(1).find(|(_, count)| !range.contains(count));
        if let Some((_, count)) = outside {
            let (min, max) = range.into_inner();
            return Err(refused(
                request,
                format!(
                    "servo {} (`{}`): {count} counts are outside its limits {min} to {max}; ask for less or change the limits",
                    self.id, self.name
                ),
            ));
        }
        let limit = self.travel.max_rate_rad_per_s.get();
        for pair in corners.windows(2) {
            let ((t0, c0), (t1, c1)) = (pair[0], pair[1]);
            let rate = f64::from(c0.abs_diff(c1)) / COUNTS_PER_RAD / ((t1 - t0).max(1) as f64 * 1e-6);
            // A count more or less is rounding.
            let rounding = 1.0 / COUNTS_PER_RAD / ((t1 - t0).max(1) as f64 * 1e-6);
            if rate > limit + rounding {
                return Err(refused(
                    request,
                    format!(
                        "servo {} (`{}`): {rate:.2} rad/s are above max_rate_rad_per_s = {limit}; take longer or raise it",
                        self.id, self.name
                    ),
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{BUS, parse};
    use crate::travel::Travel;

    fn at(seconds: f64) -> MonotonicNs {
        MonotonicNs(1_000_000_000).plus_seconds(seconds)
    }

    fn stream() -> Stream {
        let channel = parse(BUS).unwrap().channels.remove(0);
        let Travel::Counts(travel) = channel.travel else { panic!("on a bus") };
        let mut stream = Stream::new([(channel.id, channel.name, travel)], 0.01);
        stream.hold_at(1, 2048, at(0.0));
        stream
    }

    fn profile(segments: &[(u32, u16)]) -> PulseProfile {
        PulseProfile {
            tracks: vec![PulseTrack { channel: 1, start_pulse: 2048, segments: segments.to_vec() }],
        }
    }

    fn why(result: Result<(), ServoError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn goals_are_the_profile_in_the_mean_over_the_period_they_are_held() {
        let mut stream = stream();
        let strokes = [(100_000, 2148), (100_000, 1948), (100_000, 2048)];
        stream.arm(&profile(&strokes), at(0.1), at(0.0)).unwrap();
        assert_eq!(stream.goals(at(0.0)), [(1, 2048)]);
        // 1 count/ms up: from 0.15 to 0.16 s the profile passes 2098 to 2108.
        assert_eq!(stream.goals(at(0.15)), [(1, 2103)]);
        assert_eq!(stream.goals(at(0.25)), [(1, 2038)]);
        assert_eq!(stream.goals(at(9.0)), [(1, 2048)]);
        assert!(stream.advance(at(0.09)).is_empty());
        let tick = at(0.1).0 / 1000;
        assert_eq!(stream.advance(at(0.101)), [ServoEvent::Started { board_tick_us: tick }]);
        assert!(stream.moves(at(0.2)));
        assert_eq!(stream.advance(at(0.41)), [ServoEvent::Finished { board_tick_us: tick + 300_000 }]);
        assert!(!stream.moves(at(0.42)));
    }

    #[test]
    fn what_the_limits_forbid_is_refused_with_the_limit_and_changes_nothing() {
        let mut stream = stream();
        for (result, says) in [
            (stream.jog(1, 2701, 1.0, at(0.0)), "2701 counts are outside its limits 1400 to 2700"),
            (stream.jog(1, 2600, 0.1, at(0.0)), "8.47 rad/s are above max_rate_rad_per_s = 6"),
            (stream.jog(1, 2600, f64::NAN, at(0.0)), "no duration"),
            (stream.jog(7, 2600, 1.0, at(0.0)), "no servo with ID 7 in the config; there are 1"),
            (stream.arm(&profile(&[(100_000, 2800)]), at(1.0), at(0.0)), "outside its limits"),
            (stream.arm(&profile(&[(10_000, 2200)]), at(1.0), at(0.0)), "above max_rate_rad_per_s"),
            (
                stream.arm(&profile(&[(100_000, 2100)]), at(0.01), at(0.0)),
                "10 ms ahead, at least 50 ms wanted",
            ),
        ] {
            let message = why(result);
            assert!(message.contains(says), "{message}");
        }
        assert_eq!(stream.goals(at(1.0)), [(1, 2048)]);
        stream.jog(1, 2100, 0.5, at(1.0)).unwrap();
        let message = why(stream.arm(&profile(&[(100_000, 2100)]), at(2.0), at(1.2)));
        assert!(message.contains("servo 1 is on its way, wanted 2048 counts"), "{message}");
        let message = why(stream.arm(&profile(&[(100_000, 2100)]), at(2.0), at(1.6)));
        assert!(message.contains("commanded to 2100, wanted 2048"), "{message}");
    }

    #[test]
    fn servo_that_does_not_follow_is_reported_after_a_tenth_of_a_second() {
        let mut stream = stream();
        stream.jog(1, 2448, 0.5, at(0.0)).unwrap();
        assert_eq!(stream.following_fault(1, 2048, at(0.1)), None, "80 counts behind: 0.12 rad");
        assert_eq!(stream.following_fault(1, 2048, at(0.2)), None, "0.25 rad, but only now");
        assert_eq!(stream.following_fault(1, 2048, at(0.29)), None);
        let fault = stream.following_fault(1, 2048, at(0.31)).unwrap();
        assert!(
            fault.contains("servo 1 (`base`)") && fault.contains("max_error_rad = 0.2 for 110 ms"),
            "{fault}"
        );
        let mut recovers = self::stream();
        recovers.following_fault(1, 2448, at(0.0));
        recovers.following_fault(1, 2048, at(0.05));
        assert_eq!(recovers.following_fault(1, 2448, at(0.15)), None);
    }

    #[test]
    fn parking_is_no_faster_than_the_servo_may() {
        let mut stream = stream();
        stream.jog(1, 2448, 0.5, at(0.0)).unwrap();
        let takes_s = stream.park(&[1], at(0.5));
        assert!((takes_s - 400.0 / COUNTS_PER_RAD / 6.0).abs() < 1e-9, "{takes_s}");
        assert_eq!(stream.goals(at(0.5 + takes_s)), [(1, 2048)]);
        assert!(stream.goals(at(0.5 + takes_s / 2.0))[0].1.abs_diff(2248) < 25);
    }
}
